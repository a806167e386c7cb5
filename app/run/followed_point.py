"""The point that is followed: a fingertip, rigid or a vertex of a licensed body, or any joint."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np

from app.errors import RunError
from app.findings.comparison import point_title
from app.run.ask import TIP
from app.run.body_motion import body_motion
from conventions.joints import JOINT_INDEX, TIP_VERTICES
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion
from model.motion.tracks import Tracks, track_points
from renderer.body.body import Body

TipPieces = Callable[["Motion"], Iterator[np.ndarray]]

_PIECE_FRAMES = 4096
"""The tracks of all joints over an hour would take 0.6 GB at once."""


@dataclass(frozen=True)
class TipSource:
    """How the point that the figure and the diagnostics follow is found."""

    name: str
    """As `diagnostics.json` tells it."""
    pieces: TipPieces
    """Motion -> positions (T, 3) in metres, some frames after the other."""
    point: str = TIP
    """A fingertip or a joint of SMPL-X."""
    is_of_body: bool = False
    """Whether a posed body is needed; other points are among the tracks of the open skeleton."""
    _known: WeakKeyDictionary[Motion, np.ndarray] = field(
        default_factory=WeakKeyDictionary, repr=False, compare=False
    )

    def track(
        self,
        motion: Motion,
        num_frames: int | None = None,
        on_piece: Callable[[], None] = lambda: None,
        tracks: Tracks | None = None,
    ) -> np.ndarray:
        """Positions (T, 3) in metres; those of a whole motion are found once.

        Args:
            num_frames: so many of the first frames are enough.
            tracks: of the motion, where somebody has posed it already.
            on_piece: called now and then in a long motion; what it raises ends the work.
        """
        if motion in self._known:
            on_piece()
            return self._known[motion][:num_frames]
        if tracks is not None and not self.is_of_body:
            on_piece()
            self._known[motion] = tracks.point(self.point).copy()
            return self._known[motion][:num_frames]
        part = motion if num_frames is None else motion.part(slice(num_frames))
        found = []
        for piece in self.pieces(part):
            found.append(piece)
            on_piece()
        track = np.concatenate(found)
        if len(track) == motion.num_frames:
            self._known[motion] = track
        return track

    @property
    def title(self) -> str:
        return point_title(self.point)


def choose_tip_source(body: Body, body_path: Path | None, point: str = TIP) -> TipSource:
    """A fingertip, rigid with the open body and a vertex of a licensed one; or any joint.

    Raises:
        RunError: if there is no such point, with the points there are.
    """
    if point in JOINT_INDEX:
        joint = JOINT_INDEX[point]
        if body_path is None:
            return TipSource("joint", lambda motion: open_point(motion, point), point)
        return TipSource(
            "joint of the body",
            lambda motion: body_joint(body, motion, joint),
            point,
            is_of_body=True,
        )
    if point not in TIP_VERTICES:
        raise RunError(
            f"There is no point {point!r} to follow; choose a fingertip ({', '.join(TIP_VERTICES)})"
            f" or a joint of SMPL-X, such as right_wrist or {TIP}3."
        )
    if body_path is None:
        return TipSource("rigid", lambda motion: open_point(motion, point), point)
    vertex = TIP_VERTICES[point]
    return TipSource(
        f"vertex {vertex}", lambda motion: vertex_tip(body, motion, vertex), point, is_of_body=True
    )


def open_point(motion: Motion, point: str) -> Iterator[np.ndarray]:
    """A joint or rigid fingertip of the open skeleton, (T, 3) metres, in pieces."""
    skeleton = open_body_skeleton()
    return (track_points(part, skeleton).point(point).copy() for part in _motion_pieces(motion))


def vertex_tip(body: Body, motion: Motion, vertex: int) -> Iterator[np.ndarray]:
    """A vertex of a posed body, (T, 3) metres, in pieces."""
    return (chunk[:, vertex].copy() for chunk in body.vertices(body_motion(motion)))


def body_joint(body: Body, motion: Motion, joint: int) -> Iterator[np.ndarray]:
    """A joint of a body of its own shape, (T, 3) metres, in pieces."""
    return (
        body.joint_positions(body_motion(part))[:, joint].copy() for part in _motion_pieces(motion)
    )


def _motion_pieces(motion: Motion) -> Iterator[Motion]:
    for start in range(0, motion.num_frames, _PIECE_FRAMES):
        yield motion.part(slice(start, start + _PIECE_FRAMES))
