"""Motion as a browser plays it."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import numpy as np

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
