"""Bars of what goes on, on a terminal or in a notebook's cell."""

from __future__ import annotations

from typing import Any

from app import text
from app.run.ask import Event, Progress
from conventions.names import printable


class Bars:
    """One for each thing that is at work, below one another; use it as a context."""

    def __init__(self, *, is_shown: bool, stays: bool = True) -> None:
        self._is_shown, self._stays = is_shown, stays
        self._bars: dict[str, Any] = {}

    def __enter__(self) -> Bars:
        return self

    def __exit__(self, *exception: object) -> None:
        for bar in self._bars.values():
            bar.close()

    def show(self, title: str, share: float) -> None:
        """Move a bar to a share, 0 to 1, of its way."""
        from tqdm.auto import tqdm

        if title not in self._bars:
            form = "{desc:<22} {percentage:3.0f} % |{bar}| {elapsed}"
            self._bars[title] = tqdm(
                total=100,
                desc=printable(title),
                bar_format=form,
                disable=not self._is_shown,
                leave=self._stays,
            )
        bar = self._bars[title]
        bar.n = round(100 * min(1.0, share))
        bar.refresh()

    def take(self, event: Event) -> None:
        """Show how far a stage of a run is."""
        if isinstance(event, Progress):
            self.show(text.STAGE_NAMES[event.stage], event.fraction)
