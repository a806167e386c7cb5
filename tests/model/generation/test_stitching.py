"""Windows of any length: how many, how they fade into each other, what speech each hears."""

from typing import Any

import torch

from model.generation.base import SpeechWindow, System, Window, fade_weights, num_windows
from model.motion.rotations import geodesic_angle, matrix_from_axis_angle
from model.sampling.samplers import clip_seed


def test_windows_cover_every_length_and_no_window_is_spare():
    assert [num_windows(n, 60, 8) for n in (60, 61, 112, 113, 164, 165)] == [1, 2, 2, 3, 3, 4]
    for num_frames in (1, 7, 8, 9, 59, 60, 61, 111, 112, 113, 164, 165, 1710):
        count = num_windows(num_frames, 60, 8)
        assert 60 + 52 * (count - 1) >= num_frames
        assert count == 1 or 60 + 52 * (count - 2) < num_frames


def test_a_fade_follows_the_geodesic_and_rises_evenly_on_both_sides():
    weight = fade_weights(8)
    assert (weight.diff() > 0).all() and weight[-1] < 1
    torch.testing.assert_close(weight + weight.flip(0), torch.ones(8))
    assert 0 < weight[0] < 0.02  # leaves the older window without a step
    older = matrix_from_axis_angle(torch.zeros(2, 8, 55, 3))
    newer = matrix_from_axis_angle(torch.tensor([0.0, 0.0, 0.8]).expand(2, 8, 55, 3))
    root, face = torch.randn(2, 8, 3), torch.rand(2, 8, 52)
    nobody: Any = None  # a join asks nothing of its system
    one, other = Window(older, root, face), Window(newer, root + 1, face - 1)
    joined = System.join(nobody, one, other)
    expected = (0.8 * weight)[None, :, None].expand(2, 8, 55)
    torch.testing.assert_close(geodesic_angle(older, joined.rotmat), expected, atol=1e-4, rtol=0)
    torch.testing.assert_close(joined.root - root, weight[:, None].expand(2, 8, 3))
    torch.testing.assert_close(face - joined.expression, weight[:, None].expand(2, 8, 52))
    same = System.join(nobody, other, other)
    torch.testing.assert_close(same.rotmat, newer, atol=1e-5, rtol=0)
    torch.testing.assert_close(same.root, other.root)


def test_windows_of_speech_hold_both_its_ends():
    features = torch.arange(200.0)[:, None].expand(-1, 3)
    for start in (0, 52, 104, 156):
        window = SpeechWindow.of(features, start, 60, context=20)
        wanted = torch.arange(start - 20, start + 80).clamp(0, 199).float()
        torch.testing.assert_close(window.speech[:, 0], wanted)
        torch.testing.assert_close(window.around(0, 60)[:, 0], wanted[20:80])
        torch.testing.assert_close(window.around(5, 60)[:, 0], wanted[15:85])


def test_clips_of_a_set_have_seeds_of_their_own_that_never_change():
    assert clip_seed(0, "garden") == 1_008_839_452
    seeds = {clip_seed(seed, name) for seed in range(50) for name in ("a", "b", "a b", "0 a")}
    assert len(seeds) == 200 and all(0 <= seed < 2**31 for seed in seeds)
