"""Zips of results, as people hand them in: unpacked and measured as sets beside each other."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.run.many.motions import diagnose_folders, in_folders, sets_of
from app.run.many.unpacked import Limits, unpack_sets
from app.run.output.telling import Reporter
from app.run.requests.request import Ask, OnEvent, ShouldCancel

MAX_BYTES = 10**9
"""Of all zips of a run, unpacked."""
MAX_FILES = 1500
"""Of all of them."""


@dataclass(frozen=True)
class Sets:
    """What was written, and found."""

    files: tuple[Path, ...]
    notes: tuple[str, ...]
    told: dict[str, Any]
    """What `app.run.many.table.write_tables` leaves in ``many.json``."""
    clips: dict[str, dict[str, Path]]
    """By system, and the reference, the motion file of each clip."""
    sounds: dict[str, Path]
    """By clip."""
    ask: Ask


def measure_sets(
    ask: Ask,
    on_event: OnEvent = lambda event: None,
    should_cancel: ShouldCancel = lambda: False,
) -> Sets:
    """Unpack zips, each a system's results, below ``ask.out``, then measure one clip after the
    other; those that cannot be read are left out.

    Raises:
        CancelledRun: when ``should_cancel`` said so.
        RunError: for zips that cannot be read, hold too much, or share no clip.
        MotionError: where no clip can be read.
    """
    run = Reporter(on_event, should_cancel)
    limits = Limits(files=MAX_FILES, total_bytes=MAX_BYTES)
    folders = unpack_sets(sets_of(ask), ask.out / "unpacked", limits)
    found = diagnose_folders(in_folders(ask, folders), run.share("numbers"))
    told = json.loads((ask.out / "many.json").read_text())
    return Sets(found.files, found.notes, told, found.measured, found.sounds, ask)
