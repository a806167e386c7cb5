"""Where hands may be: within reach, outside the trunk, apart from each other."""

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from model.corpus.arm import Arm, solve_arm
from model.corpus.channels import ELBOW_OUT, POSITION
from model.corpus.rig import SIDES
from model.corpus.signals import minimum_jerk

PALM_CENTRE_M = 0.085  # from the wrist along the forearm


def within_reach(arm: Arm, hand: Float[np.ndarray, "T C"]) -> Float[np.ndarray, "T C"]:
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


def keep_hands_apart(arms: dict[str, Arm], curves: dict[str, Float[np.ndarray, "T C"]]) -> None:
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


def _soft_ceiling(value: np.ndarray, limit: np.ndarray | float, margin: float) -> np.ndarray:
    """The value, bent over smoothly above ``limit`` and never past ``limit + margin``."""
    over = np.maximum(value - limit, 0.0)
    return np.where(value > limit, limit + margin * np.tanh(over / margin), value)
