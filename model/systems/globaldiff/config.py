"""Systems of GlobalDiff's ablation with explanations, and their settings."""

from dataclasses import dataclass, field, replace
from typing import Any

from model.generation.family import Ablation, AblationStep, Claim, Family, NonAblationSystem
from model.motion.spaces import RootFormat, RotationSpace, VectorScaling
from model.networks.config import BranchConfig
from model.sampling.samplers import FLOW_SAMPLERS, make_samplers
from model.training.config import PAPER, SMOKE, GeometricWeights, TrainConfig


@dataclass(frozen=True)
class NetworkConfig(BranchConfig):
    """Shape of the two-branch motion network (GlobalDiff, "Overall Structure")."""

    rotation_space: RotationSpace = "global"
    """Format of rotations: global as in GlobalDiff; axis-angle is nearest to Gaussian, for a
    network that extends the linear-Gaussian denoiser (`model.sampling.prior`)."""
    root: RootFormat = "velocity"
    """Format of root motion; with absolute positions ("place") the body returns to its home."""

    @property
    def has_prior(self) -> bool:
        """True if the network has a linear-Gaussian prior."""
        return self.rotation_space == "axis-angle"

    @property
    def motion_dim(self) -> int:
        """Channels of a motion vector: 55 rotations and the root."""
        return 55 * (3 if self.has_prior else 6) + 3


@dataclass(frozen=True)
class GlobalDiffLossWeights(GeometricWeights):
    """Weights of the training terms; a term of weight 0 is not computed."""

    seed: float = 1.0
    """Extra weight of eq. 7 on the frames that repeat the seed pose."""
    joint: float = 0.0
    """Weight of L_j: anchors turned with each joint (GlobalDiff eqs. 8 to 10), metres squared."""
    skeleton: float = 0.0
    """Weight of L_s: cosines between bones (GlobalDiff eqs. 11 to 13)."""
    motion: float = 0.0
    """Weight of L_m: codes of the frozen variational encoder (GlobalDiff eqs. 14 and 15)."""
    time_weight_floor: float | None = 0.5
    """Constant of the sample weight 1 / ((1 - t)^2 + it), scaled to mean 1, which raises late steps
    of the flow, on which smoothness depends. None: equal weights."""


@dataclass(frozen=True)
class GlobalDiffTrainConfig(TrainConfig):
    """Settings of a training of an ablation step, or of this project's system."""

    system: str = "globaldiff/global"
    network: NetworkConfig = field(default_factory=NetworkConfig)
    representation: VectorScaling = "normalised"
    """Scaling of motion vectors by body-part group, or none."""
    loss: GlobalDiffLossWeights = field(default_factory=GlobalDiffLossWeights)
    flow_time_power: float = 2.0
    """Exponent applied to uniform flow times: above 1 more are early, where speech decides."""


@dataclass(frozen=True)
class AblationRow:
    """One row of the paper's Table 2: its training's additions to L_simple and L_pos."""

    rotation_space: RotationSpace
    constraints: tuple[str, ...] = ()
    """Fields of `GlobalDiffLossWeights` that get their weight from `CONSTRAINT_WEIGHTS`."""


ABLATION: dict[str, AblationRow] = {
    "globaldiff/local": AblationRow("local"),
    "globaldiff/global": AblationRow("global"),
    "globaldiff/joint": AblationRow("global", ("joint",)),
    "globaldiff/skeleton": AblationRow("global", ("joint", "skeleton")),
    "globaldiff/full": AblationRow("global", ("joint", "skeleton", "motion")),
}
"""Ablation steps in the order of the paper's Table 2; each adds one thing to the one before."""

PRIORFLOW = "workbench/priorflow"
"""This project's system: blocks of the paper's network on a Gaussian prior
(`model.sampling.prior`). It is in this family because it shares networks, training and sampling."""

SYSTEMS: tuple[str, ...] = (PRIORFLOW, *ABLATION)
"""Names of all systems of the family, in the order of display."""

