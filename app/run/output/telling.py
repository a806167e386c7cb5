"""How a run tells of itself: progress, files, notes, and whether it shall stop."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from app.errors import CancelledRun
from app.run.requests.request import (
    ArtefactKind,
    OnEvent,
    Progress,
    ShouldCancel,
    Stage,
)


class Reporter:
    """The ear of whoever asked for a run."""

    def __init__(self, on_event: OnEvent, should_cancel: ShouldCancel) -> None:
        self._on_event = on_event
        self.should_cancel = should_cancel
        self.notes: list[str] = []

    def progress(self, stage: Stage, fraction: float, detail: str = "") -> None:
        self._on_event(Progress(stage, fraction, detail))

    def file(self, kind: ArtefactKind, name: str, path: Path) -> None:
        """Take a file that is whole.

        Args:
            name: of the row that it belongs to, or the file's own.
        """

    def note(self, *sentences: str) -> None:
        """Keep what the person should read; each sentence once."""
        self.notes.extend(note for note in sentences if note not in self.notes)

    def stop_if_asked(self) -> None:
        """Between steps that cannot be interrupted themselves.

        Raises:
            CancelledRun: if the person asked to stop.
        """
        if self.should_cancel():
            raise CancelledRun


def share_teller(
    stage: Stage, on_event: OnEvent, should_cancel: ShouldCancel
) -> Callable[[float], None]:
    """What takes the share done of a stage: it tells of it, or ends the work by CancelledRun."""

    def on_share(share: float) -> None:
        if should_cancel():
            raise CancelledRun
        on_event(Progress(stage, share))

    return on_share
