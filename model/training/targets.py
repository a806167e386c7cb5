"""Inputs and targets of a training step, and statistics of the training split.

Targets are computed once for all clips; a step then reads a window's rows instead of converting and
posing it each time it is drawn.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from conventions.joints import NUM_JOINTS
from model.data.prepared import Batch, PreparedData, derived_arrays
from model.motion import packing, spaces
from model.motion.kinematics import RestSkeleton
from model.motion.packing import AXIS_ANGLE_GROUPS, MOTION_DIM, DecodedMotion, Normaliser
from model.motion.packing import rotations as rotations_of
from model.motion.spaces import RootFormat, RotationSpace, VectorScaling
from model.networks.config import BranchConfig
from model.networks.trained import TrainedWeights
from model.sampling.prior import GaussianPrior, fit_components, fit_prior
from model.speech.features import simulate_microphone, vocal_tract_perturbation
from model.training.config import TrainConfig
from model.training.parallel import ShardedRandom

BLOCK_FRAMES = 2000
TARGETS_FORMAT = 2
WINDOWS = 400
STD_FLOOR = 0.02
"""Smallest standard deviation, so that nearly constant channels are not scaled to unit variance."""
PRIOR_BATCHES, PRIOR_BATCH_SIZE = 12, 256


@dataclass(frozen=True)
class Targets:
    """Arrays of all frames of a `PreparedData`, in one rotation space."""

    space: RotationSpace
    root_format: RootFormat
    skeleton: RestSkeleton
    vectors: np.ndarray
    """Motion vectors (N, C), not normalised."""
    untranslated_positions: np.ndarray
    """Joint positions (N, 165) in metres, with the pelvis at its place in the rest pose."""

    def for_batch(
        self, batch: Batch, *, with_rotations: bool
    ) -> tuple[Float[Tensor, "B T C"], DecodedMotion]:
        """Return vectors and decoded motion of a batch's windows; rotations only on request."""
        vectors = self.windows(batch)
        if with_rotations and self.space != "global":
            return vectors, packing.decode(vectors, self.space, self.skeleton, self.root_format)
        decoded = DecodedMotion(
            R_world_joint=rotations_of(vectors, self.space) if with_rotations else None,
            untranslated_positions=torch.from_numpy(
                self.untranslated_positions[batch.frame_rows]
            ).unflatten(-1, (NUM_JOINTS, 3)),
            translation=packing.root_positions(vectors[..., -spaces.ROOT_DIM :], self.root_format),
            global_vectors=vectors if with_rotations else None,
        )
        return vectors, decoded

    def windows(self, batch: Batch) -> Float[Tensor, "B T C"]:
        """Return the vectors of a batch's windows."""
        return torch.from_numpy(self.vectors[batch.frame_rows])


def prepare_targets(
    data: PreparedData, space: RotationSpace, root: RootFormat, skeleton: RestSkeleton
) -> Targets:
    """Compute the arrays next to those of ``data`` unless they exist, then map them to memory."""
    stem = f"{space}-{root}"
    width = spaces.AXIS_ANGLE_MOTION_DIM if space == "axis-angle" else MOTION_DIM
    vectors, rooted = derived_arrays(
        data,
        f"targets-{stem}",
        {"format": TARGETS_FORMAT, "rest_joints": skeleton.rest_joints.tolist()},
        {f"vectors-{stem}": (width, np.float32), f"rooted-{stem}": (3 * NUM_JOINTS, np.float32)},
        _by_clip(data, space, root, skeleton),
    )
    return Targets(space, root, skeleton, vectors, rooted)


