"""Our own speech encoder: codes in which one linear layer reads phones, accents, ends of phrases
and mean plans.

It has the part that WavLM has in the papers. It is trained on the corpus's exact annotation, as
many microphones hear it (`model.systems.helpers`), and is frozen for all that listen to it.
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
from model.networks.trained import Trained
from model.speech.audio import Speech
from model.speech.encoder import PHONES, SPEECH_ENCODER, TOLD, CodesConfig
from model.speech.features import MelEncoder
from model.speech.transcript import Accent

CPU = torch.device("cpu")


@dataclass(frozen=True)
class SpeechReading:
    """What is read off codes."""

    phone: Float[Tensor, "B T phones"]
    """Logits; the first is none."""
    told: Float[Tensor, "B T told"]
    """`TOLD`: logits, but for strength and speed."""


class CodesNetwork(nn.Module):
    """Dilated convolutions over `MelEncoder`'s features, and what is read off them."""

    def __init__(self, config: CodesConfig) -> None:
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
        self.told = nn.Linear(config.codes, len(TOLD))

    def codes(self, speech: Float[Tensor, "B T speech_dim"]) -> Float[Tensor, "B T codes"]:
        """Numbers from -1 to 1, from normalised features; beyond the ends the network hears
        what is usual."""
        x = self.frames(speech)
        for convolution, mixed in zip(self.around, self.mixed, strict=True):
            x = x + mixed(F.silu(convolution(F.silu(x).transpose(1, 2)).transpose(1, 2)))
        return torch.tanh(self.code(self.norm(x)))

    def forward(self, speech: Float[Tensor, "B T speech_dim"]) -> SpeechReading:
        """What is read off the codes of normalised features."""
        codes = self.codes(speech)
        return SpeechReading(self.phone(codes), self.told(codes))


@dataclass(frozen=True)
class SpeechCodes:
    """A trained network with the statistics of what it hears; never changed again."""

    network: CodesNetwork
    normaliser: Normaliser
    sha256: str

    @torch.inference_mode()
    def of(self, features: Float[Tensor, "*B T speech_dim"]) -> Float[Tensor, "*B T codes"]:
        """Codes of `MelEncoder`'s features."""
        batch = features.view(-1, *features.shape[-2:])
        codes = self.network.codes(self.normaliser.normalise(batch)).float()
        return codes.view(*features.shape[:-1], -1)


def load_codes(folder: Path, device: torch.device = CPU) -> SpeechCodes:
    """Read the encoder."""
    trained = Trained.read(folder, SPEECH_ENCODER)
    network = trained.as_of(CodesNetwork(trained.card.config(CodesConfig, "codes")))
    return SpeechCodes(network.to(device), trained.normaliser.to(device), trained.sha256)


SURE = 0.6
"""Likeliest moments are accents from here on."""
LEAST_APART = 4
"""Frames."""


def heard_accents(speech: Speech, folder: Path) -> tuple[Accent, ...]:
    """Where accents are heard; none where the encoder's weights are not in the folder.

    On 12 test clips of the corpus .97 of its accents are heard within .1 s, and .92 of what is
    heard is one; noise without any speech has one a second."""
    if not (folder / f"{SPEECH_ENCODER}.json").is_file():
        return ()
    return _accents(load_codes(folder), speech)


@torch.inference_mode()
def _accents(codes: SpeechCodes, speech: Speech) -> tuple[Accent, ...]:
    features = torch.from_numpy(MelEncoder().encode(speech.waveform, speech.num_frames))
    told = codes.network(codes.normaliser.normalise(features[None])).told[0]
    likely = torch.sigmoid(told[:, TOLD.index("accent")]).numpy()
    strength = told[:, TOLD.index("strength")].numpy()
    peaks, _ = find_peaks(likely, height=SURE, distance=LEAST_APART)
    return tuple(
        Accent(round((int(k) + 0.5) / FPS, 4), round(float(np.clip(strength[k], 0, 1)), 3))
        for k in peaks
    )
