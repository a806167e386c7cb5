"""The expression network: speech and speaker to face units, frame by frame.

GlobalDiff estimates expressions "directly" from audio and speaker with a shallow Transformer
encoder, because lips follow phonemes almost one to one. Deterministic; one network serves every
system, so that all of them show the same face.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from model.config import ExpressionConfig
from model.layers import sinusoidal_positions


class ExpressionNetwork(nn.Module):
    """Face unit weights (0 to 1) of each frame of a window."""

    def __init__(self, config: ExpressionConfig) -> None:
        super().__init__()
        self.config = config
        width = config.width
        self.speech_in = nn.Linear(config.speech_dim, width)
        self.local_context = nn.Conv1d(
            width, width, config.conv_kernel, padding=config.conv_kernel // 2
        )
        self.speaker = nn.Embedding(config.num_speakers, width)
        layer = nn.TransformerEncoderLayer(
            width, config.num_heads, 2 * width, dropout=0.1, activation="gelu",
            batch_first=True, norm_first=True,
        )  # fmt: skip
        self.encoder = nn.TransformerEncoder(layer, config.num_layers, enable_nested_tensor=False)
        self.out = nn.Linear(width, config.expression_dim)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)
        self.register_buffer(
            "positions", sinusoidal_positions(config.window_frames, width), persistent=False
        )

    def forward(
        self, speech: Float[Tensor, "B T speech_dim"], speaker: Int[Tensor, " B"]
    ) -> Float[Tensor, "B T expression_dim"]:
        x = self.speech_in(speech)
        x = x + nn.functional.silu(self.local_context(x.transpose(1, 2)).transpose(1, 2))
        x = x + self.positions + self.speaker(speaker)[:, None]
        return self.out(self.encoder(x))


@torch.inference_mode()
def predict_expressions(
    network: ExpressionNetwork,
    speech: Float[Tensor, "T speech_dim"],
    speaker: int,
    batch_size: int = 64,
) -> Float[Tensor, "T expression_dim"]:
    """Face units of a whole clip, from half-overlapping windows blended with a triangular weight.

    Args:
        speech: features at 30 fps, any number of frames; the ends are padded by repetition.
    """
    window = network.config.window_frames
    hop = window // 2
    num_frames = len(speech)
    num_windows = max(1, -(-num_frames // hop) + 1)
    # Half a window of padding in front, so that every frame lies in two windows.
    index = torch.arange(-hop, (num_windows - 1) * hop - hop + window)
    padded = speech[index.clamp(0, num_frames - 1)]
    windows = padded.unfold(0, window, hop).transpose(1, 2)  # (num_windows, window, speech_dim)
    ramp = (torch.arange(window) + 0.5) / hop
    weight = torch.minimum(ramp, 2 - ramp)[:, None]
    total = torch.zeros(len(padded), network.config.expression_dim)
    for first in range(0, len(windows), batch_size):
        batch = windows[first : first + batch_size]
        predicted = network(batch, torch.full((len(batch),), speaker))
        for k, one in enumerate(predicted):
            start = (first + k) * hop
            total[start : start + window] += weight * one
    return total[hop : hop + num_frames].clamp(0, 1)


@dataclass(frozen=True)
class SpeechWindow:
    """Speech and face of some frames; past the end of the speech both are held."""

    speech: Float[Tensor, "T speech_dim"]
    expressions: Float[Tensor, "T expression_dim"]
    num_frames: int
    """Frames that the speech really has."""
    is_last: bool
    """Whether the speech ends in this window."""


class ExpressionStream:
    """Cuts windows from speech that arrives in blocks, with the face that `predict_expressions`
    gives the whole of it. Keeps only what windows to come need."""

    def __init__(
        self,
        network: ExpressionNetwork,
        features: Iterable[Float[Tensor, "_ speech_dim"]],
        speaker: int,
    ) -> None:
        self.network = network
        self.speaker = speaker
        self._blocks = iter(features)
        self._kept = torch.empty(0, network.config.speech_dim)
        self._first = 0
        self._ended = False

    def window(self, start: int, length: int) -> SpeechWindow:
        """Frames ``start`` to ``start + length``, no earlier than in the call before.

        Raises:
            ValueError: if the speech has no frame there.
        """
        hop = self.network.config.window_frames // 2
        stop = start + length
        # A frame's face comes from two windows, which reach to the end of the next hop.
        needed = (-(-stop // hop) + 1) * hop
        self._read_to(needed)
        self._drop_before(max(0, (start // hop - 1) * hop))
        offset = start - self._first
        if offset >= len(self._kept):
            raise ValueError(f"The speech has no frame {start}; at least 1 more is needed.")
        visible = self._kept[: needed - self._first]
        expressions = predict_expressions(self.network, visible, self.speaker)
        index = torch.arange(offset, offset + length).clamp_max(len(visible) - 1)
        return SpeechWindow(
            speech=visible[index],
            expressions=expressions[index],
            num_frames=min(length, len(visible) - offset),
            is_last=self._ended and self._first + len(self._kept) <= stop,
        )

    def _read_to(self, frame: int) -> None:
        while not self._ended and self._first + len(self._kept) < frame:
            block = next(self._blocks, None)
            if block is None:
                self._ended = True
            else:
                self._kept = torch.cat([self._kept, block])

    def _drop_before(self, frame: int) -> None:
        self._kept = self._kept[frame - self._first :]
        self._first = frame
