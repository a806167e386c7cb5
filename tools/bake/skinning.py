"""Dual quaternion skinning, and pose correctives for linear skinning fitted to it.

Dual quaternions keep volume. Correctives are linear in the nine entries of ``R - I`` of each joint,
fitted on random rotations of that joint alone, mostly about the axis it bends in.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float64, Int
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_INDEX, JOINT_NAMES, NUM_JOINTS, PARENTS


def rotate_towards(
    start: Float64[np.ndarray, " 3"], end: Float64[np.ndarray, " 3"]
) -> Float64[np.ndarray, "3 3"]:
    """Return the smallest rotation from direction ``start`` to ``end`` (not opposite)."""
    start, end = start / np.linalg.norm(start), end / np.linalg.norm(end)
    x, y, z = np.cross(start, end)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + cross + cross @ cross / (1 + start @ end)


def posed_joints(
    joints: Float64[np.ndarray, "J 3"], R_world_joint: Float64[np.ndarray, "J 3 3"]
) -> Float64[np.ndarray, "J 3"]:
    """Return joint positions with each bone turned by the global rotation of its parent joint."""
    posed = joints.copy()
    for joint in range(1, NUM_JOINTS):
        parent = PARENTS[joint]
        posed[joint] = posed[parent] + R_world_joint[parent] @ (joints[joint] - joints[parent])
    return posed


def linear_blend(
    vertices: Float64[np.ndarray, "V 3"],
    weights: Float64[np.ndarray, "V J"],
    joints: Float64[np.ndarray, "J 3"],
    R_world_joint: Float64[np.ndarray, "J 3 3"],
) -> Float64[np.ndarray, "V 3"]:
    """Blend vertices linearly as the renderer does, without correctives."""
    translations = _translations(joints, R_world_joint)
    blended = np.tensordot(weights, R_world_joint, 1)
    return np.einsum("vab,vb->va", blended, vertices) + weights @ translations


def dual_quaternion_blend(
    vertices: Float64[np.ndarray, "V 3"],
    weights: Float64[np.ndarray, "V J"],
    joints: Float64[np.ndarray, "J 3"],
    R_world_joint: Float64[np.ndarray, "J 3 3"],
) -> Float64[np.ndarray, "V 3"]:
    """Blend vertices with dual quaternions (Kavan et al. 2007)."""
    real = Rotation.from_matrix(R_world_joint).as_quat(scalar_first=True)
    real *= np.where(real[:, :1] < 0, -1, 1)
    shift = _translations(joints, R_world_joint)
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
    joints: Float64[np.ndarray, "J 3"], R_world_joint: Float64[np.ndarray, "J 3 3"]
) -> Float64[np.ndarray, "J 3"]:
    return posed_joints(joints, R_world_joint) - np.einsum("jab,jb->ja", R_world_joint, joints)


NUM_SAMPLES = 120
RIDGE = 0.03
SMALL_ROTATION = 0.1
MIXED_SHARE = 0.005
"""Weight of a joint's branch above which, and below one minus which, vertices are corrected."""
SMALLEST_OFFSET_M = 1e-4
LINEAR_SHOULDER_SHARE = 0.7
"""Share of linear blending at the shoulder, which bulges with dual quaternions alone."""
HANGING_CAP_SHRINK_SHARE = 0.38
"""Share by which the cap of the shoulder is moved towards its joint when the arm hangs."""
CAP_RADIUS_M = 0.16
_LARGEST_ANGLE = {"elbow": 2.2, "knee": 2.0, "shoulder": 1.5, "hip": 1.4, "wrist": 1.3}
_UNCORRECTED = ("pelvis", "jaw", "left_eye", "right_eye", "left_foot", "right_foot")


def pose_correctives(
    vertices: Float[np.ndarray, "V 3"],
    weights: Float[np.ndarray, "V J"],
    joints: Float[np.ndarray, "J 3"],
    rng: np.random.Generator,
) -> tuple[Int[np.ndarray, " K"], Int[np.ndarray, " K"], Float[np.ndarray, "K 3 9"]]:
    """Fit correctives: return vertex, joint, and offset (m) per entry of that joint's R - I."""
    blocks = [
        _fit_joint(vertices, weights, joints, joint, rng)
        for joint in range(1, NUM_JOINTS)
        if JOINT_NAMES[joint] not in _UNCORRECTED
    ]
    which, of_joint, offsets = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    offsets[np.abs(offsets) < SMALLEST_OFFSET_M] = 0
    used = np.abs(offsets).max((1, 2)) > 0
    return which[used], of_joint[used], offsets[used]


