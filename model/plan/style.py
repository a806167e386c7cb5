"""Style of a whole plan: measurement, change, style files, and sliders of live generation.

A style file is TOML. Its numbers are those of `Style`; in the table ``times`` they are factors of
each plan's own values. ``excite`` goes from -1 (calm) to 1 (excited). With ``wrong_words`` strokes
move to words that did not trigger them.

The plan of live speech is not known in advance, so sliders (`LiveStyle`) are factors of what the
speech would give.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from model.plan.annotation_files import Interval
from model.plan.editing import (
    GestureKey,
    add_gesture,
    change_hands,
    clamp_goals,
    default_stroke_end_on_word,
    delete_gesture,
    gestures,
    move_gesture,
    raise_gesture,
    scale_gesture,
    scale_gesture_speed,
)
from model.plan.kinds import BIMANUAL_TOLERANCE_S, REST_POSITION, group_gesture_phases
from model.plan.plan import SIDES, GesturePlan, HandPhase, PlanError, PlanResult, Smile
from model.storage.files import parse_toml, read_within_limit

_RELATIVE_TOLERANCE = 0.02
"""Relative difference below which a style's value counts as reached."""
LIMITS = {
    "gestures_per_min": (0.0, 90.0), "size_m": (0.05, 0.6), "height_m": (-0.4, 0.4),
    "stroke_s": (0.2, 1.0), "both": (0.0, 1.0), "smile": (0.0, 1.0),
}  # fmt: skip


def _within(values: Mapping[str, float]) -> dict[str, float]:
    return {name: float(np.clip(value, *LIMITS[name])) for name, value in values.items()}


@dataclass(frozen=True)
class Style:
    """Overall style of a plan."""

    gestures_per_min: float
    """Number of gestures per minute; those of both hands together count once."""
    size_m: float
    """Mean distance of stroke ends from the rest position (m)."""
    height_m: float
    """Mean height of stroke ends above the chest joint (m)."""
    stroke_s: float
    """Mean duration of strokes (s)."""
    both: float
    """Share of gestures that both hands make."""
    smile: float
    """Mean size of smiles over the whole time, 0 without one."""


def style_of(plan: GesturePlan) -> Style:
    """Measure the style of a plan, which is also the initial value of its sliders."""
    strokes = group_gesture_phases(plan)
    goals = [stroke.last_stroke.goal for stroke in strokes]
    twice = sum(stroke.is_bimanual for stroke in strokes) / 2
    count = len(strokes) - twice
    smiles = sum(one.size * (one.end_s - one.start_s) for one in plan.smiles)

    def mean(numbers: Sequence[float], usual: float) -> float:
        return float(np.mean(numbers)) if numbers else usual

    return Style(**_within({
        "gestures_per_min": 60 * count / plan.duration_s,
        "size_m": mean([math.dist(goal, REST_POSITION) for goal in goals], 0.2),
        "height_m": mean([up for _, up, _ in goals], -0.1),
        "stroke_s": mean([one.last_stroke.end_s - one.last_stroke.start_s for one in strokes], 0.3),
        "both": twice / count if count else 0.0,
        "smile": smiles / plan.duration_s,
    }))  # fmt: skip


def with_arousal(style: Style, arousal: float) -> Style:
    """Make a style calmer (``arousal`` -1) or more excited (1)."""
    return replace(style, **_within({
        "gestures_per_min": style.gestures_per_min * 1.6**arousal,
        "size_m": style.size_m * 1.3**arousal,
        "height_m": style.height_m + 0.06 * arousal,
        "stroke_s": style.stroke_s / 1.25**arousal,
        "both": style.both + 0.15 * arousal,
    }))  # fmt: skip


def with_style(plan: GesturePlan, style: Style, words: Sequence[Interval] = ()) -> PlanResult:
    """Change a plan's style as far as gestures, time and words (for added beats) allow."""
    notes: list[str] = []
    now = style_of(plan)
    if _differs(style.gestures_per_min, now.gestures_per_min):
        plan = _with_rate(plan, style.gestures_per_min, words)
        got = style_of(plan).gestures_per_min
        if abs(got - style.gestures_per_min) * plan.duration_s / 60 > 1:
            notes.append(f"There is room for only {got:.0f} gestures per minute.")
    if _differs(style.both, now.both):
        plan = _with_both(plan, style.both)
    now = style_of(plan)
    if _differs(style.stroke_s, now.stroke_s):
        speed = float(np.clip(now.stroke_s / style.stroke_s, 0.2, 5))
        plan = _each(plan, lambda each, gesture: scale_gesture_speed(each, gesture, speed))
    if _differs(style.size_m, now.size_m):
        size = float(np.clip(style.size_m / now.size_m, 0.1, 4))
        plan = _each(plan, lambda each, gesture: scale_gesture(each, gesture, size))
    by_m = style.height_m - style_of(plan).height_m
    if _differs(style.height_m, now.height_m) and abs(by_m) > 1e-3:
        plan = _each(plan, lambda each, gesture: raise_gesture(each, gesture, by_m))
    if _differs(style.smile, now.smile):
        plan = replace(plan, smiles=_smiles(plan, style.smile, now.smile))
    return PlanResult(plan, tuple(notes))


