"""Small made data and small real networks, for tests of everything that loads or trains them."""

import copy
import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TypeVar

import numpy as np
import torch
from torch import Tensor, nn

from model.motion.motion import save_motion
from model.motion.packing import MOTION_DIM, Normaliser
from model.networks.branch import PriorResidualNetwork
from model.sampling.prior import GaussianPrior
from model.speech.audio import Speech, write_wav
from model.storage.cards import to_json
from model.storage.checkpoint import save_weights
from model.systems.face.config import ExpressionConfig, FaceTrainConfig
from model.systems.face.face import FaceNetwork
from model.systems.globaldiff.config import GlobalDiffTrainConfig, NetworkConfig
from model.systems.globaldiff.system import MotionNetwork
from model.training.config import TrainConfig
from tests.helpers import smooth_motion_example

TINY_NETWORK = NetworkConfig(width=16, num_blocks=1, num_heads=2, num_speakers=4)
TINY_EXPRESSION = ExpressionConfig(width=16, num_blocks=1, num_heads=2, num_speakers=4)


TINY_SYSTEMS = {
    "globaldiff/local": replace(TINY_NETWORK, rotation_space="local"),
    "globaldiff/global": TINY_NETWORK,
}
TINY_BEST = replace(TINY_NETWORK, rotation_space="axis-angle", speech_context=6, root="place")


def made_prior(channels: int, seed_frames: int = 8) -> GaussianPrior:
    """Components of different size that move on the scale of half a second (Matern 3/2)."""
    return copy.deepcopy(_prior(channels, seed_frames))


@cache
def _prior(channels: int, seed_frames: int) -> GaussianPrior:
    lag = (torch.arange(60)[:, None] - torch.arange(60)).abs() / 8.0
    fall = (1 + lag) * torch.exp(-lag)
    return GaussianPrior(torch.linspace(0.02, 2.0, channels)[:, None, None] * fall, seed_frames)


def made_components(mean: torch.Tensor, std: float) -> Normaliser:
    """Components that are channels in another order, each counted twice over."""
    mix = 2.0 * torch.eye(len(mean)).flip(0)
    return Normaliser(mean, torch.full_like(mean, std), mix, torch.linalg.inv(mix))


def made_waveform(num_samples: int, seed: int = 0) -> np.ndarray:
    """A buzz whose loudness comes and goes about three times a second."""
    rng = np.random.default_rng(seed)
    time = np.arange(num_samples) / 16_000
    buzz = np.sign(np.sin(2 * np.pi * 120 * time)) * (0.5 + 0.5 * np.sin(2 * np.pi * 3 * time))
    return (0.2 * buzz + 0.01 * rng.standard_normal(num_samples)).astype(np.float32)


def made_speech(num_samples: int) -> Speech:
    return Speech(waveform=made_waveform(num_samples), sha256="0" * 64, notes=())


def make_data_folder(folder: Path, seconds: float = 4.0) -> Path:
    """A folder in BEAT2's layout: two training clips and one each for validation and test."""
    for sub in ("smplxflame_30", "wave16k"):
        (folder / sub).mkdir(parents=True)
    rows = ["id,type"]
    speakers = ((1, "ann"), (2, "bob"), (1, "ann"), (3, "eve"))  # eve is never trained on
    for k, kind in enumerate(("train", "train", "val", "test")):
        name = "{}_{}_0_{k}_{k}".format(*speakers[k], k=k)
        save_motion(
            smooth_motion_example(round(30 * seconds), k), folder / "smplxflame_30" / f"{name}.npz"
        )
        write_wav(folder / "wave16k" / f"{name}.wav", made_waveform(round(16_000 * seconds), k))
        rows.append(f"{name},{kind}")
    (folder / "train_test_split.csv").write_text("\n".join(rows) + "\n")
    return folder


Network = TypeVar("Network", bound=nn.Module)


def shaken(network: Network, by: float = 0.05) -> Network:
    """Its weights moved, so that layers that begin at zero say something."""
    with torch.no_grad():
        for parameter in network.parameters():
            parameter += by * torch.randn_like(parameter)
    return network.eval()


def save_made(
    folder: Path, config: TrainConfig, network: nn.Module, statistics: dict[str, Tensor]
) -> None:
    """A network as trained weights, with a complete card."""
    tensors = {f"network.{name}": tensor for name, tensor in network.state_dict().items()}
    card = {"config": json.loads(to_json(config)), "speakers": {"ann": 1, "bob": 2}, "steps": 0}
    card |= {"training_data": "none", "date": "-"}
    save_weights(folder, config.system, tensors | statistics, card)


def make_weights(folder: Path, systems: dict[str, NetworkConfig] = TINY_SYSTEMS) -> Path:
    """Systems and the expression network with random tiny weights and complete cards."""
    torch.manual_seed(0)
    prior = made_prior(52)
    expression = FaceNetwork(TINY_EXPRESSION, prior)
    config = FaceTrainConfig(system="expression", expression=TINY_EXPRESSION)
    statistics = made_components(torch.full((52,), 0.2), 0.1).tensors()
    save_made(folder, config, expression, statistics | {"prior.covariance": prior.covariance})
    for system, network_config in systems.items():
        if network_config.has_prior:
            mean = torch.zeros(network_config.motion_dim)
            mean[-2] = 1.2
            normaliser = made_components(mean, 0.1)
            prior = made_prior(network_config.motion_dim)
            network = PriorResidualNetwork(
                network_config, prior, channels=network_config.motion_dim, expression_dim=52
            )
            more = {"prior.covariance": prior.covariance}
        else:
            mean = torch.zeros(MOTION_DIM)
            mean[0:330:6] = mean[4:330:6] = 1.0  # the identity rotation
            mean[331] = 1.2
            normaliser = Normaliser(mean, torch.full((MOTION_DIM,), 0.1))
            network, more = MotionNetwork(network_config), {}
        config = GlobalDiffTrainConfig(system=system, network=network_config)
        save_made(folder, config, shaken(network), normaliser.tensors() | more)
    return folder
