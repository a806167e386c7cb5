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
    title="AsynFusion: face and body that hear each other",
    systems=SYSTEMS,
    about={
        DDIM: "Two networks side by side, one for the face and one for the body; after every block "
        "each reads what the other has made of it so far. 25 diffusion steps each.",
        LCM_SYNC: "Distilled from it: 8 steps that lead where many small ones would.",
        LCM_ASYNC: "The same distilled network. The face takes 4 steps while the body takes 8; in "
        "between, the body reads what the face was at last.",
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
    guidance=dict.fromkeys(SYSTEMS, 2.5),
    shared_weights={LCM_ASYNC: LCM_SYNC},
)
