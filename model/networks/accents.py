"""Accents of speech, as our own speech encoder hears them."""

from pathlib import Path

import numpy as np
import torch
from scipy.signal import find_peaks

from conventions.rates import FPS
from model.networks.speech_codes import SpeechCodes, load_codes
from model.speech.audio import Speech
from model.speech.codes import SPEECH_ENCODER, TOLD
from model.speech.features import MelEncoder
from model.speech.transcript import Accent

SURE = 0.6
"""Likeliest moments are accents from here on."""
LEAST_APART = 4
"""Frames."""


def heard_accents(speech: Speech, folder: Path) -> tuple[Accent, ...]:
    """Where accents are heard; none where the encoder's weights are not in the folder.

    On 12 test clips of the corpus .97 of its accents are heard within .1 s, and .92 of what is
    heard is one; noise without any speech has one a second.

    Raises:
        CheckpointError: if its weights are damaged.
    """
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