CONSTRAINT_WEIGHTS: dict[str, float] = {"joint": 900.0, "skeleton": 3.0, "motion": 0.045}
"""Weights at which each constraint has 0.4 times the gradient of the other terms together, measured
on a trained `globaldiff/global`. The official weights suit raw errors, and the paper gives none;
eq. 10 is in metres squared at 5 cm, hence its large factor."""


def presets(system: str) -> dict[str, GlobalDiffTrainConfig]:
    """Return one system's settings: ``demo``, ``paper`` or ``smoke``.

    ``demo`` has the size of the bundled weights and trains in one stage; how the bundled files were
    trained is in docs/experiments/training.md. ``paper`` has the paper's size, ``smoke`` the least.
    """
    config = _best() if system == PRIORFLOW else _ablation_step(system)
    large = replace(
        config.network, width=384, num_blocks=6, num_heads=8, conv_kernel=0, speech_dim=1024
    )
    least = replace(config.network, width=48, num_blocks=1, num_heads=2)
    return {
        "demo": config,
        "paper": replace(config, network=large, **PAPER),
        "smoke": replace(config, network=least, **SMOKE),
    }


def _ablation_step(system: str) -> GlobalDiffTrainConfig:
    """Return the settings of an ablation step, with the paper's losses and raw 6D as in its code.

    Flow times are uniform and equal in weight. 600,000 windows are half an hour on a processor.
    """
    row = ABLATION[system]
    weights: dict[str, Any] = {name: CONSTRAINT_WEIGHTS[name] for name in row.constraints}
    return GlobalDiffTrainConfig(
        system=system,
        representation="raw",
        network=NetworkConfig(
            rotation_space=row.rotation_space, width=96, num_blocks=2, num_heads=3
        ),
        loss=GlobalDiffLossWeights(
            velocity=0.0, acceleration=0.0, time_weight_floor=None, **weights
        ),
        flow_time_power=1.0,
        batch_size=64,
        steps=9400,
        learning_rate=8e-4,
        save_every=500,
        validate_every=1000,
    )


def _best() -> GlobalDiffTrainConfig:
    """Return the settings of this project's system; see docs/experiments/priorflow.md."""
    return GlobalDiffTrainConfig(
        system=PRIORFLOW,
        network=NetworkConfig(
            rotation_space="axis-angle", num_blocks=4, speech_context=40, root="place"
        ),
        loss=GlobalDiffLossWeights(
            velocity=30.0, acceleration=30.0, contact=0.5, rooted=True, seed=0.0,
            time_weight_floor=0.1,
        ),
        batch_size=64,
        steps=7000,
        learning_rate=1e-3,
        ema_decay=0.998,
        save_every=500,
        validate_every=1000,
    )  # fmt: skip


_LOCAL, _GLOBAL, _FULL = "globaldiff/local", "globaldiff/global", "globaldiff/full"

_TITLE = "Five systems, each adding one thing to the one before"
_INTRODUCTION = (
    "All predict the clean motion from a noised one, the speech, the speaker and a short seed pose "
    "(flow matching, eq. 7), with losses on positions as well as rotations. In this project, "
    "everything except the added part is the same: data and their order, network, training "
    "windows, and the initial noise in a comparison. Each was trained from random weights, on "
    "unnormalised 6D rotations as in the paper's code. The paper claims that "
    "each step helps; the metrics show whether it does on your clip."
)
_OWN_TITLE = "Our own system"
_OWN_MEANING = (
    "A linear-Gaussian prior of the motion (range, smoothness and duration of each body part's "
    "movement) gives the distribution of the clean motion given the noised one and the previous "
    "frames. The network predicts what the speech adds, in units of the posterior standard "
    "deviation. The generated motion therefore has the range and smoothness of the training data; "
    "the systems of the ablation have no such prior."
)

