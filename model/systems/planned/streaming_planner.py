"""Streaming planner: draws a plan a little ahead of the motion; past parts are final.

The planner needs a second of speech on either side, so the caller extrapolates the speech that has
not arrived yet. Its draw for future frames conditions the motion network; with more speech these
are drawn anew, with the same random numbers. A movement that has begun is completed as drawn: its
goal cannot change half way.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from conventions.rates import FPS
from model.generation.base import WindowSpec
from model.plan.kinds import FOLLOW_BEATS, GesturePhases, KindTable, Position, group_gesture_phases
from model.plan.plan import PHASES, SIDES, STILL_PHASES, GesturePlan, HandPhase, Side, StreamedPlan
from model.plan.plan_features import TIERS_BY_NAME, EventOnset, chains_to_plan
from model.plan.style import LiveStyle
from model.systems.planned.planner import KIND_KEY, Planner

PAST_PLAN_FRAMES = 90
"""Frames of the plan before the first requested one."""
NUM_PAST_EVENTS = 3
"""Number of events of each tier that are stored from before that."""
_TOGETHER_FRAMES = 5
"""Frames after a hand's preparation in which the other may start its own as well."""
_MOVING = tuple(name for name in PHASES if name not in STILL_PHASES)
_PREPARATION, _STROKE = (1 + PHASES.index(name) for name in ("preparation", "stroke"))
_NUM_EVENTS = 1 + len(PHASES)
_SMILE = 1 + TIERS_BY_NAME["smile"].states.index("smile")


