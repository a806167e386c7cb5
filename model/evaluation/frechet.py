"""Fréchet distances (AsynFusion eq. 16) with encoders that were trained here, one for each.

FGD (Yoon et al. 2020) is that of the body: codes of local rotations and root motion, one for every
8 frames. FED is that of the face units, FMD that of both together. Numbers of another encoder, or
of another amount of motion, cannot be compared with these.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import torch
from jaxtyping import Float

from model.data.recordings import face_units
from model.evaluation.intervals import Interval, bootstrap_of
from model.motion.motion import Motion
from model.networks.autoencoder import FrozenEncoder, input_vectors
from model.systems.autoencoders.config import FED_ENCODER, FGD_ENCODER, FMD_ENCODER

ENCODERS = {"fmd": FMD_ENCODER, "fed": FED_ENCODER, "fgd": FGD_ENCODER}
"""Which encoder each distance needs."""
FRECHET_DRAWS = 200
SPLITS = 20

Features = Float[np.ndarray, "_ dim"]


def left_out(judges: Mapping[str, FrozenEncoder], recorded: Iterable[Motion]) -> list[str]:
    """A sentence on everything that cannot be measured: without its encoder, or because recorded
    faces are not in the units that systems draw."""
    sentences = [
        f"{measure.upper()} is left out: its encoder {name} is not among the weights."
        for measure, name in ENCODERS.items()
        if measure not in judges
    ]
    if any(motion.expression_basis != "arkit52" for motion in recorded):
        sentences.append(
            "FMD, FED and Div of body and face are left out where faces are not in ARKit's units."
        )
    return sentences


@torch.inference_mode()
def motion_features(encoder: FrozenEncoder, motion: Motion) -> Features | None:
    """The coarsest codes of a whole clip, cut to whole codes; None if the encoder sees faces and
    this one is not in ARKit's units."""
    config = encoder.network.config
    if config.face_channels > 0 and motion.expression_basis != "arkit52":
        return None
    whole = motion.num_frames - motion.num_frames % max(config.scales)
    poses, trans, face = (
        torch.from_numpy(array[:whole].copy())[None]
        for array in (motion.poses, motion.trans, face_units(motion))
    )
    codes = encoder.codes(input_vectors(config, poses, trans, face))[-1]
    return codes[0].numpy().astype(np.float64)


def frechet_distance(a: Features, b: Features) -> float:
    """``|m_a - m_b|^2 + tr(C_a + C_b - 2 (C_a C_b)^(1/2))`` of two sets of features."""
    cov_a, cov_b = np.cov(a, rowvar=False), np.cov(b, rowvar=False)
    values, vectors = np.linalg.eigh(cov_a)
    root = vectors * np.sqrt(values.clip(0)) @ vectors.T
    cross = np.sqrt(np.linalg.eigvalsh(root @ cov_b @ root).clip(0)).sum()
    mean = np.square(a.mean(0) - b.mean(0)).sum()
    return float(mean + np.trace(cov_a) + np.trace(cov_b) - 2 * cross)


def distance(recorded: Sequence[Features], generated: Sequence[Features]) -> Interval:
    """Of all clips, with its interval over clips (drawn in pairs; biased upwards)."""

    def statistic(index: np.ndarray) -> float:
        chosen = [np.concatenate([clips[i] for i in index]) for clips in (recorded, generated)]
        return frechet_distance(*chosen)

    return bootstrap_of(statistic, len(recorded), FRECHET_DRAWS)


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
