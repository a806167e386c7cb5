"""Training of the motion autoencoders."""

import torch
from torch import nn

from model.data.prepared import Batch, PreparedData
from model.motion.decoding import decode, to_vectors
from model.motion.packing import Normaliser
from model.motion.skeleton import open_body_skeleton
from model.networks.autoencoder import MotionAutoencoder
from model.systems.autoencoders.config import AutoencoderTrainConfig
from model.training import losses
from model.training.geometric import geometric_terms
from model.training.parallel import WHOLE, Shard
from model.training.statistics import statistics_batch
from model.training.task import DescentTask, StepFunction, StepLoss, Workshop


def make_task(
    config: AutoencoderTrainConfig, data: PreparedData, workshop: Workshop
) -> DescentTask:
    """The task of one autoencoder.

    Raises:
        CheckpointError: if the weights to start from are missing, damaged or of another shape.
    """
    torch.manual_seed(config.random_seed)
    given = workshop.given()
    if given is None:
        batch = statistics_batch(data, config.window_frames, config.mirror)
        vectors = to_vectors(config.autoencoder.rotation_space, batch.poses, batch.transl)
        statistics = Normaliser.fit(vectors.flatten(0, 1), config.representation)
    else:
        statistics = given.normaliser
    normaliser = statistics.to(workshop.shard.device)
    network = MotionAutoencoder(config.autoencoder)
    if given is not None:
        given.load_into(network)
    return DescentTask(
        config, network, autoencoder_step(config, normaliser), normaliser, config.window_frames,
        shard=workshop.shard,
    )  # fmt: skip


def autoencoder_step(config: AutoencoderTrainConfig, normaliser: Normaliser) -> StepFunction:
    """The loss of a motion autoencoder: its input back, its geometry, and the codes' KL term."""
    skeleton = open_body_skeleton()
    shape = config.autoencoder
    space = shape.rotation_space

    def step(
        network: nn.Module, batch: Batch, generator: torch.Generator, shard: Shard = WHOLE
    ) -> StepLoss:
        size, num_frames = batch.poses.shape[:2]
        num_frames -= num_frames % max(shape.scales)
        vectors = to_vectors(space, shard.of(batch.poses), shard.of(batch.transl))
        vectors = vectors[:, :num_frames]
        motion = normaliser.normalise(vectors)
        hidden, noise = None, None
        if network.training:
            draw = torch.rand(size, num_frames, generator=generator)
            hidden = shard.of(draw < shape.mask_share)
            if shape.kl_weight > 0:
                noise = [
                    shard.of(torch.randn(size, num_frames // scale, shape.latent_dim,
                                         generator=generator))
                    for scale in sorted(shape.scales)
                ]  # fmt: skip
        with shard.autocast():
            restored, codes = network(motion, hidden, noise)
        restored = restored.float()
        terms = {"simple": config.loss.simple * losses.simple_loss(restored, motion)}
        terms |= geometric_terms(
            config.loss,
            decode(normaliser.restore(restored), space, skeleton),
            decode(vectors, space, skeleton),
        )
        if shape.kl_weight > 0:
            terms["kl"] = shape.kl_weight * losses.kl_loss(codes)
        return StepLoss.of({name: term.mean() for name, term in terms.items()})

    return step
