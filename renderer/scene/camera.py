"""Cameras: perspective, views, automatic framing, and orbits by a person.

World frame: y up, metres, the body faces +z. A camera looks along its own -z, as in OpenGL.

app/page/web/body/orbit.js has the same rules and limits; a test checks that both agree.
"""

import functools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

Z_NEAR_M = 0.1
MARGIN_NDC = 0.06
"""Share of half the picture that is free at each side."""
YFOV_RAD = 0.55
"""Vertical field of view: about a 45 mm lens, so that hands in front are not enlarged."""

_ANGLES_DEG = {
    "front": (0.0, 6.0),
    "three_quarter": (40.0, 6.0),
    "side": (90.0, 6.0),
    "face": (12.0, 2.0),
    "left_hand": (25.0, 8.0),
    "right_hand": (-25.0, 8.0),
}
"""Azimuth from +z towards +x, the body's left, and elevation of each view's camera (degrees)."""


@dataclass(frozen=True)
class Camera:
    """Upright perspective camera at ``eye`` that looks at ``target`` (metres)."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    yfov_rad: float = YFOV_RAD

    def translated(self, offset: Float[np.ndarray, " 3"]) -> "Camera":
        """Return the camera moved by ``offset`` (m)."""
        eye, target = np.add(self.eye, offset), np.add(self.target, offset)
        return Camera(eye=_triple(eye), target=_triple(target), yfov_rad=self.yfov_rad)

    @functools.lru_cache(maxsize=16)  # noqa: B019 - a few small values
    def axes(self) -> Float[np.ndarray, "3 3"]:
        """Return rows: the camera's right, up and backward directions in the world."""
        backward = np.subtract(self.eye, self.target).astype(np.float64)
        backward /= np.linalg.norm(backward)
        right = np.cross((0.0, 1.0, 0.0), backward)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(backward, right), backward])

    def pose(self) -> Float[np.ndarray, "4 4"]:
        """Return ``T_world_camera``, in pyrender's convention."""
        pose = np.eye(4)
        pose[:3, :3] = self.axes().T
        pose[:3, 3] = self.eye
        return pose

    def project(
        self, points: Float[np.ndarray, "*batch 3"], width: int, height: int
    ) -> Float[np.ndarray, "*batch 2"]:
        """Project points to pixels, (0, 0) at the upper left corner; NaN behind the camera."""
        in_camera = (points - np.asarray(self.eye)) @ self.axes().T
        depth = np.where(in_camera[..., 2] < 0.0, -in_camera[..., 2], np.nan)
        focal_px = 0.5 * height / np.tan(0.5 * self.yfov_rad)
        x = 0.5 * width + focal_px * in_camera[..., 0] / depth
        y = 0.5 * height - focal_px * in_camera[..., 1] / depth
        return np.stack([x, y], axis=-1)


def view_axes(view: str) -> Float[np.ndarray, "3 3"]:
    """Return rows: right, up and backward of a view's camera at any distance."""
    azimuth, elevation = np.deg2rad(_ANGLES_DEG[view])
    level = np.cos(elevation)
    eye = np.array([np.sin(azimuth) * level, np.sin(elevation), np.cos(azimuth) * level])
    return Camera(_triple(eye), target=(0.0, 0.0, 0.0)).axes()


def fit_camera(
    points: Float[np.ndarray, "N 3"],
    view: str = "front",
    *,
    aspect: float = 1.0,
    radius_m: Float[np.ndarray, " N"] | float = 0.0,
) -> Camera:
    """Return the nearest camera of a view that has every point inside its picture.

    Each side of the picture is a plane through the eye, so the eye has a closed form: the planes of
    one axis touch the outermost points, and the axis that needs more distance decides.

    Args:
        points: points in metres; the same array for all systems of a comparison gives equal
            cameras.
        aspect: width of the picture by its height.
        radius_m: radius of a sphere around each point that must be inside.
    """
    axes = view_axes(view)
    right, up, backward = (points.astype(np.float64) @ axes.T).T
    radius = np.broadcast_to(radius_m, len(points))
    tan_y = (1.0 - MARGIN_NDC) * np.tan(0.5 * YFOV_RAD)
    tan_x = tan_y * aspect
    x, z_for_x = _plane_intersection(right, backward, tan_x, radius)
    y, z_for_y = _plane_intersection(up, backward, tan_y, radius)
    # Nothing may come nearer than the near plane, however small it is.
    z = max(z_for_x, z_for_y, float((backward + radius).max()) + 2.0 * Z_NEAR_M)
    eye = np.array([x, y, z]) @ axes
    return Camera(eye=_triple(eye), target=_triple(eye - axes[2]))


