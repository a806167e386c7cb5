"""Foot lock and hand constraint of a plan, by inverse kinematics of legs and arms.

A network predicts rotations, and a foot is the end of four of them: it slides and jitters where it
should stand. The plan defines when a foot is planted, and the network where: it stays where it
lands, with its sole flat, and the leg's two bones follow from hip and ankle in closed form.

The network follows the plan of the hands approximately, but a stroke may end late, or be missing.
The wrist is moved most of the way to the planned path, in closed form: the elbow opens or closes as
far as it must and the whole arm turns, without a change of the hand's pose.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Float64
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation
from torch import Tensor

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.motion.kinematics import forward_kinematics, open_body_skeleton
from model.motion.motion import Motion
from model.motion.tracks import CHEST_AXIS_SIGNS
from model.motion.two_bone_ik import HingedLimb, minimum_jerk, unit
from model.plan.plan import SIDES, FootContact, GesturePlan, Side, StreamedPlan, fill_gaps
from model.plan.plan_features import goal_path

ANKLE_M = 0.074
"""Height of the open body's ankle over the floor with its sole flat (m)."""
LIFT_M = 0.035
"""Lift of the foot at a step's highest point (m)."""
TOE_DROP_DEG_PER_M = 350.0
"""Angle of the hanging toes per metre of lift (degrees)."""
STEP_S = 1.0
"""Longest step (s); a foot that is off the ground for longer is not lifted here."""
LANDING_S = 0.2
"""Time (s) in which a landing foot comes to rest."""
MIN_KNEE_BEND_RAD = np.radians(4.0)
"""Smallest bend of a knee (rad). The pelvis is lowered where a leg would be too short."""
_SOFT_LEG_M = 0.003
_STOOD = "stood"
_KNEE_AXIS = np.array([1.0, 0.0, 0.0])


class HandFootConstraint:
    """Constraints of hands and feet for one sample (`model.generation.base.MotionConstraint`).

    Args:
        plan: None for one that arrives with the speech.
        placements: the footings of an earlier version, which stay.
    """

    def __init__(
        self, plan: GesturePlan | None, placements: Mapping[str, Float64[Tensor, "n 6"]]
    ) -> None:
        self.margin = SOFT_MARGIN
        contacts = {
            FootContact(start_s, end_s, SIDES[int(foot)]): FootPlacement(x, z, turn)
            for start_s, end_s, foot, x, z, turn in (
                placements[_STOOD].tolist() if placements else ()
            )
        }
        self._hands = HandGuide(plan or GesturePlan(1.0))
        self._feet = FootLock(plan.planted if plan else (), contacts)

    def constrain_next(self, motion: Motion) -> Motion:
        return self._feet.constrain_next(self._hands.constrain_next(motion))

    def set_condition(self, streamed: StreamedPlan, next_frame_in_condition: int) -> None:
        self._hands.set_plan(streamed.condition, next_frame_in_condition)
        self._feet.set_contacts(streamed.foot_contacts_from_start)

    def state(self) -> dict[str, Tensor]:
        """Return the footings so far."""
        rows = [
            (event.start_s, event.end_s, SIDES.index(event.foot), *at)
            for event, at in self._feet.placements.items()
        ]
        return {_STOOD: torch.tensor(rows, dtype=torch.float64).reshape(-1, 6)}


class FootPlacement(NamedTuple):
    """Position and direction of a planted foot."""

    x: float
    z: float
    """Position of the ankle in world coordinates (m)."""
    yaw_rad: float
    """Rotation of the foot about the vertical; 0 points ahead."""


