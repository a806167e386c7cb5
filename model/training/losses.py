"""Loss terms of prediction and target, on vectors and on joint positions.

Terms return one value per sample, so that the flow's time weights can be applied outside.
"""

import math
from collections.abc import Callable, Mapping, Sequence

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from conventions.joints import JOINT_INDEX
from model.motion.packing import DecodedMotion
from model.training.config import GeometricWeights

FEET = [JOINT_INDEX[f"{side}_{part}"] for side in ("left", "right") for part in ("ankle", "foot")]
CONTACT_SPEED_M = 0.002
"""Step (m) below which a foot counts as standing: 6 cm/s."""
SMOOTH_L1_BETA = 0.02
"""Distance (m) at which the position terms turn from squared to absolute error (official code)."""


def simple_loss(x_1: Float[Tensor, "B T C"], target: Float[Tensor, "B T C"]) -> Float[Tensor, " B"]:
    """Compute GlobalDiff eq. 7: mean squared error of the clean motion, normalised channels."""
    return (x_1 - target).square().mean((1, 2))


def points_loss(
    positions: Float[Tensor, "B T P 3"], target: Float[Tensor, "B T P 3"], order: int = 0
) -> Float[Tensor, " B"]:
    """Compute L_pos: smooth L1 error of points in metres (joints through forward kinematics).

    With an order above 0, that of differences, metres per frame^order (official code only).
    """
    a, b = positions.diff(n=order, dim=1), target.diff(n=order, dim=1)
    return F.smooth_l1_loss(a, b, beta=SMOOTH_L1_BETA, reduction="none").mean((1, 2, 3))


def contact_loss(
    positions: Float[Tensor, "B T 55 3"], target: Float[Tensor, "B T 55 3"]
) -> Float[Tensor, " B"]:
    """Compute squared horizontal steps (cm²) of ankles and feet that stand in the target."""
    still = target[:, :, FEET].diff(dim=1).norm(dim=-1) < CONTACT_SPEED_M
    steps = 100 * positions[:, :, FEET][..., [0, 2]].diff(dim=1)
    return (steps.square().sum(-1) * still).mean((1, 2))


def kl_loss(
    codes: Sequence[tuple[Float[Tensor, "B _ _"], Float[Tensor, "B _ _"]]],
) -> Float[Tensor, " B"]:
    """Compute the KL divergence of (mean, log-variance) of each scale from a standard normal."""
    by_scale = [
        0.5 * (mean.square() + log_var.exp() - 1 - log_var).mean((1, 2)) for mean, log_var in codes
    ]
    return torch.stack(by_scale).sum(0)


def first_difference_loss(
    x_1: Float[Tensor, "B T C"], target: Float[Tensor, "B T C"]
) -> Float[Tensor, " B"]:
    """Compute the mean squared error of first differences, normalised channels."""
    return simple_loss(x_1.diff(dim=1), target.diff(dim=1))


def finite_or_raise(numbers: dict[str, float], step: int, clips: list[str]) -> None:
    """Raise FloatingPointError with step and clips if a loss or gradient is not finite."""
    for name, value in numbers.items():
        if not math.isfinite(value):
            clips = list(dict.fromkeys(clips))
            raise FloatingPointError(
                f"The {name} is {value} at step {step}; clips in the batch: {', '.join(clips)}."
            )


def geometric_terms(
    weights: GeometricWeights, predicted: DecodedMotion, target: DecodedMotion
) -> dict[str, Float[Tensor, " B"]]:
    """Compute the weighted terms on positions, one value per sample, without those of weight 0."""
    world = predicted.positions, target.positions
    positions = positions_to_compare(weights, predicted, target)
    terms = {
        "position": lambda: points_loss(*positions),
        "velocity": lambda: points_loss(*positions, 1),
        "acceleration": lambda: points_loss(*positions, 2),
        "contact": lambda: contact_loss(*world),
    }
    return weighted_terms(weights, terms)


def positions_to_compare(
    weights: GeometricWeights, predicted: DecodedMotion, target: DecodedMotion
) -> tuple[Float[Tensor, "B T 55 3"], Float[Tensor, "B T 55 3"]]:
    """Return the joint positions to compare: in world coordinates, or pelvis-aligned."""
    if weights.rooted:
        return predicted.untranslated_positions, target.untranslated_positions
    return predicted.positions, target.positions


def weighted_terms(
    weights: GeometricWeights, terms: Mapping[str, Callable[[], Float[Tensor, " B"]]]
) -> dict[str, Float[Tensor, " B"]]:
    """Compute each term times the weight of its name, without those of weight 0."""
    return {
        name: getattr(weights, name) * term()
        for name, term in terms.items()
        if getattr(weights, name) > 0
    }
