"""The encoder's features of speech that is still being spoken.

They are those of `model.speech.features` but for the voice that they are relative to: a clip's is
known when it is over, a speaker's is told from what was said so far. Sound is heard in blocks of
100 ms (3 motion frames, 10 hops), as soon as 27 ms after a block are there: half of the window in
which a pitch is found.
"""

from collections import deque
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float32

from conventions.rates import FPS, SAMPLE_RATE
from model.speech.features import (
    HOP,
    PITCH_WINDOW,
    Hops,
    MelEncoder,
    Voice,
    analysed,
    average_over_frames,
    columns_of,
)

BLOCK_FRAMES = 3
BLOCK_SAMPLES = BLOCK_FRAMES * SAMPLE_RATE // FPS
LOOK_AHEAD = PITCH_WINDOW // 2 - HOP // 2
"""Samples after a block that its features need."""
_KEPT_BEFORE = PITCH_WINDOW // HOP
"""Hops whose sound the window of the first one still reaches, and one more for its onset."""


class RunningVoice:
    """The voice of the last half minute of voiced sound; silence and noise do not change it.

    It begins with half a second of a usual voice, so that the first word is neither shouted nor
    whispered.
    """

    KEPT_HOPS = 3000
    START_HOPS = 50
    START = Voice(level_db=28.0, pitch=7.3)
    """Loud parts at -18 dB of full scale; 158 Hz."""
    QUIETEST_DB = 0.0
    """-46 dB of full scale: what is quieter stays quiet, however long nothing else is heard."""
    PERCENTILE = 85.0
    """Of voiced hops: about the `SPEECH_PERCENTILE` of all hops of speech with its pauses."""

    def __init__(self) -> None:
        start = [self.START.level_db] * self.START_HOPS, [self.START.pitch] * self.START_HOPS
        self._energy = deque(start[0], maxlen=self.KEPT_HOPS)
        self._pitch = deque(start[1], maxlen=self.KEPT_HOPS)
        self._voice = self.START

    def voice(self, hops: Hops) -> Voice:
        """The voice as of these hops, which follow those of the call before."""
        voiced: Bool[np.ndarray, " hops"] = hops.voiced(self._voice.level_db)
        if voiced.any():
            self._energy.extend(hops.energy[voiced].tolist())
            self._pitch.extend(hops.pitch[voiced].tolist())
            level_db = float(np.percentile(self._energy, self.PERCENTILE))
            pitch = float(np.median(self._pitch))
            self._voice = Voice(max(level_db, self.QUIETEST_DB), pitch)
        return self._voice


class CausalMel:
    """`MelEncoder` for sound that arrives in blocks. What it has said never changes."""

    def __init__(self, voice_of: Callable[[Hops], Voice] | None = None) -> None:
        """
        Args:
            voice_of: what voice is heard as of the next hops; by default that of a `RunningVoice`.
        """
        self._voice_of = voice_of or RunningVoice().voice
        self._sound = np.zeros(0, np.float32)
        self._first_hop = 0
        """Of the sound that is kept."""
        self._next_hop = 0

    def hear(self, samples: Float32[np.ndarray, " N"]) -> Float32[np.ndarray, "frames 68"]:
        """Features of the frames that are known with this sound, and were not before it.

        Args:
            samples: the next of 16 kHz mono, any number.
        """
        self._sound = np.concatenate([self._sound, samples])
        there = self._first_hop * HOP + len(self._sound)
        blocks = (there - LOOK_AHEAD) // BLOCK_SAMPLES - self._next_hop * HOP // BLOCK_SAMPLES
        rows = [self._next_block() for _ in range(blocks)]
        none = np.zeros((0, MelEncoder.dim), np.float32)
        return np.concatenate([none, *rows])

    def _next_block(self) -> Float32[np.ndarray, "3 68"]:
        hops = BLOCK_SAMPLES // HOP
        start = self._next_hop - self._first_hop
        before = min(1, start)  # the hop that onset and steadiness of the first are seen from
        found = analysed(self._sound, start - before, start + hops)
        new = Hops(*(values[before:] for values in vars(found).values()))
        columns = columns_of(found, self._voice_of(new))[before:]
        self._next_hop += hops
        self._drop_before(self._next_hop - _KEPT_BEFORE)
        silence = np.zeros(MelEncoder.dim)  # none is needed: a block's hops are its frames'
        return average_over_frames(columns, BLOCK_FRAMES, silence).astype(np.float32)

    def _drop_before(self, hop: int) -> None:
        if hop > self._first_hop:
            self._sound = self._sound[(hop - self._first_hop) * HOP :]
            self._first_hop = hop
