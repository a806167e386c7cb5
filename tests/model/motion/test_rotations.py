import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from model.motion import rotations
from tests.helpers import ROTATION_DRAWS, random_rotations

BATCHES = [(), (1,), (3, 2)]
DTYPES = [torch.float32, torch.float64]
TOLERANCE = {torch.float32: 2e-6, torch.float64: 1e-14}

every_draw = pytest.mark.parametrize("draw", ROTATION_DRAWS)
every_batch = pytest.mark.parametrize("batch", BATCHES)
every_dtype = pytest.mark.parametrize("dtype", DTYPES)


def scipy_of(matrices: np.ndarray) -> Rotation:
    return Rotation.from_matrix(matrices.reshape(-1, 3, 3))


def angle_between(a: np.ndarray, b: np.ndarray) -> float:
    """Largest angle in radians between two stacks of matrices, by SciPy in float64."""
    return float((scipy_of(a).inv() * scipy_of(b)).magnitude().max())


@every_draw
@every_batch
@every_dtype
def test_axis_angle_to_matrix_agrees_with_scipy(draw, batch, dtype):
    matrices = random_rotations(draw, batch)
    axis_angle = torch.from_numpy(scipy_of(matrices).as_rotvec().reshape(*batch, 3)).to(dtype)
    expected = Rotation.from_rotvec(axis_angle.double().numpy().reshape(-1, 3)).as_matrix()
    result = rotations.matrix_from_axis_angle(axis_angle)
    assert result.dtype == dtype
    assert result.shape == (*batch, 3, 3)
    np.testing.assert_allclose(
        result.double().numpy().reshape(-1, 3, 3), expected, rtol=0, atol=TOLERANCE[dtype]
    )


@every_draw
@every_batch
@every_dtype
def test_matrix_to_axis_angle_agrees_with_scipy(draw, batch, dtype):
    matrices = torch.from_numpy(random_rotations(draw, batch)).to(dtype)
    axis_angle = rotations.axis_angle_from_matrix(matrices)
    assert axis_angle.dtype == dtype
    assert axis_angle.norm(dim=-1).max() <= math.pi + TOLERANCE[dtype]
    back = Rotation.from_rotvec(axis_angle.double().numpy().reshape(-1, 3)).as_matrix()
    # Float32 input is itself rounded: compare with what the rounded matrix says.
    assert angle_between(back, matrices.double().numpy()) < 4 * TOLERANCE[dtype]


@every_dtype
def test_tiny_angles_keep_their_relative_precision(dtype):
    axis_angle = torch.tensor([[1e-7, -2e-7, 3e-7], [1e-4, 2e-4, -3e-4], [2e-3, 0, 0]], dtype=dtype)
    back = rotations.axis_angle_from_matrix(rotations.matrix_from_axis_angle(axis_angle))
    torch.testing.assert_close(
        back, axis_angle, rtol=2e-6 if dtype == torch.float32 else 1e-12, atol=0
    )


@pytest.mark.parametrize("axis", [(1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0), (0.6, -0.8, 0)])
@every_dtype
def test_half_turns_exactly(axis, dtype):
    axis_angle = math.pi * torch.tensor(axis, dtype=dtype)
    back = rotations.axis_angle_from_matrix(rotations.matrix_from_axis_angle(axis_angle))
    error = min((back - axis_angle).abs().max(), (back + axis_angle).abs().max())
    assert error < 4 * TOLERANCE[dtype]


@every_draw
@every_batch
@every_dtype
def test_quaternions_agree_with_scipy_up_to_sign(draw, batch, dtype):
    matrices = torch.from_numpy(random_rotations(draw, batch)).to(dtype)
    quat = rotations.quat_wxyz_from_matrix(matrices)
    expected = scipy_of(matrices.double().numpy()).as_quat(scalar_first=True).reshape(*batch, 4)
    dot = (quat.double().numpy() * expected).sum(-1)
    assert (quat[..., 0] >= 0).all()
    np.testing.assert_allclose(np.abs(dot), 1, atol=TOLERANCE[dtype])
    for either_sign in (quat, -quat):
        axis_angle = rotations.axis_angle_from_quat_wxyz(either_sign)
        torch.testing.assert_close(
            rotations.matrix_from_axis_angle(axis_angle),
            matrices,
            rtol=0,
            atol=4 * TOLERANCE[dtype],
        )


