"""Progress on a terminal; silent where standard error is none."""

from __future__ import annotations

import sys
from typing import Any

from tqdm import tqdm

from app import text
from app.run.request import Event, Progress, Stage


class ProgressBar:
    """One bar from 0 to 100 percent."""

    def __init__(self, title: str) -> None:
        self._bar: Any = tqdm(
            total=100,
            desc=title,
            unit="%",
            bar_format="{desc:<22} {percentage:3.0f} % |{bar}| {elapsed}",
            disable=not sys.stderr.isatty(),
            leave=True,
        )

    def __enter__(self) -> ProgressBar:
        return self

    def show(self, fraction: float) -> None:
        """Move to ``fraction`` (0 to 1) of the way."""
        self._bar.n = round(100 * min(1.0, fraction))
        self._bar.refresh()

    def close(self) -> None:
        self._bar.close()

    def __exit__(self, *exception: object) -> None:
        self.close()


class ProgressBars:
    """One bar for each stage of a run, below one another."""

    def __init__(self) -> None:
        self._stage: Stage | None = None
        self._bar: ProgressBar | None = None

    def __enter__(self) -> ProgressBars:
        return self

    def take(self, event: Event) -> None:
        """Show an event of `app.run.pipeline.generate_all`."""
        if not isinstance(event, Progress):
            return
        if event.stage != self._stage:
            self._close()
            self._stage, self._bar = event.stage, ProgressBar(text.STAGE_NAMES[event.stage])
        if self._bar is not None:
            self._bar.show(event.fraction)

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.close()

    def __exit__(self, *exception: object) -> None:
        self._close()
