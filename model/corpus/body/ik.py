"""Analytic inverse kinematics: two free bones for arms, two bones on a hinge for legs."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from model.corpus.people.rig import about_axis, transposed, unit


def hinge_frame(
    along: Float[np.ndarray, "T 3"], hinge: Float[np.ndarray, "T 3"]
) -> Float[np.ndarray, "T 3 3"]:
    """Frames: first column ``along``, second ``hinge`` made orthogonal to it."""
    first = unit(along)
    second = unit(hinge - (first * hinge).sum(-1, keepdims=True) * first)
    return np.stack([first, second, np.cross(first, second)], axis=-1)


def two_bone_ik(
    root: Float[np.ndarray, "T 3"],
    target: Float[np.ndarray, "T 3"],
    upper: Float[np.ndarray, " 3"],
    lower: Float[np.ndarray, " 3"],
    hinge: Float[np.ndarray, " 3"],
    pole: Float[np.ndarray, "T 3"],
) -> tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3"]]:
    """Rotations of both bones that bring the lower bone's end to the target.

    A target near or past full stretch is approached softly, so that the middle joint never snaps.

    Args:
        root: where the upper bone begins.
        target: where the lower bone shall end.
        upper: the upper bone at rest.
        lower: the lower bone at rest.
        hinge: the middle joint's axis at rest.
        pole: the direction in which the middle joint lies off the line from root to target.

    Returns:
        The upper bone's rotation, the lower bone's rotation, the lower bone's unit direction.
    """
    a, b = np.linalg.norm(upper), np.linalg.norm(lower)
    reach = target - root
    distance = np.linalg.norm(reach, axis=-1, keepdims=True)
    limit = 0.985 * (a + b)
    soft = limit - 0.06 * (a + b)
    bent = soft + (limit - soft) * (1 - np.exp(-(distance - soft) / (limit - soft)))
    distance = np.maximum(np.where(distance > soft, bent, distance), abs(a - b) + 0.05)
    towards = unit(reach)
    along = (a * a - b * b + distance**2) / (2 * distance)
    height = np.sqrt(np.maximum(a * a - along**2, 1e-8))
    aside = unit(pole - (pole * towards).sum(-1, keepdims=True) * towards)
    middle = towards * along + aside * height
    upper_direction = unit(middle)
    lower_direction = unit(towards * distance - middle)
    upper_rot, lower_rot = bone_rotations(upper_direction, lower_direction, upper, lower, hinge)
    return upper_rot, lower_rot, lower_direction


def bone_rotations(
    upper_direction: Float[np.ndarray, "T 3"],
    lower_direction: Float[np.ndarray, "T 3"],
    upper: Float[np.ndarray, " 3"],
    lower: Float[np.ndarray, " 3"],
    hinge: Float[np.ndarray, " 3"],
) -> tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3 3"]]:
    """Rotations that turn two bones there and the hinge between them across both."""
    axis = unit(np.cross(upper_direction, lower_direction))
    upper_rest = hinge_frame(upper[None], hinge[None])[0]
    lower_rest = hinge_frame(lower[None], hinge[None])[0]
    upper_rot = hinge_frame(upper_direction, axis) @ upper_rest.T
    return upper_rot, hinge_frame(lower_direction, axis) @ lower_rest.T


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
        return hinge_frame(span, np.cross(pole, span)) @ transposed(at_rest), turned

    def _law_of_cosines(self) -> tuple[float, float, float]:
        """c, p, q of: squared length = c + 2 (p cos bend + q sin bend)."""
        fixed = (self.upper @ self.axis) * (self.lower @ self.axis)
        constant = self.upper @ self.upper + self.lower @ self.lower + 2 * fixed
        sine = np.cross(self.axis, self.lower) @ self.upper
        return float(constant), float(self.upper @ self.lower - fixed), float(sine)
