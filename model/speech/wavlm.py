"""WavLM (Chen et al. 2022) and HuBERT (Hsu et al. 2021) features as GlobalDiff computes them.

Speech is cut into windows of 2 s, of which 99 vectors each are resampled to 60 frames.

Needs the ``transformers`` package and a folder with ``config.json`` and the weights, such as
``patrickvonplaten/wavlm-libri-clean-100h-large`` that GlobalDiff uses. Nothing is downloaded.
"""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from model.speech.encoder import WEIGHTS_VARIABLE, EncoderError

WINDOW_SAMPLES, WINDOW_FRAMES = 32_000, 60
SpeechModel = Callable[[Float32[np.ndarray, "n 32000"]], Float32[Tensor, "n 60 dim"]]
"""Function from windows of speech (n, 32000) to features of their frames (n, 60, dim)."""


class WavLMEncoder:
    """Encoder with WavLM's last hidden state, computed in consecutive windows."""

    name = "wavlm"

    def __init__(self, folder: Path | None = None) -> None:
        """Load weights, by default from ``WAVLM_DIR``; raises EncoderError without them."""
        folder = folder or Path(os.environ.get(WEIGHTS_VARIABLE, ""))
        if folder == Path() or not (folder / "config.json").is_file():
            raise EncoderError(
                "The speech encoder wavlm needs its weights; set WAVLM_DIR to a folder that holds "
                f"config.json and the weights (got {str(folder)!r}), or use mel64."
            )
        self._hear, self.dim = load_speech_model(folder, "WavLMModel")

    def encode(
        self, waveform: Float32[np.ndarray, " N"], num_frames: int
    ) -> Float32[np.ndarray, "num_frames dim"]:
        needed = -(-num_frames // WINDOW_FRAMES) * WINDOW_SAMPLES
        padded = np.pad(waveform[:needed], (0, max(0, needed - len(waveform))))
        return self._hear(padded.reshape(-1, WINDOW_SAMPLES)).flatten(0, 1).numpy()[:num_frames]


def load_speech_model(folder: Path, class_name: str) -> tuple[SpeechModel, int]:
    """Load a model of transformers by its class name and its folder of weights.

    Returns an encoder of windows of speech, and the feature dimension. Raises EncoderError if the
    package is not installed, or the weights cannot be read.
    """
    try:
        import transformers
    except ImportError as error:
        raise EncoderError(
            "WavLM and HuBERT need the package transformers: pip install transformers, or use the "
            "encoder mel64 or precomputed features."
        ) from error
    try:
        model = getattr(transformers, class_name).from_pretrained(folder, local_files_only=True)
    except (OSError, ValueError, RuntimeError) as error:
        raise EncoderError(
            f"The speech model in {folder} cannot be loaded: {str(error).splitlines()[0]}"
        ) from error
    network = cast(Any, model).eval().requires_grad_(False)
    path = folder / "preprocessor_config.json"
    levels = json.loads(path.read_text()).get("do_normalize", True) if path.is_file() else True

    @torch.inference_mode()
    def hear(windows: Float32[np.ndarray, "n 32000"]) -> Float32[Tensor, "n 60 dim"]:
        states = []
        for window in torch.from_numpy(windows):
            if levels:
                spread = (window.var(correction=0) + 1e-7).sqrt()
                window = (window - window.mean()) / spread
            states.append(resampled(network(window[None]).last_hidden_state))
        return torch.cat(states)

    return hear, int(network.config.hidden_size)


def resampled(features: Float[Tensor, "n source_frames dim"]) -> Float[Tensor, "n 60 dim"]:
    """Resample features to 60 frames, linearly in time with both ends aligned."""
    return torch.nn.functional.interpolate(
        features.transpose(1, 2), size=WINDOW_FRAMES, mode="linear", align_corners=True
    ).transpose(1, 2)
