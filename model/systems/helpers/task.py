"""Training of the autoencoders, of the classifier of matched speech, and of the speech encoder."""

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor, nn

from model.data.annotations import load_plan_annotations, load_speech_labels
from model.data.prepared import Batch, PreparedData
from model.data.recordings import DataError
from model.motion.kinematics import open_body_skeleton
from model.motion.packing import Normaliser, decode
from model.networks.autoencoder import MotionAutoencoder, autoencoder_input
from model.networks.speech_codes import SpeechCodesNetwork, SpeechPredictions
from model.speech.encoder import SPEECH_LABELS
from model.systems.helpers.config import (
    AutoencoderTrainConfig,
    MatchingTrainConfig,
    SpeechEncoderTrainConfig,
)
from model.systems.helpers.matching import (
    TRACKS_BY_PART,
    MatchingNetwork,
    agreement,
    centred_log_arm_speed,
    speed_and_jaw_features,
)
from model.training import losses
from model.training.config import TrainConfig
from model.training.losses import geometric_terms
from model.training.parallel import ShardedRandom
from model.training.targets import augmented_speech, fit_speech_normaliser, statistics_batch
from model.training.task import SingleNetworkTask, StepLoss, TaskSetup


def make_task(config: TrainConfig, data: PreparedData, setup: TaskSetup) -> SingleNetworkTask:
    """Make the training task for the type of the config."""
    return TASKS[type(config)](config, data, setup)


