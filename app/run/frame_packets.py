"""Binary frames of motion and the open body as a GLB for browsers, never a licensed mesh."""

from __future__ import annotations

import functools
import struct
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.run.models import get_body

if TYPE_CHECKING:
    from model.motion.motion import Motion
    from renderer.body.body import Body, BodyMotion

NUM_FACES = 52
FACE_BASIS = "arkit52"
MAX_FRAMES = 2**16 - 1
"""Maximum number of frames in a message, and in a motion that a browser plays."""
HEADER = struct.Struct("<IHHffHH")
"""First frame, number of frames, face weights per frame, generation time of the window (ms), its
waiting time (ms), active visitors, and zero."""


def frames_message(
    first: int,
    motion: Motion | BodyMotion,
    *,
    generation_ms: float = 0.0,
    waited_ms: float = 0.0,
    visitors: int = 0,
) -> bytes:
    """Encode frames of the open body for the browser.

    Positions are 32-bit floats, local rotations quaternions (x, y, z, w) of 16-bit integers, and
    face weights bytes.
    """
    from scipy.spatial.transform import Rotation

    count = motion.num_frames
    quaternions = Rotation.from_rotvec(motion.poses.reshape(-1, 3)).as_quat()
    faces = np.clip(motion.expressions[:, :NUM_FACES], 0, 1)
    if motion.expression_basis != FACE_BASIS:  # the open body has no such blendshapes
        faces = np.zeros_like(faces)
    return b"".join(
        [
            HEADER.pack(first, count, NUM_FACES, generation_ms, waited_ms, visitors, 0),
            motion.trans.astype("<f4").tobytes(),
            np.round(quaternions * 32_767).astype("<i2").tobytes(),
            np.round(faces * 255).astype(np.uint8).tobytes(),
        ]
    )


_SHOULDERS_RAD, _ELBOWS_RAD = 1.15, 1.9
"""Joint angles (rad) of the poses by which a camera leaves space for gestures."""


@functools.cache
def make_open_body_glb() -> bytes:
    """Return the GLB file of the open body, made at the first call."""
    from renderer.body.lod import NUM_COARSER, open_body_lod_faces
    from renderer.files.glb import glb_bytes

    body = get_body(None)
    return glb_bytes(
        body, camera_framing_poses(body), coarser_faces=open_body_lod_faces()[NUM_COARSER - 1 :]
    )


def write_viewer_body(source_and_target: tuple[Path, Path], *_: object) -> None:
    """Write a visitor's character, the first file, as the viewer's mesh, the second."""
    from renderer.body.body import load_body
    from renderer.body.lod import character_lod_faces
    from renderer.files.glb import glb_bytes

    source, target = source_and_target
    body = load_body(source)
    target.write_bytes(glb_bytes(body, camera_framing_poses(body), character_lod_faces(body)))


@functools.cache
def encode_open_body_builds() -> bytes:
    """Return vertex offsets of the open body's other shapes for app/page/web/stage/builds.js."""
    from renderer.files.glb import body_build_offsets_bytes

    return body_build_offsets_bytes()


def encode_camera_framing_poses() -> bytes:
    """Encode `camera_framing_poses` for a browser, which frames live motion by them at first."""
    return frames_message(0, camera_framing_poses(get_body(None)))


def face_blendshape_names() -> tuple[str, ...]:
    return get_body(None).expression_names


def camera_framing_poses(body: Body) -> BodyMotion:
    """Make four poses (4, 165) that bound live motion, for framing the camera.

    Hands at the hips and the face at rest, as a body waits for speech; then hands at the face; then
    a step to either side, with all expressions.
    """
    from conventions.joints import JOINT_INDEX
    from renderer.body.body import BodyMotion

    poses = np.zeros((4, len(JOINT_INDEX), 3))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        poses[:, JOINT_INDEX[f"{side}_shoulder"], 2] = -sign * _SHOULDERS_RAD
        poses[1, JOINT_INDEX[f"{side}_elbow"], 1] = -sign * _ELBOWS_RAD
        poses[1, JOINT_INDEX[f"{side}_shoulder"], 2] = -sign * _SHOULDERS_RAD / 2
    trans = np.zeros((4, 3))
    trans[:, 1] = -body.template[:, 1].min()  # soles on the floor
    trans[2:, 0] = -0.12, 0.12
    return BodyMotion(
        poses=poses.reshape(4, -1),
        trans=trans,
        expressions=np.repeat([[0.0], [1.0], [1.0], [1.0]], 100, axis=1),
        expression_basis=body.expression_basis,
        betas=np.zeros(10),
    )
