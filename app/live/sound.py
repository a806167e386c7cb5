"""What comes from a microphone, judged before anybody computes with it."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from app.errors import RunError
from conventions.rates import SAMPLE_RATE

MAX_SOUND_BYTES = 32_000
"""Of one message: a second."""


def read_sound(content: bytes) -> np.ndarray:
    """Samples between -1 and 1.

    Raises:
        RunError: if these are no such bytes, or more than a second of sound.
    """
    if not content or len(content) % 2:
        raise RunError("The sound that came is damaged; start again.")
    if len(content) > MAX_SOUND_BYTES:
        raise RunError(
            f"A block of sound has {len(content)} bytes; at most {MAX_SOUND_BYTES} are taken."
        )
    return np.frombuffer(content, "<i2").astype(np.float32) / 32_768


MAX_S = 30 * 60.0
"""Of sound in one session."""
AHEAD_S = 3.0
"""How much more sound than time may have come: networks gather and let go."""
WATCHED_S = 20.0
"""A session that sends sound for less than a quarter of such a time does not need its place."""
QUIET_S = 180.0
"""Without any sound that could be heard, a microphone has been forgotten."""
AUDIBLE = 0.001
"""Of full scale, -60 dB; what a microphone that is switched off stays below."""

TOO_LONG = "A live session lasts at most {minutes:g} minutes; start another one."
TOO_FAST = "Sound came faster than it can be spoken; start again."
TOO_LITTLE = (
    "Only {came:.1f} s of sound came in the last {seconds:.0f} s, and live speech needs all of it: "
    "look after your connection, then start again."
)
TOO_QUIET = (
    "Nothing could be heard for {minutes:g} minutes, and others may wait for the place: look after "
    "your microphone, then start again."
)


class Microphone:
    """Of one session."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._samples = 0
        self._begun = self._watched_since = self._heard_at = clock()
        self._watched_samples = 0

    def check(self, content: bytes) -> None:
        """Take the next sound for what it is.

        Raises:
            RunError: if it is no sound, too much or too fast, or if next to none has come lately.
        """
        samples, now = read_sound(content), self._clock()
        if not self._samples:  # the models may have taken long to be read
            self._watched_since = now
        self._samples += len(samples)
        spoken_s = self._samples / SAMPLE_RATE
        if spoken_s > MAX_S:
            raise RunError(TOO_LONG.format(minutes=MAX_S / 60))
        if spoken_s > now - self._begun + AHEAD_S:
            raise RunError(TOO_FAST)
        if np.abs(samples).max() > AUDIBLE:
            self._heard_at = now
        elif now - self._heard_at > QUIET_S:
            raise RunError(TOO_QUIET.format(minutes=QUIET_S / 60))
        self._watched_samples += len(samples)
        watched_s = now - self._watched_since
        if watched_s >= WATCHED_S:
            came_s = self._watched_samples / SAMPLE_RATE
            if came_s < watched_s / 4:
                raise RunError(TOO_LITTLE.format(came=came_s, seconds=watched_s))
            self._watched_since, self._watched_samples = now, 0
