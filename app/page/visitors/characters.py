"""Character of each visitor, kept like an upload for the browser that has the visitor's cookie."""

from __future__ import annotations

import hashlib
import os
import shutil
from contextlib import suppress
from pathlib import Path

from app.page.visitors.job_folders import touch

FILE = "Your character.glb"
"""Name of every character's file; that of the visitor is never used."""


class Characters:
    """Characters of all visitors, below a folder whose content is deleted after a while."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def folder(self, cookie: str) -> Path:
        """Return the folder of a visitor's character, which may not exist."""
        return (
            self._root / f"character-{hashlib.sha256(cookie.encode(errors='replace')).hexdigest()}"
        )

    def keep(self, cookie: str, source: Path) -> None:
        """Move a file into the visitor's folder, in place of an earlier one."""
        folder = self.folder(cookie)
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        os.replace(source, folder / FILE)
        touch([folder])

    def find(self, cookie: str) -> Path | None:
        """Return the visitor's character, or None."""
        path = self.folder(cookie) / FILE
        return path if cookie and path.is_file() else None

    def link(self, cookie: str, folder: Path) -> Path | None:
        """Return the visitor's character in the folder of a run, which it stays in, or None."""
        if (path := self.find(cookie)) is None:
            return None
        touch([path.parent])
        with suppress(FileExistsError):
            os.link(path, folder / FILE)
        return folder / FILE

    def drop(self, cookie: str) -> None:
        """Delete the visitor's character."""
        shutil.rmtree(self.folder(cookie), ignore_errors=True)
