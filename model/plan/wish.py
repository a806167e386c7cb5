"""A style file: what is wished of every plan of a batch, or of one condition of a study.

TOML. Numbers are those of `Style`; in the table ``times`` they say how many times what each plan
asks for itself. ``excite`` goes from -1 (calm) to 1 (excited). With ``wrong_words`` strokes land
where nothing called for them.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from model.plan.editing import Edited, Gesture, moved, on_word
from model.plan.kinds import Spoken
from model.plan.plan import GesturePlan, PlanError, bytes_within
from model.plan.style import LIMITS, Style, excited, style_of, together, with_style

MAX_BYTES = 10_000
AWAY_S = 0.25
"""A stroke on a wrong word lands so far from where any stroke was called for."""
FARTHEST_S = 2.0
STEP_S = 0.05
MOST_TIMES = 10.0
_NUMBERS = tuple(each.name for each in fields(Style))
_TIMES = tuple(name for name in _NUMBERS if name != "height_m")


@dataclass(frozen=True)
class StyleWish:
    """What is wished of a plan on the whole; nothing changes none."""

    to: Mapping[str, float] = field(default_factory=dict)
    """Numbers of `Style` by name."""
    times: Mapping[str, float] = field(default_factory=dict)
    """How many times what the plan has; heights have none, as the chest is their zero."""
    excite: float = 0.0
    wrong_words: bool = False

    def done(self, plan: GesturePlan, words: Sequence[Spoken] = ()) -> Edited:
        """The plan as wished, as far as there are gestures, words and time for it."""
        now = style_of(plan)
        wish = replace(now, **{
            name: _within(name, getattr(now, name) * share) for name, share in self.times.items()
        })  # fmt: skip
        wish = excited(replace(wish, **self.to), self.excite)
        found = with_style(plan, wish, words)
        if not self.wrong_words:
            return found
        wrong = on_wrong_words(found.plan, words)
        return Edited(wrong.plan, (*found.notes, *wrong.notes))


def on_wrong_words(plan: GesturePlan, words: Sequence[Spoken] = ()) -> Edited:
    """Every gesture as it is, but at least `AWAY_S` from where any was called for: on another word
    if words are known, else at another time. One that has no room stays, and that is said."""
    called = np.array([group[0].lands_s for group in together(plan)])
    groups = together(plan)
    places = [on_word(word) for word in words]
    texts = {on_word(word): word.text.lower() for word in words}
    steps = np.arange(AWAY_S, FARTHEST_S + STEP_S / 2, STEP_S)
    stayed = 0
    for group in groups:
        at_s = group[0].lands_s
        wished = places or [at_s + sign * step for step in steps for sign in (1, -1)]
        free = [
            to for to in wished
            if np.abs(called - to).min() >= AWAY_S and abs(to - at_s) <= FARTHEST_S
        ]  # fmt: skip
        for to_s in sorted(free, key=lambda to: abs(to - at_s)):
            try:
                plan = _all_moved(plan, group, to_s - at_s, texts.get(to_s, ""))
            except PlanError:
                continue
            break
        else:
            stayed += 1
    notes = (f"{stayed} of {len(groups)} gestures stay on their words.",) if stayed else ()
    return Edited(plan, notes)


def read_wish(path: Path) -> StyleWish:
    """A style file.

    Raises:
        PlanError: if it is missing, too large, or says anything else.
    """
    data = bytes_within(path, MAX_BYTES, f"{MAX_BYTES // 1000} kB")
    try:
        told = tomllib.loads(data.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise PlanError(f"{path.name} is no TOML file.") from error
    try:
        return wish_of(told)
    except PlanError as error:
        raise PlanError(f"{path.name}: {error}") from None


def wish_of(told: Mapping[str, Any]) -> StyleWish:
    """What a style file's tables say.

    Raises:
        PlanError: if it is anything else.
    """
    known = (*_NUMBERS, "times", "excite", "wrong_words")
    unknown = sorted(set(told) - set(known))
    if unknown:
        raise PlanError(f"a style has no {unknown[0][:40]!r}; it may have {', '.join(known)}.")
    times = told.get("times", {})
    if not isinstance(times, Mapping) or set(times) - set(_TIMES):
        raise PlanError(f"`times` is a table of some of {', '.join(_TIMES)}.")
    wrong = told.get("wrong_words", False)
    if not isinstance(wrong, bool):
        raise PlanError("`wrong_words` is true or false.")
    both = sorted(set(told) & set(times))
    if both:
        raise PlanError(f"{both[0]} is given twice, alone and in `times`; leave one out.")
    return StyleWish(
        {name: _number(name, told[name], *LIMITS[name]) for name in _NUMBERS if name in told},
        {name: _number(f"times.{name}", times[name], 0.0, MOST_TIMES) for name in times},
        _number("excite", told.get("excite", 0.0), -1.0, 1.0),
        wrong,
    )


def _all_moved(plan: GesturePlan, group: Sequence[Gesture], by_s: float, word: str) -> GesturePlan:
    for gesture in group:
        plan = moved(plan, gesture, gesture.lands_s + by_s, word).plan
    return plan


def _within(name: str, value: float) -> float:
    return float(np.clip(value, *LIMITS[name]))


def _number(name: str, value: object, least: float, most: float) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    number = float(value) if is_number else math.nan  # pyright: ignore[reportArgumentType]
    if not least <= number <= most:
        raise PlanError(f"{name} is a number from {least:g} to {most:g}; got {str(value)[:20]}.")
    return number
