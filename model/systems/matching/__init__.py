"""The judge of matched and mismatched speech: may import what systems may."""

from model.generation.family import Family
from model.systems.matching.config import HEARING_JUDGE, PRESETS, named_config

FAMILY = Family(
    name="matching",
    title="The judge of matched speech",
    presets=PRESETS,
    config=named_config,
    package="model.systems.matching",
    place=8,
    helpers=(HEARING_JUDGE,),
)
