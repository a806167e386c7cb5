"""Speech features of the authors' networks: separate windows of 2 s, at the motion's rate.

Windows begin every 27,734 samples, so that 8 frames of motion lie in two of them, and the features
of a frame depend on the window. So a frame has two halves here: as one of a window's later frames,
and as one of the first 8 of a window.
"""

import json
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from model.generation.base import num_windows
from model.speech import wavlm
from model.speech.encoder import EncoderError
from model.speech.wavlm import WINDOW_FRAMES, WINDOW_SAMPLES, SpeechModel
from model.systems.official import checkpoints
from model.systems.official.checkpoints import SEED_FRAMES, SPEECH_DIM

STEP_SAMPLES = WINDOW_SAMPLES - int(16_000 / 30 * SEED_FRAMES)
ADVANCE = WINDOW_FRAMES - SEED_FRAMES
MODELS = {"wavlm": "WavLMModel", "hubert": "HubertModel"}
"""Class of the speech model in a folder, by the ``model_type`` of its config."""


class OfficialEncoder:
    """Speech encoder (`model.speech.encoder`) with two halves of 1024 numbers per frame."""

    name = "official"
    dim = 2 * SPEECH_DIM

    def __init__(self, hear: SpeechModel) -> None:
        self._hear = hear

    def encode(
        self, waveform: Float32[np.ndarray, " N"], num_frames: int
    ) -> Float32[np.ndarray, "num_frames dim"]:
        """Encode speech (`model.speech.encoder.SpeechEncoder.encode`)."""
        count = num_windows(num_frames, WINDOW_FRAMES, SEED_FRAMES)
        needed = WINDOW_SAMPLES + (count - 1) * STEP_SAMPLES
        padded = np.pad(waveform[:needed], (0, max(0, needed - len(waveform))))
        starts = [index * STEP_SAMPLES for index in range(count)]
        windows = np.stack([padded[start : start + WINDOW_SAMPLES] for start in starts])
        return windows_to_frames(self._hear(windows)).numpy()[:num_frames]


def windows_to_frames(windows: Float[Tensor, "n 60 dim"]) -> Float[Tensor, "frames both"]:
    """Arrange features of windows as two halves of each frame, as the module describes."""
    num_frames = WINDOW_FRAMES + (len(windows) - 1) * ADVANCE
    later = windows.new_zeros(num_frames, windows.shape[-1])
    for index in reversed(range(len(windows))):  # the window that a frame is late in comes last
        later[index * ADVANCE : index * ADVANCE + WINDOW_FRAMES] = windows[index]
    first = later.clone()
    for index, window in enumerate(windows):
        first[index * ADVANCE : index * ADVANCE + SEED_FRAMES] = window[:SEED_FRAMES]
    return torch.cat([later, first], dim=-1)


def frames_to_window(frames: Float[Tensor, "60 both"]) -> Float[Tensor, "60 dim"]:
    """Return the features of one window from those of its frames."""
    later, first = frames.chunk(2, dim=-1)
    return torch.cat([first[:SEED_FRAMES], later[SEED_FRAMES:]])


def official_encoder() -> OfficialEncoder:
    """Make the encoder from the speech model in a folder, or from a file of features."""
    source = checkpoints.require_speech_model_or_features()
    return OfficialEncoder(_by_model(source) if source.is_dir() else _prepared(source))


def _by_model(folder: Path) -> SpeechModel:
    """Return a function that encodes each window separately, as the authors do."""
    try:
        config = json.loads((folder / "config.json").read_text())
        kind, width = str(config.get("model_type")), int(config["hidden_size"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise EncoderError(
            f"{folder} holds no config.json of a speech model; name another with "
            "--official-features PATH."
        ) from error
    if kind not in MODELS or width != SPEECH_DIM:
        raise EncoderError(
            f"{folder} holds a {kind} with hidden size {width}; the authors' networks need a wavlm "
            f"or hubert with hidden size {SPEECH_DIM}."
        )
    return wavlm.load_speech_model(folder, MODELS[kind])[0]


def _prepared(path: Path) -> SpeechModel:
    """Return a function with the features of one speech from a file."""
    features = read_features(path)

    def hear(windows: Float32[np.ndarray, "n 32000"]) -> Float32[Tensor, "n 60 1024"]:
        needed = len(windows)
        if len(features) != needed and not (needed == 1 and len(features) == 2):
            raise EncoderError(
                f"{path.name} holds features of {len(features)} windows, but this speech has "
                f"{needed} (one begins every {STEP_SAMPLES} samples at 16 kHz); give a file of "
                "features of this speech."
            )
        return features[:needed]

    return hear


def read_features(path: Path) -> Float32[Tensor, "n 60 1024"]:
    """Read 60 or 99 vectors a window, ``features`` of .npz or an .npy; raises EncoderError."""
    try:
        loaded = np.load(path, allow_pickle=False)
        array = loaded if isinstance(loaded, np.ndarray) else loaded["features"]
    except Exception as error:  # a damaged file makes NumPy's reader raise almost anything
        raise EncoderError(
            f"{path} cannot be read as prepared features; an .npz with `features`, or an .npy, is "
            "needed."
        ) from error
    is_right = array.ndim == 3 and array.shape[1] in (WINDOW_FRAMES, 99)
    if not is_right or array.shape[2] != SPEECH_DIM or array.dtype.kind != "f":
        raise EncoderError(
            f"{path.name} holds {array.dtype} of the shape {array.shape}; features must be floats "
            f"of shape (windows, {WINDOW_FRAMES} or 99, {SPEECH_DIM})."
        )
    features = torch.from_numpy(array.astype(np.float32))
    if not features.isfinite().all():
        raise EncoderError(f"{path.name} holds features that are not finite (NaN or infinite).")
    return features if features.shape[1] == WINDOW_FRAMES else wavlm.resampled(features)
