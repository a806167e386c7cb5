"""GlobalDiff's three structure constraints, pure functions that return one value per sample."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from conventions.joints import PARENTS

ANCHOR_DISTANCE_M = 0.05
SHORTEST_BONE_M = 1e-4
"""A bone below this length has no direction."""


def octahedron_anchors() -> Float[Tensor, "6 3"]:
    """N = 6 anchors, one on each half axis of a joint's frame, 5 cm from it (official code)."""
    axes = torch.eye(3)
    return ANCHOR_DISTANCE_M * torch.cat([axes, -axes])


def joint_structure_loss(
    rotmat: Float[Tensor, "B T J 3 3"],
    target: Float[Tensor, "B T J 3 3"],
    anchors: Float[Tensor, "N 3"],
) -> Float[Tensor, " B"]:
    """L_j, GlobalDiff eqs. 8 to 10: squared distance of turned anchors, in metres squared.

    ``v_hat = R v`` (eq. 8) and ``v_tilde = R_gt v`` (eq. 9); the mean over joints, anchors and
    frames of ``|v_hat - v_tilde|^2`` (eq. 10). A joint's position does not enter.

    Args:
        rotmat: global rotations. With anchors that span space, zero means equal rotations.
    """
    turned = (rotmat - target) @ anchors.to(rotmat).T  # (B, T, J, 3, N)
    return turned.square().sum(-2).mean((1, 2, 3))


def bone_directions(
    positions: Float[Tensor, "*batch J 3"],
) -> tuple[Float[Tensor, "*batch bones 3"], Float[Tensor, "*batch bones"]]:
    """Unit vectors from parents to joints (GlobalDiff eq. 11), and each bone's length in metres.

    A degenerate bone gets the zero vector.
    """
    bones = positions[..., 1:, :] - positions[..., list(PARENTS[1:]), :]
    length = bones.square().sum(-1).clamp_min(1e-18).sqrt()
    is_valid = length > SHORTEST_BONE_M
    safe = torch.where(is_valid, length, torch.ones_like(length))
    return bones / safe[..., None] * is_valid[..., None], length


def skeleton_structure_loss(
    positions: Float[Tensor, "B T J 3"],
    target: Float[Tensor, "B T J 3"],
) -> Float[Tensor, " B"]:
    """L_s, GlobalDiff eq. 13: mean squared difference of the cosines between every two bones (the
    angular matrix D D^T of eq. 12), over valid pairs.

    Valid are the ordered pairs of two different bones that have a direction in prediction and
    target. The matrices are never formed: with D and E the masked directions, S = D + E and
    M = D - E,

        |D D^T - E E^T|^2 = (tr(S^T S M^T M) + tr(M^T S M^T S)) / 2

    holds for any number of bones, needs 3 x 3 products only, and loses no digits where the two are
    nearly equal.
    """
    predicted, length = bone_directions(positions)
    wanted, wanted_length = bone_directions(target)
    is_valid = (length > SHORTEST_BONE_M) & (wanted_length > SHORTEST_BONE_M)
    predicted, wanted = predicted * is_valid[..., None], wanted * is_valid[..., None]
    total, difference = predicted + wanted, predicted - wanted

    def gram(a: Tensor, b: Tensor) -> Float[Tensor, "B T 3 3"]:
        return a.transpose(-1, -2) @ b

    cross = gram(difference, total)
    squared = (
        (gram(total, total) * gram(difference, difference)).sum((-1, -2))
        + (cross * cross.transpose(-1, -2)).sum((-1, -2))
    ) / 2
    count = is_valid.sum(-1)
    pairs = (count * (count - 1)).clamp_min(1)
    return (squared / pairs).mean(-1)


def temporal_structure_loss(
    codes: Sequence[Float[Tensor, "B _ dim"]],
    target: Sequence[Float[Tensor, "B _ dim"]],
) -> Float[Tensor, " B"]:
    """L_m, GlobalDiff eq. 15: squared distance of the codes of two motions.

    Args:
        codes: ``z = g(X)`` (eq. 14), one tensor for each scale of the encoder; every scale counts
            alike, as the mean over its numbers.
    """
    squared = [(a - b).square().mean((1, 2)) for a, b in zip(codes, target, strict=True)]
    return torch.stack(squared).sum(0)