class AutoencoderTask(SingleNetworkTask):
    """Reconstruction of an autoencoder's input, with geometric terms and the codes' KL term."""

    config: AutoencoderTrainConfig

    def __init__(
        self, config: AutoencoderTrainConfig, data: PreparedData, setup: TaskSetup
    ) -> None:
        weights = setup.seed_and_read_initial_weights(config, data)
        frames = config.window_frames
        normaliser = (
            weights.normaliser
            if weights
            else fit_input_normaliser(config, statistics_batch(data, frames))
        )
        network = MotionAutoencoder(config.autoencoder)
        super().__init__(setup, config, weights, network, normaliser, frames)
        self.skeleton = open_body_skeleton()

    def loss(self, network: nn.Module, batch: Batch, draws: ShardedRandom) -> StepLoss:
        config, shape, shard = self.config, self.config.autoencoder, draws.shard
        space, body = shape.rotation_space, slice(shape.motion_channels)
        face = slice(shape.motion_channels, None)
        num_frames = batch.poses.shape[1]
        num_frames -= num_frames % max(shape.scales)
        vectors = autoencoder_input(
            shape,
            shard.local_rows(batch.poses),
            shard.local_rows(batch.transl),
            shard.local_rows(batch.arkit_weights),
        )[:, :num_frames]
        normalised = self.normaliser.normalise(vectors)
        hidden, noise = None, None
        if network.training:
            draw = torch.rand(draws.batch_size, num_frames, generator=draws.generator)
            hidden = shard.local_rows(draw < shape.mask_share)
            if shape.kl_weight > 0:
                noise = [
                    draws.noise((num_frames // scale, shape.latent_dim))
                    for scale in sorted(shape.scales)
                ]
        with shard.autocast():
            restored, codes = network(normalised, hidden, noise)
        restored = restored.float()
        terms = {}
        if shape.motion_channels > 0:
            simple = losses.simple_loss(restored[..., body], normalised[..., body])
            terms["simple"] = config.loss.simple * simple
            terms |= geometric_terms(
                config.loss,
                decode(self.normaliser.restore(restored)[..., body], space, self.skeleton),
                decode(vectors[..., body], space, self.skeleton),
            )
        if shape.face_channels > 0:
            pair = restored[..., face], normalised[..., face]
            terms["face"] = config.loss.simple * losses.simple_loss(*pair)
            terms["face_difference"] = config.loss.simple * losses.first_difference_loss(*pair)
        if shape.kl_weight > 0:
            terms["kl"] = shape.kl_weight * losses.kl_loss(codes)
        return StepLoss({name: term.mean() for name, term in terms.items()})


def fit_input_normaliser(config: AutoencoderTrainConfig, batch: Batch) -> Normaliser:
    """Compute the statistics of the network's input.

    All blendshapes share one standard deviation, like a body part's channels: separate ones would
    amplify units that hardly move. Raises DataError if the network needs faces and they never move.
    """
    shape = config.autoencoder
    vectors = autoencoder_input(shape, batch.poses, batch.transl, batch.arkit_weights).flatten(0, 1)
    motion, face = vectors.split([shape.motion_channels, shape.face_channels], dim=-1)
    parts = []
    if shape.motion_channels > 0:
        parts.append(Normaliser.fit(motion, config.representation))
    if shape.face_channels > 0:
        if not (face != face[0]).any():
            raise DataError(
                f"{config.system} needs faces as ARKit blendshapes, but no face in this data moves."
            )
        parts.append(Normaliser.fit(face, groups=[range(shape.face_channels)]))
    return Normaliser(
        torch.cat([part.mean for part in parts]), torch.cat([part.std for part in parts])
    )


TRACK_STD_FLOOR = 0.01
"""Smallest standard deviation of a track, so that a still jaw is not amplified."""


class SpeechMotionMatchingTask(SingleNetworkTask):
    """Contrastive training of matching speech and motion for each part, and of arm speed.

    All pieces of the batch are candidates (InfoNCE, van den Oord et al. 2018; in both directions as
    in CLIP). Several processes compare the pieces of their own shares.
    """

    config: MatchingTrainConfig

    def __init__(self, config: MatchingTrainConfig, data: PreparedData, setup: TaskSetup) -> None:
        weights = setup.seed_and_read_initial_weights(config, data)
        normaliser = (
            weights.normaliser
            if weights
            else fit_track_normaliser(
                speed_and_jaw_features(statistics_batch(data, config.piece_frames).poses)
            )
        )
        network = MatchingNetwork(config.matching)
        super().__init__(
            setup, config, weights, network, normaliser, config.pieces * config.piece_frames
        )

    def loss(self, network: nn.Module, batch: Batch, draws: ShardedRandom) -> StepLoss:
        config, shard = self.config, draws.shard

        def pieces(x: Float[Tensor, "B T C"]) -> Float[Tensor, "N P C"]:
            return x.unflatten(1, (config.pieces, config.piece_frames)).flatten(0, 1)

        with torch.no_grad():
            tracks = self.normaliser.normalise(
                speed_and_jaw_features(shard.local_rows(batch.poses))
            )
            speech = shard.local_rows(augmented_speech(config, network, batch, draws.generator))
        with shard.autocast():
            speech_tracks, motion_tracks_encoded, speed, log_scale = network(
                pieces(speech), pieces(tracks)
            )
        terms, shares = {}, {}
        for part, scale in zip(TRACKS_BY_PART, log_scale.exp(), strict=True):
            agreements = agreement(motion_tracks_encoded[part].float(), speech_tracks[part].float())
            terms[part] = contrastive_loss(scale * agreements)
            shares[f"{part}_share_right"] = pairwise_matching_accuracy(agreements.detach())
        wanted = centred_log_arm_speed(pieces(tracks))
        error = (speed.float() - wanted).square().mean() / wanted.square().mean().clamp_min(1e-6)
        terms["arm_speed"] = config.arm_speed_weight * error
        return StepLoss(terms, shares)


def fit_track_normaliser(tracks: Float[Tensor, "N T tracks"]) -> Normaliser:
    """Compute the statistics of `speed_and_jaw_features`."""
    flat = tracks.flatten(0, 1)
    return Normaliser(flat.mean(0), flat.std(0).clamp_min(TRACK_STD_FLOOR))


def contrastive_loss(scores: Float[Tensor, "N N"]) -> Float[Tensor, ""]:
    """Compute the cross-entropy of the diagonal, over rows and over columns."""
    own = torch.arange(len(scores), device=scores.device)
    return (F.cross_entropy(scores, own) + F.cross_entropy(scores.T, own)) / 2


def pairwise_matching_accuracy(agreements: Float[Tensor, "N N"]) -> Float[Tensor, ""]:
    """Compute how often a motion (row) agrees more with its own than with another speech."""
    own = agreements.diagonal()[:, None]
    others = ~torch.eye(len(agreements), dtype=torch.bool, device=agreements.device)
    return (own > agreements)[others].float().mean()


_NUMBERS = ("strength", "speed")
"""Entries of `SPEECH_LABELS` that are not logits."""


class SpeechEncoderTask(SingleNetworkTask):
    """Training of the speech encoder with one loss per prediction (`prediction_losses`)."""

    config: SpeechEncoderTrainConfig

    def __init__(
        self, config: SpeechEncoderTrainConfig, data: PreparedData, setup: TaskSetup
    ) -> None:
        weights, shape = setup.seed_and_read_initial_weights(config, data), config.codes
        self.spoken = load_speech_labels(
            data, load_plan_annotations(data, 1 + max(data.speaker_names))
        )
        network = SpeechCodesNetwork(shape)
        normaliser = weights.normaliser if weights else fit_speech_normaliser(data)
        super().__init__(
            setup,
            config,
            weights,
            network,
            normaliser,
            config.window_frames,
            shape.context_frames_per_side,
        )

    def loss(self, network: nn.Module, batch: Batch, draws: ShardedRandom) -> StepLoss:
        config, shard = self.config, draws.shard
        with torch.no_grad():
            features = shard.local_rows(augmented_speech(config, network, batch, draws.generator))
            speech = self.normaliser.normalise(features)
            phone, labels = (
                shard.local_rows(part) for part in self.spoken.phones_and_labels(batch)
            )
        with shard.autocast():
            reading = network(speech)
        inside = slice(
            config.codes.context_frames_per_side,
            speech.shape[1] - config.codes.context_frames_per_side,
        )
        predictions = SpeechPredictions(
            reading.phone_logits[:, inside].float(), reading.label_outputs[:, inside].float()
        )
        right = (predictions.phone_logits.argmax(-1) == phone).float().mean()
        return StepLoss(prediction_losses(predictions, phone, labels), {"phones_right": right})


def prediction_losses(
    predictions: SpeechPredictions, phone: Int[Tensor, "B T"], labels: Float[Tensor, "B T labels"]
) -> dict[str, Float[Tensor, ""]]:
    """Compute cross-entropies, and squared errors of strength (at accents) and speed."""
    losses = {"phone": F.cross_entropy(predictions.phone_logits.flatten(0, 1), phone.flatten())}
    for number, name in enumerate(SPEECH_LABELS):
        predicted, wanted = predictions.label_outputs[..., number], labels[..., number]
        if name not in _NUMBERS:
            losses[name] = F.binary_cross_entropy_with_logits(predicted, wanted)
            continue
        counts = (
            labels[..., SPEECH_LABELS.index("accent")]
            if name == "strength"
            else torch.ones_like(predicted)
        )
        losses[name] = ((predicted - wanted).square() * counts).sum() / counts.sum().clamp_min(1)
    return losses


TASKS: dict[type[TrainConfig], type] = {
    AutoencoderTrainConfig: AutoencoderTask,
    MatchingTrainConfig: SpeechMotionMatchingTask,
    SpeechEncoderTrainConfig: SpeechEncoderTask,
}
