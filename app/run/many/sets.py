"""Zips of results, as people hand them in: unpacked and measured as sets beside each other."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from app.run.many.motions import diagnose_folders
from app.run.many.speeches import ENDINGS as SOUND_ENDINGS
from app.run.many.unpacked import Limits, stem_of, unpacked
from app.run.output.telling import share_teller
from app.run.requests.request import Ask, OnEvent, ShouldCancel
from conventions.names import REFERENCE_NAME, printable
from model.formats.read import ENDINGS

MAX_BYTES = 10**9
"""Of all zips of a run, unpacked."""
MAX_FILES = 1500
"""Of all of them."""
_UNPACKED = 0.05
"""Share of the work that is done then."""


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
    on_progress = share_teller("numbers", on_event, should_cancel)
    top = ask.out / "unpacked"
    left = Limits(files=MAX_FILES, total_bytes=MAX_BYTES)

    def folder_of(path: Path, name: str, endings: tuple[str, ...]) -> Path:
        nonlocal left
        on_progress(0.0)
        folder = top / name / (printable(stem_of(path)) or "set")
        folder.mkdir(parents=True)
        count = unpacked(path, folder, endings, left)
        held = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
        left = Limits(files=left.files - count, total_bytes=left.total_bytes - held)
        return folder

    opened = replace(
        ask,
        motions=tuple(
            folder_of(path, f"set{number}", ENDINGS) for number, path in enumerate(ask.motions)
        ),
        reference=ask.reference and folder_of(ask.reference, REFERENCE_NAME, ENDINGS),
        speech=ask.speech and folder_of(ask.speech, "speech", SOUND_ENDINGS),
    )
    left_to_do = 1 - _UNPACKED
    found = diagnose_folders(opened, lambda share: on_progress(_UNPACKED + left_to_do * share))
    told = json.loads((ask.out / "many.json").read_text())
    return Sets(found.files, found.notes, told, found.measured, found.sounds, ask)
