"""Made-up numbers like those of ``diagnostics.json``: the sheet is drawn from such a dict."""

from typing import Any

import numpy as np

from conventions.joints import JOINT_NAMES, PARENTS

NAMES = (
    "globaldiff/local",
    "globaldiff/global",
    "globaldiff/joint",
    "globaldiff/skeleton.s2",
    "globaldiff/full",
    "asynfusion/lcm",
)
CHAIN = (
    *("pelvis", "spine1", "spine2", "spine3", "right_collar", "right_shoulder", "right_elbow"),
    *("right_wrist", "right_middle1", "right_middle2", "right_middle3"),
)


def depth_of_joints() -> np.ndarray:
    depth = np.zeros(len(JOINT_NAMES), dtype=int)
    for joint, parent in enumerate(PARENTS):
        depth[joint] = 0 if parent < 0 else depth[parent] + 1
    return depth


def example_diagnostics(
    num_systems: int = 2, has_reference: bool = True, names: tuple[str, ...] = NAMES
) -> dict[str, Any]:
    depth = depth_of_joints()
    return {
        "fps": 30,
        "tip": "right_middle",
        "joint_names": list(JOINT_NAMES),
        "depth_of_joint": depth.tolist(),
        "window_advance_frames": 52,
        "window_overlap_frames": 8,
        "systems": {
            name: _both(depth, seed, 1.0 + 1.4 * (num_systems - seed))
            for seed, name in enumerate(names[:num_systems])
        },
        "reference": _both(depth, 99, 1.0) if has_reference else None,
    }


def _both(depth: np.ndarray, seed: int, roughness: float) -> dict[str, dict[str, Any]]:
    raw = _measures(depth, seed, roughness)
    return {"raw": raw, "savgol": _measures(depth, seed, 1.0 + 0.25 * (roughness - 1.0))}


def _measures(depth: np.ndarray, seed: int, roughness: float) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    jerk = (8.0 + 12.0 * depth) * roughness ** (depth / 10.0) * np.exp(rng.normal(0, 0.15, 55))
    frequency = np.linspace(0.0, 15.0, 65)
    power = np.exp(-frequency / 0.9) + 2e-4 * (roughness - 0.9) * rng.gamma(5.0, 0.2, 65)
    phase = 40.0 * roughness * rng.gamma(30.0, 1 / 30.0, 52)
    phase[:9] *= 1.0 + 0.5 * (roughness - 1.0)
    share = rng.dirichlet(np.ones(len(CHAIN))) - 0.02
    return {
        "tip_jerk_m_s3": 120.0 * roughness,
        "tip_velocity_power_above_5hz": 0.006 * roughness,
        "seam_jerk_ratio": 1.0 + 0.3 * (roughness - 1.0),
        "joint_jerk_m_s3": jerk.tolist(),
        "jerk_by_depth_m_s3": [float(jerk[depth == d].mean()) for d in range(11)],
        "tip_spectrum": {
            "frequency_hz": frequency.tolist(),
            "velocity_power": (power / power.sum()).tolist(),
        },
        "tip_jerk_attribution": {"joints": list(CHAIN), "share": share.tolist()},
        "jerk_by_window_phase_m_s3": phase.tolist(),
    }
