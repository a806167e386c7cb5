"""A limb of two bones and a hinge, such as a leg with its knee: how far and whereto it reaches.

Needs no torch, so that the corpus's worker processes start quickly.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation


def minimum_jerk(phase: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """0 up to phase 0, 1 from phase 1 on, the minimum-jerk polynomial between."""
    x = np.clip(phase, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x * x)


def unit(vector: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """The vector scaled to length 1; a zero vector stays zero."""
    return vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-9)


def about_axis(
    axis: Float[np.ndarray, " 3"], angle: Float[np.ndarray, " T"]
) -> Float[np.ndarray, "T 3 3"]:
    """Rotations by ``angle`` radians about one fixed unit axis."""
    return Rotation.from_rotvec(angle[:, None] * axis).as_matrix()


def hinge_frame(
    along: Float[np.ndarray, "T 3"], hinge: Float[np.ndarray, "T 3"]
) -> Float[np.ndarray, "T 3 3"]:
    """Frames: first column ``along``, second ``hinge`` made orthogonal to it."""
    first = unit(along)
    second = unit(hinge - (first * hinge).sum(-1, keepdims=True) * first)
    return np.stack([first, second, np.cross(first, second)], axis=-1)


@dataclass(frozen=True)
class HingedLimb:
    """Two bones at rest, and the unit axis about which the middle joint alone turns.

    A knee that turns about one axis keeps the sideways angle that thigh and shin have at rest.
    """

    upper: Float[np.ndarray, " 3"]
    lower: Float[np.ndarray, " 3"]
    axis: Float[np.ndarray, " 3"]

    def length(self, bend: Float[np.ndarray, "*T"]) -> Float[np.ndarray, "*T"]:
        """Metres from end to end with the middle joint turned by ``bend`` radians."""
        constant, cosine, sine = self._law_of_cosines()
        return np.sqrt(constant + 2 * (cosine * np.cos(bend) + sine * np.sin(bend)))

    def bend(self, length: Float[np.ndarray, "*T"]) -> Float[np.ndarray, "*T"]:
        """Radians at which the limb is so long; straight where it cannot be."""
        constant, cosine, sine = self._law_of_cosines()
        share = (length**2 - constant) / (2 * np.hypot(cosine, sine))
        return np.arctan2(sine, cosine) + np.arccos(np.clip(share, -1.0, 1.0))

    def reach(
        self, span: Float[np.ndarray, "T 3"], pole: Float[np.ndarray, "T 3"]
    ) -> tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3 3"]]:
        """Rotations of the upper bone, and of the lower bone against it, that reach over ``span``.

        Args:
            span: from the limb's root to where its end shall be.
            pole: the direction in which the middle joint lies off the span.
        """
        turned = about_axis(self.axis, self.bend(np.linalg.norm(span, axis=-1)))
        at_rest = hinge_frame(
            self.upper + turned @ self.lower, np.broadcast_to(self.axis, span.shape)
        )
        return hinge_frame(span, np.cross(pole, span)) @ at_rest.swapaxes(-1, -2), turned

    def _law_of_cosines(self) -> tuple[float, float, float]:
        """c, p, q of: squared length = c + 2 (p cos bend + q sin bend)."""
        fixed = (self.upper @ self.axis) * (self.lower @ self.axis)
        constant = self.upper @ self.upper + self.lower @ self.lower + 2 * fixed
        sine = np.cross(self.axis, self.lower) @ self.upper
        return float(constant), float(self.upper @ self.lower - fixed), float(sine)
