"""What the authors' system costs, measured with random weights of its size."""

import os
import resource
import tempfile
from pathlib import Path

import numpy as np
import torch

from model.generation.cost import generation_ms
from model.speech.audio import Speech
from model.systems.official import FAMILY
from model.systems.official.checkpoint import make_network
from model.systems.official.files import FOLDER_VARIABLE, SPEECH_VARIABLE
from model.systems.official.sizes import SPEECH_DIM, WINDOW_FRAMES
from model.systems.official.speech import STEP_SAMPLES


def measured(seconds: float = 10.0) -> list[tuple[str, float, str, str]]:
    """Milliseconds a frame, from files as their script saves them, speech features not counted; and
    the most memory of this process, GB, whose environment names those files from then on. See
    `Family.has_cost`."""
    speech = Speech(np.zeros(round(16_000 * seconds), np.float32), sha256="")
    windows = 1 + -(-(speech.num_frames - WINDOW_FRAMES) // (STEP_SAMPLES * 30 // 16_000))
    with tempfile.TemporaryDirectory(prefix="official-") as name:
        folder = Path(name)
        torch.save(make_network("motion").state_dict(), folder / "epoch_19")
        torch.save(make_network("expression").state_dict(), folder / "speech.pt")
        rng = np.random.default_rng(0)
        features = rng.standard_normal((windows, WINDOW_FRAMES, SPEECH_DIM)).astype(np.float32)
        np.save(folder / "features.npy", features)
        os.environ |= {FOLDER_VARIABLE: name, SPEECH_VARIABLE: str(folder / "features.npy")}
        system = FAMILY.load(FAMILY.systems[0], folder)
        steps = system.samplers[0].steps
        each = generation_ms(system, speech, steps)
    memory_gb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    return [
        (f"generation, size of the official code, {steps} steps", each, "ms/frame", ""),
        ("memory of it", memory_gb, "GB", "at most 4"),
    ]