def extreme_positions_per_joint(
    points: Float[np.ndarray, "T J 3"], view: str, *, aspect: float = 1.0
) -> Float[np.ndarray, "5 J 3"]:
    """Return five positions of each of J points that give the same camera as all T of them."""
    right, up, backward = view_axes(view)
    tan_y = (1.0 - MARGIN_NDC) * np.tan(0.5 * YFOV_RAD)
    tan_x = tan_y * aspect
    outwards = [right + tan_x * backward, -right + tan_x * backward]
    outwards += [up + tan_y * backward, -up + tan_y * backward, backward]
    farthest = np.stack([(points @ direction).argmax(axis=0) for direction in outwards])
    return np.take_along_axis(points, farthest[..., None], axis=0)


def _plane_intersection(
    across: Float[np.ndarray, " N"],
    backward: Float[np.ndarray, " N"],
    tangent: float,
    radius: Float[np.ndarray, " N"],
) -> tuple[float, float]:
    """Return the intersection of two planes of slopes ``+-tangent`` that enclose the points."""
    outwards = tangent * backward + radius * np.hypot(1.0, tangent)
    high = float((across + outwards).max())
    low = float((-across + outwards).max())
    return (high - low) / 2.0, (high + low) / (2.0 * tangent)


def _triple(vector: Float[np.ndarray, " 3"]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in vector)
    return x, y, z


MAX_PITCH_RAD = 1.48
"""Largest pitch from level, up or down (rad)."""
ZOOM_RANGE = (0.4, 10.0)
MAX_PAN_M = 1.5
"""Largest offset to the side, and up or down (m)."""


@dataclass(frozen=True)
class Orbit:
    """Movement of a camera from its original position by a person."""

    yaw_rad: float = 0.0
    """Azimuth around the body (rad)."""
    pitch_rad: float = 0.0
    """Elevation above the body (rad)."""
    zoom: float = 1.0
    """Zoom factor: the distance is divided by it."""
    right_m: float = 0.0
    up_m: float = 0.0

    @property
    def is_moved(self) -> bool:
        return self != Orbit()

    def check(self) -> None:
        """Check that all values are within their limits; raises ValueError with one sentence."""
        for what, value, least, most in (
            ("yaw", self.yaw_rad, -1e6, 1e6),
            ("pitch", self.pitch_rad, -MAX_PITCH_RAD, MAX_PITCH_RAD),
            ("zoom", self.zoom, *ZOOM_RANGE),
            ("offset to the right (m)", self.right_m, -MAX_PAN_M, MAX_PAN_M),
            ("offset upwards (m)", self.up_m, -MAX_PAN_M, MAX_PAN_M),
        ):
            if not least <= value <= most:
                raise ValueError(
                    f"The camera's {what} must be from {least:g} to {most:g}; got {value:g}."
                )

    def apply(self, camera: Camera, around: Float[np.ndarray, " 3"]) -> Camera:
        """Return the camera moved around a point (m), which stays at its depth in the picture."""
        right, up, backward = camera.axes()
        distance = float(backward @ np.subtract(camera.eye, around))
        middle = np.asarray(camera.eye) - distance * backward
        sin, cos = np.sin(self.yaw_rad), np.cos(self.yaw_rad)
        turn = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
        right, up, backward = (turn @ axis for axis in (right, up, backward))
        level = np.arcsin(np.clip(backward[1], -1.0, 1.0))
        pitch = np.clip(level + self.pitch_rad, -MAX_PITCH_RAD, MAX_PITCH_RAD) - level
        above = np.cos(pitch) * up - np.sin(pitch) * backward
        behind = np.cos(pitch) * backward + np.sin(pitch) * up
        eye = middle + self.right_m * right + self.up_m * above + distance / self.zoom * behind
        return Camera(_triple(eye), _triple(eye - behind), camera.yfov_rad)
