"""The speech encoder of our own, which planners hear with: may import what systems may."""

from model.generation.family import Family
from model.speech.codes import SPEECH_ENCODER
from model.systems.speech_encoder.config import PRESETS, named_config

FAMILY = Family(
    name="speech-encoder",
    title="The speech encoder",
    presets=PRESETS,
    config=named_config,
    package="model.systems.speech_encoder",
    place=9,
    helpers=(SPEECH_ENCODER,),
)
