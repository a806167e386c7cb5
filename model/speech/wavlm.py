"""WavLM features (Chen et al. 2022) at the motion's frame rate, from weights on this computer.

Needs the ``transformers`` package and a folder with ``config.json`` and the weights, such as
``patrickvonplaten/wavlm-libri-clean-100h-large`` that GlobalDiff uses. Nothing is downloaded.

The official code cuts the speech into 2 s clips and stretches each clip's features to 60 frames.
Here a file is encoded once, in long blocks with context on both sides, and features are read at
the exact time of each motion frame.
"""

import json
import os
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from jaxtyping import Float32, Float64

from conventions.rates import FPS, SAMPLE_RATE
from model.speech.encoder import WEIGHTS_VARIABLE, EncoderError

BLOCK_S = 10.0
CONTEXT_S = 2.0
"""Speech before and after each block that its features may see."""


class WavLMEncoder:
    """Last hidden state of WavLM, interpolated in time to the centre of each motion frame."""

    name = "wavlm"

    def __init__(
        self,
        folder: str | Path | None = None,
        block_s: float = BLOCK_S,
        context_s: float = CONTEXT_S,
    ) -> None:
        """Load the weights.

        Args:
            folder: where they are; the environment variable ``WAVLM_DIR`` if not given.
            block_s: seconds encoded at once; bounds the memory.
            context_s: seconds on either side of a block that are encoded with it.

        Raises:
            EncoderError: if the folder or the ``transformers`` package is not there.
        """
        folder = Path(folder or os.environ.get(WEIGHTS_VARIABLE, ""))
        if folder == Path("") or not (folder / "config.json").is_file():
            raise EncoderError(
                "The speech encoder wavlm needs its weights; set WAVLM_DIR to a folder that holds "
                f"config.json and the weights (got {str(folder)!r}), or use mel64."
            )
        self._model = speech_model(folder, "WavLMModel")
        config: Any = self._model.config
        self.dim = int(config.hidden_size)
        self._stride = int(np.prod(config.conv_stride))
        self._reach = _receptive_field(config.conv_kernel, config.conv_stride)
        self._normalises = normalises(folder)
        self._block = max(1, round(block_s * SAMPLE_RATE / self._stride))
        self._context = round(context_s * SAMPLE_RATE / self._stride)

    def encode(
        self, waveform: Float32[np.ndarray, " N"], num_frames: int
    ) -> Float32[np.ndarray, "num_frames dim"]:
        padded = self._prepared(waveform, num_frames)
        hidden = self._hidden_states(padded)
        # The middle of the samples that each hidden state sees, and of each motion frame.
        hidden_s = (np.arange(len(hidden)) * self._stride + (self._reach - 1) / 2) / SAMPLE_RATE
        frame_s = (np.arange(num_frames) + 0.5) / FPS
        return _interpolate(hidden, hidden_s, frame_s)

    def _prepared(
        self, waveform: Float32[np.ndarray, " N"], num_frames: int
    ) -> Float32[np.ndarray, " M"]:
        """The speech at the level WavLM expects, followed by silence up to the last frame."""
        if self._normalises and len(waveform):
            level = np.sqrt(waveform.var() + 1e-7)
            waveform = ((waveform - waveform.mean()) / level).astype(np.float32)
        needed = int(np.ceil(num_frames * SAMPLE_RATE / FPS)) + self._reach
        return np.pad(waveform, (0, max(0, needed - len(waveform))))

    def _hidden_states(self, waveform: Float32[np.ndarray, " M"]) -> Float32[np.ndarray, "H dim"]:
        """Hidden states of the whole waveform, block by block; blocks start on the stride."""
        total = (len(waveform) - self._reach) // self._stride + 1
        blocks = []
        for start in range(0, total, self._block):
            stop = min(start + self._block, total)
            first, last = max(0, start - self._context), min(total, stop + self._context)
            samples = waveform[first * self._stride : (last - 1) * self._stride + self._reach]
            with torch.inference_mode():
                inputs = torch.from_numpy(samples)[None]
                hidden = self._model(inputs).last_hidden_state[0]
            assert len(hidden) == last - first
            blocks.append(hidden[start - first : stop - first].float().numpy())
        return np.concatenate(blocks)


def speech_model(folder: Path, name: str) -> torch.nn.Module:
    """A model of transformers by the name of its class, with the weights in a folder.

    Raises:
        EncoderError: if the package is not installed, or the weights cannot be read.
    """
    try:
        import transformers
    except ImportError as error:
        raise EncoderError(
            "The package transformers is needed to hear by WavLM or HuBERT; pip install it, or use "
            "the encoder mel64, or features that were prepared."
        ) from error
    try:
        model = getattr(transformers, name).from_pretrained(folder, local_files_only=True)
    except (OSError, ValueError, RuntimeError) as error:
        raise EncoderError(
            f"The speech model in {folder} cannot be loaded: {str(error).splitlines()[0]}"
        ) from error
    return cast(torch.nn.Module, model).eval().requires_grad_(False)


def normalises(folder: Path) -> bool:
    """Whether the weights were trained on speech of zero mean and unit variance."""
    path = folder / "preprocessor_config.json"
    return bool(json.loads(path.read_text()).get("do_normalize", True)) if path.is_file() else True


def _receptive_field(
    kernels: tuple[int, ...] | list[int], strides: tuple[int, ...] | list[int]
) -> int:
    """Samples that one output of a stack of convolutions sees."""
    reach, step = 1, 1
    for kernel, stride in zip(kernels, strides, strict=True):
        reach += (kernel - 1) * step
        step *= stride
    return reach


def _interpolate(
    values: Float32[np.ndarray, "H dim"],
    at_s: Float64[np.ndarray, " H"],
    wanted_s: Float64[np.ndarray, " frames"],
) -> Float32[np.ndarray, "frames dim"]:
    """Linear in time; the first and last value hold outside."""
    position = np.interp(wanted_s, at_s, np.arange(len(at_s)))
    before = np.minimum(position.astype(np.int64), max(0, len(values) - 2))
    weight = (position - before)[:, None].astype(np.float32)
    after = np.minimum(before + 1, len(values) - 1)
    return (1 - weight) * values[before] + weight * values[after]
