"""What training costs on this machine, for the project's benchmark."""

import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from model.data.prepared import Clip, PreparedData
from model.data.recordings import NUM_FACE_UNITS
from model.systems.registry import family_of
from model.training.parallel import WHOLE
from model.training.task import TaskSetup

WARM_STEPS = 2
BATCH = 64
_FRAMES = 600
SPEECH_DIMS = {"mel64": 68, "wavlm": 1024}


def training_rate(
    system: str, helpers: Path, config_name: str = "demo", *, fast: bool = True, num_steps: int = 8
) -> float:
    """Windows a second in training a system, in one process.

    The data is made up: only its shape costs time.

    Args:
        helpers: folder of networks that the system needs.
        config_name: whose size; a preset of its family.
        fast: with bf16 and compiled where this machine gains by them, as `model.train` does;
            otherwise in fp32 and not compiled.

    Raises:
        CheckpointError: if an encoder is missing.
    """
    family = family_of(system)
    config = replace(family.config(config_name, system), batch_size=BATCH)
    shard = replace(WHOLE, bf16=fast)
    with tempfile.TemporaryDirectory(prefix="training-rate-") as folder:
        data = _made_up_data(Path(folder), SPEECH_DIMS[config.encoder])
        task = family.make_task(config, data, TaskSetup(helpers, None, shard, may_compile=fast))
        started = 0.0
        for step in range(WARM_STEPS + num_steps):
            if step == WARM_STEPS:
                started = time.perf_counter()
            rng = np.random.default_rng(step)
            batch = data.window_batch(data.clips, task.window_frames, BATCH, rng)
            task.step(step, batch, torch.Generator().manual_seed(step))
        return num_steps * BATCH / (time.perf_counter() - started)


def _made_up_data(folder: Path, speech_dim: int) -> PreparedData:
    rng = np.random.default_rng(0)

    def noise(columns: int, spread: float) -> np.ndarray:
        return rng.normal(0, spread, (_FRAMES, columns)).astype(np.float32)

    return PreparedData(
        folder,
        folder,
        clips=(Clip("1_made_0", 1, "train", 0, _FRAMES),),
        poses=noise(165, 0.1),
        transl=noise(3, 0.01),
        expression=noise(NUM_FACE_UNITS, 0.1),
        speech=noise(speech_dim, 1.0),
        speakers={1: "made"},
    )
