"""What generation and training cost on this machine, for the project's benchmark."""

import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from model.data.prepared import Clip, PreparedData
from model.data.recordings import NUM_FACE_UNITS
from model.speech.audio import Speech
from model.storage.settings import TrainConfig
from model.systems.base import System
from model.systems.globaldiff.config import named_config
from model.systems.windows import GenerateOptions, generate_motion
from model.training.parallel import WHOLE
from model.training.rate import can_compile
from model.training.task import make_task

WARM_STEPS = 2
BATCH = 64
_FRAMES = 600


def generation_ms(system: System, speech: Speech, steps: int, samples: int = 1) -> float:
    """Milliseconds for each frame of each sample, speech features included."""
    options = GenerateOptions(next(iter(system.speakers)), steps=steps, samples=samples)
    started = time.perf_counter()
    generate_motion(system, speech, options)
    return 1e3 * (time.perf_counter() - started) / (speech.num_frames * samples)


def training_rate(
    system: str, helpers: Path, config_name: str = "demo", *, fast: bool = True, num_steps: int = 8
) -> float:
    """Windows a second in training a system of the ladder, in one process.

    The data is made up: only its shape costs time.

    Args:
        helpers: folder of L_m's encoder, where the system needs it.
        config_name: whose size; see `named_config`.
        fast: with bf16 and compiled where this machine gains by them, as `model.train` does;
            otherwise in fp32 and not compiled.

    Raises:
        CheckpointError: if an encoder is missing.
    """
    config = replace(named_config(config_name, system), batch_size=BATCH)
    shard = replace(WHOLE, bf16=fast)
    compile_step = fast and can_compile()
    with tempfile.TemporaryDirectory(prefix="training-rate-") as folder:
        data = _made_up_data(config, Path(folder))
        task = make_task(config, data, helpers, compile_step=compile_step)
        network = task.network.train()
        average = torch.optim.swa_utils.AveragedModel(network)
        if compile_step:
            network.compile(dynamic=False)
        optimizer = torch.optim.AdamW(network.parameters(), lr=config.learning_rate, fused=True)
        started = 0.0
        for step in range(WARM_STEPS + num_steps):
            if step == WARM_STEPS:
                started = time.perf_counter()
            batch = data.window_batch(
                data.clips, config.network.window_frames, BATCH, np.random.default_rng(step)
            )
            loss = task.step_loss(network, batch, torch.Generator().manual_seed(step), shard)
            optimizer.zero_grad(set_to_none=True)
            loss.total.backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), config.clip_norm)
            optimizer.step()
            average.update_parameters(network)
        return num_steps * BATCH / (time.perf_counter() - started)


def _made_up_data(config: TrainConfig, folder: Path) -> PreparedData:
    rng = np.random.default_rng(0)

    def noise(columns: int, spread: float) -> np.ndarray:
        return rng.normal(0, spread, (_FRAMES, columns)).astype(np.float32)

    return PreparedData(
        folder,
        clips=(Clip("1_made_0", 1, "train", 0, _FRAMES),),
        poses=noise(165, 0.1),
        transl=noise(3, 0.01),
        expression=noise(NUM_FACE_UNITS, 0.1),
        speech=noise(config.network.speech_dim, 1.0),
        speakers={1: "made"},
    )
