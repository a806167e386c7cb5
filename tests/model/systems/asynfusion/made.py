"""AsynFusion with random tiny weights, and what it is asked with."""

from pathlib import Path

import torch
from torch import Tensor

from model.motion.spaces import AXIS_ANGLE_MOTION_DIM
from model.storage.checkpoint import save_weights
from model.systems.asynfusion.config import DDIM, LCM_SYNC, DualBranchConfig, Interaction
from model.systems.asynfusion.network import DualBranchNetwork, Pair
from model.systems.asynfusion.streams import Stream, face_tensors
from tests.model.made import made_components, made_prior

FACE, BODY = 52, AXIS_ANGLE_MOTION_DIM


def tiny_config(interaction: Interaction = "cross-attention") -> DualBranchConfig:
    return DualBranchConfig(
        width=16, num_blocks=2, num_heads=2, num_speakers=4, speech_context=6,
        interaction=interaction,
    )  # fmt: skip


def tiny_network(
    interaction: Interaction = "cross-attention", *, consistent: bool = False
) -> DualBranchNetwork:
    """Its layers say something: those that begin at zero are moved away from it."""
    torch.manual_seed(0)
    priors = made_prior(FACE), made_prior(BODY)
    network = DualBranchNetwork(tiny_config(interaction), priors, consistent=consistent)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(0.1 * torch.randn_like(parameter))
    return network.eval().requires_grad_(False)


def made_pair(size: int = 2, seed: int = 0) -> Pair:
    generator = torch.Generator().manual_seed(seed)
    return (
        torch.randn(size, 60, FACE, generator=generator),
        torch.randn(size, 60, BODY, generator=generator),
    )


def made_conditions(size: int = 2) -> dict[str, Tensor]:
    generator = torch.Generator().manual_seed(9)
    return {
        "speech": torch.randn(size, 72, 68, generator=generator),
        "speaker": torch.tensor([1, 2])[:size],
        "has_seed": torch.tensor([True, False])[:size],
        "has_speech": torch.ones(size, dtype=torch.bool),
    }


def made_streams() -> tuple[Stream, Stream]:
    """A calm face, and a body that stands upright at 1.2 m."""
    face = made_components(torch.full((FACE,), 0.3), 0.1)
    mean = torch.zeros(BODY)
    mean[-2] = 1.2
    return Stream(face, made_prior(FACE)), Stream(made_components(mean, 0.05), made_prior(BODY))


def make_asynfusion(folder: Path, speech_dropout: float = 0.1) -> Path:
    """Weights of the teacher and of the student."""
    face, body = made_streams()
    config = {
        "encoder": "mel64",
        "network": vars(tiny_config()),
        "speech_dropout": speech_dropout,
    }
    for name, aim in ((DDIM, "noise"), (LCM_SYNC, "teacher")):
        state = tiny_network().state_dict()
        tensors = {f"network.{key}": tensor for key, tensor in state.items()}
        tensors |= body.tensors() | face_tensors(face)
        card = {
            "config": config | {"aim": aim},
            "speakers": {"ann": 1, "bob": 2},
            "steps": 0,
            "training_data": "none",
            "date": "-",
        }
        save_weights(folder, name, tensors, card)
    return folder
