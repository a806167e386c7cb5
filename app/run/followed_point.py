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
from app.run.models import get_body
from conventions.joints import JOINT_INDEX, TIP_VERTICES
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion
from model.motion.tracks import Tracks, track_points
from renderer.body.body import Body

_PIECE_FRAMES = 4096
"""The tracks of all joints over an hour would take 0.6 GB at once."""


@dataclass(frozen=True)
class TipSource:
    """How the point that the figure and the diagnostics follow is found.

    Raises:
        RunError: if there is no such point, with the points there are.
    """

    point: str = TIP
    """A fingertip or a joint of SMPL-X."""
    body: Body | None = None
    """A licensed one, whose vertices and joints are followed; else those of the open skeleton."""
    _known: WeakKeyDictionary[Motion, np.ndarray] = field(
        default_factory=WeakKeyDictionary, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        if self.point not in (*JOINT_INDEX, *TIP_VERTICES):
            raise RunError(
                f"There is no point {self.point!r} to follow; choose a fingertip "
                f"({', '.join(TIP_VERTICES)}) or a joint of SMPL-X, such as right_wrist or {TIP}3."
            )

    @property
    def name(self) -> str:
        """As `diagnostics.json` tells it."""
        if self.point in JOINT_INDEX:
            return "joint" if self.body is None else "joint of the body"
        return "rigid" if self.body is None else f"vertex {TIP_VERTICES[self.point]}"

    @property
    def title(self) -> str:
        return point_title(self.point)

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
        if motion not in self._known:
            part = motion if num_frames is None else motion.part(slice(num_frames))
            pieces = self._pieces(part)
            if tracks is not None and self.body is None:
                pieces = iter([tracks.point(self.point)])
            found = []
            for piece in pieces:
                found.append(piece.copy())
                on_piece()
            track = np.concatenate(found)
            if len(track) < motion.num_frames:
                return track
            self._known[motion] = track
        else:
            on_piece()
        return self._known[motion][:num_frames]

    def _pieces(self, motion: Motion) -> Iterator[np.ndarray]:
        if self.body is not None and self.point in TIP_VERTICES:
            for chunk in self.body.vertices(body_motion(motion)):
                yield chunk[:, TIP_VERTICES[self.point]]
            return
        for start in range(0, motion.num_frames, _PIECE_FRAMES):
            part = motion.part(slice(start, start + _PIECE_FRAMES))
            if self.body is None:
                yield track_points(part, open_body_skeleton()).point(self.point)
            else:
                yield self.body.joint_positions(body_motion(part))[:, JOINT_INDEX[self.point]]


def choose_tip_source(body: Path | None, point: str = TIP) -> TipSource:
    """With the open body, or with the one of a file."""
    return TipSource(point, None if body is None else get_body(body))
