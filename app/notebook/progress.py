"""Bars of tqdm in the cell, or on the terminal."""

from __future__ import annotations

from typing import Any

from app import text
from app.run.requests.request import Event, Progress


class Bar:
    """From 0 to 100 percent; use it as a context."""

    def __init__(self, title: str, is_shown: bool = True) -> None:
        from tqdm.auto import tqdm

        self._bar: Any = tqdm(total=100, desc=title, unit="%", leave=False, disable=not is_shown)

    def __enter__(self) -> Bar:
        return self

    def __exit__(self, *exception: object) -> None:
        self._bar.close()

    def show(self, share: float) -> None:
        """Move to ``share`` (0 to 1) of the way."""
        self._bar.update(round(100 * share) - self._bar.n)

    def take(self, event: Event) -> None:
        """Show what a run tells of the stage that is at work."""
        if isinstance(event, Progress):
            self._bar.set_description(text.STAGE_NAMES[event.stage], refresh=False)
            self.show(event.fraction)
