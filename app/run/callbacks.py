"""Progress events of a task and its cancellation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from app.errors import Cancelled

Stage = Literal["speech", "motion", "numbers", "video", "comparison", "figure"]
STAGES: tuple[Stage, ...] = ("speech", "motion", "numbers", "video", "comparison", "figure")


@dataclass(frozen=True)
class Progress:
    """Progress of one stage."""

    stage: Stage
    fraction: float
    """Fraction done of this stage, 0 to 1."""
    detail: str = ""
    """Current item, such as the name of a system."""
    clip: str = ""
    """Number of clips, such as "4 clips", if there are several; progress is the mean of them."""


@dataclass(frozen=True)
class Grown:
    """Event of new content in a run's folder, as listed in its `run.json`."""

    folder: Path


Event = Progress | Grown


class Ear:
    """Callbacks of the caller of a task: progress events and cancellation."""

    def __init__(
        self,
        hear: Callable[[Event], None] = lambda event: None,
        should_cancel: Callable[[], bool] = lambda: False,
    ) -> None:
        """Store the callbacks of the caller.

        Args:
            hear: called with each progress event, and when the folder has new content.
            should_cancel: called many times a second.
        """
        self.hear = hear
        self.should_cancel = should_cancel

    def progress(self, stage: Stage, fraction: float, detail: str = "") -> None:
        self.hear(Progress(stage, fraction, detail))

    def share(
        self, stage: Stage, part: float = 1.0, before: float = 0.0
    ) -> Callable[[float], None]:
        """Return a callback for the fraction done of a part of a stage.

        It reports the progress, and raises `Cancelled` when the caller has cancelled.
        """

        def on_share(share: float) -> None:
            self.stop_if_asked()
            self.progress(stage, before + part * share)

        return on_share

    def stop_if_asked(self) -> None:
        """Raise `Cancelled` if the caller has cancelled; for steps that cannot be interrupted."""
        if self.should_cancel():
            raise Cancelled


DEAF = Ear()
