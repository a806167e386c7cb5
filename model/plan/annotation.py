"""The plan that a TextGrid of the corpus writes down, tier by tier."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from model.motion.timing import FPS
from model.plan.plan import (
    PHASES,
    SIDES,
    Blink,
    Brow,
    GesturePlan,
    HandPhase,
    Look,
    Nod,
    PlanError,
    Planted,
    Smile,
    Stand,
)

_ITEM = re.compile(r"^[ \t]*item \[\d+\]:", re.MULTILINE)
_NAME = re.compile(r'name = "([^"]*)"')
_XMAX = re.compile(r"^xmax = ([\d.]+)", re.MULTILINE)
_INTERVAL = re.compile(r'xmin = ([\d.]+)\s+xmax = ([\d.]+)\s+text = "([^"]*)"')
_POINT = re.compile(r'number = ([\d.]+)\s+mark = "([^"]*)"')
_SAME_MOMENT_S = 0.5 / FPS
APEX_S = 0.08
"""A stroke and the apex that tells its word are at most so far apart."""

Told = TypeVar("Told")


def annotated_plan(path: Path) -> GesturePlan:
    """The plan in a TextGrid of the corpus.

    Raises:
        PlanError: if it tells no gestures of both hands with their goals.
    """
    text = path.read_text(encoding="utf-8")
    length = _XMAX.search(text)
    tiers = {}
    for part in _ITEM.split(text)[1:]:
        name = _NAME.search(part)
        if name:
            tiers[name[1]] = part
    missing = [
        tier for side in SIDES for tier in (f"gesture_{side}", f"goal_{side}") if tier not in tiers
    ]
    if missing or length is None:
        raise PlanError(f"{path.name} has no tier {missing[0] if missing else 'at all'}.")

    def intervals(name: str, made: Callable[[float, float, str], Told]) -> tuple[Told, ...]:
        found = _INTERVAL.findall(tiers.get(name, ""))
        return tuple(made(float(start), float(end), label) for start, end, label in found if label)

    def points(name: str, made: Callable[[float, str], Told]) -> tuple[Told, ...]:
        return tuple(made(float(at), mark) for at, mark in _POINT.findall(tiers.get(name, "")))

    apexes = points("apex", lambda at, mark: (at, mark.split(" ")))
    hands = {}
    for side in SIDES:
        phases = intervals(f"gesture_{side}", lambda start, end, label: (start, end, label))
        goals = points(f"goal_{side}", lambda at, mark: (at, _numbers(mark)))
        words = {at: mark[2] for at, mark in apexes if len(mark) == 3 and mark[1] == side}
        hands[side] = _hand(phases, goals, words)
    return GesturePlan(
        duration_s=float(length[1]),
        left=hands["left"],
        right=hands["right"],
        nods=points("nods", lambda at, mark: Nod(at, float(mark))),
        looks=intervals("gaze", lambda start, end, label: Look(start, end, *_numbers(label))),
        brows=points("brows", lambda at, mark: Brow(at, _numbers(mark)[0])),
        smiles=intervals("smile", lambda start, end, label: Smile(start, end, float(label))),
        blinks=points("blinks", lambda at, _: Blink(at)),
        stands=intervals("weight", Stand),  # pyright: ignore[reportArgumentType]
        planted=tuple(
            stand
            for side in SIDES
            for stand in intervals(f"foot_{side}", lambda a, b, _, side=side: Planted(a, b, side))
        ),
    )


def _hand(
    phases: tuple[tuple[float, float, str], ...],
    goals: tuple[tuple[float, tuple[float, ...]], ...],
    words: dict[float, str],
) -> tuple[HandPhase, ...]:
    """Phases with where they end: at the last goal that is reached by then."""
    found = []
    for start_s, end_s, label in phases:
        name, _, kind = label.partition(" ")
        if name not in PHASES:
            continue
        reached = [goal for at, goal in goals if at <= end_s + _SAME_MOMENT_S] or [goals[0][1]]
        out, up, forward = reached[-1]
        at = min(words, key=lambda at: abs(at - end_s), default=None)
        lands = name == "stroke" and at is not None and abs(at - end_s) < APEX_S
        word = words[at] if lands and at is not None else ""
        found.append(HandPhase(start_s, end_s, name, (out, up, forward), kind, word))
    return tuple(found)


def _numbers(label: str) -> tuple[float, ...]:
    return tuple(map(float, label.split(" ")))
