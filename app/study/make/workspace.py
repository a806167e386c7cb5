"""The folder of an export: what it may be told, what is hosted, what stays, what is half done."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.config import BUNDLED_WEIGHTS
from app.errors import RunError
from app.run.videos.videos import PARALLEL_VIDEOS
from app.study.design.fields import FieldError, read_object
from model.storage.files import written_atomically
from processes.pool import JobPool

BUNDLE = "participant_bundle"
PRIVATE = "researcher_only"
_MAX_STATE_BYTES = 64 << 20


class Workspace:
    """Paths, and the record of finished videos by which an export is resumed.

    The researcher's folder can be entered by its owner alone.
    """

    def __init__(self, out: Path) -> None:
        self.bundle = out / BUNDLE
        self.media = self.bundle / "media"
        self.private = out / PRIVATE
        self.key = self.private / "key.json"
        self.work = self.private / "unfinished"
        self.notes = self.private / "made"
        """Of workers elsewhere, which the export has not heard of yet."""
        self._state = self.private / "state.json"
        self._videos: dict[str, str] = {}
        self._fingerprint = ""

    def open(self, fingerprint: str) -> None:
        """Make the folders, or go on in those of an earlier run.

        Args:
            fingerprint: of the plan and everything it is made from.

        Raises:
            RunError: if the folder holds something else.
        """
        self._fingerprint = fingerprint
        out = self.private.parent
        if out.exists() and not out.is_dir():
            raise RunError(f"{out} is a file; name a folder for the study.")
        if self._state.is_file():
            self._read_state()
        elif self.bundle.exists() and any(self.bundle.iterdir()):
            raise RunError(f"{out} holds a bundle of something else; choose another folder.")
        try:
            self.private.mkdir(parents=True, exist_ok=True)
            self.private.chmod(0o700)
            shutil.rmtree(self.work, ignore_errors=True)
            for folder in (self.work, self.media):
                folder.mkdir(parents=True, exist_ok=True)
            for folder in (self.bundle, self.media, self.private):
                for part in folder.glob(".*.part*"):  # of a run that was killed
                    part.unlink()
        except OSError as error:
            raise RunError(f"The folder {out} cannot be written to; choose another.") from error
        self._write_state()

    def has_video(self, blind: str) -> bool:
        """Whether the video was finished, and is still what it was then."""
        path = self.video(blind)
        return blind in self._videos and path.is_file() and sha256(path) == self._videos[blind]

    def video(self, blind: str) -> Path:
        """Where the video lies for the participants."""
        return self.media / f"{blind}.mp4"

    def finish_videos(self, blinds: list[str]) -> None:
        """Record them; from now on a resumed run keeps them."""
        self._videos |= {blind: sha256(self.video(blind)) for blind in blinds}
        self._write_state()

    def _write_state(self) -> None:
        self.write_json(
            self._state,
            {"fingerprint": self._fingerprint, "videos": dict(sorted(self._videos.items()))},
        )

    @property
    def digests(self) -> dict[str, str]:
        """sha256 of every finished video."""
        return dict(self._videos)

    def write_json(self, path: Path, value: Any) -> None:
        """Write a file whole or not at all."""
        self.write_text(path, json.dumps(value, indent=1, ensure_ascii=False) + "\n")

    def write_text(self, path: Path, text: str) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        with written_atomically(path) as part:
            part.write_text(text, "utf-8")

    def clean(self) -> None:
        """Remove what only the making needed."""
        for folder in (self.work, self.notes):
            shutil.rmtree(folder, ignore_errors=True)

    def _read_state(self) -> None:
        try:
            state = read_object(self._state, _MAX_STATE_BYTES)
            fingerprint = state.text("fingerprint")
            videos = state.inner("videos")
            self._videos = {blind: videos.text(blind) for blind in videos.names()}
        except FieldError as error:
            raise RunError(
                f"{self._state} is damaged: {error}; remove it, and all videos are made anew."
            ) from error
        if fingerprint != self._fingerprint:
            raise RunError(
                f"{self.private.parent} holds the export of another plan, or the plan or a file "
                "that it names has changed; export to a new folder."
            )


def sha256(path: Path) -> str:
    """Of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@dataclass(frozen=True)
class ExportOptions:
    """What does not change what the study is."""

    weights: Path = BUNDLED_WEIGHTS
    body: Path | None = None
    """A licensed SMPL-X npz; None is the open body."""
    parallel: int = PARALLEL_VIDEOS
    """Videos drawn at once."""
    pool: JobPool | None = None
    """Who makes the clips, several at once; None makes one after the other, here."""
