"""The body that a browser moves: the open body as a GLB with all of its face, and a camera that
has room for gestures.

It is always the open body: the mesh of a licensed one is not handed to visitors.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

import numpy as np

from app.run.models import get_body
from app.run.pieces import frames_message

if TYPE_CHECKING:
    from renderer.body.body import Body, BodyMotion

_SHOULDERS_RAD, _ELBOWS_RAD = 1.15, 1.9


@functools.cache
def body_glb() -> bytes:
    """The file; made at the first call."""
    from renderer.body.look import coarser_faces
    from renderer.files.glb import glb_bytes

    body = get_body(None)
    return glb_bytes(body, reaches(body), coarser=coarser_faces())


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
