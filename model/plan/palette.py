"""The gestures that a person can choose from, and where hands usually make them."""

from collections.abc import Mapping
from types import MappingProxyType

Place = tuple[float, float, float]

REST_PLACE: Place = (0.25, -0.26, 0.25)
"""Where hands usually rest: before the body."""
PREPARED: Place = (-0.066, 0.005, -0.049)
"""Where a hand is made ready, from where its stroke ends: nearer to the body."""
PLACES: Mapping[str, Place] = MappingProxyType({
    "all": (0.33, -0.08, 0.28), "arc": (0.33, -0.13, 0.30), "back": (0.30, 0.12, 0.20),
    "beat": (0.23, -0.20, 0.35), "big": (0.32, 0.00, 0.28), "brush": (0.26, -0.15, 0.32),
    "carry": (0.19, -0.09, 0.33), "chop": (0.19, -0.10, 0.36), "cup_both": (0.11, -0.13, 0.32),
    "dismiss": (0.31, -0.08, 0.36), "down": (0.24, -0.23, 0.36), "drive": (0.19, -0.05, 0.36),
    "five": (0.26, 0.08, 0.27), "forward": (0.18, 0.06, 0.40), "four": (0.20, 0.03, 0.28),
    "frame": (0.18, -0.09, 0.35), "here": (0.22, -0.18, 0.36), "item": (0.15, -0.13, 0.34),
    "knock": (0.17, -0.02, 0.38), "long": (0.31, -0.10, 0.30), "no": (0.26, -0.11, 0.31),
    "offer": (0.23, -0.15, 0.35), "offer_low": (0.28, -0.23, 0.32), "one": (0.24, 0.12, 0.28),
    "open_up": (0.25, -0.13, 0.32), "phone": (0.25, 0.30, 0.21), "point_up": (0.21, 0.12, 0.29),
    "precise": (0.17, 0.02, 0.32), "present": (0.24, -0.11, 0.34), "pull": (0.26, -0.07, 0.24),
    "quote": (0.24, 0.14, 0.27), "roll": (0.15, -0.13, 0.33), "round": (0.15, -0.18, 0.31),
    "self": (0.08, -0.03, 0.21), "set_down": (0.22, -0.19, 0.35), "shrug": (0.32, -0.12, 0.24),
    "small": (0.15, 0.09, 0.31), "small_both": (0.10, -0.08, 0.31), "stop": (0.20, 0.07, 0.38),
    "sweep": (0.34, -0.07, 0.30), "that_side": (0.34, -0.11, 0.32), "there": (0.41, 0.12, 0.28),
    "think": (0.22, 0.06, 0.31), "this_side": (0.35, -0.09, 0.33), "three": (0.26, 0.00, 0.27),
    "together": (0.13, -0.10, 0.32), "turn_out": (0.25, -0.10, 0.30), "two": (0.14, 0.09, 0.24),
    "up": (0.26, 0.17, 0.28), "wave_off": (0.28, -0.06, 0.32), "weigh": (0.24, -0.14, 0.32),
    "wow": (0.24, 0.31, 0.25), "you": (0.17, 0.01, 0.41), "you_open": (0.19, -0.08, 0.41),
})  # fmt: skip
"""By kind, where its strokes end (medians in the corpus's annotation): out, up, forward."""
BY_BOTH = frozenset({
    "all", "big", "carry", "cup_both", "drive", "frame", "item", "long", "no", "open_up", "present",
    "quote", "roll", "round", "shrug", "small_both", "together", "weigh", "wow",
})  # fmt: skip
"""Kinds that both hands make together."""
ANY_PLACE = PLACES["offer"]
"""Of a kind that is not known."""


def usual_place(kind: str) -> Place:
    """Where strokes of a kind end."""
    return PLACES.get(kind, ANY_PLACE)


def ready_for(goal: Place) -> Place:
    """Where a hand is made ready for a stroke that ends at ``goal``."""
    return _moved(goal, PREPARED)


def usual_goal(phase: str, kind: str, before: Place, stroke: Place | None) -> Place:
    """Where a phase leads whose place nobody has told.

    Args:
        before: where the hand is when it begins.
        stroke: where the next stroke ends, if that is told.
    """
    if phase in ("rest", "retraction"):
        return REST_PLACE
    if phase == "preparation":
        return ready_for(stroke or usual_place(kind))
    if phase == "stroke":
        return usual_place(kind)
    if phase == "beat":
        return _moved(before, (0.0, -0.05, 0.01))
    return before


def _moved(place: Place, by: Place) -> Place:
    out, up, forward = (round(a + b, 4) for a, b in zip(place, by, strict=True))
    return out, up, forward
