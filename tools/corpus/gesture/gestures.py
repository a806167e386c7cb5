"""Gesture library: wrist targets, palms, hand shapes, and the words of literal gestures.

A hand shape is 19 numbers in degrees: flexion of the three joints of index, middle, ring and pinky
(12), abduction of each of these fingers (4, positive away from the middle finger's line towards the
pinky), and the thumb's flexion, opposition and tip bend (3).

Positions are in metres from the chest joint in the chest's frame, as (out, up, forward), where
"out" is towards the hand's own side; a palm is the direction it faces, in the same axes.
"""

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from conventions.joints import JOINT_INDEX
from tools.corpus.people.rig import SIDE_SIGN, euler_matrices, matrices

LONG_FINGERS = ("index", "middle", "ring", "pinky")
SHAPE_SIZE = 19
FLEX = slice(0, 12)
ABDUCTION = slice(12, 16)
THUMB = slice(16, 19)
LOWEST_FLEX_DEG = (-8.0, 0.0, -2.0)  # for the three joints of a long finger
_ABDUCTION_PER_SPREAD = np.array([-1.0, -0.1, 0.35, 0.9])
_CLOSED_ABDUCTION = np.array(
    [5.0, 1.0, -4.0, -10.0]
)  # brings the rest pose's fanned fingers together


def _shape(index, middle, ring, pinky, spread, thumb) -> Float[np.ndarray, " 19"]:
    flex = np.array([*index, *middle, *ring, *pinky], dtype=np.float64)
    return np.concatenate([flex, spread * _ABDUCTION_PER_SPREAD, np.array(thumb, dtype=np.float64)])


SHAPES: dict[str, Float[np.ndarray, " 19"]] = {
    "relaxed": _shape((12, 20, 9), (17, 23, 10), (20, 24, 11), (20, 22, 10), 2, (12, 10, 14)),
    "lazy": _shape((20, 28, 12), (27, 32, 14), (30, 34, 15), (27, 30, 13), 3, (14, 12, 18)),
    "half_open": _shape((8, 16, 7), (14, 22, 10), (20, 28, 12), (24, 28, 12), 4, (4, 6, 8)),
    "open": _shape((6, 13, 6), (8, 15, 7), (9, 16, 8), (9, 15, 8), 8, (-6, -8, 2)),
    "splayed": _shape((-2, 8, 4), (0, 9, 5), (2, 10, 5), (1, 8, 5), 15, (-14, -14, -4)),
    "flat": _shape((10, 9, 4), (11, 10, 4), (12, 11, 5), (13, 12, 5), 0, (2, 4, 6)),
    "blade": _shape((3, 5, 2), (4, 5, 3), (5, 6, 3), (6, 7, 3), -1, (6, 12, 8)),
    "cup": _shape((10, 14, 7), (15, 17, 8), (19, 19, 9), (22, 20, 10), 5, (0, 0, 8)),
    "bowl": _shape((24, 22, 10), (26, 24, 12), (28, 25, 12), (30, 24, 12), 7, (2, 12, 14)),
    "cage": _shape((14, 34, 16), (15, 36, 17), (17, 36, 17), (18, 34, 16), 11, (8, 14, 16)),
    "claw": _shape((6, 48, 26), (8, 50, 28), (9, 50, 28), (10, 46, 26), 10, (8, 10, 26)),
    "fist": _shape((62, 72, 40), (68, 78, 42), (70, 78, 42), (70, 74, 40), -2, (35, 30, 34)),
    "soft_fist": _shape((48, 58, 30), (55, 64, 34), (58, 64, 34), (58, 60, 32), 0, (28, 26, 26)),
    "loose": _shape((38, 48, 24), (46, 54, 28), (50, 55, 28), (52, 52, 28), 0, (24, 22, 20)),
    "thumb_out": _shape((52, 60, 32), (58, 66, 34), (60, 66, 34), (60, 62, 32), 0, (-20, -16, -8)),
    "point": _shape((3, 5, 2), (58, 70, 38), (64, 74, 40), (66, 72, 40), 0, (32, 28, 26)),
    "soft_point": _shape((6, 14, 7), (34, 42, 20), (44, 50, 24), (48, 48, 24), 2, (18, 18, 20)),
    "point_thumb": _shape((4, 8, 4), (54, 64, 34), (60, 68, 36), (62, 66, 36), 2, (-12, -10, 0)),
    "pinch": _shape((36, 42, 20), (30, 34, 16), (22, 26, 13), (16, 20, 10), 4, (24, 34, 18)),
    "soft_pinch": _shape((30, 36, 17), (32, 36, 17), (34, 37, 18), (34, 36, 17), 2, (20, 28, 16)),
    "ring_pinch": _shape((44, 52, 24), (14, 20, 9), (8, 14, 7), (4, 11, 6), 8, (26, 32, 22)),
    "purse": _shape((40, 34, 16), (44, 36, 17), (44, 36, 17), (40, 34, 16), -3, (30, 40, 16)),
    "one": _shape((0, 3, 1), (62, 74, 40), (66, 76, 40), (66, 72, 40), 0, (34, 30, 28)),
    "two": _shape((0, 3, 1), (0, 4, 2), (64, 74, 40), (66, 72, 40), 7, (34, 32, 28)),
    "three": _shape((0, 4, 2), (0, 4, 2), (4, 8, 4), (60, 68, 38), 7, (34, 36, 28)),
    "four": _shape((0, 4, 2), (0, 4, 2), (2, 5, 2), (4, 8, 4), 9, (34, 40, 30)),
    "phone": _shape((50, 60, 32), (56, 66, 34), (56, 64, 34), (8, 12, 6), 8, (-22, -18, -8)),
    "wave_in": _shape((20, 14, 6), (28, 22, 10), (36, 30, 14), (44, 38, 18), 4, (6, 8, 10)),
    "wave_out": _shape((34, 40, 19), (26, 30, 14), (18, 20, 10), (10, 13, 6), 5, (6, 10, 10)),
    "grip": _shape((46, 50, 22), (50, 54, 24), (52, 54, 24), (50, 50, 22), 3, (10, 34, 22)),
    "knock": _shape((56, 62, 20), (58, 64, 20), (60, 64, 20), (58, 60, 20), 0, (20, 16, 20)),
}


