"""Runs whose gestures can be edited, each by the browser that asked for it, and their takes."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from app.page.player.player import Showing
from app.page.visitors.visitors import is_same
from app.run.requests.request import GenerateRequest
from app.run.takes.take import Take
from model.speech.transcript import Word

MAX_TAKES = 60
"""Of one run."""


@dataclass(frozen=True)
class KeptTake:
    """A motion that edits can start from: one of the run's own, or a take."""

    take: Take
    of: str
    """The run's own row."""
    start: str = ""
    """The row whose plan was changed; empty of the run's own."""


@dataclass(eq=False)
class EditedRun:
    """One run, and what has become of it. Safe to use from several threads."""

    name: str
    cookie: str
    """Of the browser that asked for it; empty for one that keeps none, whose page alone knows the
    run's name."""
    folder: Path
    """It is there for as long as this is."""
    request: GenerateRequest
    showing: Showing
    known: dict[str, KeptTake] = field(default_factory=dict)
    """By row."""
    _numbers: Any = field(default_factory=lambda: itertools.count(1))

    def next_number(self) -> int:
        """Of a take; none comes twice, so that no browser takes one for another."""
        return next(self._numbers)

    def keep(self, row: str, kept: KeptTake) -> None:
        self.known[row] = kept

    @property
    def words(self) -> tuple[Word, ...]:
        """Of its speech."""
        return tuple(Word(*word) for word in self.showing.timeline().get("words", ()))

    @property
    def num_takes(self) -> int:
        return sum(1 for kept in self.known.values() if kept.start)

    def say(self, sentence: str = "", *, is_refused: bool = False, state: str = "") -> None:
        """Have the editor say something beside all that it knows.

        Args:
            state: ``waiting`` or ``working`` while a take is made.
        """
        self.showing.editing = {
            "rows": self.showing.performed(),
            "known": {row: self._told(kept) for row, kept in list(self.known.items())},
            "said": sentence,
            "refused": is_refused,
            "state": state,
        }

    def _told(self, kept: KeptTake) -> dict[str, Any]:
        return {
            "of": kept.of,
            "from": kept.start,
            "told": self.showing.address(kept.take.told),
            "fresh": [[round(a, 3), round(b, 3)] for a, b in kept.take.fresh_s],
        }


class EditedRuns:
    """All of them. Safe to use from several threads."""

    def __init__(self) -> None:
        self._runs: dict[str, EditedRun] = {}
        self._lock = threading.Lock()

    def keep(
        self, cookie: str, folder: Path, request: GenerateRequest, showing: Showing
    ) -> EditedRun | None:
        """A run that has ended; None of one that performed no plan.

        Args:
            request: with a speech that is there for as long as the folder.
        """
        if not showing.performed():
            return None
        run = EditedRun(folder.name, cookie, folder, request, showing)
        with self._lock:
            for name in [name for name, one in self._runs.items() if not one.folder.is_dir()]:
                del self._runs[name]
            self._runs[run.name] = run
        run.say()
        return run

    def find(self, name: str, cookie: str) -> EditedRun | None:
        """None of a run that is another browser's, or kept no longer."""
        with self._lock:
            run = self._runs.get(name)
        if run is None or not run.folder.is_dir():
            return None
        return run if not run.cookie or is_same(run.cookie, cookie) else None


def own_speech(request: GenerateRequest, form: Mapping[str, Any]) -> Path:
    """Where a run's speech stays under its own name, as `kept_values` has left it."""
    return Path(form.get("speech") or request.speech)
