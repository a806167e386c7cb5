"""Metrics of the face: blinks, brow movement, jaw and loudness, and movement with the hands."""

import numpy as np
import torch
from jaxtyping import Float, Num

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.motion.kinematics import blendshape_names
from model.motion.motion import Motion
from model.motion.rotations import axis_angle_from_matrix, matrix_from_axis_angle

BLINK_CLOSED, BLINK_OPEN = 0.5, 0.3
"""Lid values (0 open to 1 closed) above which a blink begins, and below which it ends."""


def blendshape_columns(name: str) -> tuple[int, ...]:
    """Return the columns of a blendshape on both sides, in the order of `blendshape_names`."""
    return tuple(k for k, unit in enumerate(blendshape_names()) if unit.startswith(name))


def face_measures(motion: Motion, loudness: Float[np.ndarray, " T"]) -> dict[str, float]:
    """Compute blinks per minute, brow movement, and the correlation of jaw and loudness.

    ``blinks_per_min``; ``brow_std``: standard deviation of the inner brow raise (0 to 1);
    ``jaw_loudness``: correlation of the jaw angle with the loudness of the speech, 0 for a jaw that
    does not move. A motion with FLAME coefficients has the last only.
    """
    frames = min(motion.num_frames, len(loudness))
    jaw = np.linalg.norm(motion.poses[:frames, 3 * JOINT_INDEX["jaw"] :][:, :3], axis=1)
    measures = {"jaw_loudness": correlation(jaw, loudness[:frames])}
    if motion.expression_basis == "arkit52":
        lids = motion.expressions[:, blendshape_columns("eyeBlink")].mean(1)
        brow = motion.expressions[:, blendshape_columns("browInnerUp")].mean(1)
        measures["blinks_per_min"] = 60 * count_blinks(lids) / motion.duration_s
        measures["brow_std"] = float(brow.std())
    return measures


def count_blinks(lids: Float[np.ndarray, " T"]) -> int:
    """Count the blinks in lid closures from 0 (open) to 1 (closed)."""
    is_closed, count = False, 0
    for value in lids:
        if not is_closed and value > BLINK_CLOSED:
            is_closed, count = True, count + 1
        elif is_closed and value < BLINK_OPEN:
            is_closed = False
    return count


MAX_LAG_S = 0.5
SMOOTHING_FRAMES = 9


def max_correlation_over_lags(a: Float[np.ndarray, " N"], b: Float[np.ndarray, " M"]) -> float:
    """Compute the highest correlation over lags of up to 0.5 s, after smoothing over 0.3 s.

    Choosing the lag raises it above 0 for any two signals: compare with a shifted one.
    """
    frames = min(len(a), len(b))
    box = np.ones(SMOOTHING_FRAMES) / SMOOTHING_FRAMES
    a, b = (np.convolve(track[:frames], box, "valid") for track in (a, b))
    lags = range(-round(MAX_LAG_S * FPS), round(MAX_LAG_S * FPS) + 1)
    return max(correlation(a, b, lag) for lag in lags)


def correlation(a: Num[np.ndarray, " T"], b: Num[np.ndarray, " T"], lag: int = 0) -> float:
    """Compute the correlation of ``a`` with ``b`` ``lag`` frames before; 0 if one is constant."""
    a, b = (a[lag:], b[: len(b) - lag]) if lag >= 0 else (a[:lag], b[-lag:])
    if len(a) < 2 or min(a.std(), b.std()) < 1e-12:
        return 0.0
    return float(np.corrcoef(a, b)[0, 1])


SHIFT_S = 4.0
"""Circular shift of a track (s) for the chance level of a correlation."""
_WRISTS = [JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"]]


def face_hand_correlation_above_chance(
    motion: Motion, joints: Float[np.ndarray, "T 55 3"]
) -> dict[str, float]:
    """Compute ``brow_with_hands`` and ``head_with_hands``, correlations beyond chance.

    They correlate the inner brow raise, and the head's angular speed, with the speed of the wrists,
    less the correlation of the same face shifted by 4 s in a circle. Above 0: they move together
    more than by chance. A motion with FLAME coefficients has no brow value, one under 8 s neither.
    """
    if motion.num_frames < 2 * SHIFT_S * FPS:
        return {}
    hands = wrist_speed_sum(joints)
    measures = {
        "head_with_hands": _correlation_above_chance(head_chest_angular_speed_rad_s(motion), hands)
    }
    if motion.expression_basis == "arkit52":
        brow = motion.expressions[1:, blendshape_columns("browInnerUp")].mean(1)
        measures["brow_with_hands"] = _correlation_above_chance(brow, hands)
    return measures


def wrist_speed_sum(joints: Float[np.ndarray, "T 55 3"]) -> Float[np.ndarray, " T1"]:
    """Compute the sum of both wrists' speeds (m/s), from each frame to the next."""
    return np.linalg.norm(np.diff(joints[:, _WRISTS], axis=0), axis=-1).sum(-1) * FPS


def head_chest_angular_speed_rad_s(motion: Motion) -> Float[np.ndarray, " T1"]:
    """Compute the head's angular speed against the chest (rad/s), from each frame to the next."""
    poses = torch.from_numpy(motion.poses).unflatten(-1, (-1, 3))
    neck, head = (matrix_from_axis_angle(poses[:, JOINT_INDEX[n]]) for n in ("neck", "head"))
    turned = neck @ head
    steps = axis_angle_from_matrix(turned[:-1].mT @ turned[1:])
    return steps.norm(dim=-1).numpy() * FPS


def _correlation_above_chance(
    face: Float[np.ndarray, " N"], hands: Float[np.ndarray, " N"]
) -> float:
    later = np.roll(face, round(SHIFT_S * FPS))
    return max_correlation_over_lags(face, hands) - max_correlation_over_lags(later, hands)
