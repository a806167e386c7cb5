"""Speech that arrives in blocks, cut into the windows that systems hear."""

from collections.abc import Iterable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor


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
