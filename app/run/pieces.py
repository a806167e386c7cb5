"""Motion as a browser plays it: the bytes, and how they are told of window by window."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import numpy as np

from app.run.output.telling import Reporter
from app.run.requests.request import Piece
from app.run.videos.own_videos import Register, register_of

if TYPE_CHECKING:
    from model.motion.motion import Motion
    from renderer.body.body import BodyMotion

NUM_FACES = 52
FACE_BASIS = "arkit52"
MAX_FRAMES = 2**16 - 1
"""Of one message, and of a motion that a browser plays."""
HEADER = struct.Struct("<IHHffHH")
"""First frame, frames, face weights a frame, ms that the window took, ms that it waited for its
turn, visitors at work, and zero."""
_GROWN = 1.2
"""So many times as long, a motion may stand elsewhere among the others."""


def frames_message(
    first: int,
    motion: Motion | BodyMotion,
    *,
    made_ms: float = 0.0,
    waited_ms: float = 0.0,
    visitors: int = 0,
) -> bytes:
    """Frames of the open body as the browser draws them: positions as 32-bit floats, rotations of
    all joints to their parents as quaternions (x, y, z, w) of 16-bit numbers, face weights as
    bytes."""
    from scipy.spatial.transform import Rotation

    count = motion.num_frames
    quaternions = Rotation.from_rotvec(motion.poses.reshape(-1, 3)).as_quat()
    faces = np.clip(motion.expressions[:, :NUM_FACES], 0, 1)
    if motion.expression_basis != FACE_BASIS:  # the open body's face cannot follow it
        faces = np.zeros_like(faces)
    return b"".join(
        [
            HEADER.pack(first, count, NUM_FACES, made_ms, waited_ms, visitors, 0),
            motion.trans.astype("<f4").tobytes(),
            np.round(quaternions * 32_767).astype("<i2").tobytes(),
            np.round(faces * 255).astype(np.uint8).tobytes(),
        ]
    )


class PieceTeller:
    """Tells of one row's motion while it is made."""

    def __init__(
        self, name: str, num_frames: int, reporter: Reporter, like: Motion | None = None
    ) -> None:
        """
        Args:
            num_frames: of the whole row.
            like: a motion as which it is laid onto the others; None is by itself.
        """
        self._name = name
        self._num_frames = num_frames
        self._reporter = reporter
        self._parts: list[Motion] = []
        self._end = 0
        self._is_placed = like is not None
        self._register = None if like is None else register_of(like)
        self._register_at = 0

    def go_on(self, motion: Motion) -> None:
        """Tell of the frames after those before."""
        if self._num_frames > MAX_FRAMES:
            return
        message = frames_message(self._end, motion)
        self._parts.append(motion)
        self._end += motion.num_frames
        place = self._registered()
        told = self._name, message, self._end, self._num_frames
        self._reporter.piece(Piece(*told, place.turn_rad, place.shift_m))

    def _registered(self) -> Register:
        """Of the whole at its end; before it from time to time, as it takes all frames so far."""
        from model.motion.motion import put_together

        is_due = self._end >= min(_GROWN * self._register_at, self._num_frames)
        if self._register is None or (is_due and not self._is_placed):
            self._register = register_of(put_together(self._parts))
            self._register_at = self._end
        return self._register
