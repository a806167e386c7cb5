"""Training of the judge of matched and mismatched speech."""

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from model.data.prepared import Batch, PreparedData
from model.motion.packing import Normaliser
from model.systems.matching.config import MatchingTrainConfig
from model.systems.matching.network import (
    PARTS,
    MatchingNetwork,
    agreement,
    arm_speed,
    motion_tracks,
)
from model.training.parallel import Draws
from model.training.targets import heard, statistics_batch
from model.training.task import DescentTask, StepLoss, TaskSetup

STD_FLOOR = 0.01
"""Of a track: a jaw that never moves is not blown up."""


class MatchingTask(DescentTask):
    """For each part, the cross-entropy of finding the speech of a motion, and the motion of a
    speech, among all pieces of the batch (InfoNCE, van den Oord et al. 2018; in both directions as
    in CLIP); and the error of the arms' log speed told from speech.

    Several processes compare the pieces of their own shares.
    """

    config: MatchingTrainConfig

    def __init__(self, config: MatchingTrainConfig, data: PreparedData, setup: TaskSetup) -> None:
        given = setup.begin(config, data)
        normaliser = (
            given.normaliser
            if given
            else fit_tracks(motion_tracks(statistics_batch(data, config.piece_frames).poses))
        )
        network = MatchingNetwork(config.matching)
        super().__init__(
            setup, config, given, network, normaliser, config.pieces * config.piece_frames
        )

    def loss(self, network: nn.Module, batch: Batch, draws: Draws) -> StepLoss:
        config, shard = self.config, draws.shard

        def pieces(x: Float[Tensor, "B T C"]) -> Float[Tensor, "N P C"]:
            return x.unflatten(1, (config.pieces, config.piece_frames)).flatten(0, 1)

        with torch.no_grad():
            tracks = self.normaliser.normalise(motion_tracks(shard.of(batch.poses)))
            speech = shard.of(heard(config, network, batch, draws.generator))
        with shard.autocast():
            heard_tracks, seen_tracks, told, log_scale = network(pieces(speech), pieces(tracks))
        terms, shares = {}, {}
        for part, scale in zip(PARTS, log_scale.exp(), strict=True):
            agreements = agreement(heard_tracks[part].float(), seen_tracks[part].float())
            terms[part] = contrastive_loss(scale * agreements)
            shares[f"{part}_share_right"] = share_right(agreements.detach())
        wanted = arm_speed(pieces(tracks))
        error = (told.float() - wanted).square().mean() / wanted.square().mean().clamp_min(1e-6)
        terms["arm_speed"] = config.arm_speed_weight * error
        return StepLoss(terms, shares)


make_task = MatchingTask


def fit_tracks(tracks: Float[Tensor, "N T tracks"]) -> Normaliser:
    """Statistics of `motion_tracks`."""
    flat = tracks.flatten(0, 1)
    return Normaliser(flat.mean(0), flat.std(0).clamp_min(STD_FLOOR))


def contrastive_loss(scores: Float[Tensor, "N N"]) -> Float[Tensor, ""]:
    """Cross-entropy of the diagonal, over rows and over columns."""
    own = torch.arange(len(scores), device=scores.device)
    return (F.cross_entropy(scores, own) + F.cross_entropy(scores.T, own)) / 2


def share_right(agreements: Float[Tensor, "N N"]) -> Float[Tensor, ""]:
    """How often a motion (row) agrees more with its own speech than with another of the batch."""
    own = agreements.diagonal()[:, None]
    others = ~torch.eye(len(agreements), dtype=torch.bool, device=agreements.device)
    return (own > agreements)[others].float().mean()
