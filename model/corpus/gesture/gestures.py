"""The gesture library: wrist targets, palms and hand shapes, and the words that call for them.

Positions are in metres from the chest joint in the chest's frame, as (out, up, forward), where
"out" is towards the hand's own side; a palm is the direction it faces, in the same axes.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float

from model.corpus.gesture.hand_shapes import SHAPES

Vector = Float[np.ndarray, " 3"]


@dataclass(frozen=True)
class HandPose:
    """Where one hand is and how it is held."""

    position: Vector
    palm: Vector
    flex_deg: float = 0.0
    """Wrist flexion towards the palm."""
    deviation_deg: float = 0.0
    """Wrist deviation towards the thumb."""
    elbow_out: float = 0.0
    """How far the elbow is lifted sideways; 0 hangs under the shoulder."""
    fingers: Float[np.ndarray, " 19"] = field(default_factory=lambda: SHAPES["relaxed"])


@dataclass(frozen=True)
class Cycle:
    """A repeated circle or up-and-down of the hands during the stroke."""

    vertical_m: float
    forward_m: float
    hz: float
    in_turn: bool
    """The second hand goes half a period later."""


@dataclass(frozen=True)
class Gesture:
    """Preparation and stroke poses; ``via`` poses lie between them at a share of the stroke."""

    hands: Literal["one", "two", "free", "dominant", "other"]
    prepare: HandPose
    stroke: HandPose
    via: tuple[tuple[float, HandPose], ...] = ()
    shapes: tuple[str, ...] = ()
    """Hand shapes that serve the stroke as well as its own."""
    cycle: Cycle | None = None
    shrugs: bool = False


def _pose(position, palm, flex=0.0, deviation=0.0, shape="relaxed", elbow=0.0) -> HandPose:
    return HandPose(
        *(np.array(position, dtype=np.float64), np.array(palm, dtype=np.float64)),
        *(float(flex), float(deviation), float(elbow), SHAPES[shape]),
    )


NEUTRAL = np.array([0.20, -0.14, 0.29])  # the middle of the gesture space

REST: dict[str, HandPose] = {
    "hang": _pose((0.30, -0.345, 0.085), (-0.95, -0.05, -0.3), 2, 0, "lazy"),
    "home": _pose((0.11, -0.235, 0.26), (-0.55, -0.25, -0.6), 8, 0, "relaxed", 0.12),
    "clasp": _pose((0.10, -0.17, 0.265), (-0.75, 0.1, -0.45), 6, 4, "bowl", 0.15),
    "low": _pose((0.25, -0.265, 0.245), (-0.95, -0.15, -0.1), 2, 0, "relaxed"),
    "ready": _pose((0.20, -0.18, 0.315), (-0.85, -0.35, 0.05), 0, 0, "half_open"),
    "wide": _pose((0.30, -0.215, 0.26), (-0.55, 0.7, 0.1), -4, 0, "cup", 0.05),
    "steeple": _pose((0.10, -0.085, 0.305), (-0.95, 0.0, 0.1), -6, 0, "flat", 0.1),
    "hip": _pose((0.275, -0.265, 0.075), (-0.6, -0.35, -0.75), 16, 0, "soft_fist", 0.4),
}

GESTURES: dict[str, Gesture] = {
    "beat": Gesture(
        "free",
        _pose((0.20, -0.075, 0.285), (-0.75, -0.45, 0.1), 4),
        _pose((0.215, -0.165, 0.325), (-0.75, -0.55, 0.1), 14),
    ),
    "offer": Gesture(
        "free",
        _pose((0.14, -0.13, 0.24), (-0.85, 0.35, -0.15), 6),
        _pose((0.225, -0.135, 0.345), (-0.30, 0.9, 0.05), -12, 0, "cup"),
        shapes=("open", "half_open", "bowl"),
    ),
    "offer_low": Gesture(
        "free",
        _pose((0.16, -0.17, 0.24), (-0.9, 0.2, -0.1), 4),
        _pose((0.26, -0.195, 0.31), (-0.2, 0.93, 0.1), -16, 0, "open"),
        shapes=("half_open", "cup"),
    ),
    "turn_out": Gesture(
        "free",
        _pose((0.17, -0.10, 0.27), (-0.6, -0.7, 0.0), 10, 0, "lazy"),
        _pose((0.235, -0.105, 0.30), (0.15, 0.95, 0.1), -14, 0, "half_open"),
        shapes=("cup", "open", "soft_pinch"),
    ),
    "present": Gesture(
        "two",
        _pose((0.13, -0.16, 0.25), (-0.8, 0.3, -0.2), 6, 0, "bowl"),
        _pose((0.235, -0.10, 0.33), (-0.45, 0.8, 0.2), -14, 0, "open"),
        shapes=("half_open", "splayed"),
    ),
    "weigh": Gesture(
        "two",
        _pose((0.19, -0.15, 0.28), (-0.3, 0.9, 0.0), 0, 0, "bowl"),
        _pose((0.215, -0.12, 0.31), (-0.2, 0.95, 0.0), -6, 0, "cup"),
        cycle=Cycle(0.05, 0.0, 0.8, in_turn=True),
    ),
    "cup_both": Gesture(
        "two",
        _pose((0.13, -0.13, 0.27), (-0.9, 0.1, 0.0), 4, 0, "bowl"),
        _pose((0.125, -0.105, 0.32), (-0.85, 0.4, 0.1), -4, 0, "cage"),
        shapes=("bowl", "claw"),
    ),
    "frame": Gesture(
        "two",
        _pose((0.19, -0.05, 0.27), (-0.9, -0.1, 0.2), 2, 0, "half_open"),
        _pose((0.165, -0.115, 0.335), (-0.95, -0.1, 0.1), 0, 0, "blade"),
        shapes=("flat", "cage"),
    ),
    "chop": Gesture(
        "one",
        _pose((0.19, 0.0, 0.27), (-0.9, -0.1, 0.3), -8, 8, "blade"),
        _pose((0.165, -0.125, 0.335), (-0.95, -0.25, 0.1), 4, -8, "blade"),
        shapes=("flat",),
    ),
    "precise": Gesture(
        "one",
        _pose((0.18, -0.09, 0.27), (-0.7, -0.4, 0.2), 6, 0, "lazy"),
        _pose((0.155, -0.03, 0.315), (-0.65, -0.3, 0.6), -10, 0, "ring_pinch"),
        shapes=("pinch", "purse", "soft_pinch"),
    ),
    "set_down": Gesture(
        "free",
        _pose((0.18, -0.06, 0.27), (-0.5, -0.8, 0.0), 6, 0, "lazy"),
        _pose((0.215, -0.165, 0.33), (-0.25, -0.95, 0.1), -12, 0, "flat", 0.1),
        shapes=("half_open", "open"),
    ),
    "pull": Gesture(
        "one",
        _pose((0.15, -0.08, 0.37), (-0.6, 0.2, -0.5), -4, 0, "half_open"),
        _pose((0.225, -0.10, 0.25), (-0.6, 0.3, -0.6), 8, 0, "purse", 0.1),
        shapes=("soft_pinch", "ring_pinch"),
    ),
    "open_up": Gesture(
        "two",
        _pose((0.11, -0.15, 0.29), (-0.6, -0.6, 0.1), 8, 0, "soft_pinch", 0.1),
        _pose((0.25, -0.125, 0.30), (-0.2, 0.7, 0.45), -16, 0, "splayed"),
        shapes=("open", "half_open"),
    ),
    "arc": Gesture(
        "one",
        _pose((0.10, -0.13, 0.28), (-0.5, -0.6, 0.2), 4, 0, "relaxed"),
        _pose((0.285, -0.13, 0.29), (-0.3, -0.3, 0.8), -8, 0, "half_open"),
        via=((0.5, _pose((0.19, -0.03, 0.32), (-0.5, -0.6, 0.4), -4)),),
        shapes=("soft_pinch", "cup"),
    ),
    "brush": Gesture(
        "free",
        _pose((0.185, -0.15, 0.27), (-0.7, -0.2, -0.5), 22, 0, "lazy"),
        _pose((0.24, -0.13, 0.315), (-0.6, 0.2, 0.6), -22, 0, "half_open"),
        shapes=("open", "wave_out"),
    ),
    "point_up": Gesture(
        "one",
        _pose((0.19, -0.08, 0.25), (-0.8, -0.2, 0.2), 4, 0, "loose"),
        _pose((0.20, 0.045, 0.275), (-0.55, 0.0, 0.8), -10, 0, "soft_point"),
        shapes=("point", "point_thumb"),
    ),
    "wave_off": Gesture(
        "free",
        _pose((0.17, -0.06, 0.26), (-0.6, -0.6, -0.2), 18, 0, "wave_in"),
        _pose((0.255, -0.085, 0.31), (-0.4, -0.3, 0.8), -16, -6, "wave_out"),
        shapes=("open", "half_open"),
    ),
    "self": Gesture(
        "one",
        _pose((0.17, -0.09, 0.25), (-0.75, 0, -0.5), 5),
        _pose((0.065, -0.055, 0.215), (-0.3, 0.05, -0.95), 12, 0, "flat", 0.22),
        shapes=("cup", "bowl"),
    ),
    "you": Gesture(
        "one",
        _pose((0.17, -0.06, 0.25), (-0.7, -0.4, 0), 4),
        _pose((0.16, -0.03, 0.40), (-0.75, -0.45, 0.2), 0, 0, "point"),
        shapes=("soft_point", "point_thumb"),
    ),
    "you_open": Gesture(
        "free",
        _pose((0.15, -0.10, 0.22), (-0.9, 0.2, 0), 4),
        _pose((0.18, -0.09, 0.385), (-0.55, 0.75, 0.2), -14, 0, "cup"),
        shapes=("open", "half_open"),
    ),
    "there": Gesture(
        "one",
        _pose((0.20, -0.04, 0.27), (-0.7, -0.5, 0), 6),
        _pose((0.345, 0.055, 0.275), (-0.15, -0.85, 0.4), -6, 0, "point", 0.1),
        shapes=("soft_point", "flat"),
    ),
    "big": Gesture(
        "two",
        _pose((0.12, -0.085, 0.285), (-0.95, 0, 0.1), 2, 0, "cage"),
        _pose((0.31, -0.035, 0.275), (-0.93, 0.1, 0.25), -8, 0, "open", 0.2),
        shapes=("splayed", "cage"),
    ),
    "small": Gesture(
        "one",
        _pose((0.17, -0.08, 0.26), (-0.7, -0.3, 0.2), 2),
        _pose((0.14, 0.025, 0.30), (-0.75, -0.05, 0.6), -6, 0, "pinch"),
        shapes=("ring_pinch", "purse"),
    ),
    "small_both": Gesture(
        "two",
        _pose((0.17, -0.09, 0.27), (-0.9, 0, 0), 0, 0, "flat"),
        _pose((0.10, -0.07, 0.315), (-0.98, 0, 0.1), 4, 0, "blade"),
        shapes=("cup", "soft_pinch"),
    ),
    "round": Gesture(
        "two",
        _pose((0.11, 0.005, 0.30), (-0.5, -0.8, 0.1), 8, 0, "cage"),
        _pose((0.12, -0.175, 0.30), (-0.6, 0.75, 0), 6, 0, "cage"),
        via=((0.45, _pose((0.225, -0.08, 0.30), (-0.98, -0.05, 0), 2, 0, "cage", 0.2)),),
    ),
    "long": Gesture(
        "two",
        _pose((0.10, -0.10, 0.30), (-0.95, -0.1, 0.15), 4, 0, "flat"),
        _pose((0.315, -0.09, 0.295), (-0.85, -0.2, 0.45), -4, 0, "flat", 0.1),
        shapes=("blade", "pinch"),
    ),
    "stop": Gesture(
        "free",
        _pose((0.17, -0.05, 0.21), (-0.5, -0.2, 0.5), -10),
        _pose((0.185, 0.02, 0.365), (-0.12, 0.1, 0.98), -46, 0, "flat"),
        shapes=("open",),
    ),
    "shrug": Gesture(
        "two",
        _pose((0.20, -0.17, 0.24), (-0.8, 0.3, 0), 4),
        _pose((0.31, -0.125, 0.235), (0.0, 0.92, 0.3), -26, 0, "open", -0.1),
        shapes=("half_open", "splayed"),
        shrugs=True,
    ),
    "wow": Gesture(
        "two",
        _pose((0.20, 0.01, 0.25), (-0.8, 0, 0.3), 0, 0, "open"),
        _pose((0.225, 0.215, 0.235), (-0.75, 0.05, 0.55), -14, 0, "splayed", 0.05),
        shapes=("open",),
    ),
    "drive": Gesture(
        "two",
        _pose((0.155, -0.055, 0.33), (-0.55, -0.75, 0.1), -4, 0, "loose"),
        _pose((0.16, -0.05, 0.345), (-0.55, -0.75, 0.1), -8, 0, "grip"),
        cycle=Cycle(0.075, 0.0, 0.95, in_turn=True),
    ),
    "dismiss": Gesture(
        "one",
        _pose((0.12, -0.015, 0.26), (-0.5, -0.55, -0.6), 30, 0, "wave_in"),
        _pose((0.275, -0.10, 0.335), (-0.1, -0.6, 0.8), -22, 0, "open"),
        shapes=("wave_out", "half_open"),
    ),
    "sweep": Gesture(
        "free",
        _pose((0.08, -0.075, 0.295), (-0.2, -0.95, 0.1), 6, 0, "flat", 0.1),
        _pose((0.305, -0.095, 0.29), (-0.15, -0.97, 0.2), -4, 0, "open", 0.05),
        shapes=("flat", "half_open"),
    ),
    "back": Gesture(
        "one",
        _pose((0.20, -0.03, 0.22), (-0.7, -0.2, 0.2)),
        _pose((0.285, 0.07, 0.205), (-0.5, 0.25, -0.85), -12, 0, "half_open", 0.15),
        shapes=("thumb_out", "relaxed"),
    ),
    "forward": Gesture(
        "one",
        _pose((0.15, -0.08, 0.21), (-0.9, -0.1, 0.2), 2),
        _pose((0.18, 0.0, 0.395), (-0.8, -0.5, 0.3), -4, 0, "flat"),
        shapes=("blade", "soft_point"),
    ),
    "roll": Gesture(
        "two",
        _pose((0.12, -0.10, 0.28), (-0.35, -0.2, -0.9), 6, 0, "relaxed", 0.2),
        _pose((0.14, -0.13, 0.315), (-0.5, -0.2, -0.85), 6, 0, "half_open", 0.2),
        shapes=("lazy", "soft_point"),
        cycle=Cycle(0.055, 0.055, 1.4, in_turn=True),
    ),
    "think": Gesture(
        "one",
        _pose((0.18, -0.09, 0.26), (-0.7, -0.3, 0.1), 4, 0, "lazy"),
        _pose((0.20, 0.0, 0.30), (-0.75, -0.25, 0.3), -4, 0, "half_open"),
        shapes=("claw", "soft_pinch"),
        cycle=Cycle(0.03, 0.03, 1.1, in_turn=False),
    ),
    "one": Gesture(
        "one",
        _pose((0.18, -0.06, 0.22), (-0.8, -0.2, 0.3), 4, 0, "loose"),
        _pose((0.20, 0.045, 0.27), (-0.35, 0.05, 0.93), -16, 0, "one"),
    ),
    "two": Gesture(
        "one",
        _pose((0.18, -0.06, 0.22), (-0.8, -0.2, 0.3), 4, 0, "loose"),
        _pose((0.205, 0.04, 0.275), (-0.35, 0.05, 0.93), -16, 0, "two"),
    ),
    "three": Gesture(
        "one",
        _pose((0.18, -0.06, 0.22), (-0.8, -0.2, 0.3), 4, 0, "loose"),
        _pose((0.21, 0.045, 0.275), (-0.35, 0.05, 0.93), -16, 0, "three"),
    ),
    "this_side": Gesture(
        "other",
        _pose((0.17, -0.12, 0.25), (-0.8, 0.2, 0), 4),
        _pose((0.275, -0.115, 0.31), (-0.15, 0.92, 0.1), -10, 0, "cup"),
        shapes=("flat", "half_open"),
    ),
    "that_side": Gesture(
        "dominant",
        _pose((0.17, -0.12, 0.25), (-0.8, 0.2, 0), 4),
        _pose((0.275, -0.115, 0.31), (-0.15, 0.92, 0.1), -10, 0, "cup"),
        shapes=("flat", "half_open"),
    ),
    "here": Gesture(
        "one",
        _pose((0.18, -0.06, 0.26), (-0.7, -0.5, 0.1), 4, 0, "loose"),
        _pose((0.155, -0.175, 0.345), (-0.45, -0.85, 0.1), 8, 0, "point"),
        shapes=("soft_point", "flat"),
    ),
    "up": Gesture(
        "one",
        _pose((0.20, -0.13, 0.27), (-0.5, 0.6, 0.2), 0, 0, "half_open"),
        _pose((0.225, 0.10, 0.285), (-0.35, 0.85, 0.3), -14, 0, "open"),
        shapes=("point", "flat"),
    ),
    "down": Gesture(
        "free",
        _pose((0.20, -0.04, 0.27), (-0.3, -0.9, 0.1), -4, 0, "flat"),
        _pose((0.215, -0.215, 0.325), (-0.2, -0.97, 0.1), -8, 0, "flat", 0.05),
        shapes=("half_open", "open"),
    ),
    "no": Gesture(
        "two",
        _pose((0.085, -0.075, 0.295), (-0.3, -0.9, 0.2), 4, 0, "flat", 0.1),
        _pose((0.275, -0.115, 0.305), (-0.15, -0.9, 0.4), -6, 0, "flat", 0.05),
        shapes=("blade", "open"),
    ),
    "all": Gesture(
        "two",
        _pose((0.11, -0.04, 0.33), (-0.6, -0.3, 0.5), 2, 0, "half_open", 0.1),
        _pose((0.325, -0.10, 0.265), (-0.4, 0.75, 0.3), -10, 0, "open", 0.1),
        via=((0.5, _pose((0.25, -0.02, 0.34), (-0.6, 0.2, 0.6), -4, 0, "open", 0.1)),),
        shapes=("splayed", "half_open"),
    ),
    "together": Gesture(
        "two",
        _pose((0.27, -0.09, 0.28), (-0.9, 0.2, 0.1), 0, 0, "open"),
        _pose((0.095, -0.10, 0.315), (-0.95, 0.1, 0.1), 4, 0, "cage"),
        shapes=("bowl", "blade"),
    ),
    "quote": Gesture(
        "two",
        _pose((0.22, -0.03, 0.25), (-0.4, -0.1, 0.9), -8, 0, "loose"),
        _pose((0.235, 0.085, 0.275), (-0.3, 0.0, 0.95), -14, 0, "two"),
        cycle=Cycle(0.012, 0.008, 1.9, in_turn=False),
    ),
    "four": Gesture(
        "one",
        _pose((0.18, -0.06, 0.22), (-0.8, -0.2, 0.3), 4, 0, "loose"),
        _pose((0.21, 0.045, 0.275), (-0.35, 0.05, 0.93), -16, 0, "four"),
    ),
    "five": Gesture(
        "one",
        _pose((0.18, -0.06, 0.22), (-0.8, -0.2, 0.3), 4, 0, "loose"),
        _pose((0.21, 0.04, 0.28), (-0.35, 0.05, 0.93), -16, 0, "splayed"),
    ),
    "item": Gesture(
        "two",
        _pose((0.16, -0.055, 0.28), (-0.92, -0.1, 0.1), 2, 0, "half_open"),
        _pose((0.135, -0.155, 0.33), (-0.95, -0.15, 0.1), 2, 0, "blade"),
        shapes=("flat", "cage", "bowl"),
    ),
    "carry": Gesture(
        "two",
        _pose((0.16, -0.20, 0.26), (-0.7, 0.5, 0.1), 4, 0, "cage"),
        _pose((0.16, -0.10, 0.32), (-0.75, 0.6, 0), 0, 0, "grip"),
        shapes=("cage", "bowl"),
    ),
    "phone": Gesture(
        "one",
        _pose((0.18, -0.02, 0.24), (-0.8, 0, 0), 0, 0, "loose"),
        _pose((0.215, 0.18, 0.215), (-0.75, 0.1, -0.6), 8, 0, "phone", -0.05),
    ),
    "knock": Gesture(
        "one",
        _pose((0.19, -0.02, 0.26), (-0.6, -0.4, 0.5), -8, 0, "soft_fist"),
        _pose((0.18, -0.045, 0.355), (-0.6, -0.5, 0.5), 10, 0, "knock"),
        shapes=("soft_fist",),
    ),
}

_WORDS = {
    "self": "i me my myself mine heart believe",
    "you": "you your",
    "you_open": "see remember think sure",
    "there": "there over behind straight street left",
    "big": "big huge large tall hundred thousand bigger biggest",
    "small": "small tiny little detail details simple gap smaller",
    "small_both": "mistake details little",
    "round": "round circle circles ball",
    "long": "long line wide",
    "stop": "stop wait please enough",
    "shrug": "maybe perhaps idea knows why anybody sure wrong",
    "wow": "wow amazing incredible crazy",
    "drive": "driving drove wheel",
    "dismiss": "forget boring exaggerating waste",
    "sweep": "everywhere across",
    "back": "last past ago yesterday",
    "forward": "future next forward go",
    "roll": "repeat change improve step practise again",
    "think": "think imagine believe feels idea understand",
    "precise": "exactly rules measure careful practical point",
    "frame": "plan project problem question results idea",
    "present": "beautiful wonderful brilliant answer story",
    "weigh": "compare compared comparing either rather maybe perhaps",
    "point_up": "important remember listen best only",
    "one": "first",
    "two": "two second twice",
    "three": "three third",
    "this_side": "some either",
    "that_side": "others other or",
    "carry": "carried carry box bags heavy lifted lift",
    "phone": "phone called",
    "knock": "door",
    "here": "here now this",
    "up": "up high highest climb climbed mountain tower towers",
    "down": "down low quiet under slow slowing",
    "no": "no not never nobody nothing without",
    "all": "all every everything everyone everybody whole people",
    "together": "together between share sharing connect",
    "quote": "quote quotes famous",
    "four": "four",
    "five": "five",
}


def _calls() -> dict[str, tuple[str, ...]]:
    calls: dict[str, tuple[str, ...]] = {}
    for gesture, words in _WORDS.items():
        for word in words.split():
            calls[word] = (*calls.get(word, ()), gesture)
    return calls


KEYWORDS = _calls()
"""For each word the gestures it may call for."""

ONLY_WHEN_STRESSED = frozenset(
    """self you you_open there sweep big roll think dismiss back one two frame weigh shrug here no
    all up down""".split()
)
"""Gestures whose words are too common to gesture at every time."""

LISTED = ("item", "item", "item", "set_down", "frame", "chop")
"""Gestures that set down one item of a list beside the other."""

GENERIC: dict[str, float] = {
    **{"beat": 3.6, "offer": 2.0, "offer_low": 1.3, "turn_out": 1.6, "you_open": 0.8},
    **{"present": 0.9, "cup_both": 0.8, "frame": 0.8, "precise": 0.8, "chop": 0.7},
    **{"set_down": 1.3, "brush": 1.0, "arc": 1.0, "pull": 0.7, "open_up": 0.8},
    **{"wave_off": 0.7, "sweep": 0.4, "roll": 0.5, "weigh": 0.5, "think": 0.6, "point_up": 0.4},
    **{"small_both": 0.3, "small": 0.2, "big": 0.1},
}
"""Weights of the gestures drawn where no word calls for one."""
