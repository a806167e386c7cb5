"""GlobalDiff's ladder and our own system on a prior; may import the face and what systems may."""

from model.generation.family import Family, Sampler
from model.sampling.names import FLOW_SAMPLERS
from model.systems.globaldiff.config import BEST, PRESETS, SYSTEMS, named_config

STEPS = 10


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
    samplers=tuple(Sampler(name, STEPS) for name in FLOW_SAMPLERS),
    presets=PRESETS,
    config=named_config,
    package="model.systems.globaldiff",
    guidance=dict.fromkeys(SYSTEMS, 2.5),
)
