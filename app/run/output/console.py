"""Terminal output: messages and progress on standard error, file paths on standard output."""

from __future__ import annotations

import io
import logging
import sys
from pathlib import Path
from typing import Any

from app import text
from app.run.callbacks import RunEvent, StageProgress
from conventions.names import printable


class ProgressBars:
    """Progress bars of a terminal or notebook cell, one below the other; a context manager."""

    def __init__(self, *, is_visible: bool | None = None, stays: bool = True) -> None:
        """Configure the progress bars."""
        self._is_visible, self._stays = is_visible, stays
        self._bars: dict[str, Any] = {}

    def __enter__(self) -> ProgressBars:
        return self

    def __exit__(self, *exception: object) -> None:
        for bar in self._bars.values():
            bar.close()

    def update(self, title: str, share: float) -> None:
        """Set a progress bar to a fraction from 0 to 1."""
        from tqdm.auto import tqdm

        if title not in self._bars:
            form = "{desc:<22} {percentage:3.0f} % |{bar}| {elapsed}"
            self._bars[title] = tqdm(
                total=100,
                desc=printable(title),
                bar_format=form,
                disable=None if self._is_visible is None else not self._is_visible,
                leave=self._stays,
            )
        bar = self._bars[title]
        bar.n = round(100 * min(1.0, share))
        bar.refresh()

    def on_event(self, event: RunEvent) -> None:
        if isinstance(event, StageProgress):
            self.update(text.STAGE_NAMES[event.stage], event.fraction)


def print_message(sentence: str) -> None:
    """Write one line for the user to standard error."""
    sys.stderr.write(f"{printable(sentence)}\n")


def print_path(path: Path) -> None:
    """Write the path of a file to standard output; a terminal gets no control characters."""
    out = sys.stdout
    if isinstance(out, io.TextIOWrapper):
        out.reconfigure(errors="surrogateescape")  # file names may be invalid UTF-8
    out.write(f"{printable(str(path)) if out.isatty() else path}\n")
    out.flush()


class SafeLogFormatter(logging.Formatter):
    """Log formatter that replaces control characters."""

    def format(self, record: logging.LogRecord) -> str:
        return "\n".join(map(printable, super().format(record).split("\n")))
