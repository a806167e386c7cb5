"""What a person is told on a terminal: sentences and bars on standard error, files for a script on
standard output."""

from __future__ import annotations

import io
import logging
import sys
from pathlib import Path
from typing import Any

from app import text
from app.run.callbacks import Event, Progress
from conventions.names import printable


class Bars:
    """One for each thing that is at work, below one another, on a terminal or in a notebook's cell;
    use it as a context."""

    def __init__(self, *, is_shown: bool | None = None, stays: bool = True) -> None:
        """
        Args:
            is_shown: by default where a person sees them.
        """
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
                disable=None if self._is_shown is None else not self._is_shown,
                leave=self._stays,
            )
        bar = self._bars[title]
        bar.n = round(100 * min(1.0, share))
        bar.refresh()

    def take(self, event: Event) -> None:
        """Show how far a stage of a run is."""
        if isinstance(event, Progress):
            self.show(text.STAGE_NAMES[event.stage], event.fraction)


def say(sentence: str) -> None:
    """One line for a person."""
    sys.stderr.write(f"{printable(sentence)}\n")


def name_file(path: Path) -> None:
    """One line for a script, which gets the very name; a terminal gets what it does not obey."""
    out = sys.stdout
    if isinstance(out, io.TextIOWrapper):
        out.reconfigure(errors="surrogateescape")  # a name may be no text at all
    out.write(f"{printable(str(path)) if out.isatty() else path}\n")
    out.flush()


class LogLines(logging.Formatter):
    """Lines of the log that no terminal obeys."""

    def format(self, record: logging.LogRecord) -> str:
        return "\n".join(map(printable, super().format(record).split("\n")))
