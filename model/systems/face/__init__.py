"""The expression network, which every system of GlobalDiff shows: may import what systems may."""

from model.generation.family import Family
from model.systems.face.config import EXPRESSION, PRESETS, named_config

FAMILY = Family(
    name="face",
    title="The face",
    presets=PRESETS,
    config=named_config,
    package="model.systems.face",
    place=6,
    helpers=(EXPRESSION,),
)