@dataclass
class FootLock:
    """Foot lock for a motion that arrives in pieces."""

    planted: Sequence[FootContact]
    """Times at which feet stand, from a plan. A foot without any is not changed."""
    earlier_placements: Mapping[FootContact, FootPlacement] = field(default_factory=dict)
    """Footings from an earlier version, which stay."""
    placements: dict[FootContact, FootPlacement] = field(default_factory=dict, init=False)
    """Footings of all feet that have landed so far."""
    _frames: int = field(default=0, init=False)

    def set_contacts(self, planted: Sequence[FootContact]) -> None:
        """Continue with other times; those that began before have the same footing."""
        stood = {(event.foot, event.start_s): place for event, place in self.placements.items()}
        self.planted = planted
        there = {event: stood.get((event.foot, event.start_s)) for event in planted}
        self.placements = {event: place for event, place in there.items() if place is not None}

    def constrain_next(self, motion: Motion) -> Motion:
        """Lock feet in the frames after those of the last call; lower the pelvis where needed."""
        frames = range(self._frames, self._frames + motion.num_frames)
        self._frames = frames.stop
        if not self.planted:
            return motion
        turned, places = forward_kinematics(
            motion.local_rotations().double(),
            open_body_skeleton(),
            torch.from_numpy(motion.trans).double(),
        )
        rotmat, joints = turned.numpy(), places.numpy()
        sides: list[Side] = [
            side for side in SIDES if any(event.foot == side for event in self.planted)
        ]
        feet = [(_leg(side), *self._foot(side, frames, rotmat, joints)) for side in sides]
        lowered = _lowered(
            [_hip_clearance(limb, ankle - joints[:, leg[0]]) for (leg, limb), ankle, _ in feet]
        )
        joints = joints - lowered[:, None, None] * [0.0, 1.0, 0.0]
        poses = motion.poses.reshape(-1, len(JOINT_INDEX), 3).copy()
        for (leg, limb), ankle, sole in feet:
            hip = leg[0]  # the kneecap keeps its direction
            upper, bent = limb.solve(ankle - joints[:, hip], rotmat[:, hip, :, 2])
            turns = _back(rotmat[:, 0]) @ upper, bent, _back(upper @ bent) @ sole
            for joint, local in zip(leg, turns, strict=True):
                poses[:, joint] = Rotation.from_matrix(local).as_rotvec().astype(np.float32)
        height = (motion.trans[:, 1] - lowered).astype(np.float32)
        return replace(
            motion,
            poses=poses.reshape(motion.poses.shape),
            trans=np.stack([motion.trans[:, 0], height, motion.trans[:, 2]], axis=1),
        )

    def _foot(
        self,
        side: Side,
        frames: range,
        rotmat: Float[np.ndarray, "T 55 3 3"],
        joints: Float[np.ndarray, "T 55 3"],
    ) -> tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T 3 3"]]:
        """Compute positions of the ankle (m), and the foot's global rotations."""
        joint = JOINT_INDEX[f"{side}_ankle"]
        path = joints[:, joint][:, [0, 2]].copy()
        ahead = rotmat[:, joint, :, 2]
        turn = np.arctan2(ahead[:, 0], ahead[:, 2])
        lift = np.zeros(len(frames))
        for event, after in self._stands(side):
            first, stop = _frames_of(event)
            if first in frames:
                at = first - frames.start
                here = FootPlacement(float(path[at, 0]), float(path[at, 1]), float(turn[at]))
                self.placements[event] = self.earlier_placements.get(event, here)
            if event not in self.placements:
                continue
            footing = self.placements[event]
            time = np.asarray(frames)
            gone = stop + STEP_S * FPS
            gone = gone if after is None else min(after, gone)
            held = minimum_jerk((time - first) / (LANDING_S * FPS)) if first > 0 else time >= 0
            swing = (time - stop + 1) / (gone - stop + 1)
            held = np.where(time >= first, held * (1 - minimum_jerk(swing)), 0.0)
            path += held[:, None] * ([footing.x, footing.z] - path)
            turn += held * ((footing.yaw_rad - turn + np.pi) % (2 * np.pi) - np.pi)
            if after is not None and after - stop <= STEP_S * FPS:
                lift += LIFT_M * np.where(
                    (swing > 0) & (swing < 1), np.sin(np.pi * swing) ** 2, 0.0
                )
        ankle = np.stack([path[:, 0], ANKLE_M + lift, path[:, 1]], axis=1)
        sole = np.stack([turn, np.radians(TOE_DROP_DEG_PER_M) * lift], axis=1)
        return ankle, Rotation.from_euler("YX", sole).as_matrix()

    def _stands(self, side: Side) -> Iterator[tuple[FootContact, int | None]]:
        """Yield each time that the foot stands, and the frame at which it stands again."""
        events = [event for event in self.planted if event.foot == side]
        for event, later in zip(events, [*events[1:], None], strict=True):
            yield event, None if later is None else _frames_of(later)[0]


