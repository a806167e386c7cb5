"""GlobalDiff's ladder and our own system on a prior; may import the face and what systems may."""

from model.generation.family import Beside, Claim, ExplainedSystem, Family, Ladder
from model.sampling.samplers import FLOW_SAMPLERS, SAMPLER_TITLES, Sampler
from model.systems.globaldiff.config import BEST, LADDER, SYSTEMS, presets

_SAMPLERS = tuple(
    Sampler(name, 10, title=SAMPLER_TITLES[name], guidance=2.5) for name in FLOW_SAMPLERS
)
_LOCAL, _GLOBAL, _FULL = "globaldiff/local", "globaldiff/global", "globaldiff/full"

_TITLE = "Five systems, each adding one thing to the one before"
_INTRODUCTION = (
    "All predict the clean motion from a noised one, the speech, the speaker and a short seed "
    "(flow matching, eq. 7), with positions supervised beside rotations. In this project everything"
    " but the rung's own step is equal: data and their order, network, windows of training, and "
    "the noise of a comparison; each was trained from nothing, on raw rotations as in the paper's "
    "code. That a step helps is the paper's claim; on your clip, the measures decide."
)
_OWN_TITLE = "And one of our own, made to move well"
_OWN_MEANING = (
    "Before any network, a linear-Gaussian model of the motion (how far, how smoothly and how long "
    "each part of the body moves) says what x₁ can be, given the noised motion and the frames "
    "before. The network adds to that what speech tells, in units of what is still open. So it "
    "moves as far and as smoothly as its data; the ladder shows what happens without."
)

_EQ_3 = r"R_k^{\text{global}} = R_1^{\text{local}} R_2^{\text{local}} \cdots R_k^{\text{local}}"
_EQ_5 = r"q_k = q_{\text{root}} + \sum_{(i \to j) \in \pi(k)} R_i^{\text{global}} (t_j - t_i)"
_JOINT = (
    r"\mathcal{L}_j = \frac{1}{KN} \sum_{k,n}"
    r" \|R_k^{\text{global}} v_k^n - R_k^{\text{gt}} v_k^n\|^2"
)
_SKELETON = (
    r"\mathcal{L}_s = \frac{1}{|\mathcal{B}|} \sum_{b,b' \in \mathcal{B}}"
    r" (b^{\text{T}} b' - \tilde{b}^{\text{T}} \tilde{b}')^2"
)
_MOTION = r"\mathcal{L}_m = \|g(\hat{X}) - g(X)\|^2"

_RUNGS = (
    ExplainedSystem(
        "globaldiff/local", "Local rotations",
        "Each joint is predicted relative to its parent. A joint's direction in the world is a "
        "product along the chain, so an error at the shoulder turns everything below it.",
        _EQ_3, "eq. 3",
        "Trembling that grows from shoulder to fingertip; a body that tilts as a whole.",
    ),
    ExplainedSystem(
        "globaldiff/global", "Global rotations",
        "Each joint is predicted in the world. A position is a sum over the chain's bones; an "
        "error at one joint moves what is below it but turns nothing else.",
        _EQ_5, "eq. 5",
        "A quieter fingertip. The price: nothing ties neighbours together, so single joints may "
        "twist against their parents.",
    ),
    ExplainedSystem(
        "globaldiff/joint", "+ joint constraint",
        "Six anchor points around each joint are turned along with it and compared. A position "
        "says nothing of a last joint's own turn; the anchors do.",
        _JOINT, "eqs. 8 to 10",
        "Thumbs and little fingers: without it they may be flipped or twisted.",
    ),
    ExplainedSystem(
        "globaldiff/skeleton", "+ skeleton constraint",
        "The angle between every two bones is compared, however far apart they are on the body.",
        _SKELETON, "eqs. 11 to 13",
        "Posture: leaning, uneven limbs and unsteady feet should become rarer.",
    ),
    ExplainedSystem(
        "globaldiff/full", "+ motion constraint",
        "A trained encoder g turns whole stretches of motion into codes at several time scales; "
        "codes of prediction and recording are compared.",
        _MOTION, "eqs. 14 and 15",
        "Timing: rhythm and dynamics over seconds, which no single frame shows.",
    ),
)  # fmt: skip

LADDER_EXPLAINED = Ladder(_TITLE, _INTRODUCTION, _RUNGS, (Beside(BEST, _OWN_TITLE, _OWN_MEANING),))


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
    samplers=dict.fromkeys(SYSTEMS, _SAMPLERS),
    presets=presets,
    package="model.systems.globaldiff",
    place=2,
    usual={
        "run": (_LOCAL, _GLOBAL, BEST),
        "steps": (_FULL, BEST),
        "hearing": (BEST, _GLOBAL),
        "hearing-tab": (BEST, _GLOBAL),
        "training": (_GLOBAL,),
        "bench-training": (_GLOBAL, _FULL),
    },
    ladder=LADDER_EXPLAINED,
    claim=Claim(
        "global rotations jerk less than local ones",
        more=_LOCAL,
        less=tuple(name for name in LADDER if name != _LOCAL),
        plain=_GLOBAL,
        full=_FULL,
        added="its constraints",
    ),
)
