"""Progress events of a task and its cancellation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from app.errors import Cancelled

RunStage = Literal["speech", "motion", "numbers", "video", "comparison", "figure"]
RUN_STAGES: tuple[RunStage, ...] = ("speech", "motion", "numbers", "video", "comparison", "figure")


@dataclass(frozen=True)
class StageProgress:
    """Progress of one stage."""

    stage: RunStage
    fraction: float
    """Fraction done of this stage, 0 to 1."""
    detail: str = ""
    """Current item, such as the name of a system."""
    clips_text: str = ""
    """Number of clips, such as "4 clips", if there are several; progress is the mean of them."""


@dataclass(frozen=True)
class FolderUpdated:
    """Event of new content in a run's folder, as listed in its `run.json`."""

    folder: Path


RunEvent = StageProgress | FolderUpdated


class RunCallbacks:
    """Callbacks of the caller of a task: progress events and cancellation."""

    def __init__(
        self,
        on_event: Callable[[RunEvent], None] = lambda event: None,
        should_cancel: Callable[[], bool] = lambda: False,
    ) -> None:
        """Store the caller's callbacks; progress and new files in the folder are events."""
        self.on_event = on_event
        self.should_cancel = should_cancel

    def report_progress(self, stage: RunStage, fraction: float, detail: str = "") -> None:
        self.on_event(StageProgress(stage, fraction, detail))

    def progress_callback(
        self, stage: RunStage, part_size: float = 1.0, start: float = 0.0
    ) -> Callable[[float], None]:
        """Return a callback for the fraction done of a part of a stage.

        It reports the progress, and raises `Cancelled` when the caller has cancelled.
        """

        def on_share(share: float) -> None:
            self.raise_if_cancelled()
            self.report_progress(stage, start + part_size * share)

        return on_share

    def raise_if_cancelled(self) -> None:
        """Raise `Cancelled` if the caller has cancelled; for steps that cannot be interrupted."""
        if self.should_cancel():
            raise Cancelled


NO_CALLBACKS = RunCallbacks()
