"""From a plan's keys to collar, shoulder, elbow, wrist and finger rotations.

Moves are minimum-jerk and superposed, so that one may begin before the last has ended. The arm is
solved in the chest's frame by analytic two-bone inverse kinematics.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from model.corpus.hand_shapes import ABDUCTION, FLEX, SHAPE_SIZE, THUMB, finger_rotations
from model.corpus.ik import hinge_frame, two_bone_ik
from model.corpus.plan import Key, Plan
from model.corpus.rig import (
    JOINT,
    SIDE_SIGN,
    SIDES,
    Rig,
    about_axis,
    euler_matrices,
    transposed,
    unit,
)
from model.corpus.signals import (
    FPS,
    bump,
    frame_times,
    low_pass,
    minimum_jerk,
    smooth_line,
    smooth_noise,
)
from model.corpus.speakers import Speaker

# The channels of a hand's curves.
POSITION = slice(0, 3)  # metres, chest frame, x to the body's left
PRONATION, WRIST_FLEX, DEVIATION, ELBOW_OUT = 3, 4, 5, 6  # degrees, degrees, degrees, no unit
FINGERS = slice(7, 7 + SHAPE_SIZE)
NUM_CHANNELS = 7 + SHAPE_SIZE
PALM_CENTRE_M = 0.085  # from the wrist along the forearm
SHOULDER_TWIST_SHARE = 0.3  # of the humeral twist; the elbow joint takes the rest
_HAND_DELAY_S = np.concatenate(
    [
        [0.0, 0.0, 0.0, 0.03, 0.03, 0.03, 0.0],
        np.repeat([0.02, 0.035, 0.05, 0.065], 3) + np.tile([0.0, 0.015, 0.03], 4),
        [0.02, 0.02, 0.03, 0.04],
        [0.02, 0.02, 0.03],
    ]
)


@dataclass(frozen=True)
class Arm:
    """One arm's bones in the chest's frame at rest."""

    side: str
    collar: Float[np.ndarray, " 3"]
    shoulder: Float[np.ndarray, " 3"]
    upper: Float[np.ndarray, " 3"]
    fore: Float[np.ndarray, " 3"]

    @property
    def sign(self) -> float:
        return SIDE_SIGN[self.side]

    @property
    def hinge(self) -> Float[np.ndarray, " 3"]:
        return np.array([0.0, -self.sign, 0.0])


def arm_of(rig: Rig, side: str) -> Arm:
    """The arm's bones; the collar's root is measured from the chest joint."""
    return Arm(
        side,
        rig.rest_joints[JOINT[f"{side}_collar"]] - rig.rest_joints[JOINT["spine3"]],
        rig.offsets[JOINT[f"{side}_shoulder"]],
        rig.offsets[JOINT[f"{side}_elbow"]],
        rig.offsets[JOINT[f"{side}_wrist"]],
    )


def move_arms(
    rig: Rig, plan: Plan, num_frames: int, speaker: Speaker, rng: np.random.Generator
) -> tuple[dict[int, Float[np.ndarray, "T 3 3"]], dict[str, Float[np.ndarray, "T C"]]]:
    """Local rotations of both arms and hands, and the hands' curves by side."""
    time_s = frame_times(num_frames)
    shrug = np.zeros(num_frames)
    for start_s, end_s in plan.shrugs:
        shrug += minimum_jerk((time_s - start_s + 0.35) / 0.4)
        shrug -= minimum_jerk((time_s - end_s) / 0.55)
    arms = {side: arm_of(rig, side) for side in SIDES}
    curves = {side: _follow_keys(arms[side], plan.keys[side], time_s, rng) for side in SIDES}
    for span in plan.cycles:
        _add_cycle(curves[span.side], span, time_s)
    _add_life(arms, curves, speaker, rng)
    for side in SIDES:
        curves[side] = _within_reach(arms[side], curves[side])
    _keep_hands_apart(arms, curves)
    rotations: dict[int, np.ndarray] = {}
    for side in SIDES:
        arm = arms[side]
        shake = smooth_noise(rng, num_frames, 1.5 * speaker.sway, 0.18, 3) * [1, 1, 0.7]
        shake += smooth_noise(rng, num_frames, 1.5, 0.7, 3)
        collar, upper, fore, direction = solve_arm(
            arm, curves[side][:, POSITION], curves[side][:, ELBOW_OUT], shrug, shake
        )
        _trail(arm, curves[side], fore, direction)
        rotations |= _arm_rotations(arm, curves[side], collar, upper, fore, speaker, rng)
    return rotations, curves


