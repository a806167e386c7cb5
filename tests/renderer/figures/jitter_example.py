"""Made-up numbers like those of a run, for the jitter sheet."""

from dataclasses import replace
from typing import Any

import numpy as np

from conventions.joints import JOINT_NAMES, PARENTS
from conventions.names import Version
from renderer.figures.jitter_series import Jitter, JitterSheet

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


def example_sheet(
    num_systems: int = 2, has_reference: bool = True, names: tuple[str, ...] = NAMES
) -> JitterSheet:
    depth = depth_of_joints()
    systems = {
        name: _both(depth, seed, 1.0 + 1.4 * (num_systems - seed))
        for seed, name in enumerate(names[:num_systems])
    }
    reference = {"reference": _both(depth, 99, 1.0)} if has_reference else {}
    return JitterSheet(reference | systems, "right middle fingertip", 52, 8)


def with_numbers(sheet: JitterSheet, name: str, kind: Version, **numbers: Any) -> JitterSheet:
    """The sheet with other numbers of one motion."""
    versions = sheet.jitter[name]
    versions = {**versions, kind: replace(versions[kind], **numbers)}
    return replace(sheet, jitter={**sheet.jitter, name: versions})


def _both(depth: np.ndarray, seed: int, roughness: float) -> dict[Version, Jitter]:
    raw = _jitter(depth, seed, roughness)
    return {"raw": raw, "savgol": _jitter(depth, seed, 1.0 + 0.25 * (roughness - 1.0))}


def _jitter(depth: np.ndarray, seed: int, roughness: float) -> Jitter:
    rng = np.random.default_rng(seed)
    jerk = (8.0 + 12.0 * depth) * roughness ** (depth / 10.0) * np.exp(rng.normal(0, 0.15, 55))
    frequency = np.linspace(0.0, 15.0, 65)
    power = np.exp(-frequency / 0.9) + 2e-4 * (roughness - 0.9) * rng.gamma(5.0, 0.2, 65)
    phase = 40.0 * roughness * rng.gamma(30.0, 1 / 30.0, 52)
    phase[:9] *= 1.0 + 0.5 * (roughness - 1.0)
    share = rng.dirichlet(np.ones(len(CHAIN))) - 0.02
    return Jitter(
        by_depth=np.array([jerk[depth == d].mean() for d in range(11)]),
        by_joint=jerk,
        spectrum=(frequency, power / power.sum()),
        chain=CHAIN,
        chain_drop=share,
        by_phase=phase,
        period=None,
    )
