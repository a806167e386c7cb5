"""Feet that stand where a plan says that they do, and the legs that go with them.

A network tells rotations, and a foot is the end of four of them: it slides and trembles where it
should stand. Here the plan says when a foot is planted, and the network where: it stays where it
lands, with its sole flat, and the leg's two bones follow from hip and ankle in closed form.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.motion.kinematics import joint_positions_from_local
from model.motion.limb import HingedLimb
from model.motion.motion import Motion
from model.motion.skeleton import RestSkeleton
from model.plan.plan import SIDES, Planted, Side

ANKLE_M = 0.074
"""Height of the open body's ankle over the floor with its sole flat."""
LIFT_M = 0.035
"""Of a step's highest point."""
TIPTOE_DEG = 350.0
"""How far the toes hang, for each metre that a foot is lifted."""
STEP_S = 1.0
"""A foot that is off the ground for longer is not stepping, and is not lifted here."""
LANDING_S = 0.2
"""In which a foot comes to stand."""
LEAST_BEND = np.radians(4.0)
"""Of a knee. The pelvis is lowered where a leg would be asked for more than its length."""
_SOFT_M = 0.003
_KNEE_AXIS = np.array([1.0, 0.0, 0.0])


@dataclass(frozen=True)
class Footing:
    """Where a planted foot stands."""

    x: float
    z: float
    """Of the ankle in the world, metres."""
    turn: float
    """Of the foot about the vertical, radians; 0 points ahead."""


@dataclass
class HeldFeet:
    """Holds planted feet in a motion that comes piece by piece.

    Args:
        planted: when which foot stands, from a plan. A foot that never does is left as it is.
        skeleton: the body that shall stand.
        known: footings that are to be kept, of a performance before.
    """

    planted: Sequence[Planted]
    skeleton: RestSkeleton
    known: Mapping[Planted, Footing] = field(default_factory=dict)
    found: dict[Planted, Footing] = field(default_factory=dict, init=False)
    """Of all feet that have landed so far."""
    _frames: int = field(default=0, init=False)

    def go_on_with(self, planted: Sequence[Planted]) -> None:
        """From now on other times, of which those that began before have the footing they had."""
        stood = {(event.foot, event.start_s): place for event, place in self.found.items()}
        self.planted = planted
        there = {event: stood.get((event.foot, event.start_s)) for event in planted}
        self.found = {event: place for event, place in there.items() if place is not None}

    def hold(self, motion: Motion) -> Motion:
        """The frames that follow those of the call before, with legs that stand."""
        frames = range(self._frames, self._frames + motion.num_frames)
        self._frames = frames.stop
        if not self.planted:
            return motion
        local = motion.local_rotations().double()
        trans = torch.from_numpy(motion.trans).double()
        turned, places = joint_positions_from_local(local, self.skeleton, trans)
        rotmat, joints = turned.numpy(), places.numpy()
        sides: list[Side] = [
            side for side in SIDES if any(event.foot == side for event in self.planted)
        ]
        legs = [_Leg.of(side, self.skeleton) for side in sides]
        feet = [self._foot(side, frames, rotmat, joints) for side in sides]
        lowered = _lowered(
            [leg.room(joints, ankle) for leg, (ankle, _) in zip(legs, feet, strict=True)]
        )
        joints = joints - lowered[:, None, None] * [0.0, 1.0, 0.0]
        poses = motion.poses.reshape(-1, len(JOINT_INDEX), 3).copy()
        for leg, foot in zip(legs, feet, strict=True):
            for joint, angles in leg.reached(rotmat, joints, *foot):
                poses[:, joint] = angles
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
        """Where the ankle shall be, and how the foot is turned in the world."""
        joint = JOINT_INDEX[f"{side}_ankle"]
        path = joints[:, joint][:, [0, 2]].copy()
        ahead = rotmat[:, joint, :, 2]
        turn = np.arctan2(ahead[:, 0], ahead[:, 2])
        lift = np.zeros(len(frames))
        for event, after in self._stands(side):
            first, stop = _frames_of(event)
            if first in frames:
                at = first - frames.start
                here = Footing(float(path[at, 0]), float(path[at, 1]), float(turn[at]))
                self.found[event] = self.known.get(event, here)
            if event not in self.found:
                continue
            footing = self.found[event]
            time = np.asarray(frames)
            gone = stop + STEP_S * FPS
            gone = gone if after is None else min(after, gone)
            held = _eased((time - first) / (LANDING_S * FPS)) if first > 0 else time >= 0
            swing = (time - stop + 1) / (gone - stop + 1)
            held = np.where(time >= first, held * (1 - _eased(swing)), 0.0)
            path += held[:, None] * ([footing.x, footing.z] - path)
            turn += held * ((footing.turn - turn + np.pi) % (2 * np.pi) - np.pi)
            if after is not None and after - stop <= STEP_S * FPS:
                lift += LIFT_M * np.where(
                    (swing > 0) & (swing < 1), np.sin(np.pi * swing) ** 2, 0.0
                )
        ankle = np.stack([path[:, 0], ANKLE_M + lift, path[:, 1]], axis=1)
        sole = np.stack([turn, np.radians(TIPTOE_DEG) * lift], axis=1)
        return ankle, Rotation.from_euler("YX", sole).as_matrix()

    def _stands(self, side: Side) -> Iterator[tuple[Planted, int | None]]:
        """Each time that the foot stands, and the frame at which it stands again."""
        events = [event for event in self.planted if event.foot == side]
        for event, later in zip(events, [*events[1:], None], strict=True):
            yield event, None if later is None else _frames_of(later)[0]


