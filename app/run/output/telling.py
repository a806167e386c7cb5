"""How a run tells of itself: progress, notes, whether it shall stop; and what a person is told on a
terminal: sentences and bars on standard error, files for a script on standard output."""

from __future__ import annotations

import io
import logging
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from app import text
from app.errors import Cancelled
from app.run.ask import Event, OnEvent, Progress, ShouldCancel, Stage
from conventions.names import printable


class Reporter:
    """The ear of whoever asked for a run."""

    def __init__(
        self,
        on_event: OnEvent = lambda event: None,
        should_cancel: ShouldCancel = lambda: False,
    ) -> None:
        self._on_event = on_event
        self.should_cancel = should_cancel
        self.notes: list[str] = []

    def progress(self, stage: Stage, fraction: float, detail: str = "") -> None:
        self._on_event(Progress(stage, fraction, detail))

    def share(
        self, stage: Stage, part: float = 1.0, before: float = 0.0
    ) -> Callable[[float], None]:
        """What takes the share done of a part of a stage: it tells of it, or ends the work by
        `Cancelled`."""

        def on_share(share: float) -> None:
            self.stop_if_asked()
            self.progress(stage, before + part * share)

        return on_share

    def note(self, *sentences: str) -> None:
        """Keep what the person should read; each sentence once."""
        self.notes.extend(note for note in sentences if note not in self.notes)

    def stop_if_asked(self) -> None:
        """Between steps that cannot be interrupted themselves.

        Raises:
            Cancelled: if the person asked to stop.
        """
        if self.should_cancel():
            raise Cancelled


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
