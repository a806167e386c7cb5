"""What keeps hands alive: drift, a follow of the other hand, tremor, restless fingers, drag."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from conventions.rates import FPS
from tools.corpus.body.arm import Arm
from tools.corpus.body.signals import (
    DEVIATION,
    FINGERS,
    POSITION,
    PRONATION,
    WRIST_FLEX,
    low_pass,
    smooth_line,
    smooth_noise,
)
from tools.corpus.gesture.gestures import ABDUCTION, FLEX, SHAPE_SIZE, THUMB
from tools.corpus.people.rig import SIDES
from tools.corpus.people.speaker import Speaker


def add_life(
    arms: dict[str, Arm],
    curves: dict[str, Float[np.ndarray, "T C"]],
    share: Float[np.ndarray, " T"],
    speaker: Speaker,
    rng: np.random.Generator,
) -> None:
    """Drift that both hands share, drift of each, a follow of the other hand, and tremor.

    ``share`` of it is left in each frame.
    """
    num_frames = len(curves["left"])
    vigour = vigour_of(speaker)
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


def vigour_of(speaker: Speaker) -> float:
    """About 1; how much of a speaker's liveliness shows in wrists and fingers."""
    return ((speaker.energy + speaker.amplitude + speaker.sway) / 3) ** 2.5


def _finger_life(
    hand: Float[np.ndarray, "T C"], speaker: Speaker, rng: np.random.Generator
) -> Float[np.ndarray, "T 19"]:
    """Fingers that never stand still, together and one by one, livelier while the hand moves."""
    num_frames = len(hand)
    speed = np.linalg.norm(np.gradient(hand[:, POSITION], axis=0), axis=1) * FPS
    energy = np.clip(0.65 + low_pass(speed, 0.15) / 0.65, 0.65, 1.7)[:, None]
    energy *= speaker.finger_life * vigour_of(speaker) ** 0.25
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


def trailing(
    arm: Arm,
    hand: Float[np.ndarray, "T C"],
    fore: Float[np.ndarray, "T 3 3"],
    direction: Float[np.ndarray, "T 3"],
) -> Float[np.ndarray, "T C"]:
    """The curves with wrist and fingers that trail behind the hand and swing on when it stops."""
    hand = hand.copy()
    palm = fore @ np.array([0.0, -1.0, 0.0])
    pronation = np.radians(hand[:, PRONATION]) * arm.sign
    palm = Rotation.from_rotvec(direction * pronation[:, None]).apply(palm)
    velocity = np.gradient(hand[:, POSITION], axis=0) * FPS
    across = gaussian_filter1d((velocity * palm).sum(axis=1), 1.2)
    acceleration = np.gradient(velocity, axis=0) * FPS
    pull = _softly((acceleration * palm).sum(axis=1), 6.0)  # muscles stiffen when it gets rough
    hand[:, WRIST_FLEX] += WRIST_SWING.angle_deg(pull) - 9 * across
    drag = FINGER_SWING.angle_deg(pull) - _softly(6 * across, 10.0)
    hand[:, FINGERS.start : FINGERS.start + 12] += drag[:, None] * np.tile([1.0, 0.8, 0.5], 4)
    return hand


def _softly(value: Float[np.ndarray, " T"], limit: float) -> Float[np.ndarray, " T"]:
    return limit * np.tanh(value / limit)


@dataclass(frozen=True)
class Swing:
    """A limp part at the end of a moving one: a damped pendulum on a spring."""

    hz: float
    damping: float
    """Share of the critical damping."""
    lever_m: float

    def angle_deg(self, acceleration: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
        """Degrees by which the part lags behind its root, whose acceleration is in m/s^2."""
        time_s = np.arange(round(1.2 * FPS)) / FPS
        natural = 2 * np.pi * self.hz
        damped = natural * np.sqrt(1 - self.damping**2)
        answer = np.exp(-self.damping * natural * time_s) * np.sin(damped * time_s) / damped
        lag = np.convolve(acceleration, answer)[: len(acceleration)] / FPS
        return -np.degrees(lag / self.lever_m)


WRIST_SWING = Swing(hz=3.5, damping=0.5, lever_m=0.065)
FINGER_SWING = Swing(hz=4.5, damping=0.5, lever_m=0.05)
