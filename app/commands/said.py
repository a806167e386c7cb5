"""What commands say: sentences and progress on standard error, files for a script on standard
output."""

from __future__ import annotations

import io
import logging
import sys
from pathlib import Path
from typing import Any

from tqdm import tqdm

from app import text
from app.run.requests.request import Event, Progress, Stage
from conventions.names import printable


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


class ProgressBar:
    """One bar from 0 to 100 percent."""

    def __init__(self, title: str) -> None:
        self._bar: Any = tqdm(
            total=100,
            desc=printable(title),
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
    """One bar for each stage of a run, below one another; two stages may be at work at once."""

    def __init__(self) -> None:
        self._bars: dict[Stage, ProgressBar] = {}

    def __enter__(self) -> ProgressBars:
        return self

    def take(self, event: Event) -> None:
        """Show an event of `app.run.pipeline.do`."""
        if not isinstance(event, Progress):
            return
        if event.stage not in self._bars:
            self._bars[event.stage] = ProgressBar(text.STAGE_NAMES[event.stage])
        self._bars[event.stage].show(event.fraction)

    def __exit__(self, *exception: object) -> None:
        for bar in self._bars.values():
            bar.close()
