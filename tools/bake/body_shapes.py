"""Conversion of MakeHuman's rig and A pose to joints and zero pose of SMPL-X, for three builds.

The zero pose is defined by rounded angles: arms level or a little below, legs slightly apart,
fingers straight and fanned, thumbs forward and out. All builds share one skeleton, one topology and
one set of weights: a motion has the same joints and fingertips on each, and a build is only an
offset for each vertex.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float64

from conventions.joints import FINGERS, JOINT_INDEX, NUM_JOINTS, PARENTS
from tools.bake.makehuman import BodyShape, MakeHuman
from tools.bake.skinning import dual_quaternion_blend, posed_joints, rotate_towards

SIDES = (("left", "L", 1.0), ("right", "R", -1.0))
BONE_FINGERS = {"1": "thumb", "2": "index", "3": "middle", "4": "ring", "5": "pinky"}
FAN_DEG = {"index": 4.0, "middle": -6.0, "ring": -12.0, "pinky": -27.0}
FINGER_DROP = -0.06
THUMB_DIRECTIONS = ((0.57, -0.08, 0.81), (0.78, -0.20, 0.60), (0.82, -0.20, 0.53))
# Heights of spine1 to spine3 as shares of the way from pelvis to neck, as in SMPL-X.
SPINE_HEIGHTS = (("spine1", 0.24), ("spine2", 0.525), ("spine3", 0.645))
# SMPL-X turns the head about points that differ from MakeHuman's bone ends.
FUNCTIONAL_HIP_SHARE = 0.09
HIP_INWARD_SHARE = 0.25
COLLAR_SHARE = 0.15
JAW_BACK_DM = 0.35


def joint_shares(source: MakeHuman, bone: str) -> dict[str, float]:
    """Return the joints that take over the weight of a MakeHuman bone, with their shares."""
    stem, _, side_letter = bone.partition(".")
    side = {"L": "left", "R": "right"}.get(side_letter, "")
    fixed: dict[str, dict[str, float]] = {
        "root": {"pelvis": 1},
        "pelvis": {"pelvis": 1},
        "spine05": {"pelvis": 0.5, "spine1": 0.5},
        "spine04": {"spine1": 1},
        "spine03": {"spine1": 0.35, "spine2": 0.65},
        "spine02": {"spine2": 0.5, "spine3": 0.5},
        "spine01": {"spine3": 1},
        "breast": {"spine3": 1},
        "neck01": {"neck": 1},
        "neck02": {"neck": 0.8, "head": 0.2},
        "neck03": {"neck": 0.45, "head": 0.55},
        "clavicle": {f"{side}_collar": 1},
        "shoulder01": {f"{side}_collar": 0.65, f"{side}_shoulder": 0.35},
        "lowerarm01": {f"{side}_elbow": 1},
        "lowerarm02": {f"{side}_elbow": 0.8, f"{side}_wrist": 0.2},
        "wrist": {f"{side}_wrist": 1},
        "foot": {f"{side}_ankle": 1},
        "eye": {f"{side}_eye": 1},
    }
    if stem in fixed:
        return fixed[stem]
    if stem.startswith("finger"):
        return {f"{side}_{BONE_FINGERS[stem[6]]}{stem[8]}": 1}
    starts = {
        "metacarpal": "wrist",
        "upperarm": "shoulder",
        "upperleg": "hip",
        "lowerleg": "knee",
        "toe": "foot",
    }
    for start, joint in starts.items():
        if stem.startswith(start):
            return {f"{side}_{joint}": 1}
    for joint in ("jaw", "head"):
        if joint in _ancestry(source, bone):
            return {joint: 1}
    raise KeyError(f"No joint takes over the bone '{bone}'.")


def _ancestry(source: MakeHuman, bone: str) -> list[str]:
    chain = [bone]
    while parent := source.bones[chain[-1]].get("parent"):
        chain.append(parent)
    return chain


def joint_weights(source: MakeHuman) -> Float64[np.ndarray, "N J"]:
    """Compute skinning weights of the base mesh on the 55 joints; rows sum to one or to zero."""
    weights = np.zeros((len(source.base_vertices), NUM_JOINTS))
    for bone, entries in source.bone_weights.items():
        if not entries:
            continue
        vertices, values = np.array(entries).T
        for joint, share in joint_shares(source, bone).items():
            np.add.at(weights[:, JOINT_INDEX[joint]], vertices.astype(int), values * share)
    return weights / np.maximum(weights.sum(1, keepdims=True), 1e-6)


def joints_in_a_pose(
    source: MakeHuman, vertices: Float64[np.ndarray, "N 3"]
) -> Float64[np.ndarray, "J 3"]:
    """Return the 55 joints of one figure in MakeHuman's A pose."""

    def head(bone: str) -> Float64[np.ndarray, " 3"]:
        return vertices[source.bone_end(bone, "head")].mean(0)

    joints = np.zeros((NUM_JOINTS, 3))

    def put(name: str, position: Float64[np.ndarray, " 3"]) -> None:
        joints[JOINT_INDEX[name]] = position

    for side, letter, _ in SIDES:
        bones = {
            "hip": "upperleg01",
            "knee": "lowerleg01",
            "ankle": "foot",
            "foot": "toe3-1",
            "collar": "clavicle",
            "shoulder": "upperarm01",
            "elbow": "lowerarm01",
            "wrist": "wrist",
            "eye": "eye",
        }
        bones |= {f"{BONE_FINGERS[f]}{k}": f"finger{f}-{k}" for f in BONE_FINGERS for k in "123"}
        for name, bone in bones.items():
            put(f"{side}_{name}", head(f"{bone}.{letter}"))
        hip, knee = joints[JOINT_INDEX[f"{side}_hip"]], joints[JOINT_INDEX[f"{side}_knee"]]
        hip = hip + FUNCTIONAL_HIP_SHARE * (knee - hip)
        put(f"{side}_hip", hip * [1 - HIP_INWARD_SHARE, 1, 1])
        collar = joints[JOINT_INDEX[f"{side}_collar"]]
        shoulder = joints[JOINT_INDEX[f"{side}_shoulder"]]
        put(f"{side}_collar", collar + COLLAR_SHARE * (shoulder - collar))

    left_hip, left_knee = joints[JOINT_INDEX["left_hip"]], joints[JOINT_INDEX["left_knee"]]
    pelvis = (left_hip + joints[JOINT_INDEX["right_hip"]]) / 2
    pelvis[1] += 0.25 * np.linalg.norm(left_knee - left_hip)
    pelvis[2] = 0.5 * pelvis[2] + 0.5 * head("spine04")[2]
    put("pelvis", pelvis)
    put("neck", 0.8 * head("neck01") + 0.2 * head("spine01"))
    put("head", 0.2 * head("neck03") + 0.8 * head("head"))
    put("jaw", head("jaw") - [0, 0, JAW_BACK_DM])
    spine_bones = ("root", "spine04", "spine03", "spine02", "spine01", "neck01")
    spine = np.array([head(bone) for bone in spine_bones])
    neck_y = joints[JOINT_INDEX["neck"], 1]
    for name, share in SPINE_HEIGHTS:
        y = pelvis[1] + share * (neck_y - pelvis[1])
        put(name, np.array([0, y, np.interp(y, spine[:, 1], spine[:, 2])]))
    middle = [
        JOINT_INDEX[n] for n in ("pelvis", "spine1", "spine2", "spine3", "neck", "head", "jaw")
    ]
    joints[middle, 0] = 0
    return joints


