"""What is kept of one clip that is done, and where the numbers of sets come from."""

from __future__ import annotations

import datetime
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from conventions.names import REFERENCE_NAME
from model.storage.cards import BUNDLED_WEIGHTS, load_card
from model.storage.files import file_sha256

Record = dict[str, Any]
"""``frames``, and ``systems`` as of `app.run.many.table.write_tables`."""


def stamp_of(files: Mapping[str, Path], said: object) -> dict[str, Any]:
    """What a clip's numbers depend on: files, by what they are, and what was asked."""
    of_files = {}
    for name, path in files.items():
        found = path.stat()
        of_files[name] = [path.name, found.st_size, found.st_mtime_ns]
    return json.loads(json.dumps({"said": said, "files": of_files}, default=str))


def is_kept(path: Path, stamp: dict[str, Any]) -> bool:
    """Whether a clip's record is there, whole, and of this very stamp."""
    try:
        return json.loads(path.read_text()).get("stamp") == stamp
    except (OSError, ValueError, AttributeError):
        return False


def keep(path: Path, stamp: dict[str, Any], record: Record) -> None:
    """Write it, whole or not at all."""
    from model.storage.files import written_atomically

    with written_atomically(path) as temporary:
        temporary.write_text(json.dumps({"stamp": stamp, **record}, allow_nan=False) + "\n")


def read_records(paths: Mapping[str, Path]) -> dict[str, Record]:
    """By clip."""
    return {clip: json.loads(path.read_text()) for clip, path in paths.items()}


def origin_of(
    systems: list[str],
    clips: list[str],
    numbers: list[dict[str, Any]],
    measures: int,
    mean_speeds: Path | None,
) -> dict[str, Any]:
    """What stands in ``many.json`` as ``provenance``.

    Args:
        numbers: of each clip, in ``systems`` by name the ``sha256`` of its file.
        measures: number of the form in which clips are measured.
        mean_speeds: published ones that BeatAlign was measured with.
    """
    from model.systems.autoencoders.config import FGD_ENCODER
    from model.training.loop import revision

    digests = {
        name: _digest(
            [clip, each["systems"][name]["sha256"]]
            for clip, each in zip(clips, numbers, strict=True)
        )
        for name in systems
    }
    return {
        "made_at": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "project": revision(),
        "systems": digests,
        "reference": digests.get(REFERENCE_NAME),
        "encoders": {"FGD": load_card(BUNDLED_WEIGHTS, FGD_ENCODER).sha256},
        "mean_speeds": mean_speeds and file_sha256(mean_speeds),
        "measures": measures,
    }


def _digest(parts: Any) -> str:
    return hashlib.sha256(json.dumps(list(parts)).encode()).hexdigest()
