"""Folders as zip files that say nothing of when and in what order their files were made."""

from __future__ import annotations

import zipfile
from pathlib import Path

_TIME = (2000, 1, 1, 0, 0, 0)
_STORED = {".mp4"}
"""Endings of files that are compressed already."""


def zip_folder(folder: Path, out: Path) -> Path:
    """All files below ``folder``, by name, under the folder's own name."""
    with zipfile.ZipFile(out, "w") as archive:
        for path in sorted(path for path in folder.rglob("*") if path.is_file()):
            info = zipfile.ZipInfo(path.relative_to(folder.parent).as_posix(), _TIME)
            is_stored = path.suffix in _STORED
            info.compress_type = zipfile.ZIP_STORED if is_stored else zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            with path.open("rb") as source, archive.open(info, "w", force_zip64=True) as target:
                while block := source.read(1 << 20):
                    target.write(block)
    return out
