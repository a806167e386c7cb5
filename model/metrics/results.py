"""Results of all metrics of one motion.

Fields are named as the keys of ``diagnostics.json`` and explained in ``docs/formats.md``; a metric
of a clip that is too short or too still for it is NaN or None.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, is_dataclass
from typing import Any, Literal

import numpy as np

from model.metrics import joints
from model.metrics.lag import Lag
from model.metrics.posture import PostureMetrics
from model.metrics.reference_error import Diversity, ErrorsToReference
from model.metrics.seams import SeamMetrics
from model.metrics.tracked_point import TrackedPointMetrics

BeatSpeedSource = Literal["reference", "own", "emage"]


@dataclass(frozen=True)
class BeatMetrics:
    """BeatAlign in EMAGE's direction with its chance level and details; NaN if no onset counts."""

    beat_align: float
    beat_align_chance: float
    beat_align_chance_highest: float
    """Highest score of the shifted onsets, the mean of which is the chance level."""
    beats_per_joint_s: float
    """Motion beats per second, mean of the 13 joints."""
    num_speech_onsets: int
    """Number of onsets that count."""
    beat_speed_source: BeatSpeedSource
    """Source of the mean speeds in the threshold of motion beats."""


@dataclass(frozen=True)
class PublishedProtocolMetrics:
    """Values of published protocols (`model.metrics.protocols`) by id and name."""

    protocols: Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class MotionMetrics:
    """All metrics of one motion; in files the fields of all groups are on one level."""

    point: TrackedPointMetrics
    fingertips: joints.FingertipMetrics
    positions: joints.PositionMetrics
    rotations: joints.RotationMetrics
    seams: SeamMetrics
    posture: PostureMetrics
    joint_limits: joints.JointLimitMetrics
    diversity: Diversity
    errors: ErrorsToReference | None = None
    """Errors to the reference; None without a reference."""
    beats: BeatMetrics | None = None
    """BeatAlign; None without speech."""
    lag: Lag | None = None
    """Lag of the unfiltered motion behind the speech; None without speech."""
    published: PublishedProtocolMetrics | None = None
    """Published protocols; None for filtered motion, to which their authors do not apply them."""

    def as_json(self) -> dict[str, Any]:
        """Return the metrics by the keys of ``diagnostics.json``."""
        groups = [vars(group) for group in vars(self).values() if group is not None]
        return {key: as_json(value) for group in groups for key, value in group.items()}


def as_json(value: Any) -> Any:
    """Convert to plain lists and numbers; NaN, which JSON lacks, becomes None."""
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
