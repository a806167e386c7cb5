"""A plan with something of everything, and tiers as the corpus has them."""

from model.plan.annotation_files import Interval, NamedTier, format_textgrid
from model.plan.plan import (
    Blink,
    Brow,
    FootContact,
    Gaze,
    GesturePlan,
    HandPhase,
    Nod,
    Phase,
    Smile,
    Stance,
)

REST = (0.2, -0.3, 0.1)
HIGH = (0.2, 0.1, 0.3)
LOW = (0.15, -0.1, 0.35)


def phase(start_s: float, end_s: float, name: Phase, goal=REST, kind: str = "", word: str = ""):
    return HandPhase(start_s, end_s, name, goal, kind, word)


def made_plan() -> GesturePlan:
    """Six seconds: the right hand offers twice, the left rests."""
    right = (
        phase(0.0, 1.0, "rest"),
        phase(1.0, 1.5, "preparation", HIGH, "offer"),
        phase(1.5, 1.9, "stroke", LOW, "offer", "whole"),
        phase(1.9, 2.4, "hold", LOW, "offer"),
        phase(2.4, 2.6, "beat", (0.15, -0.04, 0.35), "offer"),
        phase(2.6, 2.8, "beat", LOW, "offer"),
        phase(2.8, 3.5, "hold", LOW, "offer"),
        phase(3.5, 4.2, "retraction"),
        phase(4.2, 6.0, "rest"),
    )
    return GesturePlan(
        duration_s=6.0,
        left=(phase(0.0, 6.0, "rest"),),
        right=right,
        nods=(Nod(1.9, 4.0), Nod(3.0, 2.5)),
        looks=(Gaze(0.0, 2.0, 0.0, 0.0), Gaze(2.0, 3.0, 14.0, 5.0), Gaze(3.0, 6.0, 0.0, -1.0)),
        brows=(Brow(1.9, 0.5),),
        smiles=(Smile(3.0, 5.0, 0.4),),
        blinks=(Blink(0.8), Blink(4.0)),
        stands=(Stance(0.0, 3.0, "left"), Stance(3.0, 6.0, "right")),
        planted=(
            FootContact(0.0, 6.0, "left"),
            FootContact(0.0, 2.5, "right"),
            FootContact(3.0, 6.0, "right"),
        ),
    )


def resting(duration_s: float) -> GesturePlan:
    """Both hands at rest throughout."""
    rest = (phase(0.0, duration_s, "rest"),)
    return GesturePlan(duration_s, left=rest, right=rest)


def said(text: str, start_s: float, end_s: float) -> Interval:
    """A word as it was heard."""
    return Interval(float(start_s), float(end_s), text)


def tier(name: str, *rows: tuple) -> NamedTier:
    """Intervals (start, end, label), or points (time, label)."""
    of = (Interval(float(row[0]), float(row[-2]), row[-1]) for row in rows)
    return NamedTier(name, tuple(of), has_points=any(len(row) == 2 for row in rows))


def grid(*tiers: NamedTier) -> str:
    """A TextGrid of three seconds."""
    return format_textgrid(tiers, 3.0)


HANDS = (
    tier("gesture_left", (0, 3, "rest")),
    tier("goal_left", (0.0, "0.200 -0.300 0.100")),
    tier(
        "gesture_right", (0, 1, "rest"), (1, 1.5, "preparation offer"), (1.5, 2, "stroke offer"),
        (2, 2.4, ""), (2.4, 3, "retraction"),
    ),
    tier(
        "goal_right", (0.0, "0.2 -0.3 0.1"), (1.5, "0.2 0.1 0.3"), (2.0, "0.1 0 0.4"),
        (3.0, "0.2 -0.3 0.1"),
    ),
    tier("apex", (0.5, "offer right far"), (2.0, "offer right whole"), (2.0, "offer left other")),
)  # fmt: skip
