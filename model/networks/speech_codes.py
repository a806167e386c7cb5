"""Speech encoder of this project: its codes predict phones, accents, phrase ends and mean plans.

It takes the place of WavLM in the papers. It is trained on the corpus's exact annotation with
augmentation for many microphones (`model.systems.helpers`), and frozen in all networks that use it.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from scipy.signal import find_peaks
from torch import Tensor, nn

from conventions.rates import FPS
from model.motion.packing import Normaliser
from model.networks.trained import TrainedWeights
from model.speech.audio import Speech
from model.speech.encoder import PHONES, SPEECH_ENCODER, SPEECH_LABELS, SpeechEncoderConfig
from model.speech.features import MelEncoder
from model.speech.transcript import Accent

CPU = torch.device("cpu")


@dataclass(frozen=True)
class SpeechPredictions:
    """Predictions from speech codes."""

    phone_logits: Float[Tensor, "B T phones"]
    """Logits of the phones; index 0 is no phone."""
    label_outputs: Float[Tensor, "B T labels"]
    """Predictions of `SPEECH_LABELS`: logits, but for strength and speed."""


class SpeechCodesNetwork(nn.Module):
    """Dilated convolutions over `MelEncoder`'s features, and linear outputs of their codes."""

    def __init__(self, config: SpeechEncoderConfig) -> None:
        super().__init__()
        width = config.width
        self.config = config
        self.frames = nn.Linear(config.speech_dim, width)
        self.around = nn.ModuleList(
            nn.Conv1d(width, width, 3, padding=dilation, dilation=dilation)
            for dilation in config.dilations
        )
        self.mixed = nn.ModuleList(nn.Linear(width, width) for _ in config.dilations)
        self.norm = nn.LayerNorm(width)
        self.code = nn.Linear(width, config.codes)
        self.phone = nn.Linear(config.codes, 1 + len(PHONES))
        self.told = nn.Linear(config.codes, len(SPEECH_LABELS))

    def codes(self, speech: Float[Tensor, "B T speech_dim"]) -> Float[Tensor, "B T codes"]:
        """Compute codes (-1 to 1) of normalised features; convolutions are padded with zeros."""
        x = self.frames(speech)
        for convolution, mixed in zip(self.around, self.mixed, strict=True):
            x = x + mixed(F.silu(convolution(F.silu(x).transpose(1, 2)).transpose(1, 2)))
        return torch.tanh(self.code(self.norm(x)))

    def forward(self, speech: Float[Tensor, "B T speech_dim"]) -> SpeechPredictions:
        """Predict phones and `SPEECH_LABELS` from the codes of normalised features."""
        codes = self.codes(speech)
        return SpeechPredictions(self.phone(codes), self.told(codes))


@dataclass(frozen=True)
class FrozenSpeechEncoder:
    """Trained speech encoder with the statistics of its input; its weights are constant."""

    network: SpeechCodesNetwork
    normaliser: Normaliser
    sha256: str

    @torch.inference_mode()
    def encode(self, features: Float[Tensor, "*B T speech_dim"]) -> Float[Tensor, "*B T codes"]:
        """Compute the codes of `MelEncoder`'s features."""
        batch = features.view(-1, *features.shape[-2:])
        codes = self.network.codes(self.normaliser.normalise(batch)).float()
        return codes.view(*features.shape[:-1], -1)


def load_speech_codes(folder: Path, device: torch.device = CPU) -> FrozenSpeechEncoder:
    """Load the speech encoder."""
    trained = TrainedWeights.read(folder, SPEECH_ENCODER)
    network = trained.load_into(
        SpeechCodesNetwork(trained.card.config(SpeechEncoderConfig, "codes"))
    )
    return FrozenSpeechEncoder(network.to(device), trained.normaliser.to(device), trained.sha256)


ACCENT_THRESHOLD = 0.6
"""Smallest probability of an accent's peak."""
MIN_ACCENT_DISTANCE = 4
"""Smallest distance between two accents (frames)."""


def detect_pitch_accents(speech: Speech, weights_folder: Path) -> tuple[Accent, ...]:
    """Detect pitch accents; empty without the speech encoder in the folder of weights.

    On 12 test clips of the corpus the recall is .97 within .1 s, and the precision .92; in noise
    without any speech it detects one a second.
    """
    if not (weights_folder / f"{SPEECH_ENCODER}.json").is_file():
        return ()
    return _accents(load_speech_codes(weights_folder), speech)


@torch.inference_mode()
def _accents(codes: FrozenSpeechEncoder, speech: Speech) -> tuple[Accent, ...]:
    features = torch.from_numpy(MelEncoder().encode(speech.waveform, speech.num_motion_frames))
    logits = codes.network(codes.normaliser.normalise(features[None])).label_outputs[0]
    likely = torch.sigmoid(logits[:, SPEECH_LABELS.index("accent")]).numpy()
    strength = logits[:, SPEECH_LABELS.index("strength")].numpy()
    peaks, _ = find_peaks(likely, height=ACCENT_THRESHOLD, distance=MIN_ACCENT_DISTANCE)
    return tuple(
        Accent(round((int(k) + 0.5) / FPS, 4), round(float(np.clip(strength[k], 0, 1)), 3))
        for k in peaks
    )
