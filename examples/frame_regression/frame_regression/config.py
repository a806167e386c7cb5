"""The regression's systems, samplers and settings."""

from dataclasses import dataclass, replace
from pathlib import Path

from model.generation.family import Family
from model.sampling.samplers import SamplerChoice
from model.training.config import SMOKE, TrainConfig

MEAN, DRAWN = "regression/mean", "regression/drawn"


@dataclass(frozen=True)
class RegressionConfig(TrainConfig):
    """One training of the regression."""

    width: int = 64


def presets(system: str) -> dict[str, RegressionConfig]:
    """Settings by name."""
    config = RegressionConfig(
        system, augmented_copies=0, steps=2000, batch_size=32, learning_rate=2e-3
    )
    return {"tiny": config, "smoke": replace(config, **SMOKE, width=8)}


FAMILY = Family(
    name="regression",
    title="Regression, from a package",
    systems=(MEAN, DRAWN),
    descriptions={
        MEAN: "The pose that is expected with each sound: the mean of many gestures.",
        DRAWN: "The same with smooth noise, as large as the error that the mean leaves.",
    },
    samplers={
        MEAN: (SamplerChoice("mean", 1, title="The mean, without noise"),),
        DRAWN: (SamplerChoice("smoothed", 3, title="Noise, smoothed once a step"),),
    },
    presets=presets,
    package="frame_regression",
    shared_weights={DRAWN: MEAN},
    shipped_weights_folder=Path(__file__).parent / "weights",
)
