"""Training of the motion autoencoders."""

import torch
from torch import nn

from model.data.prepared import Batch, PreparedData
from model.data.recordings import DataError
from model.motion.kinematics import open_body_skeleton
from model.motion.packing import Normaliser, decode
from model.networks.autoencoder import MotionAutoencoder, input_vectors
from model.systems.autoencoders.config import AutoencoderTrainConfig
from model.training import losses
from model.training.losses import geometric_terms
from model.training.parallel import Draws
from model.training.targets import statistics_batch
from model.training.task import DescentTask, StepLoss, TaskSetup


class AutoencoderTask(DescentTask):
    """An autoencoder's input back, its geometry, and the codes' KL term."""

    config: AutoencoderTrainConfig

    def __init__(
        self, config: AutoencoderTrainConfig, data: PreparedData, setup: TaskSetup
    ) -> None:
        given = setup.begin(config, data)
        frames = config.window_frames
        normaliser = (
            given.normaliser if given else fit_input(config, statistics_batch(data, frames))
        )
        network = MotionAutoencoder(config.autoencoder)
        super().__init__(setup, config, given, network, normaliser, frames)
        self.skeleton = open_body_skeleton()

    def loss(self, network: nn.Module, batch: Batch, draws: Draws) -> StepLoss:
        config, shape, shard = self.config, self.config.autoencoder, draws.shard
        space, body = shape.rotation_space, slice(shape.motion_channels)
        face = slice(shape.motion_channels, None)
        num_frames = batch.poses.shape[1]
        num_frames -= num_frames % max(shape.scales)
        vectors = input_vectors(
            shape, shard.of(batch.poses), shard.of(batch.transl), shard.of(batch.expression)
        )[:, :num_frames]
        seen = self.normaliser.normalise(vectors)
        hidden, noise = None, None
        if network.training:
            draw = torch.rand(draws.size, num_frames, generator=draws.generator)
            hidden = shard.of(draw < shape.mask_share)
            if shape.kl_weight > 0:
                noise = [
                    draws.noise((num_frames // scale, shape.latent_dim))
                    for scale in sorted(shape.scales)
                ]
        with shard.autocast():
            restored, codes = network(seen, hidden, noise)
        restored = restored.float()
        terms = {}
        if shape.motion_channels > 0:
            simple = losses.simple_loss(restored[..., body], seen[..., body])
            terms["simple"] = config.loss.simple * simple
            terms |= geometric_terms(
                config.loss,
                decode(self.normaliser.restore(restored)[..., body], space, self.skeleton),
                decode(vectors[..., body], space, self.skeleton),
            )
        if shape.face_channels > 0:
            pair = restored[..., face], seen[..., face]
            terms["face"] = config.loss.simple * losses.simple_loss(*pair)
            terms["face_difference"] = config.loss.simple * losses.difference_loss(*pair)
        if shape.kl_weight > 0:
            terms["kl"] = shape.kl_weight * losses.kl_loss(codes)
        return StepLoss({name: term.mean() for name, term in terms.items()})


make_task = AutoencoderTask


def fit_input(config: AutoencoderTrainConfig, batch: Batch) -> Normaliser:
    """Statistics of what the network sees. All face units share one standard deviation, as the
    channels of a body part do: one for each would blow up units that hardly move.

    Raises:
        DataError: if the network is to see faces and they never move.
    """
    shape = config.autoencoder
    vectors = input_vectors(shape, batch.poses, batch.transl, batch.expression).flatten(0, 1)
    motion, face = vectors.split([shape.motion_channels, shape.face_channels], dim=-1)
    parts = []
    if shape.motion_channels > 0:
        parts.append(Normaliser.fit(motion, config.representation))
    if shape.face_channels > 0:
        if not (face != face[0]).any():
            raise DataError(f"{config.system} learns from faces in ARKit's units; these have none.")
        parts.append(Normaliser.fit(face, groups=[range(shape.face_channels)]))
    return Normaliser(
        torch.cat([part.mean for part in parts]), torch.cat([part.std for part in parts])
    )
