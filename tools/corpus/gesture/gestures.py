"""The gesture library: wrist targets, palms and hand shapes, and the words that call for them, as
``gestures.toml`` beside this tells them.

Positions are in metres from the chest joint in the chest's frame, as (out, up, forward), where
"out" is towards the hand's own side; a palm is the direction it faces, in the same axes.
"""

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from tools.corpus.gesture.hand_shapes import SHAPES

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


def _pose(told: dict[str, Any]) -> HandPose:
    return HandPose(
        position=np.array(told["position"], dtype=np.float64),
        palm=np.array(told["palm"], dtype=np.float64),
        flex_deg=float(told.get("flex_deg", 0)),
        deviation_deg=float(told.get("deviation_deg", 0)),
        elbow_out=float(told.get("elbow_out", 0)),
        fingers=SHAPES[told.get("shape", "relaxed")],
    )


def _gesture(told: dict[str, Any]) -> Gesture:
    return Gesture(
        told["hands"],
        _pose(told["prepare"]),
        _pose(told["stroke"]),
        tuple((each["share"], _pose(each["pose"])) for each in told.get("via", ())),
        tuple(told.get("shapes", ())),
        Cycle(**told["cycle"]) if "cycle" in told else None,
        told.get("shrugs", False),
    )


_TOLD = tomllib.loads(Path(__file__).with_name("gestures.toml").read_text("utf-8"))
NEUTRAL = np.array([0.20, -0.14, 0.29])  # the middle of the gesture space
REST: dict[str, HandPose] = {name: _pose(told) for name, told in _TOLD["rest"].items()}
GESTURES: dict[str, Gesture] = {name: _gesture(told) for name, told in _TOLD["gestures"].items()}


def _calls() -> dict[str, tuple[str, ...]]:
    calls: dict[str, tuple[str, ...]] = {}
    for gesture, words in _TOLD["words"].items():
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

GENERIC: dict[str, float] = _TOLD["generic"]
"""Weights of the gestures drawn where no word calls for one."""
