"""Rotation representations and the conventions of the whole project.

Conventions, stated here once:

* Column vectors: ``R @ v`` rotates ``v``; ``R_a_c = R_a_b @ R_b_c``.
* Right-handed world, y up, the body faces +z and its left side is +x. Metres, radians, seconds.
* 30 frames per second of motion, 16 kHz mono speech.
* ``axis_angle (..., 3)``: unit axis times angle in radians.
* ``quat_wxyz (..., 4)``: unit quaternion, scalar first; what this module returns has w >= 0.
* ``rot6d (..., 6)``: the first two **rows** of the matrix, flattened (as PyTorch3D, BEAT2's
  baselines and GlobalDiff do). 30 degrees about z is
  ``[0.8660254, -0.5, 0, 0.5, 0.8660254, 0]``.

All functions take any leading batch, keep dtype and device, are exact to the dtype's precision
near angle 0 and near pi, and have finite gradients at the identity.
"""

import torch
from jaxtyping import Float
from torch import Tensor

_SERIES_BELOW = 1e-5
"""Squared angle below which three terms of the power series are exact in float64."""


def matrix_from_axis_angle(axis_angle: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    """Compute Rodrigues' formula, ``I + sin(a)/a K + (1 - cos(a))/a^2 K^2``, K = cross product."""
    angle_sq = axis_angle.square().sum(-1)[..., None, None]
    is_small = angle_sq < _SERIES_BELOW
    angle = torch.where(is_small, torch.ones_like(angle_sq), angle_sq).sqrt()
    sin_factor = torch.where(
        is_small, 1 - angle_sq / 6 + angle_sq.square() / 120, torch.sin(angle) / angle
    )
    # 1 - cos(a) = 2 sin(a/2)^2 keeps its digits for small a.
    cos_factor = torch.where(
        is_small,
        0.5 - angle_sq / 24 + angle_sq.square() / 720,
        2 * (torch.sin(angle / 2) / angle).square(),
    )
    x, y, z = axis_angle.unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1)
    cross = cross.unflatten(-1, (3, 3))
    identity = torch.eye(3, dtype=axis_angle.dtype, device=axis_angle.device)
    return identity + sin_factor * cross + cos_factor * (cross @ cross)


def axis_angle_from_matrix(rotmat: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch 3"]:
    """Convert to axis times angle, with the angle in [0, pi]; at pi the sign is arbitrary."""
    return axis_angle_from_quat_wxyz(quat_wxyz_from_matrix(rotmat))


def axis_angle_from_quat_wxyz(quat_wxyz: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 3"]:
    """Convert unit quaternions of either sign to axis times angle, with the angle in [0, pi]."""
    quat_wxyz = torch.where(quat_wxyz[..., :1] < 0, -quat_wxyz, quat_wxyz)
    w, vector = quat_wxyz[..., :1], quat_wxyz[..., 1:]
    sin_half_sq = vector.square().sum(-1, keepdim=True)
    is_small = sin_half_sq < _SERIES_BELOW
    sin_half = torch.where(is_small, torch.ones_like(sin_half_sq), sin_half_sq).sqrt()
    safe_w = torch.where(is_small, w, torch.ones_like(w))
    tan_half_sq = sin_half_sq / safe_w.square()
    factor = torch.where(
        is_small,
        2 / safe_w * (1 - tan_half_sq / 3 + tan_half_sq.square() / 5),
        2 * torch.atan2(sin_half, w) / sin_half,
    )
    return factor * vector


def quat_wxyz_from_matrix(rotmat: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch 4"]:
    """Convert to a unit quaternion with w >= 0 (Shepperd 1978: divide by the largest part).

    Each of the four candidates is 4 q_k q, linear in the matrix; the one with the largest q_k is
    well conditioned at every angle.
    """
    rows = rotmat.unbind(-2)
    (m00, m01, m02), (m10, m11, m12), (m20, m21, m22) = (row.unbind(-1) for row in rows)
    yz, zx, xy = m21 - m12, m02 - m20, m10 - m01
    candidates = torch.stack(
        [
            torch.stack([1 + m00 + m11 + m22, yz, zx, xy], dim=-1),
            torch.stack([yz, 1 + m00 - m11 - m22, m10 + m01, m02 + m20], dim=-1),
            torch.stack([zx, m10 + m01, 1 - m00 + m11 - m22, m12 + m21], dim=-1),
            torch.stack([xy, m20 + m02, m21 + m12, 1 - m00 - m11 + m22], dim=-1),
        ],
        dim=-2,
    )  # (*batch, 4 candidates, 4)
    largest = candidates.diagonal(dim1=-2, dim2=-1).argmax(-1)
    index = largest[..., None, None].expand(*largest.shape, 1, 4)
    quat = candidates.gather(-2, index).squeeze(-2)
    quat = torch.nn.functional.normalize(quat, dim=-1)
    return torch.where(quat[..., :1] < 0, -quat, quat)


def rot6d_from_matrix(rotmat: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch 6"]:
    """Return the first two rows of the matrix (Zhou et al. 2019, in PyTorch3D's row form)."""
    return rotmat[..., :2, :].flatten(-2)


def matrix_from_rot6d(rot6d: Float[Tensor, "*batch 6"]) -> Float[Tensor, "*batch 3 3"]:
    """Orthonormalise two rows of any length by Gram-Schmidt (Zhou et al. 2019, section B).

    Rows that are zero or parallel determine no rotation: the result is finite, but not a rotation.
    """
    row_0 = torch.nn.functional.normalize(rot6d[..., :3], dim=-1)
    second = rot6d[..., 3:]
    row_1 = second - (row_0 * second).sum(-1, keepdim=True) * row_0
    row_1 = torch.nn.functional.normalize(row_1, dim=-1)
    return torch.stack([row_0, row_1, torch.linalg.cross(row_0, row_1)], dim=-2)


def geodesic_angle(
    a: Float[Tensor, "*#batch 3 3"], b: Float[Tensor, "*#batch 3 3"]
) -> Float[Tensor, "*batch"]:
    """Compute the angle in [0, pi] of the rotation ``a.T @ b``.

    ``atan2(sin, cos)`` has the dtype's precision at 0 and at pi, where ``acos`` of the trace loses
    half the digits. The gradient is 0 where the two are equal.
    """
    relative = a.transpose(-1, -2) @ b
    skew = torch.stack(
        [
            relative[..., 2, 1] - relative[..., 1, 2],
            relative[..., 0, 2] - relative[..., 2, 0],
            relative[..., 1, 0] - relative[..., 0, 1],
        ],
        dim=-1,
    )
    sin_sq = skew.square().sum(-1)
    is_zero = sin_sq == 0
    sin = torch.where(is_zero, torch.ones_like(sin_sq), sin_sq).sqrt()
    sin = torch.where(is_zero, torch.zeros_like(sin), sin)
    cos = relative.diagonal(dim1=-2, dim2=-1).sum(-1) - 1
    return torch.atan2(sin, cos)


def interpolate_rotations(
    a: Float[Tensor, "*#batch 3 3"],
    b: Float[Tensor, "*#batch 3 3"],
    weight: Float[Tensor, "*#batch"] | float,
) -> Float[Tensor, "*batch 3 3"]:
    """Interpolate from ``a`` (weight 0) to ``b`` (weight 1) on the shortest path (slerp)."""
    relative = axis_angle_from_matrix(a.transpose(-1, -2) @ b)
    scale = weight[..., None] if isinstance(weight, Tensor) else weight
    return a @ matrix_from_axis_angle(scale * relative)