def _frames_of(event: Planted) -> tuple[int, int]:
    """The first frame of a stand, and the one after its last."""
    first = max(round(event.start_s * FPS), 0)
    return first, max(round(event.end_s * FPS), first + 1)


def _eased(phase: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
    """0 up to phase 0, 1 from phase 1 on, the minimum-jerk polynomial between."""
    x = np.clip(phase, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x * x)


def _lowered(rooms: Sequence[Float[np.ndarray, " T"]]) -> Float[np.ndarray, " T"]:
    """How far the pelvis comes down, so that every leg has room; softly."""
    least = -_SOFT_M * np.logaddexp.reduce([-room / _SOFT_M for room in rooms])
    return _SOFT_M * np.logaddexp(0.0, -least / _SOFT_M)


@dataclass(frozen=True)
class _Leg:
    hip: int
    knee: int
    ankle: int
    limb: HingedLimb

    @classmethod
    def of(cls, side: Side, skeleton: RestSkeleton) -> "_Leg":
        hip, knee, ankle = (JOINT_INDEX[f"{side}_{name}"] for name in ("hip", "knee", "ankle"))
        rest = skeleton.rest_joints.double().numpy()
        limb = HingedLimb(rest[knee] - rest[hip], rest[ankle] - rest[knee], _KNEE_AXIS)
        return cls(hip, knee, ankle, limb)

    def room(
        self, joints: Float[np.ndarray, "T 55 3"], ankle: Float[np.ndarray, "T 3"]
    ) -> Float[np.ndarray, " T"]:
        """How much higher the hip could be, metres; negative where the leg is too short."""
        span = ankle - joints[:, self.hip]
        longest = self.limb.length(np.full(len(ankle), LEAST_BEND))
        aside = np.minimum((span[:, [0, 2]] ** 2).sum(1), 0.99 * longest**2)
        return np.sqrt(longest**2 - aside) + span[:, 1]

    def reached(
        self,
        rotmat: Float[np.ndarray, "T 55 3 3"],
        joints: Float[np.ndarray, "T 55 3"],
        ankle: Float[np.ndarray, "T 3"],
        sole: Float[np.ndarray, "T 3 3"],
    ) -> Iterator[tuple[int, Float[np.ndarray, "T 3"]]]:
        """Each joint of the leg with its local rotation, axis-angle; the kneecap looks where it
        did."""
        upper, bent = self.limb.reach(ankle - joints[:, self.hip], rotmat[:, self.hip, :, 2])
        pelvis = rotmat[:, 0]
        turned = (_back(pelvis) @ upper, bent, _back(upper @ bent) @ sole)
        for joint, local in zip((self.hip, self.knee, self.ankle), turned, strict=True):
            yield joint, Rotation.from_matrix(local).as_rotvec().astype(np.float32)


def _back(rotmat: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T 3 3"]:
    return rotmat.swapaxes(-1, -2)
