"""From a plan's keys to collar, shoulder, elbow, wrist and finger rotations.

Moves are minimum-jerk and superposed, so that one may begin before the last has ended. The arm is
solved in the chest's frame by analytic two-bone inverse kinematics.
"""

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from conventions.joints import JOINT_INDEX
from model.motion.limb import unit
from tools.corpus.body.arm import (
    Arm,
    arm_of,
    forearm_and_wrist,
    pronation_for,
    solve_arm,
    with_less_twist,
    within_reach,
)
from tools.corpus.body.contact import Hips, hand_balls, push_apart, push_off_trunk
from tools.corpus.body.hand_life import add_life, trailing
from tools.corpus.body.signals import (
    ELBOW_OUT,
    FINGERS,
    NUM_CHANNELS,
    POSITION,
    WRIST_FLEX,
    bump,
    frame_times,
    low_pass,
    minimum_jerk,
    smooth_noise,
)
from tools.corpus.gesture.gestures import finger_rotations
from tools.corpus.gesture.plan import CycleSpan, HandKey, HandPlan
from tools.corpus.people.rig import SIDES, Rig, transposed
from tools.corpus.people.speaker import Speaker

SHOULDER_TWIST_SHARE = 0.3  # of the humeral twist; the elbow joint takes the rest
STILL = 0.85  # of the hands' own life is gone while the speaker listens
_CONTACT_ROUNDS = 2
_MAX_OFF_WAY_M = 0.017  # of a wrist from one frame to the next, against the step before
_SOFTENING_ROUNDS = 12
_HAND_DELAY_S = np.concatenate(
    [
        [0.0, 0.0, 0.0, 0.03, 0.03, 0.03, 0.0],
        np.repeat([0.02, 0.035, 0.05, 0.065], 3) + np.tile([0.0, 0.015, 0.03], 4),
        [0.02, 0.02, 0.03, 0.04],
        [0.02, 0.02, 0.03],
    ]
)
# per second, of a minimum-jerk move; wrist and fingers take longer rather than snap
_TOP_SPEED = np.concatenate([np.full(3, np.inf), [360.0, 280.0, 150.0, 5.0], np.full(19, 400.0)])


def follow_plan(
    rig: Rig,
    plan: HandPlan,
    calm: Float[np.ndarray, " T"],
    speaker: Speaker,
    rng: np.random.Generator,
) -> dict[str, Float[np.ndarray, "T C"]]:
    """The curves of both hands, by side, as the plan and the hands' own life have them.

    Where the body is ``calm`` (1; 0 while it speaks), hands have hardly any life of their own.
    """
    time_s = frame_times(len(calm))
    arms = {side: arm_of(rig, side) for side in SIDES}
    curves = {side: _follow_keys(arms[side], plan.keys[side], time_s, rng) for side in SIDES}
    for span in plan.cycles:
        _add_cycle(curves[span.side], span, time_s)
    add_life(arms, curves, 1.0 - STILL * calm, speaker, rng)
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
    """Local rotations of both arms and hands; the hands keep off the trunk and off each other."""
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
        apart = push_apart(balls["left"], balls["right"], radii)
        hands["left"][:, 0] += apart
        hands["right"][:, 0] -= apart
    for side in SIDES:
        movers[side].soften_steps(hands[side])
    return movers["left"].rotations(hands["left"]) | movers["right"].rotations(hands["right"])


class _ArmMover:
    """Turns one hand's curves into joint rotations, with noise drawn once."""

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
        """The curves with wrist and fingers that trail behind the hand."""
        _, _, fore, direction = self._solve(hand)
        return trailing(self._arm, hand, fore, direction)

    def balls(
        self, hand: Float[np.ndarray, "T C"]
    ) -> tuple[Float[np.ndarray, "T P 3"], Float[np.ndarray, " P"]]:
        """The balls of the hand in the chest's frame."""
        collar, upper, fore, direction = self._solve(hand)
        elbow = self._arm.collar + collar @ self._arm.shoulder + upper @ self._arm.upper
        wrist = elbow + np.linalg.norm(self._arm.fore) * direction
        turned, wrist_rot = forearm_and_wrist(self._arm, hand, fore)
        fingers = finger_rotations(self._arm.side, hand[:, FINGERS], self._twist)
        return hand_balls(self._rig, self._arm.side, fingers, turned @ wrist_rot, wrist)

    def soften_steps(self, hand: Float[np.ndarray, "T C"]) -> None:
        """Smooth the path where the wrist would be jerked off its way from one frame to the next.

        A fold of the arm near the shoulder can do so, or moves that overlap.
        """
        for _ in range(_SOFTENING_ROUNDS):
            off_way = np.linalg.norm(np.diff(self._wrist(hand), 2, axis=0), axis=1)
            jerked = np.pad(off_way > _MAX_OFF_WAY_M, 1).astype(float)
            if not jerked.any():
                return
            share = gaussian_filter1d(maximum_filter1d(jerked, 9), 3.0)[:, None]
            position = hand[:, POSITION]
            hand[:, POSITION] += share * (low_pass(position, 0.06) - position)

    def _wrist(self, hand: Float[np.ndarray, "T C"]) -> Float[np.ndarray, "T 3"]:
        """The wrist's place in the chest's frame."""
        collar, upper, _, direction = self._solve(hand)
        elbow = self._arm.collar + collar @ self._arm.shoulder + upper @ self._arm.upper
        return elbow + np.linalg.norm(self._arm.fore) * direction

    def rotations(self, hand: Float[np.ndarray, "T C"]) -> dict[int, Float[np.ndarray, "T 3 3"]]:
        """Local rotations of collar, shoulder, elbow, wrist and fingers."""
        side = self._arm.side
        collar, upper, fore, _ = self._solve(hand)
        upper = with_less_twist(self._arm, upper, SHOULDER_TWIST_SHARE)
        turned, wrist_rot = forearm_and_wrist(self._arm, hand, fore)
        return {
            JOINT_INDEX[f"{side}_collar"]: collar,
            JOINT_INDEX[f"{side}_shoulder"]: transposed(collar) @ upper,
            JOINT_INDEX[f"{side}_elbow"]: transposed(upper) @ turned,
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
    """Superposed minimum-jerk moves on slightly bent paths; fingers follow from index to pinky."""
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