_EQ_3 = r"R_k^{\text{global}} = R_1^{\text{local}} R_2^{\text{local}} \cdots R_k^{\text{local}}"
_EQ_5 = r"q_k = q_{\text{root}} + \sum_{(i \to j) \in \pi(k)} R_i^{\text{global}} (t_j - t_i)"
_JOINT = (
    r"\mathcal{L}_j = \frac{1}{KN} \sum_{k,n}"
    r" \|R_k^{\text{global}} v_k^n - R_k^{\text{gt}} v_k^n\|^2"
)
_SKELETON = (
    r"\mathcal{L}_s = \frac{1}{|\mathcal{P}|} \sum_{(b,b') \in \mathcal{P}}"
    r" (b^{\text{T}} b' - \tilde{b}^{\text{T}} \tilde{b}')^2"
)
_MOTION = r"\mathcal{L}_m = \|g(\hat{X}) - g(X)\|^2"

_STEPS = (
    AblationStep(
        "globaldiff/local", "Local rotations",
        "Each joint is predicted relative to its parent. A joint's global rotation is the "
        "product of the local rotations along the chain, so an error at the shoulder rotates "
        "everything below it.",
        _EQ_3, "eq. 3",
        "Tremor that grows from shoulder to fingertip; a body that tilts as a whole.",
    ),
    AblationStep(
        "globaldiff/global", "Global rotations",
        "Each joint is predicted in world coordinates. A position is a sum over the chain's bones; "
        "an error at one joint moves the joints below it but does not rotate them.",
        _EQ_5, "eq. 5",
        "Less fingertip jitter. In exchange, neighbouring joints are not coupled, so a joint may "
        "twist against its parent.",
    ),
    AblationStep(
        "globaldiff/joint", "+ joint constraint",
        "Six anchor points around each joint rotate with it and are compared with those of the "
        "recording. The position of the last joint of a chain does not show its own rotation; the "
        "anchors do.",
        _JOINT, "eqs. 8 to 10",
        "Thumbs and little fingers: without the constraint they may be flipped or twisted.",
    ),
    AblationStep(
        "globaldiff/skeleton", "+ skeleton constraint",
        "The angle between every two bones (all pairs P) is compared with the recording, however "
        "far apart the bones are on the body.",
        _SKELETON, "eqs. 11 to 13",
        "Posture: leaning, limbs held unevenly and unsteady feet should become rarer.",
    ),
    AblationStep(
        "globaldiff/full", "+ motion constraint",
        "A trained encoder g turns whole stretches of motion into codes at several time scales; "
        "codes of prediction and recording are compared.",
        _MOTION, "eqs. 14 and 15",
        "Timing: rhythm and dynamics over seconds, which no single frame shows.",
    ),
)  # fmt: skip

ABLATION_EXPLAINED = Ablation(
    _TITLE, _INTRODUCTION, _STEPS, (NonAblationSystem(PRIORFLOW, _OWN_TITLE, _OWN_MEANING),)
)


FAMILY = Family(
    name="globaldiff",
    title="GlobalDiff, and a system of our own",
    systems=SYSTEMS,
    descriptions={
        PRIORFLOW: "GlobalDiff's network blocks with a linear-Gaussian prior of the motion.",
        "globaldiff/local": "Predicts each joint's rotation relative to its parent.",
        "globaldiff/global": "Predicts each joint's rotation in world coordinates.",
        "globaldiff/joint": "Global rotations plus the joint constraint (L_j).",
        "globaldiff/skeleton": "As globaldiff/joint, plus the skeleton constraint (L_s).",
        "globaldiff/full": "As globaldiff/skeleton, plus the motion constraint (L_m).",
    },
    samplers=dict.fromkeys(SYSTEMS, make_samplers(*FLOW_SAMPLERS, steps=10, guidance=2.5)),
    presets=presets,
    package="model.systems.globaldiff",
    display_order=2,
    representatives={
        "motion": (_LOCAL, _GLOBAL, PRIORFLOW),
        "sampling_steps": (_FULL, PRIORFLOW),
        "speech_effect": (PRIORFLOW, _GLOBAL),
        "training": (_GLOBAL, _FULL),
    },
    ablation=ABLATION_EXPLAINED,
    claim=Claim(
        less_jerk_property="global rotations",
        more_jerk_property="local rotations",
        more_jerk_system=_LOCAL,
        less_jerk_systems=tuple(name for name in ABLATION if name != _LOCAL),
        first_less_jerk_system=_GLOBAL,
        additions_name="constraints",
    ),
)
