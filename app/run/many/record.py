"""What is kept of one clip that is done: its numbers, and what they depend on."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

Record = dict[str, Any]
"""``frames``, and in ``systems`` by name what `app.run.many.table.numbers_of` gives."""


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