class StreamingPlanner:
    """Streaming planner of one speaker with constant memory."""

    def __init__(self, planner: Planner, spec: WindowSpec) -> None:
        self.style = LiveStyle()
        """Style; may be changed at any time, without effect on final events."""
        self._planner, self._spec = planner, spec
        nothing = torch.zeros(1, planner.config.speech_dim)
        with torch.inference_mode():
            self._drawers = planner.make_samplers(nothing, spec)
        self._final = 1
        """First frame that may still be drawn anew; at frame 0 nothing begins."""
        self._kinds: dict[tuple[str, int], str] = {}
        self._goals: dict[tuple[str, int], Position] = {}
        """Goals of final phases, by hand and first frame."""

    @torch.inference_mode()
    def advance(
        self,
        features_of: Callable[[int, int], Float[Tensor, "T speech_dim"]],
        first: int,
        first_open: int,
        stop: int,
    ) -> StreamedPlan:
        """Plan further (`ConditionStream.advance`)."""
        first_open = max(first_open, self._final)
        self._draw(features_of, first_open, stop)
        origin = first - PAST_PLAN_FRAMES
        for drawer in self._drawers.values():
            drawer.forget_before(origin, NUM_PAST_EVENTS)
        chains = {name: drawer.chain for name, drawer in self._drawers.items()}
        shifted = {
            name: [replace(one, frame=one.frame - origin) for one in chain]
            for name, chain in chains.items()
        }
        plan = self._annotated_plan(chains_to_plan(shifted, stop - origin), origin, first_open)
        planted = tuple(
            replace(one, start_s=one.start_s + origin / FPS, end_s=one.end_s + origin / FPS)
            for one in plan.planted
        )
        self._rewind(first_open, origin)
        return StreamedPlan(plan, origin, planted)

    def conditioning(
        self, features: Float[Tensor, "n speech_dim"], streamed: StreamedPlan, first: int
    ) -> Float[Tensor, "n input_dim"]:
        """Return the motion network's input for frames from ``first`` on."""
        return self._planner.motion_network_inputs(
            features, streamed.condition, first - streamed.zero_frame
        )

    def _draw(
        self,
        features_of: Callable[[int, int], Float[Tensor, "T speech_dim"]],
        first_open: int,
        stop: int,
    ) -> None:
        """Draw all frames that are not final."""
        begin, context = self._final, self._planner.config.context_frames_per_side
        tier_inputs = self._planner.tier_inputs(
            features_of(begin - 2 * context, stop + context), self._spec
        )
        leans = partial(_style_log_odds, self.style)
        for name, drawer in self._drawers.items():
            drawer.set_tier_inputs(tier_inputs[name][:, context:], begin)
        for frame in range(begin, stop):
            if frame == first_open:
                self._mark_position()
            for drawer in self._drawers.values():
                drawer.draw(frame, self._drawers, leans)
        if first_open >= stop:
            self._mark_position()

    def _mark_position(self) -> None:
        for drawer in self._drawers.values():
            drawer.save_position()

    def _rewind(self, first_open: int, origin: int) -> None:
        for name, drawer in self._drawers.items():
            state = drawer.onset_before(first_open).state
            drawer.rewind(first_open, keeps_next_event=_is_uninterruptible(name, state))
        self._final = first_open
        for cache in (self._kinds, self._goals):
            for key in [key for key in cache if key[1] < origin - 10 * PAST_PLAN_FRAMES]:
                del cache[key]

    def _annotated_plan(self, plan: GesturePlan, origin: int, first_open: int) -> GesturePlan:
        """Return the plan with gesture types and style, with holds and rests at their place."""
        table, kinds = self._planner.kinds, {}
        hands = {side: list(plan.hand(side)) for side in SIDES}
        landed: dict[float, str] = {}
        for stroke in sorted(group_gesture_phases(plan), key=lambda one: one.last_stroke.end_s):
            begins = round(plan.hand(stroke.side)[stroke.first_index].start_s * FPS) + origin
            kind = self._kind(table, stroke, begins, landed)
            landed[stroke.last_stroke.end_s] = kind
            kinds[stroke.side, begins] = kind
            for k in range(stroke.first_index, stroke.last_index + 1):
                hands[stroke.side][k] = replace(hands[stroke.side][k], kind=kind)
        self._kinds |= {key: kind for key, kind in kinds.items() if key[1] < first_open}
        left, right = (self._shaped(side, hands[side], origin, first_open) for side in SIDES)
        smiles = tuple(
            replace(one, size=min(1.0, one.size * self.style.smile_factor))
            for one in plan.smiles
            if self.style.smile_factor > 0
        )
        return replace(plan, left=left, right=right, smiles=smiles)

    def _kind(
        self, table: KindTable, stroke: GesturePhases, begins: int, landed: Mapping[float, str]
    ) -> str:
        kind = self._kinds.get((stroke.side, begins))
        if kind is not None:
            return kind
        if stroke.is_bimanual:
            partner = table.simultaneous_kind(landed, stroke.last_stroke.end_s)
            if partner:
                return partner
        side = SIDES.index(stroke.side)
        rng = np.random.default_rng([*self._spec.clip_noise_key, KIND_KEY, side, max(0, begins)])
        return table.sample_kind(stroke, self._spec.speaker_index, rng)

    def _shaped(
        self, side: Side, phases: Sequence[HandPhase], origin: int, first_open: int
    ) -> tuple[HandPhase, ...]:
        adapted: list[HandPhase] = []
        for phase in phases:
            begins = round(phase.start_s * FPS) + origin
            shaped = self.style.adjust_goal(phase)
            if (
                phase.phase in STILL_PHASES and adapted
            ):  # its end is not known yet, so it leads nowhere
                shaped = replace(shaped, goal=adapted[-1].goal)
            if begins < first_open:
                goal = self._goals.setdefault((side, begins), shaped.goal)
                shaped = replace(shaped, goal=goal)
            if phase.phase == "beat" and not phase.kind:
                shaped = replace(shaped, kind=FOLLOW_BEATS)
            adapted.append(shaped)
        return tuple(adapted)


def _style_log_odds(
    manner: LiveStyle, tier: str, frame: int, now: EventOnset, others: Mapping[str, EventOnset]
) -> Float[np.ndarray, " events"] | None:
    """Compute the style's changes of log odds; see `EventBias`."""
    if tier == "smile" and manner.smile_factor > 0:
        odds = np.zeros(1 + len(TIERS_BY_NAME["smile"].states))
        odds[_SMILE] = math.log(manner.smile_factor)
        return odds
    if tier not in SIDES:
        return None
    odds = np.zeros(_NUM_EVENTS)
    if PHASES[now.state] in _MOVING:
        odds[1:] = math.log(manner.speed_factor)
    else:
        odds[[_PREPARATION, _STROKE]] = math.log(manner.rate_factor)
        other = others[SIDES[1 - SIDES.index(tier)]]
        if 1 + other.state == _PREPARATION and frame - other.frame <= _TOGETHER_FRAMES:
            odds[_PREPARATION] += math.log(manner.joining_factor)
    return odds


def _is_uninterruptible(tier: str, state: int) -> bool:
    """Check whether a state is completed as drawn once it has begun."""
    if tier in SIDES:
        return PHASES[state] in _MOVING
    return tier.endswith(" foot") and TIERS_BY_NAME[tier].states[state] == "step"
