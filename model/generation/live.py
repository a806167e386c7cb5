"""Streaming generation for speech that is still being spoken, 0.3 s at a time.

A whole window and the context after it are almost 3 s. Here a window is generated as soon as a few
frames of new speech are available: it starts from the last final frames, and only those of its
frames become final that have speech. Future speech is replaced by the mirror image of past speech:
speech that goes on much as it did, rather than a silence that would end every gesture.

`gan/5` on two recordings of BEAT2: with a look-ahead of 8 to 12 frames, wrists were 8 to 12 mm from
their place with all of the speech and the same noise (another seed: 165 mm), the jaw's angle
correlated with that at 0.95 to 0.99 (4 frames: 0.81); silence in place of the mirror image: 20 mm.
"""

from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from model.generation import windows
from model.generation.base import ConditionStream, MotionConstraint, SpeechWindow, System, Window
from model.generation.windows import GenerateOptions, MotionAssembler, WindowChain
from model.motion.motion import Motion

CONDITION_MARGIN = 12
"""Frames after a window for which there is still a condition."""


@dataclass(frozen=True)
class Pace:
    """Latency settings of streaming generation."""

    min_hop: int = 9
    """Fewest new frames per window; speech features arrive three at a time."""
    look_ahead: int = 9
    """Look-ahead: frames of speech after the last final frame, at least the overlap of windows."""


class LiveGenerator:
    """Streaming generator for one speaker with constant memory.

    Raises:
        UnknownNameError, ValueError: see `generate_motion`; also if the pace does not suit the
            system's windows.
    """

    def __init__(self, system: System, options: GenerateOptions, pace: Pace = Pace()) -> None:
        cut = system.windowing
        if not cut.overlap <= pace.min_hop <= cut.advance or pace.look_ahead < cut.overlap:
            raise ValueError(
                f"{system.name} needs a hop of {cut.overlap} to {cut.advance} frames and a "
                f"look_ahead of at least {cut.overlap}; got {pace.min_hop} and {pace.look_ahead}."
            )
        self._cut, self._pace = cut, pace
        self._chain = WindowChain(system, options)
        self._stream: ConditionStream | None = None
        """Generator of the condition; None for a system without one."""
        self.ahead: Any = None
        """Condition around the latest window."""
        self._constraint: MotionConstraint | None = None
        if system.condition_type is not None:
            self._stream = system.condition_stream(windows.first_window_spec(system, options))
            self._constraint = system.make_constraint(None)
        self._motion = MotionAssembler(system, constraint=self._constraint)
        self._speech: Float[Tensor, "kept dim"] = torch.zeros(0, system.encoder.dim)
        self._first = 0
        """Frame at which the stored speech begins."""
        self.next_frame = 0
        """First frame that is not final."""

    @property
    def num_speech_frames(self) -> int:
        """Number of frames of speech received so far."""
        return self._first + len(self._speech)

    @property
    def num_generatable_frames(self) -> int:
        """Frames that could become final at once; negative before there is enough speech."""
        return self.num_speech_frames - self._pace.look_ahead - self.next_frame

    @property
    def is_due(self) -> bool:
        """True if enough speech is there for the next window."""
        return self.num_generatable_frames >= self._pace.min_hop

    def add_features(self, features: Float[Tensor, "_ dim"]) -> None:
        """Append the next frames of features of ``system.encoder``."""
        self._speech = torch.cat([self._speech, features])

    def step(self) -> list[Motion]:
        """Generate one window and return its final frames for each sample, if it `is_due`.

        They are all waiting frames, but no more than a window's advance.
        """
        assert self.is_due
        hop = min(self.num_generatable_frames, self._cut.advance)
        final = self._window(hop).part(slice(hop))
        self.next_frame += hop
        self._forget_before(self.next_frame - 2 * (self._cut.frames + self._cut.context))
        return self._motion.next_motions(final)

    def set_style(self, style: Any) -> None:
        """Use conditions of another style from now on; raises ValueError if there are none."""
        if self._stream is None:
            raise ValueError("This system takes no condition besides speech.")
        self._stream.style = style

    def _window(self, hop: int) -> Window:
        """Generate the next window, and pass its condition to the constraint."""
        cut, start = self._cut, self.next_frame
        first, stop = start - cut.context, start + cut.frames + cut.context
        features = self._speech_features(first, stop)
        if self._stream is None:
            return self._chain.generate_joined(SpeechWindow(features), hop)
        margin = 0 if self._constraint is None else self._constraint.margin
        final, ends = start + hop + margin, start + cut.frames + CONDITION_MARGIN
        streamed = self.ahead = self._stream.advance(self._speech_features, first, final, ends)
        features = self._stream.conditioning(features, streamed, first)
        at = start - streamed.zero_frame
        if self._constraint is not None:
            self._constraint.set_condition(streamed, at)
        window = SpeechWindow(features)
        return self._chain.generate_joined(window, hop, streamed.condition, at)

    def _speech_features(self, first: int, stop: int) -> Float[Tensor, "n dim"]:
        """Return features of frames ``first`` to ``stop``, extrapolated at both ends."""
        wanted = torch.arange(first, stop)
        mirrored = torch.where(
            wanted < self.num_speech_frames, wanted, 2 * self.num_speech_frames - 1 - wanted
        )
        return self._speech[(mirrored - self._first).clamp(min=0)]

    def _forget_before(self, frame: int) -> None:
        if frame > self._first:
            self._speech = self._speech[frame - self._first :].clone()
            self._first = frame
