"""Protocol ``physical/mbench``: plausibility of feet and movement from the 22 body joints.

Differences are per frame and not per second. A foot is in contact if it moves less than 1 cm or is
less than 2 cm above the lowest position of both feet in the clip.
"""

import numpy as np
from jaxtyping import Bool, Float
from scipy.signal import find_peaks

from model.metrics.protocols.clip import Clip, Sums
from model.motion.runs import true_runs

BODY_JOINTS = 22
FEET = (10, 11)
MIN_FRAMES = 4
CONTACT_STEP_M, CONTACT_HEIGHT_M = 0.01, 0.02
SUNK_M = 0.005
ROOT_STEP_M, FOOT_STEP_M = 1e-3, 1.2e-4
"""Steps of root and foot (m per frame) below which a frame is not judged."""
LOWEST_RATIO, HIGHEST_RATIO, FLOATING_RATIO = 0.6, 1.75, 0.4
"""Limits of the ratio of the foot's step, relative to the root, and the root's step."""
MIN_IMPLAUSIBLE_TURNS = 3
"""Number of turns of a jumping foot that make it implausible."""
_EPSILON = 1e-6


def physical_plausibility_sums(clip: Clip) -> Sums:
    """Compute slide (m), floating share, jitter (m), dynamics (m) and penetration (m) of a clip."""
    if len(clip.joints) < MIN_FRAMES:
        return {}
    joints = clip.joints[:, :BODY_JOINTS].astype(np.float32)  # as in the published code
    feet, root = joints[:, list(FEET)], joints[:, 0]
    height = feet[..., 1] - feet[..., 1].min()
    contact = (_lengths(_steps(feet)) < CONTACT_STEP_M) | (height < CONTACT_HEIGHT_M)
    slide = (_lengths(_steps(feet)[..., [0, 2]]) * contact).sum(0) / (contact.sum(0) + _EPSILON)
    sunk = -height[height < -SUNK_M]
    values = {
        "slide_m": slide.mean(),
        "floating_share": _floating_frames(feet, root, contact) / len(joints),
        "jitter_m": _mean_difference(joints, 2),
        "dynamic_m": _mean_difference(joints, 1),
        "penetration_m": sunk.mean() if sunk.size else 0.0,
    }
    return {key: np.array(value, np.float64) for key, value in {"count": 1.0, **values}.items()}


def _steps(positions: Float[np.ndarray, "T ..."]) -> Float[np.ndarray, "T ..."]:
    """Return the steps to the next frame; the last one is repeated."""
    steps = np.diff(positions, axis=0)
    return np.concatenate([steps, steps[-1:]])


def _lengths(vectors: Float[np.ndarray, "*batch dim"]) -> np.ndarray:
    return np.linalg.norm(vectors, axis=-1)


def _mean_difference(joints: Float[np.ndarray, "T J 3"], order: int) -> float:
    """Add the mean lengths of differences in the world and relative to the pelvis."""
    both = joints, joints - joints[:, :1]
    return sum(float(_lengths(np.diff(each, n=order, axis=0)).mean()) for each in both)


def _floating_frames(
    feet: Float[np.ndarray, "T 2 3"],
    root: Float[np.ndarray, "T 3"],
    contact: Bool[np.ndarray, "T 2"],
) -> float:
    """Count frames in which the steps of feet and root do not fit each other."""
    root_step = _lengths(_steps(root))
    ratio = _lengths(_steps(feet - root[:, None])) / (root_step[:, None] + _EPSILON)
    is_odd = (_lengths(_steps(feet)) > FOOT_STEP_M) & (
        (ratio < LOWEST_RATIO) | (ratio > HIGHEST_RATIO)
    )
    is_odd &= root_step[:, None] >= ROOT_STEP_M
    implausible = contact.any(1) & (is_odd | ~contact).all(1)
    airborne = [true_runs(~contact[:, foot]) for foot in range(2)]
    floating = sum(
        int((ratio[start:end, foot] < FLOATING_RATIO).sum())
        for foot in range(2)
        for start, end in airborne[foot]
        if end - start >= MIN_FRAMES and (root_step[start:end] < ROOT_STEP_M).mean() <= 0.5
    )
    jumps = [
        (max(left[0], right[0]), min(left[1], right[1]))
        for left in airborne[0]
        for right in airborne[1]
    ]
    turning = sum(
        end - start
        for start, end in jumps
        if end - start >= MIN_FRAMES and _num_turns(feet[start:end, 0]) >= MIN_IMPLAUSIBLE_TURNS
    )
    return int(implausible.sum()) + floating / 2 + turning


def _num_turns(path: Float[np.ndarray, "T 3"]) -> int:
    """Count peaks of the angle between the way from the start and the way to the end."""
    way = path[1:] - path[0]
    unit = way / (_lengths(way)[:, None] + _EPSILON)
    return len(find_peaks(np.arccos(np.clip(unit @ unit[-1], -1.0, 1.0)))[0])