def _differs(wish: float, now: float) -> bool:
    return abs(wish - now) > _RELATIVE_TOLERANCE * max(abs(wish), abs(now), 0.05)


def group_gestures_across_hands(plan: GesturePlan) -> list[list[GestureKey]]:
    """Return all gestures in order of time, as pairs where both hands make one together."""
    groups: list[list[GestureKey]] = []
    every = sorted(
        (g for side in SIDES for g in gestures(plan, side)), key=lambda g: g.stroke_end_s
    )
    for gesture in every:
        last = groups[-1] if groups else []
        is_partner = len(last) == 1 and last[0].side != gesture.side
        if is_partner and gesture.stroke_end_s - last[0].stroke_end_s < BIMANUAL_TOLERANCE_S:
            last.append(gesture)
        else:
            groups.append([gesture])
    return groups


def _spread(count: int, most: int) -> list[int]:
    """Return indices spread evenly over a range."""
    return [int((k + 0.5) * most / count) for k in range(min(count, most))]


def _with_rate(plan: GesturePlan, per_min: float, words: Sequence[Interval]) -> GesturePlan:
    there = group_gestures_across_hands(plan)
    wanted = round(per_min * plan.duration_s / 60)
    for k in _spread(max(0, len(there) - wanted), len(there)):
        for gesture in there[k]:
            plan = delete_gesture(plan, gesture).plan
    missing = wanted - len(there)
    for word in sorted(words, key=lambda w: w.start_s - w.end_s):  # long ones first
        if missing <= 0:
            break
        try:
            edited = add_gesture(
                plan, "beat", default_stroke_end_on_word(word), "right", word.text.lower()
            )
        except PlanError:
            continue
        plan, missing = edited.plan, missing - 1
    return plan


def _with_both(plan: GesturePlan, share: float) -> GesturePlan:
    groups = group_gestures_across_hands(plan)
    both = [group for group in groups if len(group) == 2]
    single = [group for group in groups if len(group) == 1]
    missing = round(share * len(groups)) - len(both)
    for k in _spread(max(0, -missing), len(both)):
        plan = change_hands(plan, both[k][1], "right").plan
    done = 0
    for (gesture,) in single:
        if done >= missing:
            break
        try:
            plan = change_hands(plan, gesture, "both").plan
        except PlanError:
            continue
        done += 1
    return plan


def _each(
    plan: GesturePlan, change: Callable[[GesturePlan, GestureKey], PlanResult]
) -> GesturePlan:
    """Apply a change to every gesture for which it is possible."""
    for gesture in (each for group in group_gestures_across_hands(plan) for each in group):
        try:
            plan = change(plan, gesture).plan
        except PlanError:
            continue
    return plan


def _smiles(plan: GesturePlan, wish: float, now: float) -> tuple[Smile, ...]:
    if now == 0:
        return (Smile(0.0, plan.duration_s, wish),)
    scaled = (replace(one, size=min(1.0, one.size * wish / now)) for one in plan.smiles)
    return tuple(one for one in scaled if one.size > 0)


MAX_BYTES = 10_000
MIN_MISALIGNMENT_S = 0.25
"""Shortest time between a stroke on a wrong word and any original stroke end (s)."""
FARTHEST_S = 2.0
STEP_S = 0.05
MAX_TIMES = 10.0
_NUMBERS = tuple(each.name for each in fields(Style))
_TIMES = tuple(name for name in _NUMBERS if name != "height_m")


@dataclass(frozen=True)
class StyleChange:
    """Wanted change of a plan's style; the default changes nothing."""

    targets: Mapping[str, float] = field(default_factory=dict)
    """Target values of `Style` by name."""
    factors: Mapping[str, float] = field(default_factory=dict)
    """Factors of the plan's values by name; heights have none, as their zero is the chest."""
    arousal: float = 0.0
    """Arousal of the gestures, from -1 (calm) to 1 (excited); key ``excite`` of style files."""
    is_misaligned: bool = False
    """True to move strokes to other words; key ``wrong_words`` of style files."""

    def apply(self, plan: GesturePlan, words: Sequence[Interval] = ()) -> PlanResult:
        """Apply the change to a plan, as far as there are gestures, words and time for it."""
        now = style_of(plan)
        times = _within({name: getattr(now, name) * by for name, by in self.factors.items()})
        wish = replace(now, **times)
        changed = with_style(plan, with_arousal(replace(wish, **self.targets), self.arousal), words)
        return (
            changed.then(lambda new: misalign_gestures(new, words))
            if self.is_misaligned
            else changed
        )


