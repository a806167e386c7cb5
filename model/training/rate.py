"""What this processor trains fastest with: bf16 or fp32, compiled or not. Probed, not assumed."""

import logging
import shutil
import time
import warnings
from collections.abc import Callable
from functools import cache
from typing import TypeVar

import torch

log = logging.getLogger(__name__)
F = TypeVar("F", bound=Callable)

PROBE_SHAPE = (3840, 192, 384)
"""Rows, inputs and outputs of the probed product: a feed-forward layer over 64 windows."""
PROBE_RUNS = 5
BF16_GAIN = 1.3
"""Times faster that bf16 products must be; copies and what stays in fp32 eat less than that."""


@cache
def bf16_is_faster() -> bool:
    """Whether this processor multiplies bf16 matrices clearly faster than fp32 ones."""
    rows, inputs, outputs = PROBE_SHAPE
    seconds = {}
    for dtype in (torch.float32, torch.bfloat16):
        x, weight = torch.ones(rows, inputs, dtype=dtype), torch.ones(outputs, inputs, dtype=dtype)
        torch.nn.functional.linear(x, weight)  # the first call prepares the kernel
        runs = []
        for _ in range(PROBE_RUNS):
            start = time.perf_counter()
            torch.nn.functional.linear(x, weight)
            runs.append(time.perf_counter() - start)
        seconds[dtype] = min(runs)
    return seconds[torch.float32] > BF16_GAIN * seconds[torch.bfloat16]


@cache
def can_compile() -> bool:
    """Whether `torch.compile` works here; says why not, once, where it does not."""
    if not any(shutil.which(name) for name in ("g++", "clang++")):
        log.info("No C++ compiler was found: the training step is not compiled.")
        return False
    try:
        torch.compile(lambda x: (x + 1).relu().sum(), dynamic=False)(torch.ones(8))
    except Exception as error:  # whatever the compiler's tool chain may raise
        log.info(
            "torch.compile does not work here (%s): the training step is not compiled.",
            str(error).splitlines()[0],
        )
        return False
    return True


def compiled(function: F) -> F:
    """``function`` compiled for the shapes of its first call."""
    # Tables of indices are made once and cached; the compiler need not follow the cache.
    warnings.filterwarnings("ignore", message=".*lru_cache.*", category=UserWarning)
    return torch.compile(function, dynamic=False)  # type: ignore[return-value]
