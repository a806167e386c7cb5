"""What detectors look at: a motion, where its joints are, its numbers, and what is beside it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from conventions.joints import FACE, HANDS, LOWER_BODY, UPPER_BODY
from model.measures.posture import FEET
from model.measures.results import Measures
from model.measures.smoothness import angular_velocity
from model.motion.motion import Motion
from model.motion.tracks import Tracks

BODY = (*LOWER_BODY, *UPPER_BODY, *HANDS)
"""All joints but the face's."""
UPPER_AND_HANDS = (*UPPER_BODY, *HANDS)
assert not set(BODY) & set(FACE)


@dataclass(frozen=True, eq=False)
class Evidence:
    """One motion as it is, never filtered."""

    motion: Motion
    tracks: Tracks
    raw: Measures
    point: str
    """What the ``tip_`` measures follow."""
    reference: Evidence | None = None
    """Recorded motion of the same speech, of as many frames."""
    loudness: Float[np.ndarray, " N"] | None = None
    """Of the speech, frame by frame (`timing.loudness_of`)."""

    @property
    def num_frames(self) -> int:
        return self.motion.num_frames

    @cached_property
    def turning(self) -> Float[np.ndarray, "T1 55 3"]:
        """rad/s of each joint against its parent, from each frame to the next."""
        return angular_velocity(self.tracks.local_rot)

    @cached_property
    def turning_deg_s(self) -> Float[np.ndarray, "T1 55"]:
        """Its length in degrees per second."""
        return np.degrees(np.linalg.norm(self.turning, axis=-1))

    @cached_property
    def lower_foot_m(self) -> Float[np.ndarray, " T"]:
        """Height of the lower foot joint in the world."""
        return self.tracks.joints[:, list(FEET), 1].min(axis=1)

    @cached_property
    def floor_m(self) -> float:
        """Where the lower foot usually is: the median, which hardly moves while a foot is where
        no foot can be."""
        return float(np.median(self.lower_foot_m))
