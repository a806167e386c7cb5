"""GlobalDiff's ladder and our own system on a prior; may import the face and what systems may."""

from model.generation.family import Claim, Family
from model.sampling.samplers import FLOW_SAMPLERS, SAMPLER_TITLES, Sampler
from model.systems.globaldiff.config import BEST, LADDER, PRESETS, SYSTEMS, named_config
from model.systems.globaldiff.ladder import EXPLAINED

STEPS = 10
_LOCAL, _GLOBAL, _FULL = "globaldiff/local", "globaldiff/global", "globaldiff/full"


FAMILY = Family(
    name="globaldiff",
    title="GlobalDiff, and one of our own",
    systems=SYSTEMS,
    about={
        BEST: "Made to move well: the paper's network on a linear-Gaussian model of the motion.",
        "globaldiff/local": "Rotations of each joint in its parent.",
        "globaldiff/global": "Rotations of each joint in the world.",
        "globaldiff/joint": "Global, and the joint structure constraint.",
        "globaldiff/skeleton": "Joint, and the skeleton structure constraint.",
        "globaldiff/full": "Skeleton, and the temporal structure constraint.",
    },
    samplers=tuple(Sampler(name, STEPS, title=SAMPLER_TITLES[name]) for name in FLOW_SAMPLERS),
    presets=PRESETS,
    config=named_config,
    package="model.systems.globaldiff",
    place=2,
    guidance=dict.fromkeys(SYSTEMS, 2.5),
    usual={
        "run": (_LOCAL, _GLOBAL, BEST),
        "steps": (_FULL, BEST),
        "hearing": (BEST, _GLOBAL),
        "hearing-tab": (BEST, _GLOBAL),
        "first-look": (BEST,),
        "training": (_GLOBAL,),
        "bench-training": (_GLOBAL, _FULL),
        "bench-busy": (_LOCAL, _GLOBAL, _FULL),
        "bench-browser": (BEST, _LOCAL, _GLOBAL, _FULL),
    },
    ladder=EXPLAINED,
    claim=Claim(
        "global rotations jerk less than local ones",
        more=_LOCAL,
        less=tuple(name for name in LADDER if name != _LOCAL),
        plain=_GLOBAL,
        full=_FULL,
        added="its constraints",
    ),
)
