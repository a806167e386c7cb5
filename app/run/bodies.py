"""Bodies posed by motions, their alignment to the origin, and the tracked point."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np
from scipy.spatial.transform import Rotation

from app.errors import RunError
from app.findings.comparison import point_title
from app.run.models import get_body
from app.run.requests.parts import DEFAULT_TRACKED_POINT
from conventions.joints import FINGERTIP_VERTICES, JOINT_INDEX
from conventions.rates import FPS
from model.metrics.posture import FEET
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, first_frames
from model.motion.tracks import Tracks, track_points
from renderer.body.body import Body, BodyMotion


def body_motion(motion) -> BodyMotion:
    """Convert a `model.motion.motion.Motion` for the renderer, which does not import the model."""
    return BodyMotion(
        poses=motion.poses,
        trans=motion.trans,
        expressions=motion.expressions,
        expression_basis=motion.expression_basis,
        betas=motion.betas,
    )


FOOT_JOINT_HEIGHT_M = 0.05
"""Height of the foot joint above the floor (m), as in recorded clips."""


def align_average_to_origin(motion: Motion) -> Motion:
    """Align a motion to the origin, with a rotation about the vertical and a translation.

    The hips face +z on average, the median pelvis is above the origin and the lower foot is on the
    floor. All motions use the same skeleton here.
    """
    register = alignment_to_origin(motion)
    turn = Rotation.from_rotvec([0.0, register.yaw_rad, 0.0])
    rest = open_body_skeleton().rest_joints[0].double().numpy()  # centre of the pelvis rotation
    poses = motion.poses.reshape(len(motion.poses), -1, 3).copy()
    poses[:, 0] = (turn * Rotation.from_rotvec(poses[:, 0])).as_rotvec()
    trans = turn.apply(motion.trans + rest) - rest + np.array(register.translation_m)
    return replace(
        motion, poses=poses.reshape(len(poses), -1), trans=trans.astype(motion.trans.dtype)
    )


@dataclass(frozen=True)
class RootTransform:
    """Root transform that aligns a motion: rotation about the vertical, then translation."""

    yaw_rad: float
    translation_m: tuple[float, float, float]


def alignment_to_origin(motion: Motion) -> RootTransform:
    """Compute the root transform that `align_average_to_origin` applies."""
    skeleton = open_body_skeleton()
    joints = track_points(motion, skeleton).joints
    across = (joints[:, JOINT_INDEX["left_hip"]] - joints[:, JOINT_INDEX["right_hip"]]).mean(axis=0)
    facing = np.arctan2(-across[2], across[0])  # the left hip is at +x if the body faces +z
    turn = Rotation.from_rotvec([0.0, -facing, 0.0])
    rest = skeleton.rest_joints[0].double().numpy()
    pelvis = np.median(turn.apply(motion.trans + rest), axis=0)
    floor = float(np.median(joints[:, list(FEET), 1].min(axis=1)))
    return RootTransform(
        float(-facing), (-float(pelvis[0]), FOOT_JOINT_HEIGHT_M - floor, -float(pelvis[2]))
    )


MAX_FRAMES = 10_800
"""Maximum number of frames of all videos of a run together: six of one minute."""


def align_and_cap_lengths(
    motions: Mapping[str, Motion],
) -> tuple[dict[str, Motion], tuple[str, ...]]:
    """Align the motions and cut them to a renderable length; return them with notes on the cuts."""
    longest = max(MAX_FRAMES // max(len(motions), 1), 1)
    cut = [name for name, motion in motions.items() if motion.num_frames > longest]
    note = (
        f"The viewer and the videos show only the first {longest / FPS:.0f} s of {', '.join(cut)}."
    )
    placed = {
        name: align_average_to_origin(first_frames(motion, min(motion.num_frames, longest)))
        for name, motion in motions.items()
    }
    return placed, (note,) if cut else ()


_PIECE_FRAMES = 4096
"""Chunk length in frames; the tracks of all joints over an hour would take 0.6 GB at once."""


@dataclass(frozen=True)
class PointTracker:
    """Tracker of one point in any motion; raises RunError, with all names, if there is none."""

    name: str = DEFAULT_TRACKED_POINT
    """Name of a fingertip or of a joint of SMPL-X."""
    body: Body | None = None
    """Licensed body with the tracked vertices and joints; None is the open skeleton."""
    _tracks: WeakKeyDictionary[Motion, np.ndarray] = field(
        default_factory=WeakKeyDictionary, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        if self.name not in (*JOINT_INDEX, *FINGERTIP_VERTICES):
            raise RunError(
                f"There is no point {self.name!r} to track; choose a fingertip "
                f"({', '.join(FINGERTIP_VERTICES)}) or a joint of SMPL-X, such as right_wrist "
                f"or {DEFAULT_TRACKED_POINT}3."
            )

    @property
    def position_kind(self) -> str:
        """Kind of its position in `diagnostics.json`: joint, vertex, or a tip rigid to a joint."""
        if self.name in JOINT_INDEX:
            return "joint" if self.body is None else "joint of the body"
        return "rigid" if self.body is None else f"vertex {FINGERTIP_VERTICES[self.name]}"

    @property
    def title(self) -> str:
        return point_title(self.name)

    def track(
        self,
        motion: Motion,
        num_frames: int | None = None,
        on_piece: Callable[[], None] = lambda: None,
        tracks: Tracks | None = None,
    ) -> np.ndarray:
        """Return positions (T, 3) of the tracked point in metres; whole motions are cached.

        Only the first ``num_frames`` are needed, or all. ``on_piece`` is called after each chunk of
        a long motion; an exception from it stops the work.
        """
        if motion not in self._tracks:
            part = motion if num_frames is None else motion.part(slice(num_frames))
            pieces = self._pieces(part)
            if tracks is not None and self.body is None:
                pieces = iter([tracks.point(self.name)])
            positions = []
            for piece in pieces:
                positions.append(piece.copy())
                on_piece()
            track = np.concatenate(positions)
            if len(track) < motion.num_frames:
                return track
            self._tracks[motion] = track
        else:
            on_piece()
        return self._tracks[motion][:num_frames]

    def _pieces(self, motion: Motion) -> Iterator[np.ndarray]:
        if self.body is not None and self.name in FINGERTIP_VERTICES:
            for chunk in self.body.posed_vertices(body_motion(motion)):
                yield chunk[:, FINGERTIP_VERTICES[self.name]]
            return
        for start in range(0, motion.num_frames, _PIECE_FRAMES):
            part = motion.part(slice(start, start + _PIECE_FRAMES))
            if self.body is None:
                yield track_points(part, open_body_skeleton()).point(self.name)
            else:
                yield self.body.joint_positions(body_motion(part))[:, JOINT_INDEX[self.name]]


def make_point_tracker(body: Path | None, point: str = DEFAULT_TRACKED_POINT) -> PointTracker:
    """Make the tracker of a point, on a licensed body or else on the open skeleton.

    A character has its own proportions, so its metrics are those of the skeleton, too.
    """
    loaded = None if body is None else get_body(body)
    return PointTracker(point, None if loaded is None or loaded.rig is not None else loaded)
