"""Classifier-free guidance by speech (Ho and Salimans, 2022): how strongly it is heard.

A network that now and then learned without speech can be asked twice, with it and without; what
speech changes in the answer is taken ``strength`` times. At 1 the network is as it was trained, at
0 it is deaf. Jaw and eyes stay as trained at any strength: speech decides nearly all of the jaw
already, which at a strength of 2.5 would open twice as far.
"""

import torch
from jaxtyping import Bool, Float, Shaped
from torch import Tensor

from model.motion.packing import AXIS_ANGLE_GROUPS, Normaliser, joint_channels
from model.motion.skeleton import FACE
from model.motion.spaces import RotationSpace


class SpeechGuide:
    """Takes what speech changes in predictions of clean motion ``strength`` times."""

    def __init__(self, strength: float, normaliser: Normaliser, space: RotationSpace) -> None:
        self.strength = strength
        self._normaliser = normaliser
        *_, face, _, _ = AXIS_ANGLE_GROUPS
        self._face = face if space == "axis-angle" else joint_channels(FACE)

    @property
    def asks_twice(self) -> bool:
        """Whether predictions without speech are needed."""
        return self.strength != 1

    def copies(self, size: int) -> int:
        """Of a batch of that size: those that hear come first, then those that do not."""
        return 2 * size if self.asks_twice else size

    def hears(self, size: int) -> Bool[Tensor, " B"]:
        """Of the copies of a batch, whether each hears."""
        return torch.arange(self.copies(size)) < size

    def twice(self, batch: Shaped[Tensor, "B ..."]) -> Shaped[Tensor, "_ ..."]:
        """The batch, as often as it is asked."""
        return torch.cat([batch, batch]) if self.asks_twice else batch

    def guided(self, clean: Float[Tensor, "_ T C"]) -> Float[Tensor, "B T C"]:
        """One normalised prediction of those for the copies."""
        if not self.asks_twice:
            return clean
        heard, deaf = clean.chunk(2)
        mix, unmix = self._normaliser.mix, self._normaliser.unmix
        change = heard - deaf
        if unmix is not None:
            change = change @ unmix
        change[..., self._face] = 0.0
        if mix is not None:
            change = change @ mix
        return heard + (self.strength - 1) * change
