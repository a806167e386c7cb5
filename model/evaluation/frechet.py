"""Fréchet gesture distance (FGD, Yoon et al. 2020) with the encoder that was trained here.

Features are the codes of local rotations and root motion, one for every 8 frames. Numbers of
another encoder, or of another amount of motion, cannot be compared with these.
"""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float

from model.evaluation.intervals import Interval, bootstrap_of
from model.motion.kinematics import global_from_local
from model.motion.motion import Motion
from model.motion.packing import pack
from model.motion.rotations import rot6d_from_matrix
from model.networks.autoencoder import FrozenEncoder

FGD_DRAWS = 200
SPLITS = 20

Features = Float[np.ndarray, "_ dim"]


@torch.inference_mode()
def motion_features(encoder: FrozenEncoder, motion: Motion) -> Features:
    """The coarsest codes of a whole clip, cut to whole codes."""
    config = encoder.network.config
    scale = max(config.scales)
    rotmat = motion.local_rotations()
    if config.rotation_space == "global":
        rotmat = global_from_local(rotmat)
    vectors = pack(rot6d_from_matrix(rotmat), torch.from_numpy(motion.trans.copy()))
    whole = len(vectors) - len(vectors) % scale
    return encoder.codes(vectors[None, :whole])[-1][0].numpy().astype(np.float64)


def frechet_distance(a: Features, b: Features) -> float:
    """``|m_a - m_b|^2 + tr(C_a + C_b - 2 (C_a C_b)^(1/2))`` of two sets of features."""
    cov_a, cov_b = np.cov(a, rowvar=False), np.cov(b, rowvar=False)
    values, vectors = np.linalg.eigh(cov_a)
    root = vectors * np.sqrt(values.clip(0)) @ vectors.T
    cross = np.sqrt(np.linalg.eigvalsh(root @ cov_b @ root).clip(0)).sum()
    mean = np.square(a.mean(0) - b.mean(0)).sum()
    return float(mean + np.trace(cov_a) + np.trace(cov_b) - 2 * cross)


def fgd(recorded: Sequence[Features], generated: Sequence[Features]) -> Interval:
    """Distance of all clips, with its interval over clips (drawn in pairs; biased upwards)."""

    def statistic(index: np.ndarray) -> float:
        chosen = [np.concatenate([clips[i] for i in index]) for clips in (recorded, generated)]
        return frechet_distance(*chosen)

    return bootstrap_of(statistic, len(recorded), FGD_DRAWS)


def split_half_floor(recorded: Sequence[Features]) -> Interval:
    """Distance between random halves of the recorded clips: what equal motion can score.

    Halves hold half the clips, so the floor lies above that of two whole sets.
    """
    rng = np.random.default_rng(0)
    distances = []
    for _ in range(SPLITS):
        order = rng.permutation(len(recorded))
        halves = order[: len(order) // 2], order[len(order) // 2 :]
        distances.append(
            frechet_distance(*(np.concatenate([recorded[i] for i in half]) for half in halves))
        )
    low, high = np.percentile(distances, [2.5, 97.5])
    return Interval(float(np.mean(distances)), float(low), float(high))
