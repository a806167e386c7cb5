"""Process of all live sessions: sound in, frames out; it exits after `KEEP_S` without use."""

from __future__ import annotations

import secrets
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import torch

from app.errors import RunError, visitor_message
from app.live.session import LiveSession, check_supports_live, warm_up
from app.live.sessions import NOT_THERE, decode_audio
from app.run.models import get_system
from app.run.requests.parts import SamplingOptions
from app.run.requests.requests import GenerateRequest
from model.generation.base import System
from model.systems.registry import representatives
from processes.child import parent_channel

MAX_SESSIONS = 10
MAX_SESSIONS_PER_ADDRESS = 6
"""Most sessions of one address, so that other visitors find places."""
MAX_ENDED_SESSIONS = 20
KEEP_S = 600.0
"""Time (s) for which the last minute of an ended session stays available."""
SEED_LIMIT = 2**31 - 1
MACHINE_FULL = (
    "{limit} live sessions are already running on this server, and more would delay all of them. "
    "Try again in a few minutes."
)
FULL_EACH = (
    "Your network address already has {limit} live sessions; the limit is {limit}. Try again "
    "when one has ended."
)
TAKEN_OVER = "The live session continues in another tab of this browser."


def parse_live_options(message: Any) -> SamplingOptions:
    """Parse the sampling options of a browser's first message; raises RunError if invalid."""
    if not isinstance(message, dict):
        raise RunError("The page sent an invalid request for a live session. Please reload it.")
    system, speaker, seed = (message.get(key) for key in ("system", "speaker", "seed"))
    if not isinstance(system, str) or not isinstance(speaker, str):
        raise RunError("Choose a system and a speaker style first.")
    if not isinstance(seed, int) or isinstance(seed, bool) or not 0 <= seed <= SEED_LIMIT:
        raise RunError(f"The seed must be a whole number from 0 to {SEED_LIMIT}.")
    return SamplingOptions(systems=(system,), speaker=speaker, seed=seed)


class SessionScheduler:
    """All open and recently ended sessions by number; generates their windows in turn."""

    def __init__(self, weights: Path, tell: Callable[[int, object], None]) -> None:
        """Make an empty set of sessions.

        ``tell`` takes a session's number and a message: frames as bytes, other messages as an
        object, and text for the sentence with which the session ends.
        """
        self._weights, self._tell = weights, tell
        self.open: dict[int, LiveSession] = {}
        """Open sessions by number, the one that has waited longest first."""
        self.ended: deque[LiveSession] = deque(maxlen=MAX_ENDED_SESSIONS)
        self._prepared: set[str] = set()

    def handle_message(self, number: int, verb: str, content: Any) -> None:
        """Handle a message of the page: ``open``, ``sound``, ``lead``, ``close`` or ``keep``."""
        while self.ended and time.monotonic() - self.ended[0].ended_at > KEEP_S:
            self.ended.popleft()
        session = self.open.get(number)
        try:
            match verb:
                case "open":
                    self._open(number, *content)
                case "sound" if session is not None:
                    session.add_audio(decode_audio(content))
                case "lead" if session is not None:
                    session.set_style(content)
                case "close" if session is not None:
                    self._leave(number)
                case "keep":
                    self._tell(number, self._save_recording(*content))
        except Exception as error:
            self._end(number, visitor_message(error))

    def _open(self, number: int, message: Any, cookie: str, address: str) -> None:
        """Open a session for a browser; an earlier session of the same browser ends."""
        options = parse_live_options(message)
        mine = {each for each, of in self.open.items() if cookie and of.cookie == cookie}
        others = [of for each, of in self.open.items() if each not in mine]
        if len(others) >= MAX_SESSIONS:
            raise RunError(MACHINE_FULL.format(limit=MAX_SESSIONS))
        near = sum(of.address == address for of in others) if address else 0
        if near >= MAX_SESSIONS_PER_ADDRESS:
            raise RunError(FULL_EACH.format(limit=MAX_SESSIONS_PER_ADDRESS))
        for each in mine:
            self._end(each, TAKEN_OVER)
        system = self.load_and_warm_up(options.systems[0], options.speaker or "")
        session = LiveSession(system, options, partial(self._tell, number))
        session.cookie, session.address = cookie, address
        self.open[number] = session
        self._tell(number, {"token": session.token, **session.ready_message()})

    def _save_recording(self, token: str, cookie: str, folder: Path) -> GenerateRequest:
        for session in (*self.open.values(), *self.ended):
            is_it = secrets.compare_digest(session.token.encode(), token.encode())
            if is_it and session.cookie == cookie:
                return session.save_last_minute(folder)
        raise RunError(NOT_THERE)

    def generate_next_window(self) -> bool:
        """Generate one window for the longest waiting session; return whether one had work."""
        number = next((each for each, of in self.open.items() if of.has_work), None)
        if number is None:
            return False
        session = self.open[number] = self.open.pop(number)
        try:
            session.process_input(len(self.open))
        except Exception as error:
            self._end(number, visitor_message(error))
        return True

    def load_and_warm_up(self, name: str, speaker: str | None = None) -> System:
        """Load a system and generate a first window, so that no visitor waits for one-time costs.

        Raises RunError, UnknownNameError or CheckpointError if the system cannot be used live.
        """
        system = get_system(name, self._weights)
        check_supports_live(system)
        if name not in self._prepared:
            warm_up(system, speaker or next(iter(system.speakers)))
            self._prepared.add(name)
        return system

    def _leave(self, number: int) -> None:
        if number in self.open:
            session = self.open.pop(number)
            session.ended_at = time.monotonic()
            self.ended.append(session)

    def _end(self, number: int, sentence: str) -> None:
        self._leave(number)
        self._tell(number, sentence)


def main() -> None:
    """Handle messages of the page, and generate windows in between."""
    torch.set_num_threads(1)  # windows are small, and other processes need cores
    channel, (weights,) = parent_channel()
    performers = SessionScheduler(Path(weights), lambda *answer: channel.send(answer))
    with suppress(Exception):  # the error is reported to the visitor who opens one
        for name in representatives("streaming"):
            performers.load_and_warm_up(name)
    has_work = False
    try:
        while channel.poll(0.0 if has_work else KEEP_S) or has_work or performers.open:
            while channel.poll(0.0):
                performers.handle_message(*channel.recv())
            has_work = performers.generate_next_window()
    except (EOFError, OSError):
        return  # the page has ended


if __name__ == "__main__":
    main()
