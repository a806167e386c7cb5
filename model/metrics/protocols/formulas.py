"""Formulas of the protocols that are measured from one clip at a time."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from model.metrics.protocols import genea
from model.metrics.protocols.alignment import BeatAlignVariant, workbench_beat_sums
from model.metrics.protocols.clip import Clip, Sums, mean_values
from model.metrics.protocols.coverage import coverage_sums
from model.metrics.protocols.face import face_squared_error_sums, face_velocity_error_sums
from model.metrics.protocols.physical import physical_plausibility_sums
from model.metrics.protocols.semantics import SemanticRelevanceRecall
from model.metrics.protocols.table import PROTOCOLS
from model.metrics.reference_error import l1_distance_to_mean


@dataclass(frozen=True)
class Formula:
    """Function from a clip to its sums, empty if it is too short, and from added sums to values."""

    sums: Callable[[Clip], Sums]
    evaluate: Callable[[Mapping[str, np.ndarray]], dict[str, float]] = mean_values


def l1_diversity_sums(clip: Clip) -> Sums:
    """Compute the L1 distance to the mean pose of a clip."""
    return {
        "count": np.array(1.0),
        "l1_diversity_m": np.array(l1_distance_to_mean(clip.pelvis_aligned)),
    }


FORMULAS: Mapping[str, Formula] = {
    "beats/workbench": Formula(partial(workbench_beat_sums, mean_speed_source="reference")),
    "beats/workbench-own": Formula(partial(workbench_beat_sums, mean_speed_source="own")),
    "beats/workbench-emage": Formula(partial(workbench_beat_sums, mean_speed_source="emage")),
    "beats/emage": Formula(
        BeatAlignVariant(threshold_over_mean_speed=0.3, margin_frames=60, mimics_trainer=True)
    ),
    "beats/evaltools": Formula(
        BeatAlignVariant(
            threshold_over_mean_speed=0.1, margin_frames=60, ignores_root_rotation=True
        )
    ),
    "beats/raggesture": Formula(
        BeatAlignVariant(threshold_over_mean_speed=0.3, margin_frames=10, max_frames=300)
    ),
    "l1div/emage": Formula(l1_diversity_sums),
    "physical/mbench": Formula(physical_plausibility_sums),
    "gac/unicamp": Formula(coverage_sums),
    "srgr/beat": Formula(SemanticRelevanceRecall(threshold_m=0.1, norm=2)),
    "srgr/raggesture": Formula(SemanticRelevanceRecall(threshold_m=0.3, norm=1)),
    "hellinger/genea": Formula(genea.speed_histogram_sums, genea.hellinger_distance),
    "cca/genea": Formula(genea.canonical_correlation_sums),
    "mse_face/emage": Formula(face_squared_error_sums),
    "lvd/emage": Formula(face_velocity_error_sums),
}
"""Formulas by id."""


def protocol_sums(clip: Clip, with_metrics_measured_elsewhere: bool = False) -> dict[str, Sums]:
    """Compute the sums of a clip for all protocols that have their inputs, by id.

    Metrics of this program that other code measures are included only on request.
    """
    sums = {
        name: formula.sums(clip)
        for name, formula in FORMULAS.items()
        if (with_metrics_measured_elsewhere or not PROTOCOLS[name].is_own_metric)
        and all(getattr(clip, need) is not None for need in PROTOCOLS[name].required_inputs)
    }
    return {name: each for name, each in sums.items() if each}


def protocol_values(sums: Mapping[str, Sums]) -> dict[str, dict[str, float]]:
    """Return the values of added sums by id and name."""
    return {name: FORMULAS[name].evaluate(each) for name, each in sums.items()}
