"""Soft limits to where hands may be."""

import numpy as np
from jaxtyping import Float

from tools.corpus.body.arm import Arm
from tools.corpus.body.signals import minimum_jerk


def within_reach(arm: Arm, hand: Float[np.ndarray, "T C"]) -> Float[np.ndarray, "T C"]:
    """Not too far to the side, not too high, not too near to the shoulder."""
    hand = hand.copy()
    out = _soft_ceiling(hand[:, 0] * arm.sign, 0.33, 0.07)
    hand[:, 0] = arm.sign * np.maximum(out, -0.05)
    hand[:, 1] = _soft_ceiling(hand[:, 1], 0.20, 0.07)
    # A raised hand keeps off the shoulder: the elbow would fold up and the arm spin.
    raised = minimum_jerk((hand[:, 1] + 0.05) / 0.15)
    nearest = 0.19 * raised - 1.0 * (1 - raised)
    hand[:, 2] = -_soft_ceiling(-hand[:, 2], -nearest - 0.04, 0.04)
    return hand


def _soft_ceiling(value: np.ndarray, limit: np.ndarray | float, margin: float) -> np.ndarray:
    """The value, bent over smoothly above ``limit`` and never past ``limit + margin``."""
    over = np.maximum(value - limit, 0.0)
    return np.where(value > limit, limit + margin * np.tanh(over / margin), value)