def _frames_of(event: FootContact) -> tuple[int, int]:
    """Return the first frame of a stand, and the one after its last."""
    first = max(round(event.start_s * FPS), 0)
    return first, max(round(event.end_s * FPS), first + 1)


def _lowered(rooms: Sequence[Float[np.ndarray, " T"]]) -> Float[np.ndarray, " T"]:
    """Compute how far the pelvis is lowered so that every leg is long enough, as a soft maximum."""
    least = -_SOFT_LEG_M * np.logaddexp.reduce([-room / _SOFT_LEG_M for room in rooms])
    return _SOFT_LEG_M * np.logaddexp(0.0, -least / _SOFT_LEG_M)


@cache
def _leg(side: Side) -> tuple[tuple[int, int, int], HingedLimb]:
    """Return the indices of hip, knee and ankle, and their limb."""
    hip, knee, ankle = (JOINT_INDEX[f"{side}_{name}"] for name in ("hip", "knee", "ankle"))
    rest = open_body_skeleton().rest_joints.double().numpy()
    limb = HingedLimb(rest[knee] - rest[hip], rest[ankle] - rest[knee], _KNEE_AXIS)
    return (hip, knee, ankle), limb


def _hip_clearance(limb: HingedLimb, span: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, " T"]:
    """Compute how much higher the hip could be (m); negative where the leg is too short."""
    longest = limb.length_at_bend(np.full(len(span), MIN_KNEE_BEND_RAD))
    aside = np.minimum((span[:, [0, 2]] ** 2).sum(1), 0.99 * longest**2)
    return np.sqrt(longest**2 - aside) + span[:, 1]


