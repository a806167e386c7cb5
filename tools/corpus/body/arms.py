"""Collar, shoulder, elbow, wrist and finger rotations from the keys of a plan.

Moves are minimum-jerk and superposed, so that one may begin before the last has ended. The arm is
solved in the chest's frame by analytic two-bone inverse kinematics, from a wrist position to
collar, upper arm and forearm. Drift, coupling to the other hand, tremor, finger movements and drag
add natural variation.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.motion.two_bone_ik import hinge_frame, rotations_about_axis, unit
from tools.corpus.body.contact import Hips, hand_balls, push_off_trunk, separate_hands
from tools.corpus.body.signals import (
    DEVIATION,
    ELBOW_OUT,
    FINGERS,
    NUM_CHANNELS,
    POSITION,
    PRONATION,
    WRIST_FLEX,
    bump,
    frame_times,
    low_pass,
    minimum_jerk,
    smooth_line,
    smooth_noise,
)
from tools.corpus.gesture.gestures import ABDUCTION, FLEX, SHAPE_SIZE, THUMB, finger_rotations
from tools.corpus.gesture.plan import CycleSpan, HandKey, HandPlan
from tools.corpus.people.rig import SIDE_SIGN, SIDES, Rig, euler_matrices
from tools.corpus.people.speaker import Speaker

SHOULDER_TWIST_SHARE = 0.3  # share of the humeral twist; the elbow joint takes the rest
STILL = 0.85  # share of the hands' variation removed while the speaker listens
_CONTACT_ROUNDS = 2
_MAX_OFF_WAY_M = 0.017  # largest change of a wrist's step from one frame to the next
_SOFTENING_ROUNDS = 12
_HAND_DELAY_S = np.concatenate(
    [
        [0.0, 0.0, 0.0, 0.03, 0.03, 0.03, 0.0],
        np.repeat([0.02, 0.035, 0.05, 0.065], 3) + np.tile([0.0, 0.015, 0.03], 4),
        [0.02, 0.02, 0.03, 0.04],
        [0.02, 0.02, 0.03],
    ]
)
# Per second, of a minimum-jerk move; wrist and finger moves are slowed down rather than snap.
_TOP_SPEED = np.concatenate([np.full(3, np.inf), [360.0, 280.0, 150.0, 5.0], np.full(19, 400.0)])
UPPER_ARM_LAG_S = 0.08


def two_bone_ik(
    root: Float[np.ndarray, "T 3"],
    target: Float[np.ndarray, "T 3"],
    upper: Float[np.ndarray, " 3"],
    lower: Float[np.ndarray, " 3"],
    hinge: Float[np.ndarray, " 3"],
    pole: Float[np.ndarray, "T 3"],
) -> tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3"]]:
    """Compute the rotations of two bones that bring the lower bone's end to a target.

    A target near or past full stretch is approached softly, so that the middle joint never snaps.

    Args:
        root: start of the upper bone.
        target: position for the end of the lower bone.
        pole: direction of the middle joint from the line between root and target.

    Returns:
        The upper bone's rotation, the lower bone's rotation, the lower bone's unit direction.
    """
    a, b = np.linalg.norm(upper), np.linalg.norm(lower)
    reach = target - root
    distance = np.linalg.norm(reach, axis=-1, keepdims=True)
    limit = 0.985 * (a + b)
    soft = limit - 0.06 * (a + b)
    bent = soft + (limit - soft) * (1 - np.exp(-(distance - soft) / (limit - soft)))
    distance = np.maximum(np.where(distance > soft, bent, distance), abs(a - b) + 0.05)
    towards = unit(reach)
    along = (a * a - b * b + distance**2) / (2 * distance)
    height = np.sqrt(np.maximum(a * a - along**2, 1e-8))
    aside = unit(pole - (pole * towards).sum(-1, keepdims=True) * towards)
    middle = towards * along + aside * height
    upper_direction = unit(middle)
    lower_direction = unit(towards * distance - middle)
    upper_rot, lower_rot = bone_rotations(upper_direction, lower_direction, upper, lower, hinge)
    return upper_rot, lower_rot, lower_direction


def bone_rotations(
    upper_direction: Float[np.ndarray, "T 3"],
    lower_direction: Float[np.ndarray, "T 3"],
    upper: Float[np.ndarray, " 3"],
    lower: Float[np.ndarray, " 3"],
    hinge: Float[np.ndarray, " 3"],
) -> tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3 3"]]:
    """Return the rotations of two bones to these directions, with the hinge normal to both."""
    axis = unit(np.cross(upper_direction, lower_direction))
    upper_rest = hinge_frame(upper[None], hinge[None])[0]
    lower_rest = hinge_frame(lower[None], hinge[None])[0]
    upper_rot = hinge_frame(upper_direction, axis) @ upper_rest.T
    return upper_rot, hinge_frame(lower_direction, axis) @ lower_rest.T


@dataclass(frozen=True)
class Arm:
    """Bones of one arm in the chest's frame at rest (m)."""

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
    """Return an arm's bones; the collar is measured from the chest joint."""
    return Arm(
        side,
        rig.rest_joints[JOINT_INDEX[f"{side}_collar"]] - rig.rest_joints[JOINT_INDEX["spine3"]],
        rig.offsets[JOINT_INDEX[f"{side}_shoulder"]],
        rig.offsets[JOINT_INDEX[f"{side}_elbow"]],
        rig.offsets[JOINT_INDEX[f"{side}_wrist"]],
    )


