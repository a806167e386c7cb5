"""The expression network, which every system of GlobalDiff shows: may import what systems may."""

from model.systems.face.config import EXPRESSION, PRESETS, named_config
from model.systems.family import Family

FAMILY = Family(
    name="face",
    systems=(),
    about={},
    samplers=(),
    presets=PRESETS,
    config=named_config,
    package="model.systems.face",
    helpers=(EXPRESSION,),
)
