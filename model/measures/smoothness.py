"""Measures of smoothness of points and joints over time, as pure functions, at 30 fps.

Positions are in metres. A measure that a clip is too short to have, or that would be 0 / 0, is NaN.
"""

import numpy as np
import torch
from jaxtyping import Float

from model.motion.rotations import axis_angle_from_matrix
from model.motion.skeleton import JOINT_DEPTH
from model.motion.timing import FPS

STILL_M_S3 = 1e-6
"""Jerk of rounding errors: below it nothing moves, and a ratio means nothing."""
STILL_M_S = 1e-4
"""A point that never gets as fast as 0.1 mm/s stands."""
MOVEMENT_FRAMES = 60
"""Stretches that SPARC and the dimensionless jerk are taken over. Both depend on how long a
movement lasts, so that whole clips of different lengths could not be compared; 2 s hold a gesture.
"""
SPARC_CUTOFF_HZ = 10.0
SPARC_THRESHOLD = 0.05
SPARC_PADDING = 4
"""Balasubramanian et al. 2015: cut-off, amplitude threshold and level of zero padding."""

_ROTATION_CHUNK = 2048
_THIRD_DIFFERENCE_VARIANCE = 20.0
"""Of unit white noise: 1 + 9 + 9 + 1."""
_MEDIAN_LENGTH = 1.5382
"""Median length of a vector of three independent normals of deviation 1 (chi, 3 degrees)."""


def derivative_magnitudes(
    positions: Float[np.ndarray, " T *points 3"], order: int
) -> Float[np.ndarray, " entries *points"]:
    """Length of the ``order``-th difference per unit time: m/s, m/s^2, m/s^3 for 1, 2, 3.

    Entry i comes from frames i to i + order. Shorter clips give no entries.
    """
    differences = np.diff(positions.astype(np.float64), n=order, axis=0) * float(FPS) ** order
    return np.linalg.norm(differences, axis=-1)


def mean_over_time(values: Float[np.ndarray, " T *points"]) -> Float[np.ndarray, " *points"]:
    """Mean of the first axis; NaN where there are no frames."""
    return np.asarray(values.mean(axis=0)) if len(values) else np.full(values.shape[1:], np.nan)


def angular_velocity(
    rotmat: Float[np.ndarray, "T *joints 3 3"],
) -> Float[np.ndarray, "steps *joints 3"]:
    """rad/s in the moving joint's own axes: the turn from each frame to the next, times 30."""
    steps = np.empty((max(0, len(rotmat) - 1), *rotmat.shape[1:-1]))
    for start in range(0, len(steps), _ROTATION_CHUNK):
        part = torch.from_numpy(rotmat[start : start + _ROTATION_CHUNK + 1]).double()
        turn = part[:-1].transpose(-1, -2) @ part[1:]
        steps[start : start + _ROTATION_CHUNK] = axis_angle_from_matrix(turn).numpy() * FPS
    return steps


def mean_by_depth(by_joint: Float[np.ndarray, " 55"]) -> Float[np.ndarray, " 11"]:
    """Entry d is the mean over the joints that are d bones away from the pelvis."""
    depth = np.array(JOINT_DEPTH)
    return np.array([by_joint[depth == d].mean() for d in range(max(JOINT_DEPTH) + 1)])


def rotation_noise(
    velocity: Float[np.ndarray, "steps *joints 3"],
) -> Float[np.ndarray, " *joints"]:
    """Deviation, in radians about each axis, of the white noise that rotations seem to hold.

    From the median length of the third difference of the turning, which hardly sees movement and
    no rare glitch: noise of deviation s gives sqrt(20) s on each axis. NaN under 4 frames.

    Args:
        velocity: from `angular_velocity`, rad/s.
    """
    third = np.linalg.norm(np.diff(velocity, n=2, axis=0), axis=-1) / FPS
    if not len(third):
        return np.full(third.shape[1:], np.nan)
    return np.median(third, axis=0) / (_MEDIAN_LENGTH * np.sqrt(_THIRD_DIFFERENCE_VARIANCE))


def sparc(speed: Float[np.ndarray, " T"]) -> float:
    """Spectral arc length of a speed profile (Balasubramanian et al. 2015); nearer 0 is smoother.

    Minus the length of the curve of the magnitude spectrum, divided by its value at 0 Hz, over
    frequencies from 0 to the last one below 10 Hz where it reaches 0.05, scaled to 0 to 1. NaN for
    a profile that is zero.
    """
    if not len(speed) or speed.max() < STILL_M_S:
        return float("nan")
    padded = 2 ** (int(np.ceil(np.log2(len(speed)))) + SPARC_PADDING)
    magnitude = np.abs(np.fft.rfft(speed, padded))
    frequency = np.fft.rfftfreq(padded, 1 / FPS)
    magnitude = magnitude[frequency <= SPARC_CUTOFF_HZ] / magnitude.max()
    end = int(np.flatnonzero(magnitude >= SPARC_THRESHOLD)[-1]) + 1
    steps = np.diff(magnitude[:end])
    return float(-np.hypot(1 / max(end - 1, 1), steps).sum())


def log_dimensionless_jerk(positions: Float[np.ndarray, "T 3"]) -> float:
    """``-ln(T^3 / v_peak^2 * integral of |jerk|^2 dt)``; higher is smoother (same source).

    NaN under 4 frames and where nothing moves.
    """
    jerk = derivative_magnitudes(positions, 3)
    peak = derivative_magnitudes(positions, 1).max(initial=0.0)
    if not len(jerk) or peak < STILL_M_S or not jerk.any():
        return float("nan")
    duration_s = (len(positions) - 1) / FPS
    return float(-np.log(duration_s**4 / peak**2 * np.mean(jerk**2)))


def mean_over_movements(positions: Float[np.ndarray, "T 3"]) -> tuple[float, float]:
    """SPARC and log dimensionless jerk, each the mean over stretches of 2 s from the first frame.

    What is left over at the end is not used. NaN under 61 frames; stretches in which the point
    stands still do not count.
    """
    values = []
    for start in range(0, len(positions) - MOVEMENT_FRAMES, MOVEMENT_FRAMES):
        stretch = positions[start : start + MOVEMENT_FRAMES + 1]
        values.append((sparc(derivative_magnitudes(stretch, 1)), log_dimensionless_jerk(stretch)))
    moving = np.array([pair for pair in values if np.isfinite(pair).all()])
    if not len(moving):
        return float("nan"), float("nan")
    arc, jerk = moving.mean(axis=0)
    return float(arc), float(jerk)