def _back(rotmat: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T 3 3"]:
    return rotmat.swapaxes(-1, -2)


HAND_GUIDE_WEIGHT = 0.6
"""Share of the way wrists move to the plan's. People are 3.8 cm off (mean); this leaves 3.2."""
SOFT_FRAMES = 1.5
"""Deviation (frames) of the Gaussian on the planned path, which starts with a jolt. At 1 fingertips
had 1.19 times the recorded power above 5 Hz, at 1.5 .96, with strokes as often in time."""
SOFT_MARGIN = round(4 * SOFT_FRAMES)
"""Frames of the plan that are needed on either side."""
MAX_REACH_SHARE = 0.99
"""Longest reach as a share of a straight arm's length."""
_SOFT_ARM_M = 0.004
_BENT = 0.1
"""Weight of the elbow's default plane in an arm that is nearly straight."""
_FORWARD = np.array([0.0, 0.0, 1.0])


@dataclass
class HandGuide:
    """Hand constraint for a motion that arrives in pieces."""

    plan: GesturePlan
    """Plan of the hands. A hand without phases is not changed."""
    _frames: int = field(default=0, init=False)

    def set_plan(self, plan: GesturePlan, next_frame_in_plan: int) -> None:
        """Continue with another plan, in which the next frame has this index."""
        self.plan, self._frames = plan, next_frame_in_plan

    def constrain_next(self, motion: Motion) -> Motion:
        """Move the hands in the frames after those of the last call."""
        frames = range(self._frames, self._frames + motion.num_frames)
        self._frames = frames.stop
        sides: list[Side] = [side for side in SIDES if self.plan.hand(side)]
        if not sides:
            return motion
        turned, places = forward_kinematics(motion.local_rotations().double(), open_body_skeleton())
        rotmat, joints = turned.numpy(), places.numpy()
        chest = JOINT_INDEX["spine3"]
        poses = motion.poses.reshape(-1, len(JOINT_INDEX), 3).copy()
        for side in sides:
            wished = _planned(self.plan, side, frames) * CHEST_AXIS_SIGNS[side]
            wished = np.einsum("tij,tj->ti", rotmat[:, chest], wished) + joints[:, chest]
            for joint, angles in _reached(side, rotmat, joints, wished):
                poses[:, joint] = angles
        return replace(motion, poses=poses.reshape(motion.poses.shape))


def _planned(plan: GesturePlan, side: Side, frames: range) -> Float[np.ndarray, "T 3"]:
    """Compute the plan's smoothed path of a wrist; before and after the plan it is constant."""
    margin = SOFT_MARGIN
    wide = np.arange(frames.start - margin, frames.stop + margin)
    path = goal_path(fill_gaps(plan.hand(side), plan.duration_s), (wide + 0.5) / FPS)
    return gaussian_filter1d(path, SOFT_FRAMES, axis=0)[margin : margin + len(frames)]


def _reached(
    side: Side,
    rotmat: Float[np.ndarray, "T 55 3 3"],
    joints: Float[np.ndarray, "T 55 3"],
    wished: Float[np.ndarray, "T 3"],
) -> Iterator[tuple[int, Float[np.ndarray, "T 3"]]]:
    """Yield shoulder and elbow with their new local rotations, axis-angle."""
    shoulder, elbow, wrist = (JOINT_INDEX[f"{side}_{name}"] for name in _ARM)
    upper, lower = joints[:, elbow] - joints[:, shoulder], joints[:, wrist] - joints[:, elbow]
    span = upper + lower
    led = span + HAND_GUIDE_WEIGHT * (wished - joints[:, wrist])
    straight = float(np.linalg.norm(upper[0]) + np.linalg.norm(lower[0]))
    reach = _soft_minimum(np.linalg.norm(led, axis=1), MAX_REACH_SHARE * straight)
    hinge = _hinge(side, rotmat[:, shoulder], upper, lower)
    opened = Rotation.from_rotvec(_opening(upper, lower, hinge, reach)[:, None] * hinge)
    swing = _between(upper + opened.apply(lower), led)
    parent = Rotation.from_matrix(rotmat[:, JOINT_INDEX[f"{side}_collar"]])
    new_upper = swing * Rotation.from_matrix(rotmat[:, shoulder])
    new_lower = swing * opened * Rotation.from_matrix(rotmat[:, elbow])
    yield shoulder, (parent.inv() * new_upper).as_rotvec().astype(np.float32)
    yield elbow, (new_upper.inv() * new_lower).as_rotvec().astype(np.float32)


_ARM = ("shoulder", "elbow", "wrist")


def _soft_minimum(length: Float[np.ndarray, " T"], most: float) -> Float[np.ndarray, " T"]:
    """Compute a soft minimum of length and limit."""
    return -_SOFT_ARM_M * np.logaddexp(-length / _SOFT_ARM_M, -most / _SOFT_ARM_M)


def _hinge(
    side: Side,
    shoulder: Float[np.ndarray, "T 3 3"],
    upper: Float[np.ndarray, "T 3"],
    lower: Float[np.ndarray, "T 3"],
) -> Float[np.ndarray, "T 3"]:
    """Compute the elbow's axis across the bones, or for forward bends if nearly straight."""
    rest = open_body_skeleton().rest_joints.double().numpy()
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
    """Compute the forearm's angle (rad) about the hinge for the requested distance of the wrist."""

    def dot(a: Float[np.ndarray, "T 3"], b: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, " T"]:
        return np.einsum("ti,ti->t", a, b)

    fixed = dot(upper, hinge) * dot(lower, hinge)
    cosine, sine = dot(upper, lower) - fixed, dot(upper, np.cross(hinge, lower))
    wanted = (reach**2 - dot(upper, upper) - dot(lower, lower)) / 2 - fixed
    share = np.clip(wanted / np.hypot(cosine, sine), -1.0, 1.0)
    return np.arctan2(sine, cosine) + np.arccos(share)


def _between(one: Float[np.ndarray, "T 3"], other: Float[np.ndarray, "T 3"]) -> Rotation:
    """Compute the shortest rotations between pairs of directions."""
    one, other = unit(one), unit(other)
    half = np.concatenate(
        [np.cross(one, other), 1 + np.einsum("ti,ti->t", one, other)[:, None]], axis=1
    )
    return Rotation.from_quat(half)
