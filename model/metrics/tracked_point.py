"""Metrics of the tracked point: its smoothness, and the joint that causes its jerk.

Smoothing the local rotation of joint j from R to S changes neither what is above j nor the shape of
the chain below it, so that forward kinematics of the changed chain comes down to a turn of the
point about the joint: ``p' = p_j + G_parent(j) S G_j^T (p - p_j)``, exact for any point that moves
rigidly with the last joint of the chain.

Positions are in metres, at 30 fps. A metric is NaN for too short a clip, or if it would be 0 / 0.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from conventions.joints import JOINT_NAMES, PARENTS
from conventions.rates import FPS
from model.metrics import smoothness
from model.metrics.smoothness import HIGH_FREQUENCY_HZ, STILL_M_S3, VelocitySpectrum
from model.motion.tracks import Tracks
from model.motion.transforms import smooth_over_time, smooth_rotations


@dataclass(frozen=True)
class JerkAttribution:
    """Drop of a point's jerk when one rotation alone is smoothed, as a share: 1 is all of it.

    Shares need not add up to 1: errors of two joints can hide each other, and then a share is
    negative. NaN under 4 frames and where nothing moves.
    """

    joints: tuple[str, ...]
    """Names of the joints from the pelvis to the last one that moves the point."""
    share: Float[np.ndarray, " chain"]
    translation_share: float
    """Share of the body's translation."""


def attribute_jerk(
    point: Float[np.ndarray, "T 3"], tracks: Tracks, chain: tuple[int, ...]
) -> JerkAttribution:
    """Compute the relative drop of the mean jerk of ``point`` for each joint of its chain.

    Rotations of the chain move the point; it starts at the pelvis (`tracks.kinematic_chain`).
    """
    whole = _mean_jerk(point)
    share = np.full(len(chain), np.nan)
    translation_share = np.nan
    if whole > STILL_M_S3:  # false for NaN too
        for index, joint in enumerate(chain):
            R_parent_joint = torch.from_numpy(tracks.R_parent_joint[:, joint]).double()
            turned = _turned_about(point, tracks, joint, smooth_rotations(R_parent_joint).numpy())
            share[index] = 1 - _mean_jerk(turned) / whole
        pelvis = tracks.joints[:, 0]
        moved = point + smooth_over_time(pelvis) - pelvis
        translation_share = 1 - _mean_jerk(moved) / whole
    return JerkAttribution(
        tuple(JOINT_NAMES[joint] for joint in chain), share, float(translation_share)
    )


def _turned_about(
    point: Float[np.ndarray, "T 3"],
    tracks: Tracks,
    joint: int,
    R_parent_joint: Float[np.ndarray, "T 3 3"],
) -> Float[np.ndarray, "T 3"]:
    """Compute the point's positions for other local rotations of one joint."""
    pivot = tracks.joints[:, joint]
    in_joint = np.einsum("tji,tj->ti", tracks.R_world_joint[:, joint], point - pivot)
    in_parent = np.einsum("tij,tj->ti", R_parent_joint, in_joint)
    if PARENTS[joint] >= 0:
        in_parent = np.einsum("tij,tj->ti", tracks.R_world_joint[:, PARENTS[joint]], in_parent)
    return pivot + in_parent


def _mean_jerk(positions: Float[np.ndarray, "T 3"]) -> float:
    return float(smoothness.mean_over_time(smoothness.derivative_magnitudes(positions, 3)))


STILL_M_S = 1e-4
"""Peak speed (m/s) below which a point counts as still: 0.1 mm/s."""
SMOOTHNESS_STRETCH_FRAMES = 60
"""Length (frames) of the stretches for SPARC and the dimensionless jerk. Both depend on how long a
movement lasts, so that whole clips of different lengths could not be compared; 2 s hold a gesture.
"""
SPARC_CUTOFF_HZ = 10.0
SPARC_THRESHOLD = 0.05
SPARC_PADDING = 4
"""Cutoff frequency, amplitude threshold and zero padding of Balasubramanian et al. 2015."""


@dataclass(frozen=True)
class TrackedPointMetrics:
    """Metrics of the tracked point."""

    tip_jerk_m_s3: float
    tip_acceleration_m_s2: float
    tip_speed_m_s: float
    tip_velocity_power_share_above_5hz: float
    tip_spectrum: VelocitySpectrum | None
    """Velocity spectrum as shares of its total power."""
    tip_sparc: float
    tip_log_dimensionless_jerk: float
    tip_jerk_attribution: JerkAttribution


def tracked_point_metrics(
    point: Float[np.ndarray, "T 3"], tracks: Tracks, chain: tuple[int, ...]
) -> TrackedPointMetrics:
    """Compute the metrics of a point that moves with the last joint of ``chain``."""

    def mean(order: int) -> float:
        return float(smoothness.mean_over_time(smoothness.derivative_magnitudes(point, order)))

    arc_length, log_jerk = mean_sparc_and_log_jerk(point)
    above_5hz, shares = math.nan, None
    spectrum = smoothness.velocity_spectrum(np.diff(point, axis=0) * FPS)
    if spectrum is not None and spectrum.velocity_power.any():
        shares = spectrum.normalised()
        above_5hz = float(shares.power_above(HIGH_FREQUENCY_HZ))
    return TrackedPointMetrics(
        tip_jerk_m_s3=mean(3),
        tip_acceleration_m_s2=mean(2),
        tip_speed_m_s=mean(1),
        tip_velocity_power_share_above_5hz=above_5hz,
        tip_spectrum=shares,
        tip_sparc=arc_length,
        tip_log_dimensionless_jerk=log_jerk,
        tip_jerk_attribution=attribute_jerk(point, tracks, chain),
    )


def sparc(speed: Float[np.ndarray, " T"]) -> float:
    """Compute the spectral arc length of a speed profile (Balasubramanian et al. 2015).

    Nearer 0 is smoother. It is minus the length of the curve of the magnitude spectrum, divided by
    its value at 0 Hz, over frequencies from 0 to the last one below 10 Hz where it reaches 0.05,
    scaled to 0 to 1. NaN for a profile that is zero.
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
    """Compute ``-ln(T^3 / v_peak^2 * integral of |jerk|^2 dt)``; higher is smoother (same source).

    NaN under 4 frames and where nothing moves.
    """
    jerk = smoothness.derivative_magnitudes(positions, 3)
    peak = smoothness.derivative_magnitudes(positions, 1).max(initial=0.0)
    if not len(jerk) or peak < STILL_M_S or not jerk.any():
        return float("nan")
    duration_s = (len(positions) - 1) / FPS
    return float(-np.log(duration_s**4 / peak**2 * np.mean(jerk**2)))


def mean_sparc_and_log_jerk(positions: Float[np.ndarray, "T 3"]) -> tuple[float, float]:
    """Compute SPARC and log dimensionless jerk as means over stretches of 2 s from the first frame.

    The rest at the end is not used, nor are stretches without movement. NaN below 61 frames.
    """
    values = []
    for start in range(0, len(positions) - SMOOTHNESS_STRETCH_FRAMES, SMOOTHNESS_STRETCH_FRAMES):
        stretch = positions[start : start + SMOOTHNESS_STRETCH_FRAMES + 1]
        values.append(
            (sparc(smoothness.derivative_magnitudes(stretch, 1)), log_dimensionless_jerk(stretch))
        )
    moving = np.array([pair for pair in values if np.isfinite(pair).all()])
    if not len(moving):
        return float("nan"), float("nan")
    arc, jerk = moving.mean(axis=0)
    return float(arc), float(jerk)
