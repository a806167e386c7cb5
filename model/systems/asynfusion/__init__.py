"""AsynFusion: face and body by two branches that hear each other; may import what systems may."""

from model.generation.family import Family
from model.sampling.samplers import SAMPLER_TITLES, Sampler
from model.systems.asynfusion.config import (
    DDIM,
    LCM_ASYNC,
    LCM_SYNC,
    SYSTEMS,
    presets,
)

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
    presets=presets,
    package="model.systems.asynfusion",
    place=3,
    samplers={
        DDIM: (Sampler("ddim", 25, 25, SAMPLER_TITLES["ddim"], guidance=2.5),),
        LCM_SYNC: (Sampler("lcm", 8, 8, "LCM", guidance=2.5),),
        LCM_ASYNC: (Sampler("lcm", 8, 4, "LCM", guidance=2.5),),
    },
    shared_weights={LCM_ASYNC: LCM_SYNC},
    usual=dict.fromkeys(("steps", "hearing-tab"), (LCM_ASYNC,)),
    face_steps_help="AsynFusion draws face and body apart; 0 is what it usually takes.",
)
