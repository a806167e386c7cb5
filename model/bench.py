"""What generation and training cost on this machine, for the project's benchmark."""

import os
import resource
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from model.data.prepared import Clip, PreparedData
from model.data.recordings import NUM_FACE_UNITS
from model.generation.base import System
from model.generation.windows import GenerateOptions, generate_motion
from model.speech.audio import Speech
from model.systems.registry import family_of
from model.training.parallel import WHOLE
from model.training.task import Workshop

WARM_STEPS = 2
BATCH = 64
_FRAMES = 600
SPEECH_DIMS = {"mel64": 68, "wavlm": 1024}


def generation_ms(system: System, speech: Speech, steps: int, samples: int = 1) -> float:
    """Milliseconds for each frame of each sample, speech features included."""
    options = GenerateOptions(next(iter(system.speakers)), steps=steps, samples=samples)
    started = time.perf_counter()
    generate_motion(system, speech, options)
    return 1e3 * (time.perf_counter() - started) / (speech.num_frames * samples)


def official_cost(seconds: float = 10.0) -> tuple[float, float]:
    """Milliseconds a frame of the authors' system with random weights of its size, from files as
    their script saves them, speech features not counted; and the most memory of this process, GB.
    """
    from model.systems.official import FAMILY
    from model.systems.official.checkpoint import make_network
    from model.systems.official.sizes import SPEECH_DIM, WINDOW_FRAMES
    from model.systems.official.speech import STEP_SAMPLES

    speech = Speech(np.zeros(round(16_000 * seconds), np.float32), sha256="")
    windows = 1 + -(-(speech.num_frames - WINDOW_FRAMES) // (STEP_SAMPLES * 30 // 16_000))
    with tempfile.TemporaryDirectory(prefix="official-") as name:
        folder = Path(name)
        torch.save(make_network("motion").state_dict(), folder / "epoch_19")
        torch.save(make_network("expression").state_dict(), folder / "speech.pt")
        rng = np.random.default_rng(0)
        features = rng.standard_normal((windows, WINDOW_FRAMES, SPEECH_DIM)).astype(np.float32)
        np.save(folder / "features.npy", features)
        named = {"OFFICIAL_DIR": name, "OFFICIAL_FEATURES": str(folder / "features.npy")}
        with patched(named):
            system = FAMILY.load(FAMILY.systems[0], folder)
        each = generation_ms(system, speech, system.samplers[0].steps)
    return each, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9


@contextmanager
def patched(variables: Mapping[str, str]) -> Iterator[None]:
    """With variables of the environment, for a while."""
    before = dict(os.environ)
    os.environ.update(variables)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


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
        task = family.make_task(config, data, Workshop(helpers, None, shard, may_compile=fast))
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
