"""What generation and training cost on this machine, for the project's benchmark."""

import time
from pathlib import Path

import numpy as np
import torch

from model.config import TrainConfig
from model.data import Clip, PreparedData
from model.generate import GenerateOptions, generate_motion
from model.ladder import named_config
from model.parallel import WHOLE
from model.recordings import NUM_FACE_UNITS
from model.speech.audio import Speech
from model.systems import System
from model.tasks import make_task

WARM_STEPS = 2
_FRAMES = 600


def generation_ms(system: System, speech: Speech, steps: int, samples: int = 1) -> float:
    """Milliseconds for each frame of each sample, speech features included."""
    options = GenerateOptions(next(iter(system.speakers)), steps=steps, samples=samples)
    started = time.perf_counter()
    generate_motion(system, speech, options)
    return 1e3 * (time.perf_counter() - started) / (speech.num_frames * samples)


def training_rate(system: str, helpers: Path, num_steps: int = 8) -> float:
    """Windows a second in training a system of the ladder at the bundled size, in one process.

    The data is made up: only its shape costs time.

    Args:
        helpers: folder of the expression network, and of L_m's encoder where the system needs it.

    Raises:
        CheckpointError: if one of them is missing.
    """
    config = named_config("demo", system)
    data = _made_up_data(config)
    task = make_task(config, data, helpers)
    network = task.network.train()
    average = torch.optim.swa_utils.AveragedModel(network)
    optimizer = torch.optim.AdamW(network.parameters(), lr=config.learning_rate, fused=True)
    started = 0.0
    for step in range(WARM_STEPS + num_steps):
        if step == WARM_STEPS:
            started = time.perf_counter()
        batch = data.window_batch(
            data.clips, config.network.window_frames, config.batch_size, np.random.default_rng(step)
        )
        loss = task.step_loss(network, batch, torch.Generator().manual_seed(step), WHOLE)
        optimizer.zero_grad(set_to_none=True)
        loss.total.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), config.clip_norm)
        optimizer.step()
        average.update_parameters(network)
    return num_steps * config.batch_size / (time.perf_counter() - started)


def _made_up_data(config: TrainConfig) -> PreparedData:
    rng = np.random.default_rng(0)

    def noise(columns: int, spread: float) -> np.ndarray:
        return rng.normal(0, spread, (_FRAMES, columns)).astype(np.float32)

    return PreparedData(
        clips=(Clip("1_made_0", 1, "train", 0, _FRAMES),),
        poses=noise(165, 0.1),
        transl=noise(3, 0.01),
        expression=noise(NUM_FACE_UNITS, 0.1),
        speech=noise(config.network.speech_dim, 1.0),
        speakers={1: "made"},
    )
