"""Motion for speech that is still being spoken, 0.3 s at a time.

`stream_motion` waits until a whole window and the context after it are spoken, almost 3 s. Here a
window is made as soon as a few frames of new speech are there: it starts from the last frames that
are final, and of what it makes only the frames whose speech was heard become final. What has not
been spoken yet is put to the network as the mirror image of what was: speech that goes on much as
it did, rather than a silence that would end every gesture.

`gan/5` on two recordings of BEAT2: with 8 to 12 frames heard ahead, wrists lay 8 to 12 mm from
where they were with all of the speech and the same draws (another seed: 165 mm), the jaw's angle
correlated with that at 0.95 to 0.99 (with 4 frames: 0.81); silence in place of the mirror image:
20 mm.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from model.generation.base import PlannedAhead, PlanStream, System, Window
from model.generation.limbs import SOFT_MARGIN, HeldFeet, LedHands
from model.generation.stitching import SpeechWindow
from model.generation.windows import GenerateOptions, PiecewiseMotion, WindowChain, draw_of
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion
from model.plan.plan import GesturePlan
from model.plan.style import Manner

PLANNED_AFTER = 12
"""Frames after a window for which there is still a plan; then hands stay."""


@dataclass(frozen=True)
class Pace:
    """How early frames become final."""

    hop: int = 9
    """New frames that a window is made for, at the least; speech is heard three at a time."""
    heard_ahead: int = 9
    """Frames of speech that are heard after the last frame that becomes final. The next window
    joins there, so it is no less than their overlap."""


class LiveMotion:
    """One speaker's motion; its memory does not grow.

    Raises:
        UnknownNameError, ValueError: see `stream_motion`; also if the pace does not suit the
            system's windows.
    """

    def __init__(self, system: System, options: GenerateOptions, pace: Pace = Pace()) -> None:
        cut = system.windowing
        if not cut.overlap <= pace.hop <= cut.advance or pace.heard_ahead < cut.overlap:
            raise ValueError(
                f"hop is {pace.hop} and heard_ahead {pace.heard_ahead}; {system.name} needs "
                f"{cut.overlap} to {cut.advance} and at least {cut.overlap}."
            )
        self._cut, self._pace = cut, pace
        self._chain = WindowChain(system, options)
        self._plans: PlanStream | None = None
        """What plans as speech comes, of a system that plans."""
        self.ahead: PlannedAhead | None = None
        """What it has planned around the latest window."""
        self._hands = self._feet = None
        if system.plans:
            self._plans = system.plan_stream(draw_of(system, options))
            skeleton = open_body_skeleton()
            self._hands = LedHands(GesturePlan(1.0), skeleton)
            self._feet = HeldFeet((), skeleton)
        self._motion = PiecewiseMotion(system, feet=self._feet, hands=self._hands)
        self._speech: Float[Tensor, "kept dim"] = torch.zeros(0, system.encoder.dim)
        self._first = 0
        """Frame at which the kept speech begins."""
        self.next_frame = 0
        """The first that is not final."""

    @property
    def heard(self) -> int:
        """Frames of speech that were heard."""
        return self._first + len(self._speech)

    @property
    def waiting(self) -> int:
        """Frames that could become final at once; with fewer than the pace's hop, none do."""
        return self.heard - self._pace.heard_ahead - self.next_frame

    @property
    def is_due(self) -> bool:
        """Whether enough speech is there for the next window."""
        return self.waiting >= self._pace.hop

    def hear(self, features: Float[Tensor, "_ dim"]) -> None:
        """The next frames of ``system.encoder``'s features."""
        self._speech = torch.cat([self._speech, features])

    def step(self) -> list[Motion]:
        """The frames that become final with one window, one motion for each sample; call it when
        it `is_due`. They are as many as wait, but no more than a window may advance."""
        assert self.is_due
        hop = min(self.waiting, self._cut.advance)
        final = self._window(hop).part(slice(hop))
        self.next_frame += hop
        self._forget_before(self.next_frame - 2 * (self._cut.frames + self._cut.context))
        return self._motion.go_on(final)

    def lead(self, manner: Manner) -> None:
        """Plan in another manner from now on.

        Raises:
            ValueError: of a system that performs no plans.
        """
        if self._plans is None:
            raise ValueError("This system performs no plans.")
        self._plans.manner = manner

    def _window(self, hop: int) -> Window:
        """The next window; with it hands and feet know what to do."""
        cut, start = self._cut, self.next_frame
        first, stop = start - cut.context, start + cut.frames + cut.context
        heard = self._heard_from(first, stop)
        if self._plans is None:
            return self._chain.window(SpeechWindow(heard, cut.frames, is_last=False), hop)
        final, ends = start + hop + SOFT_MARGIN, start + cut.frames + PLANNED_AFTER
        ahead = self.ahead = self._plans.go_on(self._heard_from, first, final, ends)
        heard = self._plans.heard(heard, ahead, first)
        assert self._hands is not None and self._feet is not None
        at = start - ahead.origin
        self._hands.go_on_with(ahead.plan, at)
        self._feet.go_on_with(ahead.planted)
        window = SpeechWindow(heard, cut.frames, is_last=False)
        return self._chain.window(window, hop, ahead.plan, at)

    def _heard_from(self, first: int, stop: int) -> Float[Tensor, "heard dim"]:
        """Speech from one frame to another: mirrored at the end of what was heard, held before the
        beginning."""
        wanted = torch.arange(first, stop)
        mirrored = torch.where(wanted < self.heard, wanted, 2 * self.heard - 1 - wanted)
        return self._speech[(mirrored - self._first).clamp(min=0)]

    def _forget_before(self, frame: int) -> None:
        if frame > self._first:
            self._speech = self._speech[frame - self._first :].clone()
            self._first = frame
