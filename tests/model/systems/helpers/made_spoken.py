"""Annotated speech, and a tiny encoder trained on it."""

from pathlib import Path

import torch

from model.motion.packing import Normaliser
from model.networks.speech_codes import SpeechCodesNetwork
from model.plan.annotation_files import NamedTier
from model.speech.encoder import SPEECH_ENCODER, SpeechEncoderConfig
from model.systems.helpers.config import SpeechEncoderTrainConfig
from tests.model.made import make_data_folder, save_made
from tests.model.plan.made import HANDS, grid, tier

TINY_CODES = SpeechEncoderConfig(width=16, codes=8, dilations=(1, 2))
SPOKEN = (
    tier("words", (0.2, 0.7, "whole"), (0.7, 1.0, "of"), (1.5, 2.0, "other")),
    tier("phones", (0.2, 0.4, "hh"), (0.4, 0.7, "OW1"), (0.7, 1.0, "pau"), (1.5, 2, "er")),
    tier("accents", (0.5, "0.800"), (1.8, "0.300")),
)


def make_spoken_folder(folder: Path, *tiers: NamedTier) -> Path:
    """Made recordings with what is said and done in three seconds beside each."""
    make_data_folder(folder)
    (folder / "textgrid").mkdir()
    for path in (folder / "wave16k").iterdir():
        told = grid(*(tiers or SPOKEN), *HANDS)
        (folder / "textgrid" / f"{path.stem}.TextGrid").write_text(told)
    return folder


def make_encoder_weights(folder: Path) -> Path:
    """Random weights with a complete card."""
    torch.manual_seed(2)
    statistics = Normaliser(torch.zeros(68), torch.ones(68)).tensors()
    config = SpeechEncoderTrainConfig(system=SPEECH_ENCODER, codes=TINY_CODES)
    save_made(folder, config, SpeechCodesNetwork(TINY_CODES), statistics)
    return folder
