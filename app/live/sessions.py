"""The places of all who speak live, and the process that moves their bodies."""

from __future__ import annotations

import itertools
import queue
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from app.errors import RunError, without_folders
from app.live.sound import Microphone
from app.run.ask import Ask
from processes.child import Child, Gone

MAX_SESSIONS = 10
MAX_SESSIONS_EACH = 6
"""Of one address, so that the others have places left."""
KEPT_SESSIONS = 20
KEEP_S = 600.0
"""How long the last minute of a session that has ended can still be kept."""
NOT_THERE = "There is no live minute to keep, or it was kept no longer; start the live session."
SEED_LIMIT = 2**31 - 1
FULL = (
    "{limit} visitors speak live on this machine already, and more would make all of them wait; "
    "try again in a few minutes."
)
FULL_EACH = (
    "{limit} visitors speak live from your address already, the most of one address; try again "
    "when one of them has ended."
)
TAKEN_OVER = "The live session goes on in another tab of this browser."
ENDED = "The process of live speech"
FOR_MEMORY, AGAIN = "choose a system that takes fewer steps", "start again"
Tell = Callable[[object], None]


def live_ask(told: Any) -> Ask:
    """From the first message of a browser.

    Raises:
        RunError: if that asks for nothing that can be.
    """
    if not isinstance(told, dict):
        raise RunError("The page asked for no live session; load it again.")
    system, speaker, seed = (told.get(key) for key in ("system", "speaker", "seed"))
    if not isinstance(system, str) or not isinstance(speaker, str):
        raise RunError("Choose a system and a speaker style first.")
    if not isinstance(seed, int) or isinstance(seed, bool) or not 0 <= seed <= SEED_LIMIT:
        raise RunError(f"The seed must be a whole number from 0 to {SEED_LIMIT}.")
    return Ask(out=Path(), systems=(system,), speaker=speaker, seed=seed)


@dataclass(eq=False)
class Place:
    """One visitor's."""

    number: int
    ask: Ask
    cookie: str
    """Of the browser; empty for one that keeps none."""
    address: str
    """Of the visitor; empty where it is not known."""
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32))
    microphone: Microphone = field(default_factory=Microphone)


class LiveSessions:
    """Safe to use from several threads; the process is there while anybody is, and a while more."""

    def __init__(
        self,
        weights: Path,
        max_sessions: int = MAX_SESSIONS,
        max_sessions_each: int = MAX_SESSIONS_EACH,
    ) -> None:
        self._weights, self._max_sessions = weights, max_sessions
        self._max_sessions_each = max_sessions_each
        self._lock = threading.RLock()
        self._numbers = itertools.count()
        self.places: list[Place] = []
        self._ended: deque[tuple[float, Place]] = deque()
        self._ears: dict[int, Tell] = {}
        self._child: Child | None = None

    def wake(self) -> None:
        """Start the process, so that whoever is about to speak need not wait for it."""
        with self._lock:
            if self._child is None:
                self._child = Child("app.live.child", str(self._weights), is_log_handed_on=True)
                threading.Thread(target=self._listen, args=(self._child,), daemon=True).start()

    def open(self, ask: Ask, cookie: str, tell: Tell, address: str = "") -> Place:
        """A place for one browser; an earlier one of the same browser ends.

        Args:
            tell: takes what a browser must know first, then frames as bytes and what is told beside
                them as an object, and as text the sentence with which it ends.

        Raises:
            RunError: when too many visitors are there, in all or of this address.
        """
        with self._lock:
            others = [each for each in self.places if not cookie or each.cookie != cookie]
            if len(others) >= self._max_sessions:
                raise RunError(FULL.format(limit=self._max_sessions))
            near = sum(each.address == address for each in others) if address else 0
            if near >= self._max_sessions_each:
                raise RunError(FULL_EACH.format(limit=self._max_sessions_each))
            for other in [each for each in self.places if each not in others]:
                self.close(other, TAKEN_OVER)
            place = Place(next(self._numbers), ask, cookie, address)
            self.places.append(place)
            self._ask(place.number, tell, "open", (ask, place.token))
        return place

    def put(self, place: Place, content: bytes) -> None:
        """Sound.

        Raises:
            RunError: see `Microphone.check`.
        """
        place.microphone.check(content)
        self._send(place.number, "sound", content)

    def lead(self, place: Place, told: object) -> None:
        """The sliders have been moved."""
        self._send(place.number, "lead", told)

    def close(self, place: Place, sentence: str = "") -> None:
        """The visitor has stopped, gone, or must."""
        with self._lock:
            if place not in self.places:
                return
            self.places.remove(place)
            self._ended.append((time.monotonic(), place))
            self._forget_old()
            self._send(place.number, "close")
            tell = self._ears.pop(place.number, None)
        if tell is not None:
            tell(sentence)

    def keep(self, token: str, cookie: str, folder: Path) -> Ask:
        """A run of the last minute of a session, open or ended lately, of this browser; what that
        needs is laid into a folder.

        Raises:
            RunError: if there is none.
        """
        with self._lock:
            self._forget_old()
            there = [*self.places, *(place for _, place in self._ended)]
        for place in there:
            is_it = secrets.compare_digest(place.token.encode(), token.encode())
            if is_it and place.cookie == cookie:
                return self._kept(place, folder)
        raise RunError(NOT_THERE)

    def end(self) -> None:
        """End the process; whoever is there is told."""
        if self._child is not None:
            self._child.end()

    def _kept(self, place: Place, folder: Path) -> Ask:
        answers: queue.SimpleQueue[object] = queue.SimpleQueue()
        with self._lock:
            number = next(self._numbers)
            self._ask(number, answers.put, "keep", (place.number, folder))
        answer = answers.get()
        with self._lock:
            self._ears.pop(number, None)
        if isinstance(answer, Ask):
            return answer
        raise RunError(str(answer))

    def _ask(self, number: int, tell: Tell, verb: str, told: object) -> None:
        self.wake()
        self._ears[number] = tell
        self._send(number, verb, told)

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

    def _forget_old(self) -> None:
        while self._ended and (
            time.monotonic() - self._ended[0][0] > KEEP_S or len(self._ended) > KEPT_SESSIONS
        ):
            self._send(self._ended.popleft()[1].number, "forget")
