"""AsynFusion: face and body by two branches that hear each other; may import what systems may."""

from model.generation.family import Family, Sampler
from model.systems.asynfusion.config import (
    DDIM,
    LCM_ASYNC,
    LCM_SYNC,
    PRESETS,
    SYSTEMS,
    named_config,
)


def _few_steps(face: int, body: int) -> tuple[Sampler, ...]:
    names = "lcm", "lcm-recomputed", "lcm-blend"
    return tuple(Sampler(name, body, face) for name in names)


FAMILY = Family(
    name="asynfusion",
    systems=SYSTEMS,
    about={
        DDIM: "Face and body side by side, 25 steps each.",
        LCM_SYNC: "The same, distilled to 8 steps each.",
        LCM_ASYNC: "The same distilled network; the face takes half as many steps as the body.",
    },
    samplers=(),
    presets=PRESETS,
    config=named_config,
    package="model.systems.asynfusion",
    own_samplers={
        DDIM: (Sampler("ddim", 25, 25), Sampler("ddim-blend", 25, 25)),
        LCM_SYNC: _few_steps(8, 8),
        LCM_ASYNC: _few_steps(4, 8),
    },
    shared_weights={LCM_ASYNC: LCM_SYNC},
)
