"""Connections of browsers to the live process (`app.live.session_process`), with audio checks."""

from __future__ import annotations

import itertools
import queue
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from app.errors import RunError, without_folders
from app.run.requests.requests import GenerateRequest
from conventions.rates import SAMPLE_RATE
from processes.child import Child, ChildExited

NOT_THERE = "There is no live recording to save, or it has expired. Start a live session."
SESSIONS_ENDED = "The live generation process"
MEMORY_ADVICE, RETRY_ADVICE = "choose a system with fewer sampling steps", "start again"
MessageCallback = Callable[[object], None]


MAX_SOUND_BYTES = 32_000
"""Largest message of sound: one second."""


def decode_audio(content: bytes) -> np.ndarray:
    """Parse at most a second of 16-bit samples as floats from -1 to 1; raises RunError."""
    if not content or len(content) % 2:
        raise RunError("The received audio is damaged. Start again.")
    if len(content) > MAX_SOUND_BYTES:
        raise RunError(
            f"A block of audio has {len(content)} bytes; the limit is {MAX_SOUND_BYTES}."
        )
    return np.frombuffer(content, "<i2").astype(np.float32) / 32_768


MAX_S = 30 * 60.0
"""Longest sound of one session (s)."""
MAX_AHEAD_S = 3.0
"""Sound (s) that may arrive ahead of real time, as networks deliver in bursts."""
SOUND_ARRIVAL_WINDOW_S = 20.0
"""Interval (s) in which sound for at least a quarter must arrive; else the session is ended."""
QUIET_S = 180.0
"""Longest silence (s), after which the microphone counts as forgotten."""
SILENCE_LEVEL = 0.001
"""Amplitude of full scale (-60 dB) below which sound is silence, as of a muted microphone."""

TOO_LONG = "A live session lasts at most {minutes:g} minutes; start another one."
TOO_FAST = (
    "The audio is {ahead:.1f} s ahead of real time; at most {limit:g} s are allowed. Use a live "
    "microphone, then start again."
)
TOO_LITTLE = (
    "Only {came:.1f} s of audio arrived in the last {seconds:.0f} s; live generation needs audio "
    "without gaps. Check your connection, then start again."
)
TOO_QUIET = (
    "There was no sound for {minutes:g} minutes. The session was closed because others may be "
    "waiting. Check your microphone, then start again."
)


class AudioGuard:
    """Check of the sound of one session: amount, rate and silence."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._samples = 0
        self._begun = self._watched_since = self._last_message_at = clock()
        self._watched_samples = 0

    def check(self, content: bytes) -> None:
        """Check form, amount, pace and loudness of a block of sound; raises RunError."""
        samples, now = decode_audio(content), self._clock()
        if not self._samples:  # loading the models may have taken long
            self._watched_since = now
        self._samples += len(samples)
        spoken_s = self._samples / SAMPLE_RATE
        if spoken_s > MAX_S:
            raise RunError(TOO_LONG.format(minutes=MAX_S / 60))
        if spoken_s > now - self._begun + MAX_AHEAD_S:
            ahead_s = spoken_s - (now - self._begun)
            raise RunError(TOO_FAST.format(ahead=ahead_s, limit=MAX_AHEAD_S))
        if np.abs(samples).max() > SILENCE_LEVEL:
            self._last_message_at = now
        elif now - self._last_message_at > QUIET_S:
            raise RunError(TOO_QUIET.format(minutes=QUIET_S / 60))
        self._watched_samples += len(samples)
        watched_s = now - self._watched_since
        if watched_s >= SOUND_ARRIVAL_WINDOW_S:
            came_s = self._watched_samples / SAMPLE_RATE
            if came_s < watched_s / 4:
                raise RunError(TOO_LITTLE.format(came=came_s, seconds=watched_s))
            self._watched_since, self._watched_samples = now, 0


class LiveSessions:
    """Thread-safe access to all live sessions; starts and ends their process."""

    def __init__(self, weights: Path) -> None:
        self._weights = weights
        self._lock = threading.RLock()
        self._numbers = itertools.count()
        self._callbacks: dict[int, MessageCallback] = {}
        self._microphones: dict[int, AudioGuard] = {}
        self._child: Child | None = None

    def start_process(self) -> None:
        """Start the process in advance, so that the first session need not wait for it."""
        with self._lock:
            if self._child is None:
                self._child = Child(
                    "app.live.session_process", str(self._weights), is_log_handed_on=True
                )
                threading.Thread(target=self._listen, args=(self._child,), daemon=True).start()

    def open(
        self, message: object, cookie: str, on_message: MessageCallback, address: str = ""
    ) -> int:
        """Open a session for one browser, and return its number.

        ``on_message`` takes the session's settings first, then frames as bytes, other messages as
        an object, and as text the sentence with which the session ends.
        """
        number = self._ask(on_message, "open", (message, cookie, address))
        self._microphones[number] = AudioGuard()
        return number

    def add_audio(self, number: int, content: bytes) -> None:
        """Check sound as `AudioGuard`, which limits what the process handles, and pass it on."""
        self._microphones[number].check(content)
        self._send(number, "sound", content)

    def set_style(self, number: int, message: object) -> None:
        """Set the style sliders of a session."""
        self._send(number, "lead", message)

    def close(self, number: int) -> None:
        """Close a session when its visitor has stopped or left."""
        with self._lock:
            self._callbacks.pop(number, None)
            self._microphones.pop(number, None)
            self._send(number, "close")

    def save_last_minute(self, token: str, cookie: str, folder: Path) -> GenerateRequest:
        """Make the request for a run of a session's last minute, with its files in a folder.

        The session must be open or have ended lately, and belong to this browser, else RunError.
        """
        if self._child is None:
            raise RunError(NOT_THERE)
        answers: queue.SimpleQueue[object] = queue.SimpleQueue()
        number = self._ask(answers.put, "keep", (token, cookie, folder))
        answer = answers.get()
        self.close(number)
        if isinstance(answer, GenerateRequest):
            return answer
        raise RunError(str(answer))

    def end_process(self) -> None:
        """End the process; open sessions get a message."""
        if self._child is not None:
            self._child.kill()

    def _ask(self, on_message: MessageCallback, verb: str, content: object) -> int:
        with self._lock:
            self.start_process()
            number = next(self._numbers)
            self._callbacks[number] = on_message
            self._send(number, verb, content)
        return number

    def _send(self, number: int, verb: str, content: object = None) -> None:
        if self._child is not None:
            self._child.send((number, verb, content))

    def _listen(self, child: Child) -> None:
        try:
            while True:
                number, message = child.receive()
                tell = self._callbacks.get(number)
                if tell is not None:
                    tell(message)
        except ChildExited:
            why = without_folders(
                child.exit_report().user_message(SESSIONS_ENDED, MEMORY_ADVICE, RETRY_ADVICE)
            )
        with self._lock:
            self._child = None
            callbacks, self._callbacks = self._callbacks, {}
        child.kill()
        for tell in callbacks.values():
            tell(why)
