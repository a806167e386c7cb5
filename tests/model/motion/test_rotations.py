"""Every form of a rotation against SciPy, where rotation code breaks too."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from model.motion import rotations
from tests.helpers import ROTATION_DRAWS, random_rotations

TOLERANCE = {torch.float32: 2e-6, torch.float64: 1e-14}
every_draw = pytest.mark.parametrize("draw", ROTATION_DRAWS)
every_dtype = pytest.mark.parametrize("dtype", TOLERANCE)


def scipy_of(matrices: torch.Tensor) -> Rotation:
    return Rotation.from_matrix(matrices.double().numpy().reshape(-1, 3, 3))


def assert_near(found: torch.Tensor, expected, tolerance: float) -> None:
    np.testing.assert_allclose(
        found.double().numpy(), np.asarray(expected).reshape(found.shape), rtol=0, atol=tolerance
    )


@every_draw
@every_dtype
@pytest.mark.parametrize("batch", [(), (1,), (3, 2)])
def test_every_form_agrees_with_scipy(draw, batch, dtype):
    """Float32 input is itself rounded: compared with what the rounded one says."""
    tolerance = TOLERANCE[dtype]
    matrices = torch.from_numpy(random_rotations(draw, batch)).to(dtype)
    vectors = torch.from_numpy(scipy_of(matrices).as_rotvec().reshape(*batch, 3)).to(dtype)
    made = rotations.matrix_from_axis_angle(vectors)
    assert made.dtype == dtype and made.shape == (*batch, 3, 3)
    expected = Rotation.from_rotvec(vectors.double().numpy().reshape(-1, 3)).as_matrix()
    assert_near(made, expected, tolerance)
    axis_angle = rotations.axis_angle_from_matrix(matrices)
    assert axis_angle.dtype == dtype and axis_angle.norm(dim=-1).max() <= math.pi + tolerance
    back = Rotation.from_rotvec(axis_angle.double().numpy().reshape(-1, 3))
    assert (back.inv() * scipy_of(matrices)).magnitude().max() < 4 * tolerance
    quat = rotations.quat_wxyz_from_matrix(matrices)
    theirs = scipy_of(matrices).as_quat(scalar_first=True).reshape(*batch, 4)
    assert (quat[..., 0] >= 0).all()
    np.testing.assert_allclose(np.abs((quat.double().numpy() * theirs).sum(-1)), 1, atol=tolerance)
    for either_sign in (quat, -quat):
        again = rotations.matrix_from_axis_angle(rotations.axis_angle_from_quat_wxyz(either_sign))
        assert_near(again, matrices, 4 * tolerance)
    again = rotations.matrix_from_rot6d(rotations.rot6d_from_matrix(matrices))
    assert_near(again, matrices, 2 * tolerance)


@every_draw
@every_dtype
def test_geodesic_angle_agrees_with_scipy(draw, dtype):
    a = torch.from_numpy(random_rotations("uniform", (20,), seed=1)).to(dtype)
    b = (a.double() @ torch.from_numpy(random_rotations(draw, (20,), seed=2))).to(dtype)
    expected = (scipy_of(a).inv() * scipy_of(b)).magnitude()
    assert_near(rotations.geodesic_angle(a, b), expected, 4 * TOLERANCE[dtype])


@every_dtype
def test_tiny_angles_keep_their_precision_and_half_turns_their_axis(dtype):
    tiny = torch.tensor([[1e-7, -2e-7, 3e-7], [1e-4, 2e-4, -3e-4], [2e-3, 0, 0]], dtype=dtype)
    back = rotations.axis_angle_from_matrix(rotations.matrix_from_axis_angle(tiny))
    torch.testing.assert_close(back, tiny, rtol=2e-6 if dtype == torch.float32 else 1e-12, atol=0)
    for axis in ((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0), (0.6, -0.8, 0)):
        half = math.pi * torch.tensor(axis, dtype=dtype)
        back = rotations.axis_angle_from_matrix(rotations.matrix_from_axis_angle(half))
        error = min((back - half).abs().max(), (back + half).abs().max())
        assert error < 4 * TOLERANCE[dtype]


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.lists(st.floats(-2, 2), min_size=6, max_size=6))
def test_any_two_independent_rows_give_a_rotation(values):
    rows = torch.tensor(values, dtype=torch.float64)
    if torch.linalg.cross(rows[:3], rows[3:]).norm() < 1e-3:
        return
    matrix = rotations.matrix_from_rot6d(rows)
    assert_near(matrix @ matrix.T, np.eye(3), 1e-9)
    assert torch.linalg.det(matrix) > 0.999
    assert_near(matrix[0], rows[:3] / rows[:3].norm(), 1e-9)
    assert matrix[1] @ rows[3:] > 0


def test_conventions_are_pinned():
    turn = rotations.matrix_from_axis_angle(torch.tensor([0.0, 0.0, math.pi / 6]))
    rows = torch.tensor([0.8660254, -0.5, 0.0, 0.5, 0.8660254, 0.0])
    torch.testing.assert_close(rotations.rot6d_from_matrix(turn), rows)
    turn = rotations.matrix_from_axis_angle(torch.tensor([0.0, math.pi / 2, 0.0]))
    torch.testing.assert_close(turn @ torch.tensor([0.0, 0, 1]), torch.tensor([1.0, 0, 0]))
    quat = rotations.quat_wxyz_from_matrix(turn)
    torch.testing.assert_close(quat, torch.tensor([0.7071068, 0, 0.7071068, 0]))


def test_interpolation_is_slerp_with_one_weight_for_all_or_for_each():
    a, b = (torch.from_numpy(random_rotations("uniform", (7,), seed=s)) for s in (3, 4))
    for weight in (0.0, 0.25, 0.5, 1.0, torch.linspace(0, 1, 7).double()):
        found = rotations.interpolate_rotations(a, b, weight)
        for k, at in enumerate(torch.as_tensor(weight).expand(7).tolist()):
            ends = Rotation.from_matrix(torch.stack([a[k], b[k]]).numpy())
            assert_near(found[k], Slerp([0, 1], ends)(at).as_matrix(), 1e-12)


@every_dtype
@pytest.mark.parametrize("axis_angle", [(0, 0, 0), (1e-9, 0, 0), (math.pi, 0, 0), (0.3, 0.2, 0.1)])
def test_gradients_are_finite(axis_angle, dtype):
    vector = torch.tensor(axis_angle, dtype=dtype, requires_grad=True)
    matrix = rotations.matrix_from_axis_angle(vector)
    other = torch.eye(3, dtype=dtype)
    total = (
        rotations.axis_angle_from_matrix(matrix).sum()
        + rotations.quat_wxyz_from_matrix(matrix).sum()
        + rotations.matrix_from_rot6d(rotations.rot6d_from_matrix(matrix)).sum()
        + rotations.geodesic_angle(matrix, other)
        + rotations.interpolate_rotations(matrix, other, 0.3).sum()
    )
    total.backward()
    assert vector.grad is not None and torch.isfinite(vector.grad).all()


@pytest.mark.parametrize("scale", [0.0, 1e-4, 1.0])
def test_gradients_agree_with_finite_differences(scale):
    vector = scale * torch.tensor([0.3, -0.5, 0.8], dtype=torch.float64)
    vector.requires_grad_(True)
    to_matrix = rotations.matrix_from_axis_angle
    assert torch.autograd.gradcheck(to_matrix, vector)
    assert torch.autograd.gradcheck(
        lambda v: rotations.axis_angle_from_matrix(to_matrix(v)), vector
    )