def finger_tips(
    source: MakeHuman, vertices: Float64[np.ndarray, "N 3"]
) -> dict[str, Float64[np.ndarray, " 3"]]:
    """Return the bone ends of the fingers by ``<side>_<finger>``."""
    return {
        f"{side}_{finger}": vertices[source.bone_end(f"finger{f}-3.{letter}", "tail")].mean(0)
        for side, letter, _ in SIDES
        for f, finger in BONE_FINGERS.items()
    }


def rotations_to_zero_pose(
    joints: Float64[np.ndarray, "J 3"], tips: dict[str, Float64[np.ndarray, " 3"]]
) -> Float64[np.ndarray, "J 3 3"]:
    """Return the global rotation of each joint from the A pose to the zero pose."""
    rotations = np.full((NUM_JOINTS, 3, 3), np.nan)

    def at(name: str) -> Float64[np.ndarray, " 3"]:
        return joints[JOINT_INDEX[name]]

    def turn(name: str, rotation: Float64[np.ndarray, "3 3"]) -> None:
        rotations[JOINT_INDEX[name]] = rotation

    # The trunk leans back a little, the neck forward; the head stays level.
    lean = rotate_towards(at("neck") - at("pelvis"), np.array([0, 1, -0.08]))
    for name in ("spine1", "spine2", "spine3"):
        turn(name, lean)
    turn("pelvis", np.eye(3))
    turn("neck", rotate_towards(at("head") - at("neck"), np.array([0, 1, 0.13])))
    turn("head", np.eye(3))
    for side, _, sign in SIDES:
        bone = {
            name: at(f"{side}_{end}") - at(f"{side}_{name}")
            for name, end in (
                ("collar", "shoulder"),
                ("hip", "knee"),
                ("knee", "ankle"),
                ("ankle", "foot"),
                ("shoulder", "elbow"),
                ("elbow", "wrist"),
                ("wrist", "middle1"),
            )
        }
        turn(f"{side}_collar", rotate_towards(bone["collar"], _direction(sign, 3, -7)))
        turn(f"{side}_hip", rotate_towards(bone["hip"], np.array([sign * 0.14, -1, -0.03])))
        turn(f"{side}_knee", rotate_towards(bone["knee"], np.array([-sign * 0.10, -1, -0.07])))
        # Soles stay flat: the foot turns about the vertical only, 12 degrees outward.
        yaw = np.radians(sign * 12) - np.arctan2(bone["ankle"][0], bone["ankle"][2])
        flat = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
        turn(f"{side}_ankle", flat)
        turn(f"{side}_foot", flat)
        # The elbow's hinge, known from the bend of the A pose, becomes the vertical axis.
        hinge = np.cross(bone["shoulder"], bone["elbow"])
        new_hinge = np.array([0, -sign, 0])
        for name, new in (
            ("shoulder", _direction(sign, -12, -7)),
            ("elbow", _direction(sign, 2, -2)),
        ):
            turn(f"{side}_{name}", _frame(new, new_hinge) @ _frame(bone[name], hinge).T)
        knuckles = at(f"{side}_index1") - at(f"{side}_pinky1")
        palm_down = _frame(np.array([sign, 0, 0]), np.array([0, 0, 1]))
        hand = palm_down @ _frame(bone["wrist"], knuckles).T
        turn(f"{side}_wrist", hand)
        for finger in FINGERS:
            points = [at(f"{side}_{finger}{k}") for k in (1, 2, 3)] + [tips[f"{side}_{finger}"]]
            for k in range(3):
                if finger == "thumb":
                    new = np.array(THUMB_DIRECTIONS[k]) * [sign, 1, 1]
                else:
                    fan = np.radians(FAN_DEG[finger])
                    new = np.array([sign * np.cos(fan), FINGER_DROP, np.sin(fan)])
                along = hand @ (points[k + 1] - points[k])
                turn(f"{side}_{finger}{k + 1}", rotate_towards(along, new) @ hand)
    for joint in range(1, NUM_JOINTS):
        if np.isnan(rotations[joint, 0, 0]):  # jaw and eyes follow the head
            rotations[joint] = rotations[PARENTS[joint]]
    return rotations


