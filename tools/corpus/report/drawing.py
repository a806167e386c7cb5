"""Stick figures with hands: every gesture of the library."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from conventions.joints import FINGERS, JOINT_INDEX, JOINT_NAMES, NUM_JOINTS, PARENTS
from tools.corpus.body.arms import follow_plan, move_arms
from tools.corpus.body.contact import hips_of
from tools.corpus.body.trunk import PELVIS_TILT_DEG, SPINE
from tools.corpus.gesture.gestures import GESTURES, REST, HandPose
from tools.corpus.gesture.plan import HandKey, HandPlan
from tools.corpus.people.rig import SIDES, Rig, euler_matrices, forward_kinematics
from tools.corpus.people.speaker import SPEAKERS

SIDE_COLOURS = {"left": "#0072B2", "right": "#D55E00"}
BODY_COLOUR = "#555555"
TURN_DEG = 20.0  # the figures are seen a little from their left
HIDDEN = frozenset(JOINT_INDEX[name] for name in ("jaw", "left_eye", "right_eye"))


def draw_gestures(rig: Rig, path: Path) -> None:
    """One panel a gesture at the end of its stroke, and one a rest pose."""
    from matplotlib.figure import Figure

    poses = {name: (gesture.stroke, gesture.hands) for name, gesture in GESTURES.items()}
    poses |= {f"rest: {name}": (pose, "two") for name, pose in REST.items()}
    columns = 7
    rows = -(-len(poses) // columns)
    figure = Figure(figsize=(1.55 * columns, 1.75 * rows))
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.set_aspect("equal")
        axis.axis("off")
    figure.subplots_adjust(0, 0, 1, 0.985, 0.02, 0.06)
    for axis, (name, (pose, hands)) in zip(axes.flat, poses.items(), strict=False):
        _draw(axis, rig, *_posed(rig, pose, both=hands in ("two", "free")))
        axis.set_title(name.replace("_", " "), fontsize=7, pad=1)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=80, metadata={"Software": None})


def _posed(
    rig: Rig, pose: HandPose, both: bool
) -> tuple[Float[np.ndarray, "55 3 3"], Float[np.ndarray, "55 3"]]:
    """A standing body with one or both hands held in a pose."""
    other = pose if both else REST["hang"]
    keys = {
        "right": [HandKey(-1.0, 0.5, pose, "stroke", "")],
        "left": [HandKey(-1.0, 0.5, other, "stroke", "")],
    }
    rng, num_frames = np.random.default_rng(0), 31
    speaking = np.zeros(num_frames)
    posture = ((0, PELVIS_TILT_DEG), *((joint, bend) for joint, _, bend in SPINE))
    trunk = {
        joint: euler_matrices("X", np.full((num_frames, 1), pitch)) for joint, pitch in posture
    }
    curves = follow_plan(rig, HandPlan(keys), speaking, SPEAKERS[0], rng)
    arms = move_arms(rig, HandPlan(keys), curves, hips_of(rig, trunk), speaking, SPEAKERS[0], rng)
    local_rot = np.tile(np.eye(3), (1, NUM_JOINTS, 1, 1))
    for joint, rotmat in (trunk | arms).items():
        local_rot[0, joint] = rotmat[num_frames // 2]
    global_rot, positions = forward_kinematics(rig, local_rot, np.zeros((1, 3)))
    return global_rot[0], positions[0]


def _draw(
    axis: Any,
    rig: Rig,
    global_rot: Float[np.ndarray, "55 3 3"],
    positions: Float[np.ndarray, "55 3"],
) -> None:
    """Bones as lines, the head as a circle, the hands in a colour of their side."""
    turn = np.radians(TURN_DEG)
    view = np.array([[np.cos(turn), 0.0, -np.sin(turn)], [0.0, 1.0, 0.0]])
    centred = positions - positions[0] * [1.0, 0.0, 1.0]
    flat = centred @ view.T
    legs = {JOINT_INDEX[f"{side}_{part}"] for side in SIDES for part in ("knee", "ankle", "foot")}
    for joint in range(1, NUM_JOINTS):
        if joint in HIDDEN | legs:
            continue
        name = JOINT_NAMES[joint]
        is_arm = any(part in name for part in ("shoulder", "elbow", "wrist", *FINGERS))
        colour = SIDE_COLOURS[name.partition("_")[0]] if is_arm else BODY_COLOUR
        width = 0.8 if joint >= JOINT_INDEX["left_index1"] else 2.0
        axis.plot(*flat[[PARENTS[joint], joint]].T, color=colour, lw=width, solid_capstyle="round")
    for offset, joint in zip(rig.tip_offsets, rig.tip_joints, strict=True):
        tip = (centred[joint] + global_rot[joint] @ offset) @ view.T
        colour = SIDE_COLOURS[JOINT_NAMES[joint].partition("_")[0]]
        axis.plot(*np.stack([flat[joint], tip]).T, color=colour, lw=0.8)
    skull = JOINT_INDEX["head"]
    head = centred[skull] + global_rot[skull] @ np.array([0.0, 0.07, 0.02])
    nose = centred[skull] + global_rot[skull] @ np.array([0.0, 0.05, 0.13])
    axis.plot(*np.stack([head @ view.T, nose @ view.T]).T, color=BODY_COLOUR, lw=1.0)
    from matplotlib.patches import Circle

    axis.add_patch(Circle(tuple(head @ view.T), 0.1, fill=False, color=BODY_COLOUR, lw=1.2))
    pelvis = flat[0, 1]
    axis.set_xlim(-0.5, 0.5)
    axis.set_ylim(pelvis - 0.25, pelvis + 0.8)
