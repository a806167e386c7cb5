"""Speech cut into windows, and long motion joined from windows: how many, where, and how two
meet."""

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

    @staticmethod
    def of(
        features: Float[Tensor, "T speech_dim"], first: int, frames: int, context: int
    ) -> "SpeechWindow":
        """Some frames of whole speech, from ``first`` on, with their context."""
        wanted = torch.arange(first - context, first + frames + context)
        return SpeechWindow(features[wanted.clamp(0, len(features) - 1)])

    def around(self, context: int, window: int) -> Float[Tensor, "heard speech_dim"]:
        """The middle ``window`` frames with ``context`` frames before and after."""
        spare = (len(self.speech) - window) // 2 - context
        return self.speech[spare : len(self.speech) - spare]
