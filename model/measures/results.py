"""What is measured of one motion. Fields are called as the keys of ``diagnostics.json``, where
``docs/formats.md`` says what each is; what a clip is too short or too still for is NaN or None.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, is_dataclass
from typing import Any, Literal

import numpy as np

from model.measures.differences import Diversity, ReferenceError
from model.measures.joints import (
    FingertipMeasures,
    PositionMeasures,
    RangeMeasures,
    RotationMeasures,
)
from model.measures.lag import Lag
from model.measures.point import PointMeasures
from model.measures.posture import PostureMeasures
from model.measures.seams import SeamMeasures

BeatSpeeds = Literal["reference", "own", "emage"]


@dataclass(frozen=True)
class BeatMeasures:
    """BeatAlign in EMAGE's direction and its chance level, NaN where no onset counts; and what it
    rests on."""

    beat_align: float
    beat_align_chance: float
    beat_align_chance_highest: float
    """Of the shifts whose mean is the chance level."""
    beats_per_joint_s: float
    """Beats of motion per second, mean of the 13 joints."""
    beat_onsets: int
    """Onsets of the speech that count."""
    beat_speeds_of: BeatSpeeds
    """Whose mean speeds decide what is slow."""


@dataclass(frozen=True)
class Measures:
    """Everything of one motion; in files the fields of all groups stand side by side."""

    point: PointMeasures
    fingertips: FingertipMeasures
    positions: PositionMeasures
    rotations: RotationMeasures
    seams: SeamMeasures
    posture: PostureMeasures
    ranges: RangeMeasures
    diversity: Diversity
    errors: ReferenceError | None = None
    """None without a reference."""
    beats: BeatMeasures | None = None
    """None without speech."""
    lag: Lag | None = None
    """Of the motion as it is; None without speech."""

    def as_json(self) -> dict[str, Any]:
        """By the keys of ``diagnostics.json``."""
        groups = [vars(group) for group in vars(self).values() if group is not None]
        return {key: as_json(value) for group in groups for key, value in group.items()}


def as_json(value: Any) -> Any:
    """Plain lists and numbers. JSON knows no NaN: None says that there is no such number."""
    if is_dataclass(value):
        return as_json(vars(value))
    if isinstance(value, Mapping):
        return {key: as_json(inner) for key, inner in value.items()}
    if isinstance(value, np.ndarray):
        return as_json(value.tolist())
    if isinstance(value, list | tuple):
        return [as_json(inner) for inner in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
