"""Skinning for the bake: dual quaternions, which keep the volume that linear blending loses."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from conventions.joints import NUM_JOINTS, PARENTS


def rotate_towards(
    start: Float64[np.ndarray, " 3"], end: Float64[np.ndarray, " 3"]
) -> Float64[np.ndarray, "3 3"]:
    """The smallest rotation that turns the direction ``start`` into ``end`` (not opposite)."""
    start, end = start / np.linalg.norm(start), end / np.linalg.norm(end)
    x, y, z = np.cross(start, end)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + cross + cross @ cross / (1 + start @ end)


def posed_joints(
    joints: Float64[np.ndarray, "J 3"], global_rot: Float64[np.ndarray, "J 3 3"]
) -> Float64[np.ndarray, "J 3"]:
    """Joint positions when each bone turns with the world rotation of its parent joint."""
    posed = joints.copy()
    for joint in range(1, NUM_JOINTS):
        parent = PARENTS[joint]
        posed[joint] = posed[parent] + global_rot[parent] @ (joints[joint] - joints[parent])
    return posed


def linear_blend(
    vertices: Float64[np.ndarray, "V 3"],
    weights: Float64[np.ndarray, "V J"],
    joints: Float64[np.ndarray, "J 3"],
    global_rot: Float64[np.ndarray, "J 3 3"],
) -> Float64[np.ndarray, "V 3"]:
    """Vertices blended as the renderer does it, without correctives."""
    translations = _translations(joints, global_rot)
    blended = np.tensordot(weights, global_rot, 1)
    return np.einsum("vab,vb->va", blended, vertices) + weights @ translations


def dual_quaternion_blend(
    vertices: Float64[np.ndarray, "V 3"],
    weights: Float64[np.ndarray, "V J"],
    joints: Float64[np.ndarray, "J 3"],
    global_rot: Float64[np.ndarray, "J 3 3"],
) -> Float64[np.ndarray, "V 3"]:
    """Vertices blended with dual quaternions (Kavan et al. 2007)."""
    real = Rotation.from_matrix(global_rot).as_quat(scalar_first=True)
    real *= np.where(real[:, :1] < 0, -1, 1)
    shift = _translations(joints, global_rot)
    dual = 0.5 * np.concatenate(
        [
            -(shift * real[:, 1:]).sum(1, keepdims=True),
            shift * real[:, :1] + np.cross(shift, real[:, 1:]),
        ],
        axis=1,
    )
    real, dual = weights @ real, weights @ dual
    length = np.linalg.norm(real, axis=1, keepdims=True)
    real, dual = real / length, dual / length
    w, v = real[:, :1], real[:, 1:]
    turned = vertices + 2 * np.cross(v, np.cross(v, vertices) + w * vertices)
    return turned + 2 * (w * dual[:, 1:] - dual[:, :1] * v + np.cross(v, dual[:, 1:]))


def _translations(
    joints: Float64[np.ndarray, "J 3"], global_rot: Float64[np.ndarray, "J 3 3"]
) -> Float64[np.ndarray, "J 3"]:
    return posed_joints(joints, global_rot) - np.einsum("jab,jb->ja", global_rot, joints)
