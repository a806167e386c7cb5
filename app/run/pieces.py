"""Motion as a browser plays it, and the body that it moves: the open body as a GLB with all of its
face. It is always the open body: the mesh of a licensed one is not handed to visitors."""

from __future__ import annotations

import functools
import struct
from typing import TYPE_CHECKING

import numpy as np

from app.run.models import get_body

if TYPE_CHECKING:
    from model.motion.motion import Motion
    from renderer.body.body import Body, BodyMotion

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


_SHOULDERS_RAD, _ELBOWS_RAD = 1.15, 1.9
"""Of the poses by which a camera finds room for gestures."""


@functools.cache
def body_glb() -> bytes:
    """The file; made at the first call."""
    from renderer.body.levels import NUM_DRAWN, open_body_faces
    from renderer.files.glb import glb_bytes

    body = get_body(None)
    return glb_bytes(body, reaches(body), coarser=open_body_faces()[NUM_DRAWN - 1 :])


@functools.cache
def builds() -> bytes:
    """The body's other builds, as app/page/web/stage/builds.js reads them."""
    from renderer.files.glb import builds_bytes

    return builds_bytes()


def reaches_message() -> bytes:
    """`reaches` as a browser reads motion: it frames live motion by them before there is any."""
    return frames_message(0, reaches(get_body(None)))


def face_names() -> tuple[str, ...]:
    """Of the face weights that frames hold."""
    return get_body(None).expression_names


def reaches(body: Body) -> BodyMotion:
    """Poses that live motion hardly leaves: hands at the hips and the face at rest, as a body waits
    for speech; then hands at the face; then a step to either side, the face moved in every way."""
    from conventions.joints import JOINT_INDEX
    from renderer.body.body import BodyMotion

    poses = np.zeros((4, len(JOINT_INDEX), 3))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        poses[:, JOINT_INDEX[f"{side}_shoulder"], 2] = -sign * _SHOULDERS_RAD
        poses[1, JOINT_INDEX[f"{side}_elbow"], 1] = -sign * _ELBOWS_RAD
        poses[1, JOINT_INDEX[f"{side}_shoulder"], 2] = -sign * _SHOULDERS_RAD / 2
    trans = np.zeros((4, 3))
    trans[:, 1] = -body.template[:, 1].min()  # soles on the ground, where motion has them
    trans[2:, 0] = -0.12, 0.12
    return BodyMotion(
        poses=poses.reshape(4, -1),
        trans=trans,
        expressions=np.repeat([[0.0], [1.0], [1.0], [1.0]], 100, axis=1),
        expression_basis=body.expression_basis,
        betas=np.zeros(10),
    )
