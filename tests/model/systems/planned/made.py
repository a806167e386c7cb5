"""A tiny planner and a tiny system that performs its plans, and annotated data to train them."""

from pathlib import Path

import torch

from model.motion.packing import Normaliser
from model.plan.kinds import KindTable
from model.systems.planned.config import (
    PLANNED,
    PLANNER,
    PlannedMotionTrainConfig,
    PlannedNetworkConfig,
    PlannerConfig,
    PlannerTrainConfig,
)
from model.systems.planned.network import PlannedNetwork, PlannerNetwork
from tests.model.made import (
    TINY_BEST,
    made_components,
    made_prior,
    make_data_folder,
    make_weights,
    save_made,
    shaken,
)
from tests.model.plan.made import HANDS, grid, made_plan

TINY_PLANNER = PlannerConfig(width=16, head_width=16, num_speakers=4, window_frames=60)
TINY_NETWORK = PlannedNetworkConfig(**vars(TINY_BEST))


def make_planned_weights(folder: Path) -> Path:
    """Random weights with complete cards, beside an expression network."""
    make_weights(folder, {})
    torch.manual_seed(1)
    kinds = KindTable.fit([(made_plan(), 1), (made_plan().at_speed(1.1), 2)], num_speakers=4)
    planner = PlannerNetwork(TINY_PLANNER)
    with torch.no_grad():
        for name, head in planner.heads.items():  # something begins now and then
            head.event_out.bias[0] = 2.0 if name in ("left", "right") else 4.0
    statistics = Normaliser(torch.zeros(68), torch.ones(68)).tensors() | kinds.to_tensors()
    statistics |= {"begins.goals": torch.tensor([[1.0, -1.5, 0.5]] * 2).repeat(4, 1, 1)}
    config = PlannerTrainConfig(system=PLANNER, planner=TINY_PLANNER)
    save_made(folder, config, planner, statistics)
    prior = made_prior(TINY_NETWORK.motion_dim)
    mean = torch.zeros(TINY_NETWORK.motion_dim)
    mean[-2] = 1.2
    network = shaken(PlannedNetwork(TINY_NETWORK, prior))
    statistics = made_components(mean, 0.1).tensors() | {"prior.covariance": prior.covariance}
    statistics |= {"kinds.names": kinds.to_tensors()["kinds.names"]}
    save_made(
        folder, PlannedMotionTrainConfig(system=PLANNED, network=TINY_NETWORK), network, statistics
    )
    return folder


def make_annotated_folder(folder: Path) -> Path:
    """Made recordings with the plan of three seconds beside each."""
    make_data_folder(folder)
    (folder / "textgrid").mkdir()
    for path in (folder / "wave16k").iterdir():
        (folder / "textgrid" / f"{path.stem}.TextGrid").write_text(grid(*HANDS))
    return folder
