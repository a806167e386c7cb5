"""Small made data and small real networks, for tests of everything that loads or trains them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from model.checkpoint import save_weights
from model.config import ExpressionConfig, NetworkConfig, TrainConfig, to_json
from model.expression import ExpressionNetwork
from model.motion import save_motion
from model.network import MotionNetwork
from model.packing import MOTION_DIM
from model.speech.audio import Speech, write_wav
from tests.helpers import smooth_motion_example

TINY_NETWORK = NetworkConfig(width=16, num_blocks=1, num_heads=2, num_speakers=4)
TINY_EXPRESSION = ExpressionConfig(width=16, num_layers=1, num_heads=2, num_speakers=4)


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


def make_weights(folder: Path) -> Path:
    """Both systems and the expression network with random tiny weights and complete cards."""
    torch.manual_seed(0)
    common = {"speakers": {"ann": 1, "bob": 2}, "steps": 0, "training_data": "none", "date": "-"}
    expression = ExpressionNetwork(TINY_EXPRESSION)
    config = TrainConfig(system="expression", expression=TINY_EXPRESSION, network=TINY_NETWORK)
    tensors = {f"network.{k}": v for k, v in expression.state_dict().items()}
    save_weights(folder, "expression", tensors, {"config": json.loads(to_json(config)), **common})
    for system, space in (("globaldiff/local", "local"), ("globaldiff/global", "global")):
        network_config = replace(TINY_NETWORK, rotation_space=space)
        network = MotionNetwork(network_config)
        with torch.no_grad():
            for parameter in network.parameters():  # outputs and FiLM layers start at zero
                parameter += 0.05 * torch.randn_like(parameter)
        mean = torch.zeros(MOTION_DIM)
        mean[0:330:6] = mean[4:330:6] = 1.0  # the identity rotation
        mean[331] = 1.2
        tensors = {f"network.{k}": v for k, v in network.state_dict().items()}
        tensors |= {"normaliser.mean": mean, "normaliser.std": torch.full((MOTION_DIM,), 0.1)}
        config = TrainConfig(system=system, network=network_config, expression=TINY_EXPRESSION)
        save_weights(folder, system, tensors, {"config": json.loads(to_json(config)), **common})
    return folder
