"""A camera that a person has moved around a body, as the page's stage lets them.

app/page/web/body/orbit.js has the same rules and limits; a test holds the two together.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from renderer.scene.camera import Camera

STEEPEST_RAD = 1.48
"""From level, up or down."""
ZOOMS = (0.4, 10.0)
FARTHEST_M = 1.5
"""To the side, and up or down."""


@dataclass(frozen=True)
class Orbit:
    """How a camera has been moved from where it was put."""

    yaw_rad: float = 0.0
    """Around the body."""
    pitch_rad: float = 0.0
    """Above it."""
    zoom: float = 1.0
    """How many times as near."""
    right_m: float = 0.0
    up_m: float = 0.0

    @property
    def is_moved(self) -> bool:
        return self != Orbit()

    def check(self) -> None:
        """Refuse where no camera of the stage can stand.

        Raises:
            ValueError: with one sentence.
        """
        for what, value, least, most in (
            ("yaw", self.yaw_rad, -1e6, 1e6),
            ("pitch", self.pitch_rad, -STEEPEST_RAD, STEEPEST_RAD),
            ("zoom", self.zoom, *ZOOMS),
            ("way to the right", self.right_m, -FARTHEST_M, FARTHEST_M),
            ("way up", self.up_m, -FARTHEST_M, FARTHEST_M),
        ):
            if not least <= value <= most:
                raise ValueError(f"A camera's {what} is {least:g} to {most:g}; got {value:g}.")

    def moved(self, camera: Camera, around: Float[np.ndarray, " 3"]) -> Camera:
        """The camera after the moves.

        Args:
            around: what it is turned about; it looks on past it, as deep as it was before.
        """
        right, up, backward = camera.axes()
        distance = float(backward @ np.subtract(camera.eye, around))
        middle = np.asarray(camera.eye) - distance * backward
        sin, cos = np.sin(self.yaw_rad), np.cos(self.yaw_rad)
        turn = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
        right, up, backward = (turn @ axis for axis in (right, up, backward))
        level = np.arcsin(np.clip(backward[1], -1.0, 1.0))
        pitch = np.clip(level + self.pitch_rad, -STEEPEST_RAD, STEEPEST_RAD) - level
        above = np.cos(pitch) * up - np.sin(pitch) * backward
        behind = np.cos(pitch) * backward + np.sin(pitch) * up
        eye = middle + self.right_m * right + self.up_m * above + distance / self.zoom * behind
        target = eye - behind
        return Camera(
            eye=(float(eye[0]), float(eye[1]), float(eye[2])),
            target=(float(target[0]), float(target[1]), float(target[2])),
            yfov_rad=camera.yfov_rad,
        )
