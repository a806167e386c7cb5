"""How much a run has been given to work with, as far as that can be seen without reading it."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable
from pathlib import Path

LARGE_BYTES = 6 * 10**6
"""Half a minute of sound as recorders write it, or a minute and a half of motion."""
_PACKED_SOUND = {".mp3", ".m4a", ".aac", ".ogg", ".oga", ".opus", ".webm", ".mp4", ".wma"}
_PACKED_TIMES = 10
_ZIPPED = {".npz", ".zip"}


def is_large(uploads: Iterable[Path]) -> bool:
    """Whether a run on these is likely to take long. It only decides whose turn it is: who is taken
    for small and takes long all the same has to step aside or back."""
    return sum(map(_unpacked_bytes, uploads)) > LARGE_BYTES


def _unpacked_bytes(upload: Path) -> int:
    try:
        size = upload.stat().st_size
        if size > LARGE_BYTES:  # of a zip, its list of contents might be as long
            return size
        if upload.suffix.lower() in _ZIPPED:
            with zipfile.ZipFile(upload) as archive:
                return sum(each.file_size for each in archive.infolist())
    except Exception:  # who reads it in earnest tells what is wrong with it
        return 0
    return size * (_PACKED_TIMES if upload.suffix.lower() in _PACKED_SOUND else 1)
