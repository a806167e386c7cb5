"""Systems and settings of the family that plans first.

A planner draws gestures, nods and gaze from speech, and a motion network follows the plan.
"""

from dataclasses import dataclass, field, replace

from model.generation.family import Family
from model.sampling.samplers import make_samplers
from model.speech.encoder import SpeechEncoderConfig
from model.systems.globaldiff.config import PRIORFLOW, GlobalDiffTrainConfig, NetworkConfig
from model.systems.globaldiff.config import presets as globaldiff_presets
from model.training.config import SMOKE, VOCAL_TRACT_RANGE, TrainConfig

PLANNED = "workbench/planned"
PLANNER = "planner"


@dataclass(frozen=True)
class PlannerConfig:
    """Shape of the planner."""

    speech_dim: int = 68
    codes: int = 0
    """Dimension of the codes of `model.networks.speech_codes`, a further input; 0 for none."""
    width: int = 128
    head_width: int = 96
    dilations: tuple[int, ...] = (1, 2, 4, 8, 16)
    """Dilations of convolutions over three frames: about a second of speech on either side."""
    mixtures: int = 6
    """Number of Gaussians in a mark's mixture."""
    num_speakers: int = 31
    """Size of the speaker table; 0 stands for "no speaker"."""
    window_frames: int = 300

    @property
    def context_frames_per_side(self) -> int:
        """Frames of speech on either side."""
        return sum(self.dilations)


@dataclass(frozen=True)
class PlannerTrainConfig(TrainConfig):
    """Settings of a training of the planner."""

    planner: PlannerConfig = field(default_factory=PlannerConfig)
    speakerless: float = 0.5
    """Share of windows without speech that have no speaker either, as guidance amplifies both."""


@dataclass(frozen=True)
class PlannedNetworkConfig(NetworkConfig):
    """Shape of the motion network, and of its plan input."""

    num_kinds: int = 64
    """Largest number of gesture types."""
    kind_dim: int = 16


@dataclass(frozen=True)
class PlannedMotionTrainConfig(GlobalDiffTrainConfig):
    """Settings of a training of the motion network."""

    network: PlannedNetworkConfig = field(default_factory=PlannedNetworkConfig)
    plan_dropout: float = 0.1
    """Share of windows without a plan."""


def presets(system: str) -> dict[str, TrainConfig]:
    """Return the settings by name."""
    if system == PLANNER:
        planner = PlannerTrainConfig(
            system=system, steps=2000, batch_size=16, learning_rate=2e-3, ema_decay=0.995,
            speech_dropout=0.15, save_every=250, throats=VOCAL_TRACT_RANGE,
            planner=PlannerConfig(codes=SpeechEncoderConfig.codes),
        )  # fmt: skip
        shape = replace(planner.planner, codes=0, width=16, head_width=16, window_frames=60)
        return {"demo": planner, "smoke": replace(planner, planner=shape, **SMOKE)}
    bases = globaldiff_presets(PRIORFLOW)
    return {name: _with_plan_conditioning(bases[name], system) for name in ("demo", "smoke")}


def _with_plan_conditioning(base: GlobalDiffTrainConfig, system: str) -> PlannedMotionTrainConfig:
    shape = PlannedNetworkConfig(**vars(base.network))
    fields = {key: value for key, value in vars(base).items() if key not in ("system", "network")}
    return PlannedMotionTrainConfig(system=system, network=shape, **fields)


FAMILY = Family(
    name="planned",
    title="Plan first, then motion (our own system)",
    systems=(PLANNED,),
    descriptions={
        PLANNED: (
            "First samples a plan of gestures, nods and gaze from the speech, then generates "
            "motion that follows the plan."
        )
    },
    samplers={PLANNED: make_samplers("euler", "heun", steps=6, guidance=2.5)},
    presets=presets,
    package="model.systems.planned",
    display_order=1,
    helper_networks=(PLANNER,),
    representatives=dict.fromkeys(("motion", "speech_effect"), (PLANNED,)),
    planning_systems=(PLANNED,),
)
