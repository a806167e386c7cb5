"""The two branches asked with speech and without, so that what speech changes counts more."""

from collections.abc import Sequence
from dataclasses import dataclass

from jaxtyping import Bool, Float, Int
from torch import Tensor

from model.sampling.guidance import SpeechGuide
from model.systems.asynfusion.network import GESTURE, DualBranchNetwork, FeatureBuffer, Pair, both


@dataclass(frozen=True)
class GuidedNetwork:
    """A network whose body is guided by speech; its face stays as trained. Asked twice, both
    branches of the copies that do not hear are deaf, as they were in training."""

    network: DualBranchNetwork
    guide: SpeechGuide

    def evaluate(
        self,
        active: Sequence[int],
        x_t: Pair,
        t: Pair,
        buffer: FeatureBuffer,
        *,
        heard: Float[Tensor, "copies T width"],
        seed: Pair,
        speaker: Int[Tensor, " B"],
        has_seed: Bool[Tensor, " B"],
    ) -> dict[int, Float[Tensor, "B T C"]]:
        """See `DualBranchNetwork.evaluate`.

        Args:
            buffer: holds features of all copies.
            heard: tokens of the speech, then those of none where the guide asks twice.
        """
        twice = self.guide.twice
        found = self.network.evaluate(
            active, both(twice, x_t), both(twice, t), buffer,
            heard=heard, seed=both(twice, seed), speaker=twice(speaker), has_seed=twice(has_seed),
        )  # fmt: skip
        return {
            which: self.guide.guided(clean) if which == GESTURE else clean[: len(speaker)]
            for which, clean in found.items()
        }
