"""Files of a run in one zip."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Sequence
from pathlib import Path

_ALREADY_SMALL = {".mp4", ".png", ".npz", ".pdf", ".glb"}


def zip_files(files: Sequence[Path], out: Path) -> Path:
    """Write ``files`` flat into the zip ``out``, whole or not at all."""
    partial = out.with_name(f".{out.name}.partial")
    try:
        with zipfile.ZipFile(partial, "w") as bundle:
            for file in files:
                small = file.suffix in _ALREADY_SMALL
                bundle.write(
                    file,
                    f"{out.stem}/{file.name}",
                    zipfile.ZIP_STORED if small else zipfile.ZIP_DEFLATED,
                )
        os.replace(partial, out)
    finally:
        partial.unlink(missing_ok=True)
    return out
