"""The way between all who speak live and the process that moves their bodies (`app.live.child`),
which decides who has a place."""

from __future__ import annotations

import itertools
import queue
import threading
from collections.abc import Callable
from pathlib import Path

from app.errors import RunError, without_folders
from app.live.sound import Microphone
from app.run.ask import Ask
from processes.child import Child, Gone

NOT_THERE = "There is no live minute to keep, or it was kept no longer; start the live session."
ENDED = "The process of live speech"
FOR_MEMORY, AGAIN = "choose a system that takes fewer steps", "start again"
Tell = Callable[[object], None]


class LiveSessions:
    """Safe to use from several threads; the process is there while anybody is, and a while more."""

    def __init__(self, weights: Path) -> None:
        self._weights = weights
        self._lock = threading.RLock()
        self._numbers = itertools.count()
        self._ears: dict[int, Tell] = {}
        self._microphones: dict[int, Microphone] = {}
        self._child: Child | None = None

    def wake(self) -> None:
        """Start the process, so that whoever is about to speak need not wait for it."""
        with self._lock:
            if self._child is None:
                self._child = Child("app.live.child", str(self._weights), is_log_handed_on=True)
                threading.Thread(target=self._listen, args=(self._child,), daemon=True).start()

    def open(self, told: object, cookie: str, tell: Tell, address: str = "") -> int:
        """A session for one browser, by its number.

        Args:
            told: what the browser asks for.
            tell: takes what a browser must know first, then frames as bytes and what is told beside
                them as an object, and as text the sentence with which it ends, at once where it
                cannot be.
        """
        number = self._ask(tell, "open", (told, cookie, address))
        self._microphones[number] = Microphone()
        return number

    def put(self, number: int, content: bytes) -> None:
        """Sound, judged before it goes on: nobody can send more than the process takes.

        Raises:
            RunError: see `Microphone.check`.
        """
        self._microphones[number].check(content)
        self._send(number, "sound", content)

    def lead(self, number: int, told: object) -> None:
        """The sliders have been moved."""
        self._send(number, "lead", told)

    def close(self, number: int) -> None:
        """The visitor has stopped or gone."""
        with self._lock:
            self._ears.pop(number, None)
            self._microphones.pop(number, None)
            self._send(number, "close")

    def keep(self, token: str, cookie: str, folder: Path) -> Ask:
        """A run of the last minute of a session, open or ended lately, of this browser; what that
        needs is laid into a folder.

        Raises:
            RunError: if there is none.
        """
        if self._child is None:
            raise RunError(NOT_THERE)
        answers: queue.SimpleQueue[object] = queue.SimpleQueue()
        number = self._ask(answers.put, "keep", (token, cookie, folder))
        answer = answers.get()
        self.close(number)
        if isinstance(answer, Ask):
            return answer
        raise RunError(str(answer))

    def end(self) -> None:
        """End the process; whoever is there is told."""
        if self._child is not None:
            self._child.end()

    def _ask(self, tell: Tell, verb: str, told: object) -> int:
        with self._lock:
            self.wake()
            number = next(self._numbers)
            self._ears[number] = tell
            self._send(number, verb, told)
        return number

    def _send(self, number: int, verb: str, told: object = None) -> None:
        if self._child is not None:
            self._child.send((number, verb, told))

    def _listen(self, child: Child) -> None:
        try:
            while True:
                number, told = child.receive()
                tell = self._ears.get(number)
                if tell is not None:
                    tell(told)
        except Gone:
            why = without_folders(child.ended().sentences(ENDED, FOR_MEMORY, AGAIN))
        with self._lock:
            self._child = None
            ears, self._ears = self._ears, {}
        child.end()
        for tell in ears.values():
            tell(why)
