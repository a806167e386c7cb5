"""Motions as bodies are posed by them, laid onto each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.measures.posture import FEET
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, first_frames
from model.motion.tracks import track_points
from renderer.body.body import BodyMotion


def body_motion(motion) -> BodyMotion:
    """A `model.motion.motion.Motion` for the renderer, which does not know the model's types."""
    return BodyMotion(
        poses=motion.poses,
        trans=motion.trans,
        expressions=motion.expressions,
        expression_basis=motion.expression_basis,
        betas=motion.betas,
    )


SOLE_M = 0.05
"""Of the foot joint over the floor; that of recorded clips."""


def in_register(motion: Motion) -> Motion:
    """The same motion, moved and turned about the vertical as a whole: the pelvis is over the
    origin in the median, the lower foot on the floor, and the hips face z on average.

    All bodies are of one size here, whoever moves them.
    """
    register = register_of(motion)
    turn = Rotation.from_rotvec([0.0, register.turn_rad, 0.0])
    rest = open_body_skeleton().rest_joints[0].double().numpy()  # the pelvis turns about this
    poses = motion.poses.reshape(len(motion.poses), -1, 3).copy()
    poses[:, 0] = (turn * Rotation.from_rotvec(poses[:, 0])).as_rotvec()
    trans = turn.apply(motion.trans + rest) - rest + np.array(register.shift_m)
    return replace(
        motion, poses=poses.reshape(len(poses), -1), trans=trans.astype(motion.trans.dtype)
    )


@dataclass(frozen=True)
class Register:
    """How a motion is laid onto the others: turned about the world's vertical, then shifted."""

    turn_rad: float
    shift_m: tuple[float, float, float]


def register_of(motion: Motion) -> Register:
    """What `in_register` does to a motion."""
    skeleton = open_body_skeleton()
    joints = track_points(motion, skeleton).joints
    across = (joints[:, JOINT_INDEX["left_hip"]] - joints[:, JOINT_INDEX["right_hip"]]).mean(axis=0)
    facing = np.arctan2(-across[2], across[0])  # of the left hip, which is at x for who faces z
    turn = Rotation.from_rotvec([0.0, -facing, 0.0])
    rest = skeleton.rest_joints[0].double().numpy()
    pelvis = np.median(turn.apply(motion.trans + rest), axis=0)
    floor = float(np.median(joints[:, list(FEET), 1].min(axis=1)))
    return Register(float(-facing), (-float(pelvis[0]), SOLE_M - floor, -float(pelvis[2])))


MAX_FRAMES = 10_800
"""Of all videos of a run together: six of one minute."""


def picture_motions(motions: Mapping[str, Motion]) -> tuple[dict[str, Motion], tuple[str, ...]]:
    """The motions in register, cut to what can be drawn in reasonable time; and what the person
    should know of that."""
    longest = max(MAX_FRAMES // max(len(motions), 1), 1)
    cut = [name for name, motion in motions.items() if motion.num_frames > longest]
    told = f"Stage and videos show the first {longest / FPS:.0f} s of {', '.join(cut)}."
    placed = {
        name: in_register(first_frames(motion, min(motion.num_frames, longest)))
        for name, motion in motions.items()
    }
    return placed, (told,) if cut else ()
