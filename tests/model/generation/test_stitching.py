import pytest
import torch

from model.generation.stitching import cross_fade, fade_weights, num_windows
from model.motion.rotations import geodesic_angle, matrix_from_axis_angle


@pytest.mark.parametrize("num_frames", [1, 7, 8, 9, 59, 60, 61, 111, 112, 113, 164, 165, 1710])
def test_windows_cover_every_length_and_no_window_is_spare(num_frames):
    count = num_windows(num_frames, 60, 8)
    assert 60 + 52 * (count - 1) >= num_frames
    assert count == 1 or 60 + 52 * (count - 2) < num_frames


def test_window_counts_around_the_boundaries():
    assert [num_windows(n, 60, 8) for n in (60, 61, 112, 113, 164, 165)] == [1, 2, 2, 3, 3, 4]


def test_fade_rises_evenly_on_both_sides_and_never_drops_a_window():
    weight = fade_weights(8)
    assert (weight.diff() > 0).all() and 0 < weight[0] and weight[-1] < 1
    torch.testing.assert_close(weight + weight.flip(0), torch.ones(8))
    assert weight[0] < 0.02  # leaves the older window without a step


def test_fade_follows_the_geodesic():
    axis = torch.tensor([0.0, 0.0, 1.0])
    older = matrix_from_axis_angle(torch.zeros(2, 8, 55, 3))
    newer = matrix_from_axis_angle((axis * 0.8).expand(2, 8, 55, 3))
    root = torch.zeros(2, 8, 3)
    rotmat, blended = cross_fade((older, root), (newer, root + 1))
    angle = geodesic_angle(older, rotmat)
    expected = 0.8 * fade_weights(8)
    torch.testing.assert_close(angle, expected[None, :, None].expand(2, 8, 55), atol=1e-4, rtol=0)
    torch.testing.assert_close(blended[0, :, 0], fade_weights(8))


def test_equal_windows_stay_as_they_are():
    rotmat = matrix_from_axis_angle(torch.randn(1, 8, 55, 3))
    root = torch.randn(1, 8, 3)
    faded, faded_root = cross_fade((rotmat, root), (rotmat, root))
    torch.testing.assert_close(faded, rotmat, atol=1e-5, rtol=0)
    torch.testing.assert_close(faded_root, root)
