"""Our own system that plans first: a planner draws gestures, nods and looks from speech, and the
motion network follows the plan it is given. May import GlobalDiff's family and what systems may.
"""

from model.generation.family import Family
from model.sampling.samplers import SAMPLER_TITLES, Sampler
from model.systems.planned.config import PLANNED, PLANNER, presets

FAMILY = Family(
    name="planned",
    title="Plan first, of our own",
    systems=(PLANNED,),
    about={
        PLANNED: "Plans gestures, nods and looks from the speech first, then moves as planned.",
    },
    samplers={
        PLANNED: tuple(
            Sampler(name, 6, title=SAMPLER_TITLES[name], guidance=2.5) for name in ("euler", "heun")
        )
    },
    presets=presets,
    package="model.systems.planned",
    place=1,
    helpers=(PLANNER,),
    usual=dict.fromkeys(("run", "hearing", "hearing-tab"), (PLANNED,)),
    plans=(PLANNED,),
)
