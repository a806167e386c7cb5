"""Hands that are led to where a plan has them, and the arms that go with them.

A network hears the plan and comes near it, but a stroke may land late, or not at all. Here the
wrist is led most of the way to the planned path, in closed form: the elbow opens or closes as far
as it must and the whole arm turns, with the hand's pose as it was.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.motion.kinematics import joint_positions_from_local
from model.motion.limb import unit
from model.motion.motion import Motion
from model.motion.skeleton import RestSkeleton
from model.plan.places import OUTWARD
from model.plan.plan import SIDES, GesturePlan, Side
from model.plan.tracks import goal_path, without_gaps

LED = 0.6
"""Share of the way from where the network has a wrist to where the plan has it. People keep 3.8 cm
away from their own plans on average; this leaves 3.2."""
SOFT_FRAMES = 1.5
"""Deviation of what rounds the planned path off: phases begin and end with a jolt. At 1 fingertips
had 1.19 times the recorded power above 5 Hz, at 1.5 .96, with strokes as often in time."""
SOFT_MARGIN = round(4 * SOFT_FRAMES)
"""Frames of the plan that are heard on either side."""
LONGEST = 0.99
"""Of a straight arm's length."""
_SOFT_M = 0.004
_BENT = 0.1
"""As much as the usual plane of the elbow counts in an arm that is nearly straight."""
_FORWARD = np.array([0.0, 0.0, 1.0])


@dataclass
class LedHands:
    """Leads the hands of a motion that comes piece by piece.

    Args:
        plan: what they shall do. A hand of which it says nothing is left as it is.
    """

    plan: GesturePlan
    skeleton: RestSkeleton
    _frames: int = field(default=0, init=False)

    def go_on_with(self, plan: GesturePlan, first_frame: int) -> None:
        """From now on another plan, in which the next frame is ``first_frame``."""
        self.plan, self._frames = plan, first_frame

    def lead(self, motion: Motion) -> Motion:
        """The frames that follow those of the call before."""
        frames = range(self._frames, self._frames + motion.num_frames)
        self._frames = frames.stop
        sides: list[Side] = [side for side in SIDES if self.plan.hand(side)]
        if not sides:
            return motion
        turned, places = joint_positions_from_local(
            motion.local_rotations().double(), self.skeleton
        )
        rotmat, joints = turned.numpy(), places.numpy()
        chest = JOINT_INDEX["spine3"]
        poses = motion.poses.reshape(-1, len(JOINT_INDEX), 3).copy()
        for side in sides:
            wished = _planned(self.plan, side, frames) * OUTWARD[side]
            wished = np.einsum("tij,tj->ti", rotmat[:, chest], wished) + joints[:, chest]
            for joint, angles in _reached(side, rotmat, joints, wished, self.skeleton):
                poses[:, joint] = angles
        return replace(motion, poses=poses.reshape(motion.poses.shape))


def _planned(plan: GesturePlan, side: Side, frames: range) -> Float[np.ndarray, "T 3"]:
    """Where the plan has a wrist, rounded off; before and after the plan it stays."""
    margin = SOFT_MARGIN
    wide = np.arange(frames.start - margin, frames.stop + margin)
    path = goal_path(without_gaps(plan.hand(side), plan.duration_s), (wide + 0.5) / FPS)
    return gaussian_filter1d(path, SOFT_FRAMES, axis=0)[margin : margin + len(frames)]


def _reached(
    side: Side,
    rotmat: Float[np.ndarray, "T 55 3 3"],
    joints: Float[np.ndarray, "T 55 3"],
    wished: Float[np.ndarray, "T 3"],
    skeleton: RestSkeleton,
) -> Iterator[tuple[int, Float[np.ndarray, "T 3"]]]:
    """Shoulder and elbow with their local rotations, axis-angle, that lead the wrist."""
    shoulder, elbow, wrist = (JOINT_INDEX[f"{side}_{name}"] for name in _ARM)
    upper, lower = joints[:, elbow] - joints[:, shoulder], joints[:, wrist] - joints[:, elbow]
    span = upper + lower
    led = span + LED * (wished - joints[:, wrist])
    straight = float(np.linalg.norm(upper[0]) + np.linalg.norm(lower[0]))
    reach = _at_most(np.linalg.norm(led, axis=1), LONGEST * straight)
    hinge = _hinge(side, rotmat[:, shoulder], upper, lower, skeleton)
    opened = Rotation.from_rotvec(_opening(upper, lower, hinge, reach)[:, None] * hinge)
    swing = _between(upper + opened.apply(lower), led)
    parent = Rotation.from_matrix(rotmat[:, JOINT_INDEX[f"{side}_collar"]])
    new_upper = swing * Rotation.from_matrix(rotmat[:, shoulder])
    new_lower = swing * opened * Rotation.from_matrix(rotmat[:, elbow])
    yield shoulder, (parent.inv() * new_upper).as_rotvec().astype(np.float32)
    yield elbow, (new_upper.inv() * new_lower).as_rotvec().astype(np.float32)


_ARM = ("shoulder", "elbow", "wrist")


def _at_most(length: Float[np.ndarray, " T"], most: float) -> Float[np.ndarray, " T"]:
    """The smaller of the two, softly."""
    return -_SOFT_M * np.logaddexp(-length / _SOFT_M, -most / _SOFT_M)


def _hinge(
    side: Side,
    shoulder: Float[np.ndarray, "T 3 3"],
    upper: Float[np.ndarray, "T 3"],
    lower: Float[np.ndarray, "T 3"],
    skeleton: RestSkeleton,
) -> Float[np.ndarray, "T 3"]:
    """About what the elbow bends: across both bones, and where the arm is nearly straight, as one
    that bends forwards in the T-pose."""
    rest = skeleton.rest_joints.double().numpy()
    bone = rest[JOINT_INDEX[f"{side}_elbow"]] - rest[JOINT_INDEX[f"{side}_shoulder"]]
    usual = shoulder @ unit(np.cross(bone, _FORWARD))
    across = np.cross(upper, lower)
    size = np.linalg.norm(upper, axis=1) * np.linalg.norm(lower, axis=1)
    return unit(across / size[:, None] + _BENT * usual)


def _opening(
    upper: Float[np.ndarray, "T 3"],
    lower: Float[np.ndarray, "T 3"],
    hinge: Float[np.ndarray, "T 3"],
    reach: Float[np.ndarray, " T"],
) -> Float[np.ndarray, " T"]:
    """Radians by which the forearm turns about the hinge so that the wrist is so far away."""

    def dot(a: Float[np.ndarray, "T 3"], b: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, " T"]:
        return np.einsum("ti,ti->t", a, b)

    fixed = dot(upper, hinge) * dot(lower, hinge)
    cosine, sine = dot(upper, lower) - fixed, dot(upper, np.cross(hinge, lower))
    wanted = (reach**2 - dot(upper, upper) - dot(lower, lower)) / 2 - fixed
    share = np.clip(wanted / np.hypot(cosine, sine), -1.0, 1.0)
    return np.arctan2(sine, cosine) + np.arccos(share)


def _between(one: Float[np.ndarray, "T 3"], other: Float[np.ndarray, "T 3"]) -> Rotation:
    """The shortest turns from some directions to others."""
    one, other = unit(one), unit(other)
    half = np.concatenate(
        [np.cross(one, other), 1 + np.einsum("ti,ti->t", one, other)[:, None]], axis=1
    )
    return Rotation.from_quat(half)