def _direction(sign: float, up_deg: float, forward_deg: float) -> Float64[np.ndarray, " 3"]:
    """Return the unit vector to one side, raised and turned forward by two angles."""
    up, forward = np.radians(up_deg), np.radians(forward_deg)
    return np.array([sign * np.cos(up) * np.cos(forward), np.sin(up), np.cos(up) * np.sin(forward)])


def _frame(
    x: Float64[np.ndarray, " 3"], y: Float64[np.ndarray, " 3"]
) -> Float64[np.ndarray, "3 3"]:
    """Return a right-handed frame (columns) with x along ``x`` and y towards ``y``."""
    x = x / np.linalg.norm(x)
    y = y - x * (x @ y)
    y = y / np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)


_AVERAGE = BodyShape(
    gender=0.66,
    age=0.03,
    muscle=0.52,
    weight=0.47,
    height=0.40,
    proportions=0.6,
    cup=0.0,
    firmness=0.6,
)
FIGURES = {
    "average": _AVERAGE,
    "slender": replace(_AVERAGE, gender=0.0, muscle=0.35, weight=0.25, cup=0.5),
    "broad": replace(_AVERAGE, gender=1.0, age=0.3, muscle=0.8, weight=0.85),
}
"""Figures by the names in ``conventions.views.BODY_BUILDS``; the first sets the skeleton."""