def solve_arm(
    arm: Arm,
    position: Float[np.ndarray, "T 3"],
    elbow_out: Float[np.ndarray, " T"],
    shrug: Float[np.ndarray, " T"] | float = 0.0,
    shake_deg: Float[np.ndarray, "T 3"] | float = 0.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Compute collar, upper arm and forearm rotations in the chest's frame, and the forearm axis.

    The upper arm follows the wrist with a low-pass filter: strokes are led by the forearm, which
    points at the wrist's position from the current elbow.
    """
    sign = arm.sign
    height, ahead = position[:, 1], position[:, 2]
    out = sign * position[:, 0]
    raised = np.clip((height + 0.36) / 0.36, 0, 2.2)
    lift = -19 + 11 * raised + 4 * np.maximum(raised - 1, 0) ** 1.3 + 12 * shrug
    protract = 9 + 14 * np.clip((ahead - 0.22) / 0.2, -1, 1)
    protract -= 4 * np.clip((out - 0.2) / 0.2, 0, 1.5)
    roll = 2 + 9 * np.clip(height + 0.15, -0.2, 0.3) / 0.3
    angles = np.stack([protract, lift, roll], axis=1) + shake_deg
    collar = euler_matrices("YZX", angles * [-sign, sign, 1.0])
    root = arm.collar + collar @ arm.shoulder
    high = np.clip(height + 0.05, 0, 0.4) / 0.3
    crossing = 0.3 * np.clip((0.10 - out) / 0.1, 0, 1)
    aside = sign * (0.22 + elbow_out + 0.05 * high + crossing)
    pole = np.stack([aside, -np.ones(len(position)), -0.42 + 0.25 * high], axis=1)
    upper, _, _ = two_bone_ik(root, position, arm.upper, arm.fore, arm.hinge, pole)
    towards_elbow = unit(low_pass(upper @ unit(arm.upper), UPPER_ARM_LAG_S))
    elbow = root + np.linalg.norm(arm.upper) * towards_elbow
    direction = unit(position - elbow)
    upper, fore = bone_rotations(towards_elbow, direction, arm.upper, arm.fore, arm.hinge)
    return collar, upper, fore, direction


def pronation_for(
    arm: Arm,
    fore: Float[np.ndarray, "T 3 3"],
    direction: Float[np.ndarray, "T 3"],
    palm: Float[np.ndarray, "T 3"],
) -> Float[np.ndarray, " T"]:
    """Compute the pronation (degrees) that turns the palm to ``palm``, within the joint's range."""
    start = fore @ np.array([0.0, -1.0, 0.0])
    start = unit(start - (start * direction).sum(-1, keepdims=True) * direction)
    goal = unit(palm - (palm * direction).sum(-1, keepdims=True) * direction)
    sine = (np.cross(start, goal) * direction).sum(-1)
    angle = np.degrees(np.arctan2(sine, (start * goal).sum(-1))) * arm.sign
    return np.clip(np.where(angle > 150, angle - 360, angle), -95, 85)


def forearm_and_wrist(
    arm: Arm, hand: Float[np.ndarray, "T C"], fore: Float[np.ndarray, "T 3 3"]
) -> tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3 3"]]:
    """Return the forearm with its share of the pronation, and the wrist's local rotation."""
    along = unit(arm.fore)
    pronation = np.radians(hand[:, PRONATION]) * arm.sign
    flex = np.radians(np.clip(hand[:, WRIST_FLEX], -60, 55))
    deviation = np.radians(np.clip(hand[:, DEVIATION], -20, 22))
    wrist = rotations_about_axis(along, 0.52 * pronation)
    wrist = wrist @ rotations_about_axis(np.array([0.0, 0.0, -arm.sign]), flex)
    wrist = wrist @ rotations_about_axis(np.array([0.0, -arm.sign, 0.0]), deviation)
    return fore @ rotations_about_axis(along, 0.48 * pronation), wrist


def with_less_twist(
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
    twist = Rotation.from_matrix(upper @ swing.mT).as_rotvec()
    along = (twist * direction).sum(axis=1, keepdims=True)
    return Rotation.from_rotvec(direction * along * share).as_matrix() @ swing


def within_reach(arm: Arm, hand: Float[np.ndarray, "T C"]) -> Float[np.ndarray, "T C"]:
    """Limit the wrist's position smoothly: not too far out, too high or too near the shoulder."""
    hand = hand.copy()
    out = _soft_ceiling(hand[:, 0] * arm.sign, 0.33, 0.07)
    hand[:, 0] = arm.sign * np.maximum(out, -0.05)
    hand[:, 1] = _soft_ceiling(hand[:, 1], 0.20, 0.07)
    # A raised hand stays away from the shoulder: the elbow would fold up and the arm spin.
    raised = minimum_jerk((hand[:, 1] + 0.05) / 0.15)
    nearest = 0.19 * raised - 1.0 * (1 - raised)
    hand[:, 2] = -_soft_ceiling(-hand[:, 2], -nearest - 0.04, 0.04)
    return hand


def _soft_ceiling(
    value: Float[np.ndarray, " ..."], limit: Float[np.ndarray, " ..."] | float, margin: float
) -> np.ndarray:
    """Bend values smoothly above ``limit``, never past ``limit + margin``."""
    over = np.maximum(value - limit, 0.0)
    return np.where(value > limit, limit + margin * np.tanh(over / margin), value)


def add_idle_motion(
    arms: dict[str, Arm],
    curves: dict[str, Float[np.ndarray, "T C"]],
    share: Float[np.ndarray, " T"],
    speaker: Speaker,
    rng: np.random.Generator,
) -> None:
    """Add drift of both hands and of each, coupling and tremor, scaled by ``share`` per frame."""
    num_frames = len(curves["left"])
    vigour = hand_vigour(speaker)
    common = smooth_noise(rng, num_frames, 0.008, 0.4, 3)
    common += smooth_noise(rng, num_frames, 0.0055 * speaker.amplitude, 0.16, 3)
    velocity = {side: np.gradient(curves[side][:, POSITION], axis=0) for side in SIDES}
    for side, other in zip(SIDES, reversed(SIDES), strict=True):
        hand = curves[side]
        followed = np.cumsum(velocity[other] * [-0.1, 0.1, 0.1], axis=0)
        followed = gaussian_filter1d(followed - gaussian_filter1d(followed, 25, axis=0), 2, axis=0)
        life = np.zeros_like(hand)
        life[:, POSITION] += common * [arms[side].sign, 1, 1] + followed
        life[:, POSITION] += smooth_noise(rng, num_frames, 0.008, 0.25, 3)
        life[:, POSITION] += smooth_noise(rng, num_frames, 0.016, 0.9, 3)
        life[:, PRONATION] += smooth_line(rng, num_frames, 6.0, 0.4)
        life[:, PRONATION] += smooth_line(rng, num_frames, 3.2 * vigour, 0.13)
        life[:, WRIST_FLEX] += smooth_line(rng, num_frames, 4.5, 0.25)
        life[:, WRIST_FLEX] += smooth_line(rng, num_frames, 4.0 * vigour, 0.115)
        life[:, DEVIATION] += smooth_line(rng, num_frames, 3.5, 0.3)
        life[:, PRONATION : DEVIATION + 1] += smooth_noise(rng, num_frames, 0.3, 0.035, 3)
        life[:, FINGERS] += _finger_life(hand, speaker, rng)
        hand += share[:, None] * life


def hand_vigour(speaker: Speaker) -> float:
    """Return a factor of about 1 for the liveliness of a speaker's wrists and fingers."""
    return ((speaker.energy + speaker.amplitude + speaker.sway) / 3) ** 2.5


def _finger_life(
    hand: Float[np.ndarray, "T C"], speaker: Speaker, rng: np.random.Generator
) -> Float[np.ndarray, "T 19"]:
    """Make finger movements, together and one by one, stronger while the hand moves."""
    num_frames = len(hand)
    speed = np.linalg.norm(np.gradient(hand[:, POSITION], axis=0), axis=1) * FPS
    energy = np.clip(0.65 + low_pass(speed, 0.15) / 0.65, 0.65, 1.7)[:, None]
    energy *= speaker.finger_life * hand_vigour(speaker) ** 0.25
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


def follow_through(
    arm: Arm,
    hand: Float[np.ndarray, "T C"],
    fore: Float[np.ndarray, "T 3 3"],
    direction: Float[np.ndarray, "T 3"],
) -> Float[np.ndarray, "T C"]:
    """Return the curves with wrist and fingers that lag behind the hand and swing on at stops."""
    hand = hand.copy()
    palm = fore @ np.array([0.0, -1.0, 0.0])
    pronation = np.radians(hand[:, PRONATION]) * arm.sign
    palm = Rotation.from_rotvec(direction * pronation[:, None]).apply(palm)
    velocity = np.gradient(hand[:, POSITION], axis=0) * FPS
    across = gaussian_filter1d((velocity * palm).sum(axis=1), 1.2)
    acceleration = np.gradient(velocity, axis=0) * FPS
    pull = _softly((acceleration * palm).sum(axis=1), 6.0)  # muscles stiffen at high acceleration
    hand[:, WRIST_FLEX] += WRIST_SWING.angle_deg(pull) - 9 * across
    drag = FINGER_SWING.angle_deg(pull) - _softly(6 * across, 10.0)
    hand[:, FINGERS.start : FINGERS.start + 12] += drag[:, None] * np.tile([1.0, 0.8, 0.5], 4)
    return hand


def _softly(value: Float[np.ndarray, " T"], limit: float) -> Float[np.ndarray, " T"]:
    return limit * np.tanh(value / limit)


@dataclass(frozen=True)
class Swing:
    """Damped pendulum on a spring: a limp part at the end of a moving one."""

    hz: float
    damping: float
    """Damping as a share of the critical damping."""
    lever_m: float

    def angle_deg(self, acceleration: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
        """Compute the angle (degrees) of the part behind its root from its acceleration (m/s^2)."""
        time_s = np.arange(round(1.2 * FPS)) / FPS
        natural = 2 * np.pi * self.hz
        damped = natural * np.sqrt(1 - self.damping**2)
        answer = np.exp(-self.damping * natural * time_s) * np.sin(damped * time_s) / damped
        lag = np.convolve(acceleration, answer)[: len(acceleration)] / FPS
        return -np.degrees(lag / self.lever_m)


WRIST_SWING = Swing(hz=3.5, damping=0.5, lever_m=0.065)
FINGER_SWING = Swing(hz=4.5, damping=0.5, lever_m=0.05)


def follow_plan(
    rig: Rig,
    plan: HandPlan,
    calm: Float[np.ndarray, " T"],
    speaker: Speaker,
    rng: np.random.Generator,
) -> dict[str, Float[np.ndarray, "T C"]]:
    """Return both hands' curves by side: the plan's keys, and variation, less where ``calm``."""
    time_s = frame_times(len(calm))
    arms = {side: arm_of(rig, side) for side in SIDES}
    curves = {side: _follow_keys(arms[side], plan.keys[side], time_s, rng) for side in SIDES}
    for span in plan.cycles:
        _add_cycle(curves[span.side], span, time_s)
    add_idle_motion(arms, curves, 1.0 - STILL * calm, speaker, rng)
    return {side: within_reach(arms[side], curves[side]) for side in SIDES}


def move_arms(
    rig: Rig,
    plan: HandPlan,
    curves: dict[str, Float[np.ndarray, "T C"]],
    hips: Hips,
    calm: Float[np.ndarray, " T"],
    speaker: Speaker,
    rng: np.random.Generator,
) -> dict[int, Float[np.ndarray, "T 3 3"]]:
    """Compute local rotations of arms and hands, with hands apart and off the trunk."""
    num_frames = len(curves["left"])
    time_s = frame_times(num_frames)
    shrug = np.zeros(num_frames)
    for start_s, end_s in plan.shrugs:
        shrug += minimum_jerk((time_s - start_s + 0.35) / 0.4)
        shrug -= minimum_jerk((time_s - end_s) / 0.55)
    movers = {side: _ArmMover(rig, side, shrug, 1.0 - STILL * calm, speaker, rng) for side in SIDES}
    hands = {side: movers[side].trailing(curves[side]) for side in SIDES}
    for _ in range(_CONTACT_ROUNDS):
        balls = {}
        for side in SIDES:
            centres, radii = movers[side].balls(hands[side])
            push = push_off_trunk(centres, radii, side, hips)
            hands[side][:, POSITION] += push
            balls[side] = centres + push[:, None]
        apart = separate_hands(balls["left"], balls["right"], radii)
        hands["left"][:, 0] += apart
        hands["right"][:, 0] -= apart
    for side in SIDES:
        movers[side].soften_steps(hands[side])
    return movers["left"].rotations(hands["left"]) | movers["right"].rotations(hands["right"])


class _ArmMover:
    """Converter of one hand's curves to joint rotations, with noise drawn once."""

    def __init__(
        self,
        rig: Rig,
        side: str,
        shrug: Float[np.ndarray, " T"],
        life: Float[np.ndarray, " T"],
        speaker: Speaker,
        rng: np.random.Generator,
    ):
        num_frames = len(shrug)
        self._rig = rig
        self._arm = arm_of(rig, side)
        self._shrug = shrug
        self._shake = smooth_noise(rng, num_frames, 1.8 * speaker.sway, 0.18, 3) * [1, 1, 0.7]
        self._shake += smooth_noise(rng, num_frames, 2.2, 0.7, 3)
        self._shake *= life[:, None]
        self._twist = smooth_noise(rng, num_frames, 2.4 * speaker.finger_life, 0.16, 12)
        self._twist *= life[:, None]

    def trailing(self, hand: Float[np.ndarray, "T C"]) -> Float[np.ndarray, "T C"]:
        """Return the curves with wrist and fingers that lag behind the hand."""
        _, _, fore, direction = self._solve(hand)
        return follow_through(self._arm, hand, fore, direction)

    def balls(
        self, hand: Float[np.ndarray, "T C"]
    ) -> tuple[Float[np.ndarray, "T P 3"], Float[np.ndarray, " P"]]:
        """Return the collision spheres of the hand in the chest's frame."""
        collar, upper, fore, direction = self._solve(hand)
        elbow = self._arm.collar + collar @ self._arm.shoulder + upper @ self._arm.upper
        wrist = elbow + np.linalg.norm(self._arm.fore) * direction
        turned, wrist_rot = forearm_and_wrist(self._arm, hand, fore)
        fingers = finger_rotations(self._arm.side, hand[:, FINGERS], self._twist)
        return hand_balls(self._rig, self._arm.side, fingers, turned @ wrist_rot, wrist)

    def soften_steps(self, hand: Float[np.ndarray, "T C"]) -> None:
        """Smooth the path where the wrist would jerk, as with a folded arm or overlapping moves."""
        for _ in range(_SOFTENING_ROUNDS):
            off_way = np.linalg.norm(np.diff(self._wrist(hand), 2, axis=0), axis=1)
            jerked = np.pad(off_way > _MAX_OFF_WAY_M, 1).astype(float)
            if not jerked.any():
                return
            share = gaussian_filter1d(maximum_filter1d(jerked, 9), 3.0)[:, None]
            position = hand[:, POSITION]
            hand[:, POSITION] += share * (low_pass(position, 0.06) - position)

    def _wrist(self, hand: Float[np.ndarray, "T C"]) -> Float[np.ndarray, "T 3"]:
        """Return the wrist's position in the chest's frame."""
        collar, upper, _, direction = self._solve(hand)
        elbow = self._arm.collar + collar @ self._arm.shoulder + upper @ self._arm.upper
        return elbow + np.linalg.norm(self._arm.fore) * direction

    def rotations(self, hand: Float[np.ndarray, "T C"]) -> dict[int, Float[np.ndarray, "T 3 3"]]:
        """Return the local rotations of collar, shoulder, elbow, wrist and fingers."""
        side = self._arm.side
        collar, upper, fore, _ = self._solve(hand)
        upper = with_less_twist(self._arm, upper, SHOULDER_TWIST_SHARE)
        turned, wrist_rot = forearm_and_wrist(self._arm, hand, fore)
        return {
            JOINT_INDEX[f"{side}_collar"]: collar,
            JOINT_INDEX[f"{side}_shoulder"]: collar.mT @ upper,
            JOINT_INDEX[f"{side}_elbow"]: upper.mT @ turned,
            JOINT_INDEX[f"{side}_wrist"]: wrist_rot,
            **finger_rotations(side, hand[:, FINGERS], self._twist),
        }

    def _solve(self, hand: Float[np.ndarray, "T C"]) -> tuple[np.ndarray, ...]:
        return solve_arm(self._arm, hand[:, POSITION], hand[:, ELBOW_OUT], self._shrug, self._shake)


def _key_channels(arm: Arm, key: HandKey) -> Float[np.ndarray, " C"]:
    mirror = np.array([arm.sign, 1.0, 1.0])
    position = key.pose.position * mirror
    elbow = np.array([key.pose.elbow_out])
    _, _, fore, direction = solve_arm(arm, position[None], elbow)
    pronation = pronation_for(arm, fore, direction, unit(key.pose.palm * mirror)[None])[0]
    flex = np.clip(key.pose.flex_deg, -58, 52)
    hand = [pronation, flex, key.pose.deviation_deg, key.pose.elbow_out]
    return np.concatenate([position, hand, key.pose.fingers])


def _follow_keys(
    arm: Arm, keys: list[HandKey], time_s: Float[np.ndarray, " T"], rng: np.random.Generator
) -> Float[np.ndarray, "T C"]:
    """Superpose minimum-jerk moves on slightly bent paths; fingers follow from index to pinky."""
    targets = [_key_channels(arm, key) for key in keys]
    curves = np.tile(targets[0], (len(time_s), 1))
    span_share = np.where(np.arange(NUM_CHANNELS) < 7, 1.0, 0.85)
    for before, after, key in zip(targets[:-1], targets[1:], keys[1:], strict=True):
        step = after - before
        wanted_s = key.duration_s * span_share
        spans_s = np.maximum(wanted_s, 1.875 * np.abs(step) / _TOP_SPEED)
        starts_s = key.arrive_s - key.duration_s - 0.5 * (spans_s - wanted_s)
        first = int(np.searchsorted(time_s, starts_s.min()))
        phase = (time_s[first:, None] - starts_s - _HAND_DELAY_S) / spans_s
        curves[first:] += step * minimum_jerk(phase)
        line = unit(step[POSITION])
        aside = rng.normal(size=3) * 0.7 + [0.45 * arm.sign, 0.4, 0.25]
        aside = unit(aside - (aside @ line) * line)
        bow = rng.uniform(0.08, 0.24) * np.linalg.norm(step[POSITION])
        curves[first:, POSITION] += bow * aside * bump(phase[:, POSITION])
    return curves


def _add_cycle(
    curves: Float[np.ndarray, "T C"], span: CycleSpan, time_s: Float[np.ndarray, " T"]
) -> None:
    envelope = minimum_jerk((time_s - span.start_s + 0.15) / 0.35)
    envelope *= 1 - minimum_jerk((time_s - span.end_s + 0.1) / 0.4)
    angle = 2 * np.pi * span.hz * (time_s - span.start_s) + span.phase_rad
    curves[:, 1] += envelope * span.vertical_m * np.sin(angle)
    curves[:, 2] += envelope * span.forward_m * np.cos(angle)
    curves[:, WRIST_FLEX] += envelope * 8 * np.sin(angle - 0.6)
    curves[:, FINGERS.start : FINGERS.start + 12] += (envelope * 5 * np.sin(angle - 1.0))[:, None]
