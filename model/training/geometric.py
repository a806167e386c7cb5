"""Weighted training terms on what motion vectors mean in the world."""

from collections.abc import Callable, Mapping

from jaxtyping import Float
from torch import Tensor

from model.motion.decoding import Decoded
from model.training import losses
from model.training.config import GeometricWeights


def geometric_terms(
    weights: GeometricWeights, predicted: Decoded, target: Decoded
) -> dict[str, Float[Tensor, " B"]]:
    """The weighted terms on positions, one value per sample; those of weight 0 are left out."""
    world = predicted.positions, target.positions
    positions = positions_of(weights, predicted, target)
    terms = {
        "position": lambda: losses.position_loss(*positions),
        "velocity": lambda: losses.velocity_loss(*positions),
        "acceleration": lambda: losses.acceleration_loss(*positions),
        "contact": lambda: losses.contact_loss(*world),
    }
    return weighted(weights, terms)


def positions_of(
    weights: GeometricWeights, predicted: Decoded, target: Decoded
) -> tuple[Float[Tensor, "B T 55 3"], Float[Tensor, "B T 55 3"]]:
    """Joint positions that are compared: in the world, or with the pelvis in place."""
    if weights.rooted:
        return predicted.rooted, target.rooted
    return predicted.positions, target.positions


def weighted(
    weights: GeometricWeights, terms: Mapping[str, Callable[[], Float[Tensor, " B"]]]
) -> dict[str, Float[Tensor, " B"]]:
    """Each term times the weight of its name; those of weight 0 are neither computed nor told."""
    return {
        name: getattr(weights, name) * term()
        for name, term in terms.items()
        if getattr(weights, name) > 0
    }