def misalign_gestures(plan: GesturePlan, words: Sequence[Interval] = ()) -> PlanResult:
    """Move every gesture at least `MIN_MISALIGNMENT_S` away from all original ones.

    It moves to another word if words are known; if there is no room it stays, with a note.
    """
    groups = group_gestures_across_hands(plan)
    called = np.array([group[0].stroke_end_s for group in groups])
    places = [default_stroke_end_on_word(word) for word in words]
    texts = {default_stroke_end_on_word(word): word.text.lower() for word in words}
    steps = np.arange(MIN_MISALIGNMENT_S, FARTHEST_S + STEP_S / 2, STEP_S)
    stayed = 0
    for group in groups:
        at_s = group[0].stroke_end_s
        wished = places or [at_s + sign * step for step in steps for sign in (1, -1)]
        free = [
            to
            for to in wished
            if np.abs(called - to).min() >= MIN_MISALIGNMENT_S and abs(to - at_s) <= FARTHEST_S
        ]
        for to_s in sorted(free, key=lambda to: abs(to - at_s)):
            changed, by_s, word = plan, to_s - at_s, texts.get(to_s, "")
            try:
                for each in group:
                    changed = move_gesture(changed, each, each.stroke_end_s + by_s, word).plan
            except PlanError:
                continue
            plan = changed
            break
        else:
            stayed += 1
    notes = (
        (f"{stayed} of {len(groups)} gestures could not be moved to another word or time.",)
        if stayed
        else ()
    )
    return PlanResult(plan, notes)


def read_style_file(path: Path) -> StyleChange:
    """Read a style file; raises `PlanError` if it is missing, too large, or invalid."""
    content = read_within_limit(path, MAX_BYTES, PlanError)
    try:
        entries = parse_toml(content.decode("utf-8"))
    except ValueError as error:
        raise PlanError(f"{path.name} is not a TOML file.") from error
    try:
        return parse_style(entries)
    except PlanError as error:
        raise PlanError(f"{path.name}: {error}") from None


def parse_style(content: Mapping[str, Any]) -> StyleChange:
    """Parse the tables of a style file."""
    keys = (*_NUMBERS, "times", "excite", "wrong_words")
    unknown = sorted(set(content) - set(keys))
    if unknown:
        raise PlanError(f"{unknown[0][:40]!r} is not a style key; use {', '.join(keys)}.")
    times = content.get("times", {})
    if not isinstance(times, Mapping) or set(times) - set(_TIMES):
        raise PlanError(f"`times` must be a table with keys from {', '.join(_TIMES)}.")
    wrong = content.get("wrong_words", False)
    if not isinstance(wrong, bool):
        raise PlanError("`wrong_words` must be true or false.")
    both = sorted(set(content) & set(times))
    if both:
        raise PlanError(
            f"{both[0]} is set twice, as a value and as a factor in `times`; remove one."
        )
    return StyleChange(
        {name: _number(name, content[name], *LIMITS[name]) for name in _NUMBERS if name in content},
        {name: _number(f"times.{name}", times[name], 0.0, MAX_TIMES) for name in times},
        _number("excite", content.get("excite", 0.0), -1.0, 1.0),
        wrong,
    )


def _number(name: str, value: object, least: float, most: float) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not (is_number and least <= value <= most):  # pyright: ignore[reportOperatorIssue]
        raise PlanError(
            f"{name} must be a number from {least:g} to {most:g}; got {str(value)[:20]}."
        )
    return float(value)  # pyright: ignore[reportArgumentType]


LIVE_STYLE_LIMITS = {
    "rate_factor": (0.2, 4.0), "size_factor": (0.3, 2.5), "height_offset_m": (-0.3, 0.3),
    "speed_factor": (0.5, 2.0), "joining_factor": (0.1, 10.0), "smile_factor": (0.0, 4.0),
}  # fmt: skip


@dataclass(frozen=True)
class LiveStyle:
    """Sliders of live generation: factors (or m) relative to what the speech gives."""

    rate_factor: float = 1.0
    """Factor of the probability that a gesture begins."""
    size_factor: float = 1.0
    """Factor of the distance of goals from the rest position."""
    height_offset_m: float = 0.0
    """Height added to goals (m)."""
    speed_factor: float = 1.0
    """Factor of the speed of preparations, strokes and retractions."""
    joining_factor: float = 1.0
    """Factor of the probability that one hand joins the other."""
    smile_factor: float = 1.0

    @staticmethod
    def parse(content: Any) -> LiveStyle:
        """Parse a JSON object of numbers."""
        if not isinstance(content, dict) or not set(content) <= set(LIVE_STYLE_LIMITS):
            raise PlanError(
                f"A style must be an object with keys from {', '.join(sorted(LIVE_STYLE_LIMITS))}."
            )
        return LiveStyle(
            **{name: _number(name, content[name], *LIVE_STYLE_LIMITS[name]) for name in content}
        )

    def adjust_goal(self, phase: HandPhase) -> HandPhase:
        """Scale and raise the goal of a gesture's phase."""
        is_unchanged = self.size_factor == 1.0 and self.height_offset_m == 0.0
        if is_unchanged or phase.phase in ("rest", "retraction"):
            return phase
        out, up, forward = (
            r + self.size_factor * (g - r) for g, r in zip(phase.goal, REST_POSITION, strict=True)
        )
        return clamp_goals([replace(phase, goal=(out, up + self.height_offset_m, forward))])[0][0]
