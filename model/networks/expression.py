"""The expression network: speech and speaker to face units, drawn and not averaged.

GlobalDiff estimates expressions "directly" from audio, because lips follow phonemes almost one to
one. Lids and brows do not: the best estimate of a blink is a face that never blinks. So the face is
drawn by flow matching like the body, in the same windows, on a linear-Gaussian prior of its own.
One network serves every system, so that all of them show the same face.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from model.motion.packing import Normaliser
from model.networks.prior_network import PriorNetwork
from model.sampling.flow import seeded_noise
from model.storage.settings import ExpressionConfig

FACE_STEPS = 12


@dataclass(frozen=True)
class Face:
    """A trained expression network with the statistics of its units."""

    network: PriorNetwork
    normaliser: Normaliser
    sha256: str

    @property
    def config(self) -> ExpressionConfig:
        assert isinstance(self.network.config, ExpressionConfig)
        return self.network.config

    @torch.inference_mode()
    def draw(
        self,
        speech: Float[Tensor, "B heard speech_dim"],
        speaker: int,
        seed: Float[Tensor, "B S E"] | None,
        noise: Float[Tensor, "B T E"],
    ) -> tuple[Float[Tensor, "B T E"], Float[Tensor, "B S E"]]:
        """Windows of face units, and the seeds of the windows that follow them.

        Args:
            seed: normalised last frames of the windows before, as this returned them; None where
                a face begins.
        """
        size = len(speech)
        known = torch.zeros_like(noise[:, : self.config.seed_frames]) if seed is None else seed
        conditions = {
            "speech": speech,
            "seed": known,
            "speaker": torch.full((size,), speaker),
            "has_seed": torch.full((size,), seed is not None),
            "has_speech": torch.ones(size, dtype=torch.bool),
        }

        def predict(x_t: Tensor, t: float) -> Tensor:
            return self.network(x_t, torch.full((size,), t), **conditions)

        x_1 = self.network.prior.sample(predict, noise, seed, steps=FACE_STEPS)
        units = self.normaliser.restore(x_1).clamp(0, 1)
        return units, self.normaliser.normalise(units[:, -self.config.seed_frames :])

    def noise(self, seed: int, window: int) -> Float[Tensor, "1 T E"]:
        """The same for every system and length."""
        shape = 1, self.config.window_frames, self.config.expression_dim
        return seeded_noise([seed, 1, window], shape)


@dataclass(frozen=True)
class SpeechWindow:
    """The speech under some frames and around them; past either end it is held."""

    speech: Float[Tensor, "heard speech_dim"]
    num_frames: int
    """Frames that the speech really has."""
    is_last: bool
    """Whether the speech ends in this window."""

    def around(self, context: int, window: int) -> Float[Tensor, "heard speech_dim"]:
        """The middle ``window`` frames with ``context`` frames before and after."""
        spare = (len(self.speech) - window) // 2 - context
        return self.speech[spare : len(self.speech) - spare]


class SpeechStream:
    """Cuts windows from speech that arrives in blocks; keeps only what windows to come need."""

    def __init__(self, features: Iterable[Float[Tensor, "_ speech_dim"]], context: int) -> None:
        self.context = context
        self._blocks = iter(features)
        self._kept: Float[Tensor, "_ speech_dim"] | None = None
        self._first = 0
        self._ended = False

    def window(self, start: int, length: int) -> SpeechWindow:
        """Frames ``start`` to ``start + length`` with the context, no earlier than before.

        Raises:
            ValueError: if the speech has no frame there.
        """
        self._read_to(start + length + self.context)
        self._drop_before(max(0, start - self.context))
        if self._kept is None or start - self._first >= len(self._kept):
            raise ValueError(f"The speech has no frame {start}; at least 1 more is needed.")
        end = self._first + len(self._kept)
        wanted = torch.arange(start - self.context, start + length + self.context)
        return SpeechWindow(
            speech=self._kept[(wanted - self._first).clamp(0, len(self._kept) - 1)],
            num_frames=min(length, end - start),
            is_last=self._ended and end <= start + length,
        )

    def _read_to(self, frame: int) -> None:
        while not self._ended and self._end() < frame:
            block = next(self._blocks, None)
            if block is None:
                self._ended = True
            else:
                self._kept = block if self._kept is None else torch.cat([self._kept, block])

    def _end(self) -> int:
        return self._first + (0 if self._kept is None else len(self._kept))

    def _drop_before(self, frame: int) -> None:
        if self._kept is not None:
            self._kept = self._kept[frame - self._first :]
            self._first = frame
