"""What several tests share: random rotations, small motions and the optional real data."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from conventions.joints import FINGERTIP_JOINTS, MIRROR_PERMUTATION
from model.motion.kinematics import RestSkeleton
from model.motion.motion import ExpressionBasis, Motion

ROOT = Path(__file__).resolve().parent.parent
ROTATION_DRAWS = ("uniform", "tangent", "near_identity", "near_pi")


def random_rotations(draw: str, batch: tuple[int, ...], seed: int = 0) -> np.ndarray:
    """Float64 rotation matrices (*batch, 3, 3), also from where rotation code breaks.

    Args:
        draw: 'uniform' over SO(3); 'tangent' (axis-angle from a normal); 'near_identity' (that
            times 1e-7); 'near_pi' (angles pi - 1e-7 to pi).
    """
    rng = np.random.default_rng(seed)
    count = int(np.prod(batch))
    vectors = rng.standard_normal((count, 3))
    if draw == "uniform":
        rotations = Rotation.random(count, rng=rng)
    elif draw == "tangent":
        rotations = Rotation.from_rotvec(vectors)
    elif draw == "near_identity":
        rotations = Rotation.from_rotvec(1e-7 * vectors)
    elif draw == "near_pi":
        axes = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
        angles = np.pi - 1e-7 * rng.random((count, 1))
        rotations = Rotation.from_rotvec(angles * axes)
    else:
        raise ValueError(f"unknown draw {draw}")
    return rotations.as_matrix().reshape(*batch, 3, 3)


def random_local_rotations(
    batch: tuple[int, ...], seed: int = 0, dtype: torch.dtype = torch.float64
) -> Tensor:
    """Local rotations (*batch, 55, 3, 3), uniform over SO(3)."""
    return torch.from_numpy(random_rotations("uniform", (*batch, 55), seed)).to(dtype)


def smooth_motion_example(
    num_frames: int = 90, seed: int = 0, expression_basis: ExpressionBasis = "arkit52"
) -> Motion:
    """A gentle random motion: a few slow sinusoids (under 2 Hz) per channel."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(num_frames)[:, None, None] / 30

    def waves(channels: int, amplitude: float) -> np.ndarray:
        frequency = rng.uniform(0.2, 2.0, (1, channels, 3))
        phase = rng.uniform(0, 2 * np.pi, (1, channels, 3))
        return amplitude * np.sin(2 * np.pi * frequency * time_s + phase).mean(-1)

    expressions = np.zeros((num_frames, 100))
    expressions[:, :52] = 0.5 + waves(52, 0.5)
    return Motion(
        poses=waves(165, 0.3).astype(np.float32),
        trans=(np.array([0.0, 1.2, 0.0]) + waves(3, 0.05)).astype(np.float32),
        expressions=expressions.astype(np.float32),
        expression_basis=expression_basis,
        betas=np.zeros(300, dtype=np.float32),
    )


def csv_rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def beat2_folder() -> Path:
    """The folder of real BEAT2 clips; the calling test is skipped where there is none."""
    folder = Path(os.environ.get("BEAT2_DIR", ROOT.parent / "shared" / "data" / "beat2"))
    english = folder / "beat_english_v2.0.0"
    folder = english if english.is_dir() else folder
    if not (folder / "smplxflame_30").is_dir():
        pytest.skip("no real BEAT2 clips here; set BEAT2_DIR to their folder")
    return folder


def foreign_folder() -> Path:
    """Motion that other systems made; the calling test is skipped where there is none."""
    folder = ROOT.parent / "shared" / "data" / "foreign"
    if not folder.is_dir():
        pytest.skip("no motion of other systems here (shared/data/foreign)")
    return folder


def reported_folder() -> Path:
    """Small inputs that were once read wrongly; the calling test is skipped where they are not."""
    folder = Path(os.environ.get("REPORTED_DIR", ROOT.parent / "shared" / "data" / "inputs5"))
    if not folder.is_dir():
        pytest.skip("no inputs that were reported here (shared/data/inputs5)")
    return folder


def protocols_folder() -> Path:
    """Numbers of others' evaluation code; the calling test is skipped where there are none."""
    folder = ROOT.parent / "shared" / "data" / "protocols"
    if not folder.is_dir():
        pytest.skip("no numbers of others' evaluation code here (shared/data/protocols)")
    return folder


def official_folder() -> Path:
    """Numbers of the authors' code; the calling test is skipped where there are none."""
    folder = ROOT.parent / "shared" / "data" / "official"
    if not folder.is_dir():
        pytest.skip("no reference numbers of the authors' code here (shared/data/official)")
    return folder


def mirror_skeleton(skeleton: RestSkeleton) -> RestSkeleton:
    """The mirror image of a rest skeleton; left and right change places."""
    num_left = len(FINGERTIP_JOINTS) // 2
    image = torch.tensor([-1.0, 1.0, 1.0])
    tips = image * skeleton.tip_offsets
    return RestSkeleton(
        rest_joints=(image * skeleton.rest_joints)[list(MIRROR_PERMUTATION)],
        tip_offsets=torch.cat([tips[num_left:], tips[:num_left]]),
    )
