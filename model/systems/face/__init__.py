"""The expression network, which every system of GlobalDiff shows: may import what systems may."""

from model.generation.family import Family
from model.systems.face.config import EXPRESSION, presets

FAMILY = Family(
    name="face",
    title="The face",
    presets=presets,
    package="model.systems.face",
    place=6,
    helpers=(EXPRESSION,),
)