def solve_arm(
    arm: Arm,
    position: Float[np.ndarray, "T 3"],
    elbow_out: Float[np.ndarray, " T"],
    shrug: Float[np.ndarray, " T"] | float = 0.0,
    shake_deg: Float[np.ndarray, "T 3"] | float = 0.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Collar, upper arm and forearm rotations in the chest's frame, and the forearm's direction."""
    sign = arm.sign
    height, ahead = position[:, 1], position[:, 2]
    out = sign * position[:, 0]
    raised = np.clip((height + 0.36) / 0.36, 0, 2.2)
    lift = -17 + 7.5 * raised + 4 * np.maximum(raised - 1, 0) ** 1.3 + 12 * shrug
    protract = 9 + 9 * np.clip((ahead - 0.22) / 0.2, -1, 1) - 4 * np.clip((out - 0.2) / 0.2, 0, 1.5)
    roll = 2 + 6 * np.clip(height + 0.15, -0.2, 0.3) / 0.3
    angles = np.stack([protract, lift, roll], axis=1) + shake_deg
    collar = euler_matrices("YZX", angles * [-sign, sign, 1.0])
    root = arm.collar + collar @ arm.shoulder
    high = np.clip(height + 0.05, 0, 0.4) / 0.3
    crossing = 0.3 * np.clip((0.10 - out) / 0.1, 0, 1)
    aside = sign * (0.22 + elbow_out + 0.05 * high + crossing)
    pole = np.stack([aside, -np.ones(len(position)), -0.42 + 0.25 * high], axis=1)
    upper, fore, direction = two_bone_ik(root, position, arm.upper, arm.fore, arm.hinge, pole)
    return collar, upper, fore, direction


def _pronation_for(
    arm: Arm,
    fore: Float[np.ndarray, "T 3 3"],
    direction: Float[np.ndarray, "T 3"],
    palm: Float[np.ndarray, "T 3"],
) -> Float[np.ndarray, " T"]:
    """Degrees about the forearm that turn the palm there; the longer way round is never taken."""
    start = fore @ np.array([0.0, -1.0, 0.0])
    start = unit(start - (start * direction).sum(-1, keepdims=True) * direction)
    goal = unit(palm - (palm * direction).sum(-1, keepdims=True) * direction)
    sine = (np.cross(start, goal) * direction).sum(-1)
    angle = np.degrees(np.arctan2(sine, (start * goal).sum(-1))) * arm.sign
    return np.clip(np.where(angle > 150, angle - 360, angle), -95, 85)


def _key_channels(arm: Arm, key: Key) -> Float[np.ndarray, " C"]:
    mirror = np.array([arm.sign, 1.0, 1.0])
    position = key.pose.position * mirror
    elbow = np.array([key.pose.elbow_out])
    _, _, fore, direction = solve_arm(arm, position[None], elbow)
    pronation = _pronation_for(arm, fore, direction, unit(key.pose.palm * mirror)[None])[0]
    flex = np.clip(key.pose.flex_deg, -58, 52)
    hand = [pronation, flex, key.pose.deviation_deg, key.pose.elbow_out]
    return np.concatenate([position, hand, key.pose.fingers])


def _follow_keys(
    arm: Arm, keys: list[Key], time_s: Float[np.ndarray, " T"], rng: np.random.Generator
) -> Float[np.ndarray, "T C"]:
    """Superposed minimum-jerk moves on slightly bent paths; fingers follow from index to pinky."""
    targets = [_key_channels(arm, key) for key in keys]
    curves = np.tile(targets[0], (len(time_s), 1))
    span_share = np.where(np.arange(NUM_CHANNELS) < 7, 1.0, 0.85)
    for before, after, key in zip(targets[:-1], targets[1:], keys[1:], strict=True):
        start_s = key.arrive_s - key.duration_s
        first = int(np.searchsorted(time_s, start_s))
        phase = (time_s[first:, None] - start_s - _HAND_DELAY_S) / (key.duration_s * span_share)
        step = after - before
        curves[first:] += step * minimum_jerk(phase)
        line = unit(step[POSITION])
        aside = rng.normal(size=3) * 0.7 + [0.45 * arm.sign, 0.4, 0.25]
        aside = unit(aside - (aside @ line) * line)
        bow = rng.uniform(0.08, 0.24) * np.linalg.norm(step[POSITION])
        curves[first:, POSITION] += bow * aside * bump(phase[:, POSITION])
    return curves


def _add_cycle(curves: Float[np.ndarray, "T C"], span, time_s: Float[np.ndarray, " T"]) -> None:
    envelope = minimum_jerk((time_s - span.start_s + 0.15) / 0.35)
    envelope *= 1 - minimum_jerk((time_s - span.end_s + 0.1) / 0.4)
    angle = 2 * np.pi * span.hz * (time_s - span.start_s) + span.phase_rad
    curves[:, 1] += envelope * span.vertical_m * np.sin(angle)
    curves[:, 2] += envelope * span.forward_m * np.cos(angle)
    curves[:, WRIST_FLEX] += envelope * 8 * np.sin(angle - 0.6)
    curves[:, FINGERS.start : FINGERS.start + 12] += (envelope * 5 * np.sin(angle - 1.0))[:, None]


def _add_life(
    arms: dict[str, Arm],
    curves: dict[str, Float[np.ndarray, "T C"]],
    speaker: Speaker,
    rng: np.random.Generator,
) -> None:
    """Drift that both hands share, drift of each, a follow of the other hand, and tremor."""
    num_frames = len(curves["left"])
    common = smooth_noise(rng, num_frames, 0.008, 0.4, 3)
    common += smooth_noise(rng, num_frames, 0.0055 * speaker.amplitude, 0.16, 3)
    velocity = {side: np.gradient(curves[side][:, POSITION], axis=0) for side in SIDES}
    for side, other in zip(SIDES, reversed(SIDES), strict=True):
        hand = curves[side]
        followed = np.cumsum(velocity[other] * [-0.1, 0.1, 0.1], axis=0)
        followed = gaussian_filter1d(followed - gaussian_filter1d(followed, 25, axis=0), 2, axis=0)
        hand[:, POSITION] += common * [arms[side].sign, 1, 1] + followed
        hand[:, POSITION] += smooth_noise(rng, num_frames, 0.008, 0.25, 3)
        hand[:, POSITION] += smooth_noise(rng, num_frames, 0.016, 0.9, 3)
        hand[:, PRONATION] += smooth_line(rng, num_frames, 6.0, 0.4)
        hand[:, PRONATION] += smooth_line(rng, num_frames, 3.0, 0.12)
        hand[:, WRIST_FLEX] += smooth_line(rng, num_frames, 4.5, 0.25)
        hand[:, WRIST_FLEX] += smooth_line(rng, num_frames, 3.0, 0.10)
        hand[:, DEVIATION] += smooth_line(rng, num_frames, 3.5, 0.3)
        hand[:, PRONATION : DEVIATION + 1] += smooth_noise(rng, num_frames, 0.35, 0.035, 3)
        hand[:, FINGERS] += _finger_life(hand, speaker, rng)


def _finger_life(
    hand: Float[np.ndarray, "T C"], speaker: Speaker, rng: np.random.Generator
) -> Float[np.ndarray, "T 19"]:
    """Fingers that never stand still, together and one by one, livelier while the hand moves."""
    num_frames = len(hand)
    speed = np.linalg.norm(np.gradient(hand[:, POSITION], axis=0), axis=1) * FPS
    energy = np.clip(0.65 + low_pass(speed, 0.15) / 0.65, 0.65, 1.7)[:, None] * speaker.finger_life
    life = np.zeros((num_frames, SHAPE_SIZE))
    each_finger = smooth_noise(rng, num_frames, 6.0, 0.13, 4)
    flex = np.repeat(each_finger, 3, axis=1) * np.tile([1.0, 1.2, 0.6], 4)
    flex += smooth_noise(rng, num_frames, 4.0, 0.09, 12)
    flex += smooth_noise(rng, num_frames, 5.0, 0.3, 1)
    life[:, FLEX] = flex * energy
    life[:, ABDUCTION] = smooth_noise(rng, num_frames, 2.4, 0.16, 4) * energy
    life[:, THUMB] = smooth_noise(rng, num_frames, 5.0, 0.2, 3) * energy
    life[:, :] += smooth_noise(rng, num_frames, 0.35, 0.035, SHAPE_SIZE)
    return life


def _trail(
    arm: Arm,
    hand: Float[np.ndarray, "T C"],
    fore: Float[np.ndarray, "T 3 3"],
    direction: Float[np.ndarray, "T 3"],
) -> None:
    """Let wrist and fingers trail behind the hand's movement across its palm."""
    palm = fore @ np.array([0.0, -1.0, 0.0])
    pronation = np.radians(hand[:, PRONATION]) * arm.sign
    palm = Rotation.from_rotvec(direction * pronation[:, None]).apply(palm)
    velocity = np.gradient(hand[:, POSITION], axis=0) * FPS
    across = (velocity * palm).sum(axis=1)
    hand[:, WRIST_FLEX] -= 14 * gaussian_filter1d(across, 1.2)
    drag = np.clip(-10 * gaussian_filter1d(across, 1.5), -14, 14)
    hand[:, FINGERS.start : FINGERS.start + 12] += drag[:, None]


def _arm_rotations(
    arm: Arm,
    hand: Float[np.ndarray, "T C"],
    collar: Float[np.ndarray, "T 3 3"],
    upper: Float[np.ndarray, "T 3 3"],
    fore: Float[np.ndarray, "T 3 3"],
    speaker: Speaker,
    rng: np.random.Generator,
) -> dict[int, Float[np.ndarray, "T 3 3"]]:
    side, sign = arm.side, arm.sign
    along = unit(arm.fore)
    pronation = np.radians(hand[:, PRONATION]) * sign
    upper = _with_less_twist(arm, upper, SHOULDER_TWIST_SHARE)
    turned = fore @ about_axis(along, 0.48 * pronation)
    flex = np.radians(np.clip(hand[:, WRIST_FLEX], -60, 55))
    deviation = np.radians(np.clip(hand[:, DEVIATION], -20, 22))
    wrist = about_axis(along, 0.52 * pronation)
    wrist = wrist @ about_axis(np.array([0.0, 0.0, -sign]), flex)
    wrist = wrist @ about_axis(np.array([0.0, -sign, 0.0]), deviation)
    twist = smooth_noise(rng, len(hand), 2.4 * speaker.finger_life, 0.16, 12)
    return {
        JOINT[f"{side}_collar"]: collar,
        JOINT[f"{side}_shoulder"]: transposed(collar) @ upper,
        JOINT[f"{side}_elbow"]: transposed(upper) @ turned,
        JOINT[f"{side}_wrist"]: wrist,
        **finger_rotations(side, hand[:, FINGERS], twist),
    }


def _with_less_twist(
    arm: Arm, upper: Float[np.ndarray, "T 3 3"], share: float
) -> Float[np.ndarray, "T 3 3"]:
    """Keep ``share`` of the upper arm's twist against the hanging arm, as in fitted SMPL-X data."""
    direction = upper @ unit(arm.upper)
    hanging = hinge_frame(np.array([[0.15 * arm.sign, -1.0, -0.05]]), np.array([[-1.0, 0.0, 0.0]]))
    at_rest = hinge_frame(arm.upper[None], arm.hinge[None])
    reference = hanging[0] @ at_rest[0].T
    from_direction = reference @ unit(arm.upper)
    axis = np.cross(from_direction, direction)
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.arctan2(sine, (direction @ from_direction)[:, None])
    swing = Rotation.from_rotvec(axis / np.maximum(sine, 1e-9) * angle).as_matrix() @ reference
    twist = Rotation.from_matrix(upper @ transposed(swing)).as_rotvec()
    along = (twist * direction).sum(axis=1, keepdims=True)
    return Rotation.from_rotvec(direction * along * share).as_matrix() @ swing


def _trunk_push(point: Float[np.ndarray, "T 3"], sign: float) -> Float[np.ndarray, "T 3"]:
    """The offset that takes points out of the trunk, a superelliptic column about the spine."""
    low = np.clip(-point[:, 1] - 0.2, 0, 0.25)
    above = point[:, 1] > 0.1
    half_width = 0.175 + 0.6 * low
    half_depth = np.where(above, 0.10, 0.14 + 0.5 * low)
    x, z = point[:, 0], point[:, 2] - np.where(above, 0.03, 0.08)
    inside = (np.abs(x / half_width) ** 3 + np.abs(z / half_depth) ** 3) ** (1 / 3)
    scale = np.where(inside < 1, 1 / np.maximum(inside, 0.35) - 1, 0.0) * (point[:, 1] < 0.16)
    outwards = sign * np.maximum(sign * x, 0)
    return np.stack([outwards * scale, np.zeros_like(x), np.maximum(z, 0.05) * scale], axis=1)


def _within_reach(arm: Arm, hand: Float[np.ndarray, "T C"]) -> Float[np.ndarray, "T C"]:
    """Soft limits to the side, above and to the shoulder; the hand stays outside the trunk."""
    hand = hand.copy()
    out = _soft_ceiling(hand[:, 0] * arm.sign, 0.33, 0.07)
    hand[:, 0] = arm.sign * np.maximum(out, -0.05)
    hand[:, 1] = _soft_ceiling(hand[:, 1], 0.20, 0.07)
    # A raised hand keeps off the shoulder: the elbow would fold up and the arm spin.
    raised = minimum_jerk((hand[:, 1] + 0.05) / 0.15)
    nearest = 0.19 * raised - 1.0 * (1 - raised)
    hand[:, 2] = -_soft_ceiling(-hand[:, 2], -nearest - 0.04, 0.04)
    for _ in range(2):
        wrist = hand[:, POSITION]
        direction = solve_arm(arm, wrist, hand[:, ELBOW_OUT])[3]
        push = _trunk_push(wrist, arm.sign)
        for reach_m in (PALM_CENTRE_M, 2 * PALM_CENTRE_M):
            here = _trunk_push(wrist + reach_m * direction, arm.sign)
            further = np.abs(here).sum(1) > np.abs(push).sum(1)
            push = np.where(further[:, None], here, push)
        hand[:, POSITION] += gaussian_filter1d(push, 1.2, axis=0)
    return hand


def _keep_hands_apart(arms: dict[str, Arm], curves: dict[str, Float[np.ndarray, "T C"]]) -> None:
    """Move the hands sideways, smoothly, wherever their palms come within 15 cm of each other."""
    palms = {}
    for side in SIDES:
        hand = curves[side]
        direction = solve_arm(arms[side], hand[:, POSITION], hand[:, ELBOW_OUT])[3]
        palms[side] = hand[:, POSITION] + PALM_CENTRE_M * direction
    gap = palms["left"] - palms["right"]
    across = np.linalg.norm(gap[:, 1:] * [1.0, 0.8], axis=1)
    needed = np.sqrt(np.maximum(0.15**2 - across**2, 0.0))
    push = 0.5 * np.maximum(needed - gap[:, 0], 0.0)
    widest = np.maximum(gaussian_filter1d(push, 5.0), gaussian_filter1d(push, 2.0)) * 1.15
    push = gaussian_filter1d(widest, 2.0)
    curves["left"][:, 0] += push
    curves["right"][:, 0] -= push


def _soft_ceiling(value: np.ndarray, limit: np.ndarray | float, margin: float) -> np.ndarray:
    """The value, bent over smoothly above ``limit`` and never past ``limit + margin``."""
    over = np.maximum(value - limit, 0.0)
    return np.where(value > limit, limit + margin * np.tanh(over / margin), value)
