"""Runs whose gestures can be edited, each by the browser that asked for it."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.page.player.player import Showing
from app.page.visitors.visitors import is_same
from app.run.requests.request import GenerateRequest


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

    def say(self, sentence: str = "", *, is_refused: bool = False, state: str = "") -> None:
        """Have the editor say something beside all that it knows.

        Args:
            state: ``waiting`` or ``working`` while a take is made.
        """
        self.showing.editing = {"said": sentence, "refused": is_refused, "state": state}


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
