"""Speech that arrives in blocks, cut into windows, and long motion joined from windows: how many,
where, and how two meet."""

from collections.abc import Iterable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from model.motion.rotations import interpolate_rotations


def num_windows(num_frames: int, window: int, overlap: int) -> int:
    """Windows needed to cover ``num_frames``; each starts ``window - overlap`` after the last."""
    return 1 + max(0, -(-(num_frames - window) // (window - overlap)))


def fade_weights(overlap: int) -> Float[Tensor, " overlap"]:
    """Share of the newer window on each shared frame: a minimum-jerk ramp strictly inside (0, 1).

    ``10 s^3 - 15 s^4 + 6 s^5`` starts and ends with zero slope and curvature, so a join adds
    neither a step in velocity nor one in acceleration.
    """
    s = torch.arange(1, overlap + 1) / (overlap + 1)
    return s**3 * (10 - 15 * s + 6 * s**2)


def cross_fade(
    older: tuple[Float[Tensor, "*batch S J 3 3"], Float[Tensor, "*batch S C"]],
    newer: tuple[Float[Tensor, "*batch S J 3 3"], Float[Tensor, "*batch S C"]],
) -> tuple[Float[Tensor, "*batch S J 3 3"], Float[Tensor, "*batch S C"]]:
    """The frames two windows share: rotations along the geodesic, root channels linearly.

    Args:
        older: rotations and root channels of the last ``S`` frames of the window before.
        newer: the same of the first ``S`` frames of the next one.
    """
    weight = fade_weights(older[0].shape[-4]).to(older[1])
    rotmat = interpolate_rotations(older[0], newer[0], weight[:, None])
    return rotmat, fade(older[1], newer[1])


def fade(
    older: Float[Tensor, "*batch S C"], newer: Float[Tensor, "*batch S C"]
) -> Float[Tensor, "*batch S C"]:
    """The frames two windows share of channels that may be mixed linearly."""
    return torch.lerp(older, newer, fade_weights(older.shape[-2]).to(older)[:, None])


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
