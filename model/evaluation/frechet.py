"""Fréchet distances (AsynFusion eq. 16) and Div (eq. 17), with encoders that were trained here.

FGD (Yoon et al. 2020) is for the body: codes of local rotations and root motion, one for every 8
frames. FED is for the blendshapes, FMD for both together. Values from another encoder, or from
another amount of motion, are not comparable.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from threadpoolctl import threadpool_limits

from model.evaluation.tables import Estimate, bootstrap_statistic, percentile_interval
from model.metrics.reference_error import GESTURE_DIM, pairwise_l1, shuffled_window_batches
from model.motion.motion import Motion, arkit_weights_or_zeros
from model.networks.autoencoder import FrozenMotionEncoder, autoencoder_input
from model.systems.helpers.config import FED_ENCODER, FGD_ENCODER, FMD_ENCODER

ENCODER_NAMES = {"fmd": FMD_ENCODER, "fed": FED_ENCODER, "fgd": FGD_ENCODER}
"""Name of the encoder of each distance."""
FRECHET_DRAWS = 200
SPLITS = 20

Features = Float[np.ndarray, "_ dim"]
_ONE_THREAD = threadpool_limits.wrap(limits=1, user_api="blas")
"""Limit of numpy's BLAS to one thread: on matrices this small, several only wait for each other."""


def left_out_sentences(
    encoders: Mapping[str, FrozenMotionEncoder], recorded: Iterable[Motion]
) -> list[str]:
    """Format a sentence for each metric without its encoder, or without ARKit blendshapes."""
    sentences = [
        f"{measure.upper()} is left out: its encoder {name} is not among the weights."
        for measure, name in ENCODER_NAMES.items()
        if measure not in encoders
    ]
    if any(motion.expression_basis != "arkit52" for motion in recorded):
        sentences.append(
            "FMD, FED and Div of body and face are left out for motions without ARKit blendshapes."
        )
    return sentences


@torch.inference_mode()
def motion_features(encoder: FrozenMotionEncoder, motion: Motion) -> Features | None:
    """Compute the coarsest codes of a clip; None if the encoder needs blendshapes that it lacks."""
    config = encoder.network.config
    if config.face_channels > 0 and motion.expression_basis != "arkit52":
        return None
    whole = motion.num_frames - motion.num_frames % max(config.scales)
    poses, trans, face = (
        torch.from_numpy(array[:whole].copy())[None]
        for array in (motion.poses, motion.trans, arkit_weights_or_zeros(motion))
    )
    codes = encoder.codes(autoencoder_input(config, poses, trans, face))[-1]
    return codes[0].numpy().astype(np.float64)


@dataclass(frozen=True)
class FeatureMoments:
    """Moments of features: enough for a Fréchet distance without the features of the clips."""

    count: int
    total: Float[np.ndarray, " dim"]
    """Sum of the features."""
    products: Float[np.ndarray, "dim dim"]
    """Sum of the outer products of the features."""

    @staticmethod
    def of(features: Features) -> "FeatureMoments":
        """Compute the moments of one clip's features."""
        return FeatureMoments(len(features), features.sum(0), features.T @ features)

    @property
    def mean(self) -> Float[np.ndarray, " dim"]:
        return self.total / self.count

    @property
    def covariance(self) -> Float[np.ndarray, "dim dim"]:
        centred = self.products - np.outer(self.total, self.mean)
        return centred / (self.count - 1)


def frechet_distance(a: Features, b: Features) -> float:
    """Compute ``|m_a - m_b|^2 + tr(C_a + C_b - 2 (C_a C_b)^(1/2))`` of two sets of features."""
    return frechet_from_moments(FeatureMoments.of(a), FeatureMoments.of(b))


def frechet_from_moments(a: FeatureMoments, b: FeatureMoments, offset: float = 0.0) -> float:
    """Compute `frechet_distance` from moments, with ``offset`` on the covariances' diagonals."""
    under = offset * np.eye(len(a.total))
    values, vectors = np.linalg.eigh(a.covariance + under)
    root = vectors * np.sqrt(values.clip(0)) @ vectors.T
    cross = np.sqrt(np.linalg.eigvalsh(root @ (b.covariance + under) @ root).clip(0)).sum()
    mean = np.square(a.mean - b.mean).sum()
    return float(mean + np.trace(a.covariance) + np.trace(b.covariance) - 2 * cross)


@_ONE_THREAD
def frechet_with_interval(recorded: Sequence[Features], generated: Sequence[Features]) -> Estimate:
    """Compute the distance of all clips, with its interval (drawn in pairs; biased upwards)."""

    def statistic(index: Int[np.ndarray, " clips"]) -> float:
        chosen = [np.concatenate([clips[i] for i in index]) for clips in (recorded, generated)]
        return frechet_distance(*chosen)

    return bootstrap_statistic(statistic, len(recorded), FRECHET_DRAWS)


@_ONE_THREAD
def split_half_baseline(recorded: Sequence[Features]) -> Estimate:
    """Compute the mean Fréchet distance between random halves of the recorded clips.

    It estimates the expected value for two samples of one distribution. Halves hold half the
    clips, so it lies above that of two whole sets.
    """
    rng = np.random.default_rng(0)
    distances = []
    for _ in range(SPLITS):
        order = rng.permutation(len(recorded))
        halves = order[: len(order) // 2], order[len(order) // 2 :]
        distances.append(
            frechet_distance(*(np.concatenate([recorded[i] for i in half]) for half in halves))
        )
    return percentile_interval(float(np.mean(distances)), distances)


def window_diversity(clips: Sequence[Float[np.ndarray, "_ T _"]]) -> dict[str, Estimate]:
    """Compute the mean distance of windows in random batches of 50 (``div_gesture``, ``div``)."""
    owner = np.repeat(np.arange(len(clips)), [len(windows) for windows in clips])
    if len(owner) < 2:
        return {}
    dim = min(windows.shape[2] for windows in clips)
    windows = np.concatenate([windows[..., :dim] for windows in clips])
    parts = {"div": windows} if dim > GESTURE_DIM else {}
    parts["div_gesture"] = windows[..., :GESTURE_DIM]
    return {name: _over_batches(part, owner, len(clips)) for name, part in parts.items()}


def _over_batches(
    windows: Float[np.ndarray, "W T dim"], owner: Int[np.ndarray, " W"], num_clips: int
) -> Estimate:
    """Compute the mean over pairs, and its interval over clips."""
    sums, pairs = np.zeros((2, num_clips, num_clips))
    for batch in shuffled_window_batches(len(windows)):
        between = owner[batch][:, None], owner[batch]
        np.add.at(sums, between, pairwise_l1(windows[batch]))
        np.add.at(pairs, between, 1.0 - np.eye(len(batch)))

    def statistic(index: Int[np.ndarray, " n"]) -> float:
        """Average pairs of windows, but not of a clip with its copy in the draw."""
        chosen = np.ix_(index, index)
        counts = (index[:, None] != index) | np.eye(len(index), dtype=bool)
        total = pairs[chosen][counts].sum()
        return float(sums[chosen][counts].sum() / total) if total > 0 else 0.0

    return bootstrap_statistic(statistic, num_clips)