def finger_rotations(
    side: str, curves: Float[np.ndarray, "T 19"], twist: Float[np.ndarray, "T 12"]
) -> dict[int, Float[np.ndarray, "T 3 3"]]:
    """Compute the local rotations of one hand's 15 joints.

    ``curves`` are hand shapes, ``twist`` rotations about the long fingers' bones, both in degrees.
    """
    sign = SIDE_SIGN[side]
    rotations = {}
    for k, finger in enumerate(LONG_FINGERS):
        for j in range(3):
            flex = _within_joint(curves[:, 3 * k + j], LOWEST_FLEX_DEG[j])
            # A bent finger cannot be spread.
            freedom = np.clip(1.0 - flex / 90.0, 0.3, 1.0)
            abduction = (_CLOSED_ABDUCTION[k] + np.clip(curves[:, 12 + k], -12.0, 18.0)) * freedom
            yaw = abduction if j == 0 else 0.3 * twist[:, 3 * k + j]
            angles = np.stack([sign * yaw, -sign * flex, twist[:, 3 * k + j]], axis=1)
            rotations[JOINT_INDEX[f"{side}_{finger}{j + 1}"]] = euler_matrices("YZX", angles)
    flex, oppose, bend = np.clip(curves[:, THUMB], -30.0, 50.0).T
    zero = np.zeros_like(flex)
    thumb = (
        (12.0 + 0.9 * oppose, 10.0 + 0.35 * flex, -4.0 - 0.35 * oppose),
        (0.15 * oppose, 4.0 + 0.55 * flex, -0.35 * flex),
        (zero, 2.0 + 0.8 * bend, -0.4 * bend),
    )
    for j, (x, y, z) in enumerate(thumb):
        vector = np.radians(np.stack([x, sign * y, sign * z], axis=1))
        rotations[JOINT_INDEX[f"{side}_thumb{j + 1}"]] = matrices(vector)
    return rotations


