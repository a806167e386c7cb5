"""What is measured on the training split before the first step: means, scales, priors."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from model.data.prepared import Batch, PreparedData
from model.motion.packing import AXIS_ANGLE_GROUPS, Normaliser
from model.motion.spaces import Representation
from model.networks.config import BranchConfig
from model.sampling.prior import GaussianPrior, fit_components, fit_prior
from model.training.targets import Targets
from model.training.task import Given

WINDOWS = 400
STD_FLOOR = 0.02
"""What hardly ever changes is not blown up to unit variance."""
PRIOR_BATCHES, PRIOR_BATCH_SIZE = 12, 256


def statistics_batch(data: PreparedData, window_frames: int, mirror: float) -> Batch:
    """At most 400 windows, always the same."""
    rng = np.random.default_rng(0)
    return data.window_batch(data.of_split("train"), window_frames, WINDOWS, rng, mirror)


def fit_features(data: PreparedData) -> Normaliser:
    """Statistics of the speech features, of every hundredth frame."""
    told = torch.from_numpy(np.array(data.speech[::100], np.float32))
    return Normaliser(told.mean(0), told.std(0).clamp_min(STD_FLOOR))


def prior_batches(data: PreparedData, window_frames: int) -> Iterator[Batch]:
    """The windows that a linear-Gaussian prior is fitted to."""
    clips = data.of_split("train")
    for k in range(PRIOR_BATCHES):
        rng = np.random.default_rng([k, 17])
        yield data.window_batch(clips, window_frames, PRIOR_BATCH_SIZE, rng)


def fit_normaliser(
    data: PreparedData,
    targets: Targets,
    window_frames: int,
    mirror: float,
    representation: Representation = "normalised",
) -> Normaliser:
    """Statistics of the motion vectors that a network aims at."""
    vectors, _ = targets.of(statistics_batch(data, window_frames, mirror), rotations=False)
    groups = AXIS_ANGLE_GROUPS if targets.space == "axis-angle" else None
    return Normaliser.fit(vectors.flatten(0, 1), representation, groups)


def fit_motion_prior(
    data: PreparedData, targets: Targets, shape: BranchConfig, mirror: float, given: Given | None
) -> tuple[Normaliser, GaussianPrior]:
    """Components of motion and their linear-Gaussian prior, from windows of the training split,
    or those that given weights learned with."""
    if given is not None:
        return given.normaliser, given.prior(shape.seed_frames)
    windows = [targets.windows(batch) for batch in prior_batches(data, shape.window_frames)]
    normaliser = fit_normaliser(data, targets, shape.window_frames, mirror)
    return with_components(normaliser, windows, shape.seed_frames)


def fit_face_prior(
    data: PreparedData, shape: BranchConfig, given: Given | None = None
) -> tuple[Normaliser, GaussianPrior]:
    """The same of face units."""
    if given is not None:
        return given.normaliser, given.prior(shape.seed_frames)
    windows = [batch.expression for batch in prior_batches(data, shape.window_frames)]
    units = torch.cat([batch.flatten(0, 1) for batch in windows])
    normaliser = Normaliser(units.mean(0), units.std(0).clamp_min(STD_FLOOR))
    return with_components(normaliser, windows, shape.seed_frames)


def with_components(
    normaliser: Normaliser, windows: Sequence[Float[Tensor, "N T C"]], seed_frames: int
) -> tuple[Normaliser, GaussianPrior]:
    """The statistics with components that hardly depend on each other, and their prior."""
    mean = torch.cat([batch.flatten(0, 1) for batch in windows]).mean(0)
    centred = Normaliser(mean, normaliser.std)
    mix, unmix = fit_components([centred.scaled(batch) for batch in windows])
    mixing = replace(centred, mix=mix, unmix=unmix)
    return mixing, fit_prior([mixing.normalise(batch) for batch in windows], seed_frames)
