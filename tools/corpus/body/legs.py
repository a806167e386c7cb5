"""Leg animation: planted feet, weight shifts, steps, and the body's translation."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.motion.two_bone_ik import HingedLimb
from model.plan.plan import FootContact, Leg, Side, Stance
from tools.corpus.body.signals import (
    bump,
    frame_times,
    low_pass,
    minimum_jerk,
    smooth_line,
    smooth_noise,
    sway,
)
from tools.corpus.body.trunk import CALMER, Trunk
from tools.corpus.people.rig import SIDE_SIGN, SIDES, Rig, euler_matrices
from tools.corpus.people.speaker import Speaker

STANCE_HALF_WIDTH_M = 0.125
STANDING_BEND_DEG = 6.0  # knee bend of the supporting leg
TOES_OUT_DEG = 12.0  # of the open body's feet at rest, with kneecaps facing ahead
KNEES_IN_DEG = 5.0  # compensates for its legs, which are bowed at rest
_KNEE_AXIS = np.array([1.0, 0.0, 0.0])
_SOFTNESS_M = 0.003  # how gradually the weight goes from one leg to the other
STEP_S = 0.46


@dataclass(frozen=True)
class Legs:
    """Local rotations of the legs' joints, the body's translation, and the events behind them."""

    rotations: dict[int, Float[np.ndarray, "T 3 3"]]
    trans: Float[np.ndarray, "T 3"]
    stances: tuple[Stance, ...]
    """Stances, which cover the clip."""
    planted: tuple[FootContact, ...]
    """Spans in which each foot is on the floor."""


def move_legs(
    rig: Rig,
    trunk: Trunk,
    calm: Float[np.ndarray, " T"],
    speaker: Speaker,
    rng: np.random.Generator,
) -> Legs:
    """Animate standing, weight shifts and steps, and the translation of the body.

    The pelvis is set to the height at which the straighter leg bends like a standing leg; so no leg
    needs more than its length, and planted feet stay on the floor.
    """
    pelvis = trunk.rotations[0]
    num_frames = len(pelvis)
    feet = _footsteps(calm, speaker, rng)
    left_over = 1.0 - CALMER * calm
    middle = low_pass(0.5 * (feet.place["left"] + feet.place["right"]), 0.12)
    floating = sway(rng, num_frames, 0.015 * speaker.sway, 3) * [1, 0, 1]
    floating += smooth_noise(rng, num_frames, 0.004 * speaker.sway, 0.25, 3) * [1, 0, 1]
    floating *= left_over[:, None]
    at = middle + feet.shift + floating
    # Knees bend on accents.
    bend_deg = STANDING_BEND_DEG + 3.0 * speaker.energy * np.clip(trunk.accent, 0, 1.5)
    bend_deg += left_over * np.abs(smooth_line(rng, num_frames, 2.0 * speaker.sway, 0.4))

    limbs = {side: _leg(rig, side) for side in SIDES}
    hips, ankles, heights = {}, {}, []
    for side in SIDES:
        hips[side] = at * [1, 0, 1] + rig.rest_joints[0] + pelvis @ rig.offsets[_joint(side, "hip")]
        rest = rig.rest_joints[_joint(side, "ankle")]
        ankles[side] = feet.place[side] + [0.0, rest[1] - rig.floor_m, rest[2]]
        ankles[side] += feet.lift[side][:, None] * [0.0, 1.0, 0.0]
        gap = np.linalg.norm((hips[side] - ankles[side])[:, [0, 2]], axis=1)
        length = limbs[side].length_at_bend(np.radians(bend_deg))
        heights.append(ankles[side][:, 1] + np.sqrt(length**2 - gap**2) - hips[side][:, 1])
    height = -_SOFTNESS_M * np.logaddexp(*(-h / _SOFTNESS_M for h in heights))
    trans = np.stack([at[:, 0], height, at[:, 2]], axis=1)

    rotations: dict[int, np.ndarray] = {}
    for side in SIDES:
        sign = SIDE_SIGN[side]
        span = ankles[side] - hips[side] - height[:, None] * [0.0, 1.0, 0.0]
        turn_deg = feet.yaw_deg[side] - TOES_OUT_DEG * sign
        kneecap = euler_matrices("Y", turn_deg[:, None] - KNEES_IN_DEG * sign)
        upper, knee = limbs[side].solve(span, kneecap @ np.array([0.0, 0.0, 1.0]))
        sole = np.stack([turn_deg, 350 * feet.lift[side]], axis=1)
        rotations[_joint(side, "hip")] = pelvis.mT @ upper
        rotations[_joint(side, "knee")] = knee
        rotations[_joint(side, "ankle")] = (upper @ knee).mT @ euler_matrices("YX", sole)
    return Legs(rotations, trans, feet.stances, feet.planted)


def _leg(rig: Rig, side: str) -> HingedLimb:
    return HingedLimb(
        rig.offsets[_joint(side, "knee")], rig.offsets[_joint(side, "ankle")], _KNEE_AXIS
    )


def _joint(side: str, part: str) -> int:
    return JOINT_INDEX[f"{side}_{part}"]


@dataclass(frozen=True)
class _Feet:
    place: dict[str, Float[np.ndarray, "T 3"]]
    yaw_deg: dict[str, Float[np.ndarray, " T"]]
    lift: dict[str, Float[np.ndarray, " T"]]
    shift: Float[np.ndarray, "T 3"]
    stances: tuple[Stance, ...]
    planted: tuple[FootContact, ...]


def _footsteps(calm: Float[np.ndarray, " T"], speaker: Speaker, rng: np.random.Generator) -> _Feet:
    """Draw positions, lifts and yaws of the feet, and weight shifts; no steps while ``calm``."""
    num_frames = len(calm)
    time_s = frame_times(num_frames)
    place, yaw, lift = {}, {}, {}
    for side in SIDES:
        sign = SIDE_SIGN[side]
        stand = [sign * STANCE_HALF_WIDTH_M + rng.normal(0, 0.01), 0.0, rng.normal(0, 0.025)]
        place[side] = np.tile(stand, (num_frames, 1))
        yaw[side] = np.full(num_frames, sign * rng.uniform(8, 16))
        lift[side] = np.zeros(num_frames)
    shift = np.zeros((num_frames, 3))
    centre, weight = np.zeros(3), np.zeros(3)
    planted: list[FootContact] = []
    stands_s: dict[Side, float] = {"left": 0.0, "right": 0.0}
    other: dict[str, Leg] = {"left": "right", "right": "left"}
    changes: list[tuple[float, Leg]] = [(0.0, "both")]
    at_s = rng.uniform(2, 5)
    while at_s < time_s[-1] - 2:
        # A step and the shift after it take two seconds.
        listens = calm[round(at_s * FPS) : round((at_s + 2.0) * FPS)].max() > 0
        if listens and rng.random() < 0.7:
            at_s += 1.0
            continue
        if not listens and rng.random() < 0.65 * speaker.steps:
            goal = np.clip(0.7 * centre + rng.normal(0, [0.13, 0, 0.13]), -0.35, 0.35)
            stride, turn = goal - centre, rng.normal(0, 7)
            order: list[Side] = ["left", "right"] if stride[0] > 0 else ["right", "left"]
            for side, delay in zip(order, (0.0, rng.uniform(0.55, 0.8)), strict=True):
                planted.append(FootContact(stands_s[side], at_s + delay, side))
                stands_s[side] = at_s + delay + STEP_S
                changes.append((at_s + delay, other[side]))
                changes.append((at_s + delay + STEP_S, "both"))
                phase = (time_s - at_s - delay) / STEP_S
                place[side] += stride * minimum_jerk(phase)[:, None]
                yaw[side] += turn * minimum_jerk(phase)
                lift[side] += bump(phase) * rng.uniform(0.025, 0.045)
                unload = bump((time_s - at_s - delay + 0.2) / 0.8)
                shift[:, 0] -= 0.03 * SIDE_SIGN[side] * unload
            centre = goal
            at_s += 1.3
        side_m = rng.choice([-1.0, 1.0]) * rng.uniform(0.02, 0.07)
        goal = np.array([side_m, 0, rng.normal(0, 0.02)]) * min(speaker.sway, 1.2)
        change_s = rng.uniform(0.6, 1.2)
        shift += (goal - weight) * minimum_jerk((time_s - at_s) / change_s)[:, None]
        changes.append((at_s + 0.5 * change_s, "left" if side_m > 0 else "right"))
        weight = goal
        at_s += rng.gamma(2.5, 0.5) + 0.5
    end_s = (num_frames + 1) / FPS
    planted += [FootContact(start_s, end_s, side) for side, start_s in stands_s.items()]
    return _Feet(place, yaw, lift, shift, _stances(changes, end_s), tuple(planted))


def _stances(changes: list[tuple[float, Leg]], duration_s: float) -> tuple[Stance, ...]:
    """Return the supporting leg from each change to the next."""
    changes = sorted(changes, key=lambda change: change[0])
    ends = [*(time for time, _ in changes[1:]), duration_s]
    spans = zip(changes, ends, strict=True)
    return tuple(Stance(start, end, leg) for (start, leg), end in spans if end > start)
