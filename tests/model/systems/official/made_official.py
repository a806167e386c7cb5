"""The authors' checkpoints as their training script leaves them, with weights by the rule."""

from collections import OrderedDict
from pathlib import Path

import numpy as np
import torch

from model.systems.official.checkpoints import SPEECH_DIM, WINDOW_FRAMES, OfficialNetwork
from model.systems.official.networks import make_network
from tests.model.systems.official.filled import fill, made

NAMES: dict[OfficialNetwork, str] = {
    "motion": "split/DiffusionDITNetPartsFixedExpressions2PostNorm_LL_split/epoch_999",
    "expression": "split/SimpleSpeechModel/best.pt",
}


def make_official(folder: Path) -> Path:
    """A folder of checkpoints, of the real size; rotations hardly move from those of the rest."""
    for part, name in NAMES.items():
        state = fill(make_network(part)).state_dict()
        if part == "motion":
            _calm(state)
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        torch.save(OrderedDict(state), path)
    return folder


def _calm(state: dict[str, torch.Tensor]) -> None:
    """Let the network's answer be near a body that stands, so that its motion can be shown."""
    from model.systems.official.checkpoints import BODY_CHANNELS, HAND_CHANNELS
    from model.systems.official.system import standing_seed_pose

    pose = standing_seed_pose()[0]
    for name, channels in (("hand", HAND_CHANNELS), ("body", BODY_CHANNELS)):
        state[f"{name}.weight"] *= 0.05
        state[f"{name}.bias"] = pose[list(channels)]


def make_features(path: Path, count: int) -> Path:
    """Prepared features of that many windows."""
    np.savez(path, features=made("features", (count, WINDOW_FRAMES, SPEECH_DIM)).numpy())
    return path
