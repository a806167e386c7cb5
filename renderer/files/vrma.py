"""VRMA export: a motion for any VRM character, as VRMC_vrm_animation 1.0 defines it.

The file holds a skeleton in VRM's T-pose, whose bones the motion turns, and no mesh. Players scale
the translation by the height of the hips. The face moves by VRM's presets, the eyes by its gaze.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float64
from scipy.spatial.transform import Rotation

from conventions.humanoid import BONE_END_JOINTS
from conventions.joints import JOINT_INDEX, JOINT_NAMES, NUM_JOINTS, PARENTS
from renderer.body.body import JAW_OPEN_RAD, Body, BodyMotion
from renderer.body.character import VRM_BONE_TO_JOINT, rest_to_zero_pose_rotations
from renderer.body.face_shapes import ARKIT_TO_VRM_PRESETS
from renderer.files.glb import ASSET, GlbBinary, make_animation

_EYES = ("left_eye", "right_eye")


def vrma_bytes(body: Body, motion: BodyMotion, markers: Sequence[tuple[float, str]] = ()) -> bytes:
    """Return the file, about 14 kB per second of motion, with named markers at times (s)."""
    template, rest = body.shaped_vertices_and_joints(motion)
    pose = _t_pose(rest, float(template[:, 1].min()))
    turns = rest_to_zero_pose_rotations(dict(zip(JOINT_NAMES, pose, strict=True)), {}, rest, {})
    world, positions = body.global_transforms_without_trans(motion)
    world = world @ np.array([turn.as_matrix() for turn in turns])
    bones = {JOINT_INDEX[joint]: bone for bone, joint in VRM_BONE_TO_JOINT.items()}
    joints = [each for each in range(NUM_JOINTS) if JOINT_NAMES[each] not in ("jaw", *_EYES)]
    buffer, nodes, channels = GlbBinary(), [], []
    for node, joint in enumerate(joints):
        parent, place, rotations = PARENTS[joint], pose[joint], world[:, joint]
        if parent >= 0:
            place, rotations = place - pose[parent], world[:, parent].mT @ rotations
            nodes[joints.index(parent)].setdefault("children", []).append(node)
        nodes.append({"name": bones[joint], "translation": place.tolist()})
        channels.append((node, "rotation", buffer.add_rotations(Rotation.from_matrix(rotations))))
    hips = (positions[:, 0] + motion.trans).astype(np.float32)
    channels.append((0, "translation", buffer.add_accessor(hips)))
    eyes = motion.poses.reshape(-1, NUM_JOINTS, 3)[:, [JOINT_INDEX[eye] for eye in _EYES]]
    gaze = Rotation.from_rotvec(eyes.mean(axis=1))
    channels.append((len(nodes), "rotation", buffer.add_rotations(gaze)))
    roots = [0, len(nodes)]
    nodes.append({"name": "lookAt"})
    presets = {}
    for name, weights in _preset_weights(body, motion).items():
        presets[name] = {"node": len(nodes)}
        roots.append(len(nodes))
        moved = np.zeros((motion.num_frames, 3), np.float32)
        moved[:, 0] = weights.clip(0, 1)
        channels.append((len(nodes), "translation", buffer.add_accessor(moved)))
        nodes.append({"name": name})
    eyes = rest[[JOINT_INDEX[eye] for eye in _EYES]].mean(axis=0) - rest[JOINT_INDEX["head"]]
    extension = {
        "specVersion": "1.0",
        "humanoid": {"humanBones": {bones[each]: {"node": at} for at, each in enumerate(joints)}},
        "expressions": {"preset": presets},
        "lookAt": {"node": roots[1], "offsetFromHeadBone": eyes.tolist()},
    }
    return buffer.to_glb(
        asset=ASSET,
        extensionsUsed=["VRMC_vrm_animation"],
        extensions={"VRMC_vrm_animation": extension},
        scene=0,
        scenes=[{"nodes": roots}],
        nodes=nodes,
        animations=[make_animation(buffer, motion.num_frames, channels, markers)],
    )


def _t_pose(rest: Float64[np.ndarray, "J 3"], ground: float) -> Float64[np.ndarray, "J 3"]:
    """Return the joints in VRM's T-pose, with the soles, which are at ``ground`` at rest, at 0."""
    joints = rest.copy()
    for joint in range(1, NUM_JOINTS):
        step = rest[joint] - rest[PARENTS[joint]]
        side, _, part = (name := JOINT_NAMES[PARENTS[joint]]).partition("_")
        if BONE_END_JOINTS.get(name) == JOINT_NAMES[joint] and part != "collar":
            across = {"left": 1.0, "right": -1.0}[side]
            if part == "ankle":  # the sole stays flat
                step = np.array([0.0, step[1], np.hypot(step[0], step[2])])
            elif part in ("hip", "knee"):
                step = np.linalg.norm(step) * np.array([0.0, -1.0, 0.0])
            else:
                ahead = 1.0 if part.startswith("thumb") else 0.0
                way = np.array([across, 0.0, ahead])
                step = np.linalg.norm(step) * way / np.linalg.norm(way)
        joints[joint] = joints[PARENTS[joint]] + step
    ankle = JOINT_INDEX["left_ankle"]
    joints[:, 1] += rest[ankle, 1] - ground - joints[ankle, 1]
    return joints


def _preset_weights(body: Body, motion: BodyMotion) -> dict[str, Float[np.ndarray, " T"]]:
    """Return the weight of each of VRM's presets that the face uses; the jaw opens ``aa``."""
    weights = {"aa": (motion.poses[:, 3 * JOINT_INDEX["jaw"]] / JAW_OPEN_RAD).clip(0, 1)}
    names = body.expression_names
    for name, presets in ARKIT_TO_VRM_PRESETS.items():
        if motion.expression_basis == body.expression_basis and name in names:
            preset, share = presets[0]
            moved = share * motion.expressions[:, names.index(name)]
            weights[preset] = weights.get(preset, 0.0) + moved
    return weights
