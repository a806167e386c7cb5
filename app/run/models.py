"""Cache of systems and bodies, which are loaded once per process."""

from __future__ import annotations

import functools
import logging
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from conventions.views import BODY_LOOKS
from model.speech.librosa_cache import import_in_background
from model.storage.files import FileStamps, file_stamps
from model.systems.registry import files_affecting_system, list_systems, load_system
from processes.pool import JobPool

if TYPE_CHECKING:
    from model.generation.base import System
    from renderer.body.body import Body

log = logging.getLogger(__name__)
WORTH_S = 60.0
"""Seconds of motion that take about as long to generate as further processes take to start."""
MAX_PROCESSES = 4
"""Most processes of one run; each loads the models and may take the memory that a run may."""
_LOADING = threading.Lock()  # warm-up and first visitor must not load the same file twice


def get_system(name: str, weights: Path) -> System:
    """Return a system, loaded again when its files have changed; raises as `load_system`."""
    with _LOADING:
        return _load_system(name, weights, file_stamps(files_affecting_system(name, weights)))


def get_body(path: Path | None, look: str = BODY_LOOKS[0]) -> Body:
    """Return the open body in a look, or the one in a file, loaded once; raises BodyError."""
    with _LOADING:
        return _load_body(path, look, file_stamps([path] if path else []))


@functools.lru_cache(maxsize=16)
def _load_system(name: str, weights: Path, stamps: FileStamps) -> System:
    import_in_background()  # what encodes speech for it
    return load_system(name, weights)


@functools.lru_cache(maxsize=4)
def _load_body(path: Path | None, look: str, stamps: FileStamps) -> Body:
    from renderer.body.body import load_body

    return load_body(path, look)


def make_job_pool(motion_s: float) -> JobPool:
    """Return a pool of this process, or of several for long motion, as each loads the models."""
    return JobPool(min(MAX_PROCESSES, os.cpu_count() or 1) if motion_s > WORTH_S else 1)


def warm_up_in_steps(weights: Path, body: Path | None) -> Iterator[None]:
    """Load every system and the body, generate a short motion, and choose the OpenGL backend.

    This is done in small parts, between which the caller can do something else, so that the first
    visitor need not wait.
    """
    import numpy as np

    from conventions.rates import SAMPLE_RATE
    from model.generation.family import FamilyUnavailableError
    from model.generation.windows import GenerateOptions, generate_motion
    from model.speech.audio import Speech
    from renderer.body.lod import select_lod

    select_lod(get_body(body), height_px=1.0)  # makes the coarser meshes of a licensed body
    yield
    noise = np.random.default_rng(0).normal(0.0, 0.1, SAMPLE_RATE).astype(np.float32)
    for name in list_systems(weights):
        try:
            system = get_system(name, weights)
        except (
            FamilyUnavailableError
        ) as error:  # of another package; reported when the system is used
            log.warning("%s", error)
            continue
        options = GenerateOptions(speaker=next(iter(system.speakers)), steps=1)
        generate_motion(system, Speech(waveform=noise, sha256=""), options)
        yield
    if missing := rendering_unavailable_reason():
        log.warning("%s", missing)


def rendering_unavailable_reason() -> str:
    """Return why videos and snapshots are omitted, with what to install; empty if OpenGL works."""
    from renderer.draw.offscreen import GLError
    from renderer.draw.probe import choose_backend

    try:
        choose_backend()
    except GLError as error:
        return f"Videos and snapshots are left out. {error}"
    return ""
