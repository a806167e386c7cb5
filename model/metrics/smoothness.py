"""Smoothness of positions over time: derivatives, their means and spectra (metres, 30 fps)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
import torch
from jaxtyping import Float
from scipy.signal import welch

from conventions.joints import JOINT_DEPTH
from conventions.rates import FPS
from model.motion.rotations import axis_angle_from_matrix

STILL_M_S3 = 1e-6
"""Jerk of rounding errors (m/s³): below it nothing moves, and a ratio means nothing."""

_ROTATION_CHUNK = 2048


def derivative_magnitudes(
    positions: Float[np.ndarray, " T *points 3"], order: int
) -> Float[np.ndarray, " entries *points"]:
    """Compute the length of the ``order``-th derivative: m/s, m/s^2, m/s^3 for 1, 2, 3.

    Entry i comes from frames i to i + order. Shorter clips give no entries.
    """
    differences = np.diff(positions.astype(np.float64), n=order, axis=0) * float(FPS) ** order
    return np.linalg.norm(differences, axis=-1)


def mean_over_time(values: Float[np.ndarray, " T *points"]) -> Float[np.ndarray, " *points"]:
    """Compute the mean of the first axis; NaN without frames."""
    return np.asarray(values.mean(axis=0)) if len(values) else np.full(values.shape[1:], np.nan)


def angular_velocity(
    rotmat: Float[np.ndarray, "T *joints 3 3"],
) -> Float[np.ndarray, "steps *joints 3"]:
    """Compute angular velocity (rad/s) in the joint's axes: rotation to the next frame times 30."""
    steps = np.empty((max(0, len(rotmat) - 1), *rotmat.shape[1:-1]))
    for start in range(0, len(steps), _ROTATION_CHUNK):
        part = torch.from_numpy(rotmat[start : start + _ROTATION_CHUNK + 1]).double()
        turn = part[:-1].transpose(-1, -2) @ part[1:]
        steps[start : start + _ROTATION_CHUNK] = axis_angle_from_matrix(turn).numpy() * FPS
    return steps


def mean_by_depth(by_joint: Float[np.ndarray, " 55"]) -> Float[np.ndarray, " 11"]:
    """Compute at entry d the mean over the joints that are d bones away from the pelvis."""
    depth = np.array(JOINT_DEPTH)
    return np.array([by_joint[depth == d].mean() for d in range(max(JOINT_DEPTH) + 1)])


WELCH_FRAMES = 128
MIN_SPECTRUM_FRAMES = 32
"""Shortest clip for a spectrum (frames), about a second: it must resolve 5 Hz."""
HIGH_FREQUENCY_HZ = 5.0


@dataclass(frozen=True, eq=False)
class VelocitySpectrum:
    """Power of one velocity by frequency, its mean removed, summed over the three axes."""

    frequency_hz: Float[np.ndarray, " bins"]
    velocity_power: Float[np.ndarray, " *points bins"]
    """Mean square of the velocity in each bin, in its unit squared."""

    def power_above(self, frequency_hz: float) -> Float[np.ndarray, " *points"]:
        """Sum the power above a frequency (Hz)."""
        return np.asarray(self.velocity_power[..., self.frequency_hz > frequency_hz].sum(-1))

    def normalised(self) -> VelocitySpectrum:
        """Return each bin's share of the total power; NaN for a point that does not move."""
        power = self.velocity_power
        total = power.sum(-1, keepdims=True)
        shares = np.divide(power, total, out=np.full_like(power, np.nan), where=total > 0)
        return VelocitySpectrum(self.frequency_hz, shares)


def velocity_spectrum(velocity: Float[np.ndarray, "T *points 3"]) -> VelocitySpectrum | None:
    """Compute Welch's spectrum (Hann, 128 frames, half overlapping); None under 32 frames."""
    if len(velocity) < MIN_SPECTRUM_FRAMES:
        return None
    frequency, density = welch(velocity, fs=FPS, nperseg=min(WELCH_FRAMES, len(velocity)), axis=0)
    power = np.moveaxis(density.sum(-1), 0, -1) * (frequency[1] - frequency[0])
    return VelocitySpectrum(frequency, power)


ByJoint = Float[np.ndarray, " 55"]
ByDepth = Float[np.ndarray, " 11"]
ByFingertip = Float[np.ndarray, " 10"]
T = TypeVar("T")


@dataclass(frozen=True)
class Sides(Generic[T]):
    """A value for the left and one for the right side."""

    left: T
    right: T
