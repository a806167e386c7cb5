import pytest
import torch

from model.training import losses


def test_simple_loss_is_the_mean_square_of_each_sample():
    x_1 = torch.zeros(2, 3, 4)
    target = torch.zeros(2, 3, 4)
    target[1] = 2.0
    torch.testing.assert_close(losses.simple_loss(x_1, target), torch.tensor([0.0, 4.0]))


def test_position_loss_turns_from_squared_to_absolute_at_two_centimetres():
    target = torch.zeros(3, 5, 7, 3)
    error = torch.tensor([0.01, 0.02, 0.12])
    positions = target + error[:, None, None, None]
    # e^2 / (2 * 0.02) below, e - 0.01 above
    expected = torch.tensor([0.0025, 0.01, 0.11])
    torch.testing.assert_close(losses.position_loss(positions, target), expected)


def test_differences_ignore_what_is_constant_or_grows_evenly():
    time = torch.arange(6.0)[None, :, None, None].expand(2, 6, 4, 3)
    zero = torch.zeros_like(time)
    still, drifting, speeding = zero + 1, 0.1 * time, 0.05 * time**2
    none = torch.zeros(2)
    torch.testing.assert_close(losses.velocity_loss(still, zero), none)
    # 0.1 m per frame: 0.1 - 0.01
    torch.testing.assert_close(losses.velocity_loss(drifting, zero), none + 0.09)
    torch.testing.assert_close(losses.acceleration_loss(drifting, zero), none, atol=1e-6, rtol=0)
    # the second difference of 0.05 k^2 is 0.1
    torch.testing.assert_close(losses.acceleration_loss(speeding, zero), none + 0.09)


def test_difference_loss_sees_flicker_and_no_offset():
    target = torch.zeros(1, 8, 2)
    flicker = target + 0.1 * torch.tensor([1.0, -1.0] * 4)[None, :, None]
    torch.testing.assert_close(losses.difference_loss(target + 0.1, target), torch.zeros(1))
    torch.testing.assert_close(losses.difference_loss(flicker, target), torch.full((1,), 0.04))


def test_contact_loss_sees_steps_of_feet_that_stand_and_of_no_others():
    stands, walks = torch.zeros(1, 5, 55, 3), torch.zeros(1, 5, 55, 3)
    walks[..., 0] = 0.05 * torch.arange(5.0)[:, None]  # 1.5 m/s
    sliding = stands.clone()
    sliding[..., losses.FEET[0], 0] = 0.01 * torch.arange(5.0)  # one of four points, 1 cm a frame
    torch.testing.assert_close(losses.contact_loss(sliding, stands), torch.tensor([0.25]))
    torch.testing.assert_close(losses.contact_loss(sliding, walks), torch.zeros(1))
    lifted = stands.clone()
    lifted[..., 1] = 0.01 * torch.arange(5.0)[:, None]
    torch.testing.assert_close(losses.contact_loss(lifted, stands), torch.zeros(1))


def test_kl_is_zero_for_the_standard_normal_and_half_for_a_mean_of_one():
    zero, one = torch.zeros(2, 5, 3), torch.ones(2, 5, 3)
    torch.testing.assert_close(losses.kl_loss([(zero, zero)]), torch.zeros(2))
    torch.testing.assert_close(losses.kl_loss([(one, zero), (zero, zero)]), torch.full((2,), 0.5))


def test_a_loss_that_is_no_number_names_step_and_clips():
    with pytest.raises(FloatingPointError, match=r"total is nan at step 7; clips: a, b\."):
        losses.finite_or_raise({"simple": 1.0, "total": float("nan")}, 7, ["a", "b", "a"])
    losses.finite_or_raise({"total": 1.0}, 7, ["a"])
