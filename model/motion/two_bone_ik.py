"""Inverse kinematics of a limb with two bones and a hinge, such as a leg with its knee.

It needs no torch, so that the corpus's worker processes start quickly.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation


def minimum_jerk(phase: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Compute the minimum-jerk polynomial from 0 to 1, constant outside phases 0 to 1."""
    x = np.clip(phase, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x * x)


def unit(vector: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Scale a vector to length 1; a zero vector stays zero."""
    return vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-9)


def rotations_about_axis(
    axis: Float[np.ndarray, " 3"], angle: Float[np.ndarray, " T"]
) -> Float[np.ndarray, "T 3 3"]:
    """Return rotations by ``angle`` radians about one fixed unit axis."""
    return Rotation.from_rotvec(angle[:, None] * axis).as_matrix()


def hinge_frame(
    along: Float[np.ndarray, "T 3"], hinge: Float[np.ndarray, "T 3"]
) -> Float[np.ndarray, "T 3 3"]:
    """Make frames with first column ``along``, and second ``hinge`` made orthogonal to it."""
    first = unit(along)
    second = unit(hinge - (first * hinge).sum(-1, keepdims=True) * first)
    return np.stack([first, second, np.cross(first, second)], axis=-1)


@dataclass(frozen=True)
class HingedLimb:
    """A limb of two bones in the rest pose, with the unit axis of its middle joint.

    A knee that turns about one axis keeps the sideways angle of thigh and shin in the rest pose.
    """

    upper_bone: Float[np.ndarray, " 3"]
    lower_bone: Float[np.ndarray, " 3"]
    hinge_axis: Float[np.ndarray, " 3"]

    def length_at_bend(self, bend: Float[np.ndarray, "*T"]) -> Float[np.ndarray, "*T"]:
        """Compute the distance (m) between the ends at a bend of the middle joint (rad)."""
        constant, cosine, sine = self._law_of_cosines()
        return np.sqrt(constant + 2 * (cosine * np.cos(bend) + sine * np.sin(bend)))

    def bend_for_length(self, length: Float[np.ndarray, "*T"]) -> Float[np.ndarray, "*T"]:
        """Compute the bend (rad) at which the limb has a length; straight if it is out of reach."""
        constant, cosine, sine = self._law_of_cosines()
        share = (length**2 - constant) / (2 * np.hypot(cosine, sine))
        return np.arctan2(sine, cosine) + np.arccos(np.clip(share, -1.0, 1.0))

    def solve(
        self, span: Float[np.ndarray, "T 3"], pole: Float[np.ndarray, "T 3"]
    ) -> tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3 3"]]:
        """Compute the rotations of the upper bone, and of the lower relative to it, for ``span``.

        The span is from the limb's root to the target of its end; the middle joint lies off it in
        the direction ``pole``.
        """
        turned = rotations_about_axis(
            self.hinge_axis, self.bend_for_length(np.linalg.norm(span, axis=-1))
        )
        at_rest = hinge_frame(
            self.upper_bone + turned @ self.lower_bone, np.broadcast_to(self.hinge_axis, span.shape)
        )
        return hinge_frame(span, np.cross(pole, span)) @ at_rest.swapaxes(-1, -2), turned

    def _law_of_cosines(self) -> tuple[float, float, float]:
        """Return c, p, q of: squared length = c + 2 (p cos bend + q sin bend)."""
        fixed = (self.upper_bone @ self.hinge_axis) * (self.lower_bone @ self.hinge_axis)
        constant = self.upper_bone @ self.upper_bone + self.lower_bone @ self.lower_bone + 2 * fixed
        sine = np.cross(self.hinge_axis, self.lower_bone) @ self.upper_bone
        return float(constant), float(self.upper_bone @ self.lower_bone - fixed), float(sine)
