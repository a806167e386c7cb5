"""Folders of an export: bundle, researcher's files and unfinished work."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.errors import RunError
from app.run.tasks import ImportedFunction
from model.storage.files import write_atomically

EXPORT_STUDY = ImportedFunction("app.study.export", "export_from_request")


@dataclass(frozen=True)
class ExportRequest:
    """Request to export the study of a plan file."""

    plan: Path
    out: Path
    weights: Path
    body: Path | None
    zips: tuple[Path, Path]
    """Paths of the zips: of the participants' part, and of the researcher's with the plan."""


class ExportFolders:
    """Paths of an export; only the owner can open the researcher's folder."""

    def __init__(self, out: Path) -> None:
        self.bundle = out / "participant_bundle"
        self.media = self.bundle / "media"
        self.private = out / "researcher_only"
        self.key = self.private / "key.json"
        self.work = self.private / "unfinished"

    def prepare(self) -> None:
        """Make the folders and clear unfinished work; raises RunError for another study's."""
        out = self.private.parent
        if out.exists() and not out.is_dir():
            raise RunError(f"{out} is a file; name a folder for the study.")
        if not self.key.is_file() and self.bundle.exists() and any(self.bundle.iterdir()):
            raise RunError(
                f"{out} already contains the bundle of another study; choose another folder."
            )
        try:
            self.private.mkdir(parents=True, exist_ok=True)
            self.private.chmod(0o700)
            shutil.rmtree(self.work, ignore_errors=True)
            for folder in (self.work, self.media):
                folder.mkdir(parents=True, exist_ok=True)
            for folder in (self.bundle, self.media, self.private):
                for part in folder.glob(".*.part*"):  # left by a killed run
                    part.unlink()
        except OSError as error:
            raise RunError(f"The folder {out} cannot be written to; choose another.") from error

    def video(self, blind_id: str) -> Path:
        """Return the path of a video in the bundle."""
        return self.media / f"{blind_id}.mp4"

    def write_json(self, path: Path, value: Any) -> None:
        """Write a JSON file atomically."""
        self.write(path, json.dumps(value, indent=1, ensure_ascii=False) + "\n")

    def write(self, path: Path, content: str | bytes) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, content)

    def remove_unfinished(self) -> None:
        """Remove the folder of unfinished work."""
        shutil.rmtree(self.work, ignore_errors=True)
