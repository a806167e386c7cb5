"""All live sessions of the process: one worker makes their windows in turn."""

from __future__ import annotations

import secrets
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from app.errors import RunError, visitor_sentence
from app.live.session import Kept, LiveAsk, LiveSession, Tell, check_live, rehearse
from app.run.models import get_system

if TYPE_CHECKING:
    from model.generation.base import System

MAX_SESSIONS = 10
MAX_SESSIONS_EACH = 6
"""Of one address, so that the others have places left."""
KEEP_S = 600.0
"""How long the last minute of a session that has ended can still be kept."""
KEPT_SESSIONS = 20
FULL = (
    "{limit} visitors speak live on this machine already, and more would make all of them wait; "
    "try again in a few minutes."
)
FULL_EACH = (
    "{limit} visitors speak live from your address already, the most of one address; try again "
    "when one of them has ended."
)
TAKEN_OVER = "The live session goes on in another tab of this browser."
NOT_THERE = "There is no live minute to keep, or it was kept no longer; start the live session."


class LiveSessions:
    """Opens sessions, shares the machine among them, and finds them again."""

    def __init__(
        self,
        weights: Path,
        load: Callable[[str, Path], System] = get_system,
        max_sessions: int = MAX_SESSIONS,
        max_sessions_each: int = MAX_SESSIONS_EACH,
    ) -> None:
        self._weights, self._load, self._max_sessions = weights, load, max_sessions
        self._max_sessions_each = max_sessions_each
        self._changed = threading.Condition()
        self._turns: deque[LiveSession] = deque()
        """Open sessions; whoever has waited longest is first."""
        self._ended: deque[tuple[float, LiveSession]] = deque(maxlen=KEPT_SESSIONS)
        self._worker: threading.Thread | None = None
        self._rehearsed: set[str] = set()

    def open(
        self,
        ask: LiveAsk,
        cookie: str,
        tell: Tell,
        address: str = "",
    ) -> LiveSession:
        """A session for one browser; an earlier one of the same browser ends.

        Args:
            cookie: of the browser; empty for one that keeps none.
            address: of the visitor; empty where it is not known.

        Raises:
            RunError: when too many visitors are there, in all or of this address, or the system
                cannot be had live.
            UnknownNameError, CheckpointError: see `model.systems.registry.load_system`.
        """
        self._refuse_too_many(cookie, address)
        system = self._load(ask.system, self._weights)
        check_live(system)
        if ask.system not in self._rehearsed:
            rehearse(system, ask)
            self._rehearsed.add(ask.system)
        session = LiveSession(system, ask, cookie, tell, address=address)
        with self._changed:
            self._refuse_too_many(cookie, address)
            for other in [each for each in self._turns if cookie and each.cookie == cookie]:
                self._end(other, TAKEN_OVER)
            self._turns.append(session)
            self._start_worker()
        return session

    def put(self, session: LiveSession, content: bytes) -> None:
        """Sound for a session.

        Raises:
            RunError: see `LiveSession.put`.
        """
        session.put(content)
        with self._changed:
            self._changed.notify_all()

    def close(self, session: LiveSession, sentence: str = "") -> None:
        """The visitor has stopped, gone, or must."""
        with self._changed:
            self._end(session, sentence)

    def kept(self, token: str, cookie: str) -> tuple[LiveSession, Kept]:
        """The last minute of a session, open or ended lately, of this browser.

        Raises:
            RunError: if there is none.
        """
        with self._changed:
            self._forget_old()
            there = [*self._turns, *(session for _, session in self._ended)]
        for session in there:
            is_it = secrets.compare_digest(session.token.encode(), token.encode())
            if is_it and session.cookie == cookie:
                return session, session.kept()
        raise RunError(NOT_THERE)

    @property
    def num_open(self) -> int:
        return len(self._turns)

    def _refuse_too_many(self, cookie: str, address: str) -> None:
        others = [each for each in self._turns if not cookie or each.cookie != cookie]
        if len(others) >= self._max_sessions:
            raise RunError(FULL.format(limit=self._max_sessions))
        near = sum(each.address == address for each in others) if address else 0
        if near >= self._max_sessions_each:
            raise RunError(FULL_EACH.format(limit=self._max_sessions_each))

    def _end(self, session: LiveSession, sentence: str) -> None:
        if session in self._turns:
            self._turns.remove(session)
            self._ended.append((time.monotonic(), session))
        self._forget_old()
        session.end(sentence)

    def _forget_old(self) -> None:
        while self._ended and time.monotonic() - self._ended[0][0] > KEEP_S:
            self._ended.popleft()

    def _start_worker(self) -> None:
        """One thread with one thread of torch: windows are small, and others want to work too."""
        if self._worker is not None:
            return
        import torch

        has_begun = threading.Event()
        before = torch.get_num_threads()

        def work() -> None:
            torch.set_num_threads(1)
            has_begun.set()
            while True:
                self._turn()

        self._worker = threading.Thread(target=work, name="live", daemon=True)
        self._worker.start()
        has_begun.wait()
        torch.set_num_threads(before)  # what it set is also the start value of threads to come

    def _turn(self) -> None:
        """One window of whoever has waited longest and has work."""
        with self._changed:
            session = next((each for each in self._turns if each.has_work), None)
            if session is None:
                self._changed.wait(1.0)
                return
            self._turns.remove(session)
            self._turns.append(session)
            visitors = len(self._turns)
        try:
            session.work(visitors)
        except Exception as error:
            self.close(session, visitor_sentence(error))