def _fit_joint(
    vertices: Float[np.ndarray, "V 3"],
    weights: Float[np.ndarray, "V J"],
    joints: Float[np.ndarray, "J 3"],
    joint: int,
    rng: np.random.Generator,
) -> tuple[Int[np.ndarray, " M"], Int[np.ndarray, " M"], Float[np.ndarray, "M 3 9"]]:
    branch = np.zeros(NUM_JOINTS, bool)
    for k in range(NUM_JOINTS):
        branch[k] = k == joint or (PARENTS[k] >= 0 and branch[PARENTS[k]])
    share = weights[:, branch].sum(1)
    cap = _shoulder_cap(vertices, joints, joint)
    mixed = np.flatnonzero((share > MIXED_SHARE) & (share < 1 - MIXED_SHARE) | (cap > 0.01))
    features = np.empty((NUM_SAMPLES, 9))
    targets = np.empty((NUM_SAMPLES, len(mixed) * 3))
    for sample in range(NUM_SAMPLES):
        rotation = _random_rotation(joint, rng)
        R_world_joint = np.where(branch[:, None, None], rotation, np.eye(3))
        linear = linear_blend(vertices[mixed], weights[mixed], joints, R_world_joint)
        dual = dual_quaternion_blend(vertices[mixed], weights[mixed], joints, R_world_joint)
        if JOINT_NAMES[joint].endswith("shoulder"):
            dual += LINEAR_SHOULDER_SHARE * (linear - dual)
            hanging = max(0.0, -np.sign(joints[joint, 0]) * rotation[1, 0])
            dual -= HANGING_CAP_SHRINK_SHARE * hanging * cap[mixed, None] * (dual - joints[joint])
        # The corrective is added before skinning, so it is turned back by the blended matrix.
        blended = np.tensordot(weights[mixed], R_world_joint, 1) + 0.01 * np.eye(3)
        targets[sample] = np.linalg.solve(blended, (dual - linear)[..., None]).ravel()
        features[sample] = (rotation - np.eye(3)).ravel()
    # Small rotations need as small an error, or a nearly straight limb shows a crease.
    weight = 1 / np.maximum(np.linalg.norm(features, axis=1, keepdims=True), SMALL_ROTATION)
    features, targets = weight * features, weight * targets
    fitted = np.linalg.solve(features.T @ features + RIDGE * np.eye(9), features.T @ targets)
    return mixed, np.full(len(mixed), joint), fitted.T.reshape(len(mixed), 3, 9)


def _shoulder_cap(
    vertices: Float[np.ndarray, "V 3"], joints: Float[np.ndarray, "J 3"], joint: int
) -> Float[np.ndarray, " V"]:
    """Return 1 at a shoulder joint, falling to 0 around it; 0 everywhere for other joints."""
    if not JOINT_NAMES[joint].endswith("shoulder"):
        return np.zeros(len(vertices))
    distance = np.linalg.norm(vertices - joints[joint], axis=1)
    near = np.clip(1 - distance / CAP_RADIUS_M, 0, 1)
    return near**2 * (3 - 2 * near)


def _random_rotation(joint: int, rng: np.random.Generator) -> Float[np.ndarray, "3 3"]:
    name = JOINT_NAMES[joint]
    sign = 1.0 if name.startswith("left") else -1.0
    is_finger = joint >= JOINT_INDEX["left_index1"]
    axis = rng.normal(size=3)
    if name.endswith("elbow"):
        axis = axis * [0.6, 0.25, 0.25] + [0, -sign, 0]
    elif name.endswith("knee"):
        axis = axis * 0.2 + [1, 0, 0]
    elif is_finger:
        axis = axis * 0.25 + [0, 0, -sign]
    largest = _LARGEST_ANGLE.get(name.split("_")[-1], 1.5 if is_finger else 0.6)
    axis *= rng.uniform(0, largest) / np.linalg.norm(axis)
    return Rotation.from_rotvec(axis).as_matrix()