@every_draw
@every_batch
@every_dtype
def test_rot6d_round_trip_is_a_rotation(draw, batch, dtype):
    matrices = torch.from_numpy(random_rotations(draw, batch)).to(dtype)
    back = rotations.matrix_from_rot6d(rotations.rot6d_from_matrix(matrices))
    torch.testing.assert_close(back, matrices, rtol=0, atol=2 * TOLERANCE[dtype])


@given(st.lists(st.floats(-2, 2), min_size=6, max_size=6))
def test_any_two_independent_rows_give_a_rotation(values):
    rows = torch.tensor(values, dtype=torch.float64)
    area = torch.linalg.cross(rows[:3], rows[3:]).norm()
    if area < 1e-3:
        return
    matrix = rotations.matrix_from_rot6d(rows)
    torch.testing.assert_close(
        matrix @ matrix.T, torch.eye(3, dtype=torch.float64), rtol=0, atol=1e-9
    )
    assert torch.linalg.det(matrix) > 0.999
    torch.testing.assert_close(matrix[0], rows[:3] / rows[:3].norm(), rtol=0, atol=1e-9)


def test_pinned_row_6d_of_30_degrees_about_z():
    axis_angle = torch.tensor([0.0, 0.0, math.pi / 6], dtype=torch.float64)
    rot6d = rotations.rot6d_from_matrix(rotations.matrix_from_axis_angle(axis_angle))
    expected = torch.tensor([0.8660254, -0.5, 0.0, 0.5, 0.8660254, 0.0], dtype=torch.float64)
    torch.testing.assert_close(rot6d, expected, rtol=0, atol=1e-7)


def test_pinned_quarter_turn_about_y_takes_z_to_x():
    matrix = rotations.matrix_from_axis_angle(torch.tensor([0.0, math.pi / 2, 0.0]))
    torch.testing.assert_close(matrix @ torch.tensor([0.0, 0, 1]), torch.tensor([1.0, 0, 0]))
    quat = rotations.quat_wxyz_from_matrix(matrix)
    torch.testing.assert_close(quat, torch.tensor([0.7071068, 0, 0.7071068, 0]))


@every_draw
@every_dtype
def test_geodesic_angle_agrees_with_scipy(draw, dtype):
    a = torch.from_numpy(random_rotations("uniform", (20,), seed=1)).to(dtype)
    b = (a.double() @ torch.from_numpy(random_rotations(draw, (20,), seed=2))).to(dtype)
    expected = (scipy_of(a.double().numpy()).inv() * scipy_of(b.double().numpy())).magnitude()
    angle = rotations.geodesic_angle(a, b)
    np.testing.assert_allclose(angle.double().numpy(), expected, rtol=0, atol=4 * TOLERANCE[dtype])


def test_interpolation_agrees_with_slerp_and_ends_exactly():
    a, b = (torch.from_numpy(random_rotations("uniform", (7,), seed=s)) for s in (3, 4))
    for weight in (0.0, 0.25, 0.5, 1.0):
        result = rotations.interpolate_rotations(a, b, weight).numpy()
        for one, first, last in zip(result, a.numpy(), b.numpy(), strict=True):
            expected = Slerp([0, 1], Rotation.from_matrix([first, last]))(weight).as_matrix()
            np.testing.assert_allclose(one, expected, rtol=0, atol=1e-12)


def test_interpolation_takes_one_weight_per_rotation():
    a = torch.eye(3).expand(5, 3, 3)
    b = rotations.matrix_from_axis_angle(torch.tensor([0.0, 0.0, 1.0])).expand(5, 3, 3)
    weight = torch.linspace(0, 1, 5)
    angle = rotations.geodesic_angle(a, rotations.interpolate_rotations(a, b, weight))
    torch.testing.assert_close(angle, weight, rtol=0, atol=1e-6)


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
    assert vector.grad is not None
    assert torch.isfinite(vector.grad).all()


@pytest.mark.parametrize("scale", [0.0, 1e-4, 1.0])
def test_gradients_agree_with_finite_differences(scale):
    vector = scale * torch.tensor([0.3, -0.5, 0.8], dtype=torch.float64)
    vector.requires_grad_(True)
    assert torch.autograd.gradcheck(rotations.matrix_from_axis_angle, vector)
    assert torch.autograd.gradcheck(
        lambda v: rotations.axis_angle_from_matrix(rotations.matrix_from_axis_angle(v)), vector
    )