LEG_LENGTH_M = 0.7845
"""Length of a leg from hip to ankle (m), as in SMPL-X's mean body."""
PELVIS_M = (0.0, -0.3514, 0.012)
"""Position of the pelvis (m) in SMPL-X's mean body."""

# The joint at the end of each bone that continues in only one joint.
_BONE_END = {
    "spine1": "spine2",
    "spine2": "spine3",
    "spine3": "neck",
    **{
        f"{side}_{start}": f"{side}_{end}"
        for side in ("left", "right")
        for start, end in (
            *(("collar", "shoulder"), ("shoulder", "elbow"), ("elbow", "wrist")),
            *(("wrist", "middle1"), ("hip", "knee"), ("knee", "ankle"), ("ankle", "foot")),
            *((f"{finger}{k}", f"{finger}{k + 1}") for finger in FINGERS for k in (1, 2)),
        )
    },
}
_FEET = [JOINT_INDEX[f"{side}_{name}"] for side in ("left", "right") for name in ("ankle", "foot")]
_HEAD = ("head", "jaw", "left_eye", "right_eye")


@dataclass(frozen=True)
class Posed:
    """One figure in the zero pose, in metres, with the pelvis at `PELVIS_M`."""

    vertices: Float[np.ndarray, "N 3"]
    joints: Float[np.ndarray, "J 3"]
    head_transform: Float[np.ndarray, "3 3"]
    """Rotation and scale that were applied to the head."""


def in_zero_pose(source: MakeHuman, figure: BodyShape, weights: Float[np.ndarray, "N J"]) -> Posed:
    """Return the whole base mesh of ``figure``; ``weights`` are those of ``joint_weights``."""
    vertices = source.shape(figure)
    joints = joints_in_a_pose(source, vertices)
    rotations = rotations_to_zero_pose(joints, finger_tips(source, vertices))
    posed = dual_quaternion_blend(vertices, weights, joints, rotations)
    rest = posed_joints(joints, rotations)
    hip, knee, ankle = (rest[JOINT_INDEX[f"left_{name}"]] for name in ("hip", "knee", "ankle"))
    scale = LEG_LENGTH_M / (np.linalg.norm(knee - hip) + np.linalg.norm(ankle - knee))
    shift = PELVIS_M - scale * rest[JOINT_INDEX["pelvis"]]
    return Posed(
        posed * scale + shift, rest * scale + shift, rotations[JOINT_INDEX["head"]] * scale
    )


def fit_to_skeleton(
    posed: Posed, first: Posed, weights: Float[np.ndarray, "N J"]
) -> Float[np.ndarray, "N 3"]:
    """Fit the vertices of ``posed`` to the joints of ``first`` by moving and stretching its bones.

    The head is only moved and uniformly scaled until its eyes match; the soles are set to the
    height of those of ``first``.
    """
    target = first.joints
    stretch = np.tile(np.eye(3), (NUM_JOINTS, 1, 1))
    old_anchor, new_anchor = posed.joints.copy(), target.copy()
    for start, end in _BONE_END.items():
        bone, wanted = (
            joints[JOINT_INDEX[end]] - joints[JOINT_INDEX[start]]
            for joints in (posed.joints, target)
        )
        stretch[JOINT_INDEX[start]] += np.outer(wanted - bone, bone) / (bone @ bone)
    eyes = [JOINT_INDEX["left_eye"], JOINT_INDEX["right_eye"]]
    apart = [np.linalg.norm(joints[eyes[0]] - joints[eyes[1]]) for joints in (posed.joints, target)]
    for name in _HEAD:
        stretch[JOINT_INDEX[name]] *= apart[1] / apart[0]
        old_anchor[JOINT_INDEX[name]] = posed.joints[eyes].mean(0)
        new_anchor[JOINT_INDEX[name]] = target[eyes].mean(0)
    shift = new_anchor - np.einsum("jab,jb->ja", stretch, old_anchor)
    blended = np.tensordot(weights, stretch, 1)
    moved = np.einsum("vab,vb->va", blended, posed.vertices) + weights @ shift
    foot_share = weights[:, _FEET].sum(1)
    is_foot = foot_share > 0.5
    moved[:, 1] += foot_share * (first.vertices[is_foot, 1].min() - moved[is_foot, 1].min())
    return moved
