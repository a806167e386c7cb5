"""Classifier-free guidance by speech (Ho and Salimans, 2022): how strongly it is heard.

A network that now and then learned without speech can be asked twice, with it and without; what
speech changes in the answer is taken ``strength`` times. At 1 the network is as it was trained, at
0 it is deaf. In the head, jaw and eyes stay as trained at any strength: speech decides nearly all
of the jaw already, which at a strength of 2.5 would open twice as far.
"""

import torch
from jaxtyping import Bool, Float, Shaped
from torch import Tensor

from conventions.joints import FACE, JOINT_INDEX
from model.motion.packing import Normaliser, joint_channels
from model.motion.rotations import matrix_from_rot6d
from model.motion.spaces import RotationSpace

HEAD = (JOINT_INDEX["neck"], JOINT_INDEX["head"])


class SpeechGuide:
    """Takes what speech changes in predictions of clean motion ``strength`` times.

    Args:
        of_head: how many times in neck and head; None as elsewhere.
    """

    def __init__(
        self,
        strength: float,
        normaliser: Normaliser,
        space: RotationSpace,
        of_head: float | None = None,
    ) -> None:
        self.strength = strength
        self._of_head = strength if of_head is None else of_head
        self._normaliser = normaliser
        self._space = space
        numbers = 3 if space == "axis-angle" else 6
        self._face, self._head = (
            [numbers * joint + k for joint in joints for k in range(numbers)]
            for joints in (FACE, HEAD)
        )

    @property
    def asks_twice(self) -> bool:
        """Whether predictions without speech are needed."""
        return self.strength != 1 or self._of_head != 1

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
        more = change.new_full(change.shape[-1:], self.strength - 1)
        more[self._head] = self._of_head - 1
        change = more * change
        change[..., self._face] = self._carried(heard, change)
        if mix is not None:
            change = change @ mix
        return heard + change

    def _carried(
        self, heard: Float[Tensor, "B T C"], change: Float[Tensor, "B T C"]
    ) -> Float[Tensor, "B T face"] | float:
        """What the head's change does to the channels of jaw and eyes, which stay as they are in
        it: nothing where they are told in the head's frame. Rows of a rotation in the world are
        the head's rows times the rotation in the head."""
        if self._space != "global":
            return 0.0
        head = joint_channels((JOINT_INDEX["head"],))
        std = self._normaliser.std
        world = self._normaliser.restore(heard)
        of_head, of_face = (
            matrix_from_rot6d(world[..., channels].unflatten(-1, (-1, 6)))
            for channels in (head, self._face)
        )
        rows = (change[..., head] * std[head]).unflatten(-1, (1, 2, 3))
        return (rows @ (of_head.mT @ of_face)).flatten(-3) / std[self._face]