def _within_joint(flex: Float[np.ndarray, " T"], lowest: float) -> Float[np.ndarray, " T"]:
    """Limit flexion smoothly above the joint's lowest angle, and to at most 95 degrees."""
    margin = 8.0
    over = np.maximum(lowest + margin - flex, 0.0)
    soft = np.where(over > 0, lowest + margin - margin * np.tanh(over / margin), flex)
    return np.minimum(soft, 95.0)


Vector = Float[np.ndarray, " 3"]


@dataclass(frozen=True)
class HandPose:
    """Position, orientation and shape of one hand."""

    position: Vector
    palm: Vector
    flex_deg: float = 0.0
    """Wrist flexion towards the palm (degrees)."""
    deviation_deg: float = 0.0
    """Wrist deviation towards the thumb (degrees)."""
    elbow_out: float = 0.0
    """Sideways lift of the elbow; 0 hangs under the shoulder."""
    fingers: Float[np.ndarray, " 19"] = field(default_factory=lambda: SHAPES["relaxed"])


@dataclass(frozen=True)
class Cycle:
    """Repeated circle or up-and-down movement of the hands during the stroke."""

    vertical_m: float
    forward_m: float
    hz: float
    alternates: bool
    """True if the second hand is half a period later."""


@dataclass(frozen=True)
class GestureShape:
    """Preparation and stroke poses; ``via`` poses are between them at a share of the stroke."""

    hands: Literal["one", "two", "free", "dominant", "other"]
    prepare: HandPose
    stroke: HandPose
    via: tuple[tuple[float, HandPose], ...] = ()
    shapes: tuple[str, ...] = ()
    """Alternative hand shapes of the stroke."""
    cycle: Cycle | None = None
    shrugs: bool = False


def _pose(definition: dict[str, Any]) -> HandPose:
    return HandPose(
        position=np.array(definition["position"], dtype=np.float64),
        palm=np.array(definition["palm"], dtype=np.float64),
        flex_deg=float(definition.get("flex_deg", 0)),
        deviation_deg=float(definition.get("deviation_deg", 0)),
        elbow_out=float(definition.get("elbow_out", 0)),
        fingers=SHAPES[definition.get("shape", "relaxed")],
    )


def _gesture(content: dict[str, Any]) -> GestureShape:
    return GestureShape(
        content["hands"],
        _pose(content["prepare"]),
        _pose(content["stroke"]),
        tuple((each["share"], _pose(each["pose"])) for each in content.get("via", ())),
        tuple(content.get("shapes", ())),
        Cycle(**content["cycle"]) if "cycle" in content else None,
        content.get("shrugs", False),
    )


_TABLES = tomllib.loads(Path(__file__).with_name("gestures.toml").read_text("utf-8"))
NEUTRAL = np.array([0.20, -0.14, 0.29])  # the middle of the gesture space
REST: dict[str, HandPose] = {name: _pose(entry) for name, entry in _TABLES["rest"].items()}
GESTURES: dict[str, GestureShape] = {
    name: _gesture(entry) for name, entry in _TABLES["gestures"].items()
}


def _calls() -> dict[str, tuple[str, ...]]:
    calls: dict[str, tuple[str, ...]] = {}
    for gesture, words in _TABLES["words"].items():
        for word in words.split():
            calls[word] = (*calls.get(word, ()), gesture)
    return calls


GESTURES_BY_WORD = _calls()
"""Names of the literal gestures of each word."""

ONLY_WHEN_STRESSED = frozenset(
    """self you you_open there sweep big roll think dismiss back one two frame weigh shrug here no
    all up down""".split()
)
"""Gestures with words that are too common to be gestured every time."""

LISTED = ("item", "item", "item", "set_down", "frame", "chop")
"""Gestures that set down one item of a list next to the other."""

GENERIC: dict[str, float] = _TABLES["generic"]
"""Weights of the gestures for accents without a literal gesture."""
