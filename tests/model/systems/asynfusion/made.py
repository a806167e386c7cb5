"""AsynFusion with random tiny weights, and what it is asked with."""

from pathlib import Path

import torch
from torch import Tensor

from model.motion.spaces import AXIS_ANGLE_MOTION_DIM
from model.systems.asynfusion.config import DDIM, LCM_SYNC, AsynFusionTrainConfig, DualBranchConfig
from model.systems.asynfusion.network import BranchStatistics, DualBranchNetwork, Pair, face_tensors
from tests.model.made import made_components, made_prior, save_made, shaken

FACE, BODY = 52, AXIS_ANGLE_MOTION_DIM


TINY = DualBranchConfig(width=16, num_blocks=2, num_heads=2, num_speakers=4, speech_context=6)


def tiny_network(*, consistent: bool = False) -> DualBranchNetwork:
    """Its layers say something: those that begin at zero are moved away from it."""
    streams = made_streams()
    torch.manual_seed(0)
    network = DualBranchNetwork(TINY, streams, consistent=consistent)
    return shaken(network, by=0.1).requires_grad_(False)


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


def made_streams() -> tuple[BranchStatistics, BranchStatistics]:
    """A calm face, and a body that stands upright at 1.2 m."""
    face = made_components(torch.full((FACE,), 0.3), 0.1)
    mean = torch.zeros(BODY)
    mean[-2] = 1.2
    return BranchStatistics(face, made_prior(FACE)), BranchStatistics(
        made_components(mean, 0.05), made_prior(BODY)
    )


def make_asynfusion(folder: Path, speech_dropout: float = 0.1) -> Path:
    """Weights of the teacher and of the student."""
    face, body = made_streams()
    for name, aim in ((DDIM, "noise"), (LCM_SYNC, "teacher")):
        config = AsynFusionTrainConfig(
            system=name, network=TINY, aim=aim, speech_dropout=speech_dropout
        )
        save_made(folder, config, tiny_network(), body.tensors() | face_tensors(face))
    return folder