@torch.inference_mode()
def _by_clip(
    data: PreparedData, space: RotationSpace, root: RootFormat, skeleton: RestSkeleton
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    for clip in data.clips:
        rows = slice(clip.start, clip.stop)
        transl = data.transl[rows] - (data.mean_floor_position(clip) if root == "place" else 0.0)
        vectors = packing.poses_to_vectors(
            space,
            torch.from_numpy(np.array(data.poses[rows]))[None],
            torch.from_numpy(np.asarray(transl, np.float32))[None],
            root,
        )[0]
        blocks = (
            packing.decode(b[None], space, skeleton, root) for b in vectors.split(BLOCK_FRAMES)
        )
        rooted = [block.untranslated_positions[0].flatten(-2).numpy() for block in blocks]
        yield vectors.numpy(), np.concatenate(rooted)


def augmented_speech(
    config: TrainConfig, network: nn.Module, batch: Batch, generator: torch.Generator
) -> Float[Tensor, "B T dim"]:
    """Return the speech features of the whole batch, augmented in training."""
    speech = batch.speech
    if network.training and config.throats:
        speech = vocal_tract_perturbation(speech, config.throats, generator)
    if network.training and config.augment_speech:
        speech = simulate_microphone(speech, generator)
    return speech


def mask_conditions(
    config: TrainConfig,
    network: nn.Module,
    batch: Batch,
    draws: ShardedRandom,
    droppable: Sequence[str] = ("seed", "speaker", "speech"),
) -> dict[str, Tensor]:
    """Return the conditioning of this shard's windows: speech, speaker, and masks.

    The masks say for which samples speech and seed are not dropped. Dropout of the ``droppable``
    inputs is drawn in their order; others are never dropped.
    """
    everybody = torch.ones(len(batch.clip_names), dtype=torch.bool)
    conditions: dict[str, Tensor] = dict.fromkeys(
        ("seed", "speaker", "speech"), draws.shard.local_rows(everybody)
    )
    for name in droppable:
        conditions[name] = draws.keep_mask(getattr(config, f"{name}_dropout"))
    return {
        "speech": draws.shard.local_rows(augmented_speech(config, network, batch, draws.generator)),
        "speaker": draws.shard.local_rows(batch.speaker) * conditions["speaker"],
        "has_seed": conditions["seed"],
        "has_speech": conditions["speech"],
    }


def statistics_batch(data: PreparedData, window_frames: int) -> Batch:
    """Draw at most 400 windows, always the same."""
    rng = np.random.default_rng(0)
    return data.draw_windows(data.clips_of_split("train"), window_frames, WINDOWS, rng)


def fit_speech_normaliser(data: PreparedData) -> Normaliser:
    """Compute the statistics of the speech features from every hundredth frame."""
    sample = torch.from_numpy(np.array(data.speech[::100], np.float32))
    return Normaliser(sample.mean(0), sample.std(0).clamp_min(STD_FLOOR))


def prior_batches(data: PreparedData, window_frames: int) -> Iterator[Batch]:
    """Yield the windows to which a linear-Gaussian prior is fitted."""
    clips = data.clips_of_split("train")
    for k in range(PRIOR_BATCHES):
        rng = np.random.default_rng([k, 17])
        yield data.draw_windows(clips, window_frames, PRIOR_BATCH_SIZE, rng)


def fit_motion_normaliser(
    data: PreparedData,
    targets: Targets,
    window_frames: int,
    representation: VectorScaling = "normalised",
) -> Normaliser:
    """Compute the statistics of a network's target motion vectors."""
    vectors, _ = targets.for_batch(statistics_batch(data, window_frames), with_rotations=False)
    groups = AXIS_ANGLE_GROUPS if targets.space == "axis-angle" else None
    return Normaliser.fit(vectors.flatten(0, 1), representation, groups)


def fit_or_reuse_motion_prior(
    data: PreparedData, targets: Targets, shape: BranchConfig, start_weights: TrainedWeights | None
) -> tuple[Normaliser, GaussianPrior]:
    """Fit components of motion and their Gaussian prior, or return those of ``start_weights``."""
    if start_weights is not None:
        return start_weights.normaliser, start_weights.prior(shape.seed_frames)
    windows = [targets.windows(batch) for batch in prior_batches(data, shape.window_frames)]
    normaliser = fit_motion_normaliser(data, targets, shape.window_frames)
    return fit_components_and_prior(normaliser, windows, shape.seed_frames)


def fit_or_reuse_face_prior(
    data: PreparedData, shape: BranchConfig, start_weights: TrainedWeights | None = None
) -> tuple[Normaliser, GaussianPrior]:
    """Fit components of the blendshapes and their prior, or return those of ``start_weights``."""
    if start_weights is not None:
        return start_weights.normaliser, start_weights.prior(shape.seed_frames)
    windows = [batch.arkit_weights for batch in prior_batches(data, shape.window_frames)]
    units = torch.cat([batch.flatten(0, 1) for batch in windows])
    normaliser = Normaliser(units.mean(0), units.std(0).clamp_min(STD_FLOOR))
    return fit_components_and_prior(normaliser, windows, shape.seed_frames)


def fit_components_and_prior(
    normaliser: Normaliser, windows: Sequence[Float[Tensor, "N T C"]], seed_frames: int
) -> tuple[Normaliser, GaussianPrior]:
    """Add nearly uncorrelated components to the statistics, and fit their prior."""
    mean = torch.cat([batch.flatten(0, 1) for batch in windows]).mean(0)
    centred = Normaliser(mean, normaliser.std)
    mix, unmix = fit_components([centred.standardise(batch) for batch in windows])
    mixing = replace(centred, mix=mix, unmix=unmix)
    return mixing, fit_prior([mixing.normalise(batch) for batch in windows], seed_frames)
