"""The process of all live sessions: sound comes in, frames go out, one window after the other.

It ends by itself when nobody has asked for anything for as long as a last minute is kept.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import torch

from app.errors import RunError, visitor_sentence
from app.live.session import LiveSession, check_live, rehearse
from app.live.sessions import KEEP_S, NOT_THERE
from app.run.models import get_system
from model.generation.base import System
from model.systems.registry import usual_systems
from processes.child import parent_channel


class Performers:
    """Gives every session its turn. Sessions are known by numbers."""

    def __init__(self, weights: Path, tell: Callable[[int, object], None]) -> None:
        """
        Args:
            tell: takes a number and what is for whoever has it: frames as bytes, what is told
                beside them as an object, and as text the sentence with which it ends.
        """
        self._weights, self._tell = weights, tell
        self.open: dict[int, LiveSession] = {}
        """Whoever has waited longest is first."""
        self._ended: dict[int, LiveSession] = {}
        self._prepared: set[str] = set()

    def take(self, number: int, verb: str, told: Any) -> None:
        """What the page says."""
        session = self.open.get(number)
        try:
            match verb:
                case "open":
                    ask, token = told
                    system = self.prepare(ask.systems[0], ask.speaker)
                    session = LiveSession(system, ask, partial(self._tell, number))
                    self.open[number] = session
                    self._tell(number, {"token": token, **session.ready()})
                case "sound" if session is not None:
                    session.put(told)
                case "lead" if session is not None:
                    session.lead(told)
                case "close" if session is not None:
                    self._ended[number] = self.open.pop(number)
                case "forget":
                    self._ended.pop(number, None)
                case "keep":
                    of, folder = told
                    kept = self.open.get(of) or self._ended.get(of)
                    if kept is None:
                        raise RunError(NOT_THERE)
                    self._tell(number, kept.keep(folder))
        except Exception as error:
            self._end(number, error)

    def turn(self) -> bool:
        """One window of whoever has waited longest and has work; whether anybody had."""
        number = next((each for each, session in self.open.items() if session.has_work), None)
        if number is None:
            return False
        session = self.open[number] = self.open.pop(number)
        try:
            session.work(len(self.open))
        except Exception as error:
            self._end(number, error)
        return True

    def prepare(self, name: str, speaker: str = "") -> System:
        """Read a system, and make a first window with it, so that no visitor waits for what is slow
        only once.

        Raises:
            RunError, UnknownNameError, CheckpointError: if it cannot be had live.
        """
        system = get_system(name, self._weights)
        check_live(system)
        if name not in self._prepared:
            rehearse(system, speaker or next(iter(system.speakers)))
            self._prepared.add(name)
        return system

    def _end(self, number: int, error: Exception) -> None:
        if number in self.open:
            self._ended[number] = self.open.pop(number)
        self._tell(number, visitor_sentence(error))


def main() -> None:
    """Do what the page says, and make windows in between."""
    torch.set_num_threads(1)  # windows are small, and others want to work too
    channel, (weights,) = parent_channel()
    performers = Performers(Path(weights), lambda number, told: channel.send((number, told)))
    with suppress(Exception):  # whoever asks for one is told why
        for name in usual_systems("live"):
            performers.prepare(name)
    has_work = False
    try:
        while channel.poll(0.0 if has_work else KEEP_S) or has_work or performers.open:
            while channel.poll(0.0):
                performers.take(*channel.recv())
            has_work = performers.turn()
    except (EOFError, OSError):
        return  # the page has ended


if __name__ == "__main__":
    main()
