"""What generation costs on this machine."""

import time

from model.generation.base import System
from model.generation.windows import GenerateOptions, generate_motion
from model.speech.audio import Speech


def generation_ms(system: System, speech: Speech, steps: int, samples: int = 1) -> float:
    """Milliseconds for each frame of each sample, speech features included."""
    options = GenerateOptions(next(iter(system.speakers)), steps=steps, samples=samples)
    started = time.perf_counter()
    generate_motion(system, speech, options)
    return 1e3 * (time.perf_counter() - started) / (speech.num_frames * samples)
