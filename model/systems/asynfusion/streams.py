"""Statistics of the two streams of motion, face and body: how each is normalised, and its prior."""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from model.data.prepared import PreparedData
from model.motion.packing import AXIS_ANGLE_GROUPS, Normaliser
from model.sampling.prior import GaussianPrior
from model.systems.asynfusion.config import DualBranchConfig
from model.training.statistics import fit_face_prior, prior_batches, with_components
from model.training.targets import Targets

_FACE = ".face."


@dataclass(frozen=True)
class Stream:
    """One of the two."""

    normaliser: Normaliser
    prior: GaussianPrior

    def tensors(self) -> dict[str, Tensor]:
        """As saved with trained weights."""
        return self.normaliser.tensors() | {"prior.covariance": self.prior.covariance}

    @staticmethod
    def of_tensors(tensors: Mapping[str, Tensor], seed_frames: int) -> "Stream":
        """The inverse of `tensors`.

        Raises:
            KeyError: if there is none among them.
        """
        prior = GaussianPrior(tensors["prior.covariance"], seed_frames)
        return Stream(Normaliser.of_tensors(tensors), prior)


Streams = tuple[Stream, Stream]
"""Of the expression branch and of the gesture branch."""


def face_tensors(stream: Stream) -> dict[str, Tensor]:
    """The face's statistics under names that leave the usual ones to the body."""
    return {name.replace(".", _FACE, 1): tensor for name, tensor in stream.tensors().items()}


def read_streams(tensors: Mapping[str, Tensor], seed_frames: int) -> Streams:
    """Both, as saved.

    Raises:
        KeyError: if one of them is not there.
    """
    face = {name.replace(_FACE, ".", 1): t for name, t in tensors.items() if _FACE in name}
    return Stream.of_tensors(face, seed_frames), Stream.of_tensors(tensors, seed_frames)


def fit_streams(config: DualBranchConfig, data: PreparedData, targets: Targets) -> Streams:
    """Components of face and body and their priors, from windows of the training split."""
    bodies = [targets.windows(batch) for batch in prior_batches(data, config.window_frames)]
    vectors: Float[Tensor, "N C"] = torch.cat([body.flatten(0, 1) for body in bodies])
    body = Normaliser.fit(vectors, groups=AXIS_ANGLE_GROUPS)
    return (
        Stream(*fit_face_prior(data, config)),
        Stream(*with_components(body, bodies, config.seed_frames)),
    )
