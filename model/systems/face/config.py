"""Settings of the expression network."""

from dataclasses import dataclass, field, replace

from model.generation.family import Family
from model.networks.config import BranchConfig
from model.training.config import PAPER, SMOKE, TrainConfig

EXPRESSION = "expression"


@dataclass(frozen=True)
class ExpressionConfig(BranchConfig):
    """Shape of the expression network: one branch of motion blocks over blendshapes."""

    width: int = 96
    num_blocks: int = 2
    num_heads: int = 3
    speech_context: int = 20


@dataclass(frozen=True)
class FaceTrainConfig(TrainConfig):
    """Settings of a training of the expression network."""

    expression: ExpressionConfig = field(default_factory=ExpressionConfig)
    flow_time_power: float = 2.0
    """Exponent of flow times: ``u ** power`` with u uniform."""
    time_weight_floor: float | None = 0.5
    """Floor of `model.sampling.flow.flow_loss_weight`."""
    plan_dropout: float = 0.5
    """Share of windows without a plan, as for most systems; at 1 recordings need no annotation."""


def presets(system: str) -> dict[str, FaceTrainConfig]:
    """Return the settings by name."""
    config = FaceTrainConfig(system=system, steps=4000, batch_size=64, learning_rate=1e-3)
    large = replace(config.expression, width=384, num_blocks=4, num_heads=8, speech_dim=1024)
    small = replace(config.expression, width=32, num_blocks=1, num_heads=2)
    return {
        "demo": config,
        "paper": replace(config, expression=large, plan_dropout=1.0, **PAPER),
        "smoke": replace(config, expression=small, plan_dropout=1.0, **SMOKE),
    }


FAMILY = Family(
    name="face",
    title="The face",
    presets=presets,
    package="model.systems.face",
    display_order=6,
    helper_networks=(EXPRESSION,),
)
