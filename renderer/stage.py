"""Where one comparison takes place: one camera and one floor for all of its bodies."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32
from scipy import ndimage

from renderer.body import Body, BodyMotion
from renderer.camera import Camera, frame_points, outermost
from renderer.smplx_joints import JOINT_INDEX, JOINT_NAMES

_FOLLOWED = {
    "face": [JOINT_INDEX[name] for name in ("head", "jaw", "left_eye", "right_eye")],
    **{
        f"{side}_hand": [
            index
            for index, name in enumerate(JOINT_NAMES)
            if name == f"{side}_wrist" or (name.startswith(side) and name[-1] in "123")
        ]
        for side in ("left", "right")
    },
}
"""Joints that the camera of a close-up follows; the other views stand still and show them all."""

_FOLLOW_SIGMA_FRAMES = 12.0
"""The camera of a close-up moves slowly, so that the jitter of what it shows can be seen."""

_PIECE_FRAMES = 512

_FEET = [JOINT_INDEX[f"{side}_{name}"] for side in ("left", "right") for name in ("ankle", "foot")]


@dataclass(frozen=True)
class Stage:
    """A camera, and the floor under the motions it was made for. Metres, y up."""

    camera: Camera
    """Of a close-up: relative to the point that it follows."""
    floor_m: float
    centre_xz: tuple[float, float]
    """Middle of the ground that the joints stay above."""
    extent_m: float
    """Longer side of that ground."""


def set_stage(
    body: Body, motions: Sequence[BodyMotion], view: str = "front", aspect: float = 1.0
) -> Stage:
    """The stage that shows all of these motions, each in turn, with equal cameras.

    The joints of every frame are framed, each with the reach of the flesh around it: far cheaper
    than posing every vertex, and the picture's margin takes up what skinning adds.

    Args:
        view: one of ``camera.VIEWS``.
        aspect: width of the picture by its height.

    Raises:
        ValueError: if there is no motion.
    """
    if not motions:
        raise ValueError("A stage needs at least one motion; none was given.")
    reach = _reach(body)
    shown = _FOLLOWED.get(view, list(range(len(JOINT_NAMES))))
    edges, floors, corners = [], [], []
    for motion in motions:
        positions = _joint_positions(body, motion)
        relative = positions[:, shown] - _track(positions, view)[:, None]
        edges.append(outermost(relative, view, aspect=aspect))
        floors.append(_floor(body, positions))
        corners += [positions.min(axis=(0, 1)), positions.max(axis=(0, 1))]
    points = np.concatenate(edges)
    radius = np.broadcast_to(reach[shown], points.shape[:2])
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    return Stage(
        camera=frame_points(points.reshape(-1, 3), view, aspect=aspect, radius_m=radius.ravel()),
        floor_m=float(np.median(floors)),
        centre_xz=(float(low[0] + high[0]) / 2.0, float(low[2] + high[2]) / 2.0),
        extent_m=float(max(high[0] - low[0], high[2] - low[2])),
    )


def frames_of(motion: BodyMotion, frames: slice | Sequence[int]) -> BodyMotion:
    """Some of the frames of a motion, as a motion."""
    chosen = frames if isinstance(frames, slice) else np.asarray(frames, dtype=np.intp)
    return replace(
        motion,
        poses=motion.poses[chosen],
        trans=motion.trans[chosen],
        expressions=motion.expressions[chosen],
    )


def camera_track(body: Body, motion: BodyMotion, view: str) -> Float[np.ndarray, "T 3"]:
    """Where the camera of a view stands in each frame, relative to ``Stage.camera``, metres."""
    if view not in _FOLLOWED:
        return np.zeros((motion.num_frames, 3))
    return _track(_joint_positions(body, motion), view)


def _joint_positions(body: Body, motion: BodyMotion) -> Float32[np.ndarray, "T J 3"]:
    """All joints of a clip, computed in pieces so that memory follows the result alone."""
    starts = range(0, motion.num_frames, _PIECE_FRAMES)
    pieces = [
        body.joint_positions(frames_of(motion, slice(start, start + _PIECE_FRAMES)))
        for start in starts
    ]
    return np.concatenate(pieces)


def _track(positions: Float[np.ndarray, "T J 3"], view: str) -> Float[np.ndarray, "T 3"]:
    """The smoothed middle of the joints that a view follows; zero if it stands still."""
    if view not in _FOLLOWED:
        return np.zeros((len(positions), 3))
    middle = positions[:, _FOLLOWED[view]].mean(axis=1)
    return ndimage.gaussian_filter1d(middle, _FOLLOW_SIGMA_FRAMES, axis=0, mode="nearest")


def _reach(body: Body) -> Float[np.ndarray, " J"]:
    """Distance from each joint to the farthest vertex that mainly follows it, at rest."""
    owner = np.asarray(body.arrays.weights.argmax(axis=1)).ravel()
    distance = np.linalg.norm(body.template - body.rest_joints[owner], axis=1)
    reach = np.zeros(len(body.rest_joints))
    np.maximum.at(reach, owner, distance)
    return reach


def _floor(body: Body, positions: Float[np.ndarray, "T J 3"]) -> float:
    """Height of the soles in the median frame: the lower foot is taken to stand."""
    sole = body.rest_joints[_FEET, 1] - body.template[:, 1].min()
    return float(np.median((positions[:, _FEET, 1] - sole).min(axis=1)))
