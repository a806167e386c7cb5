"""Motion made window by window: of every length, whole, in pieces and streamed."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from conventions.joints import JOINT_INDEX
from model.generation import windows
from model.generation.base import SpeechWindow, System, Window, fade_weights, num_windows
from model.generation.windows import (
    GenerateOptions,
    WindowChain,
    generate_motion,
    motion_pieces,
    single_threaded,
)
from model.motion.kinematics import forward_kinematics, open_body_skeleton
from model.motion.motion import Motion, concatenate
from model.motion.rotations import geodesic_angle, matrix_from_axis_angle
from model.sampling.samplers import noise_seed_of_clip
from model.systems.globaldiff.config import PRIORFLOW
from processes.job import Cancelled
from tests.model.made import made_speech


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
        torch.testing.assert_close(window.features[:, 0], wanted)
        torch.testing.assert_close(window.trim_context(0, 60)[:, 0], wanted[20:80])
        torch.testing.assert_close(window.trim_context(5, 60)[:, 0], wanted[15:85])


def test_clips_of_a_set_have_seeds_of_their_own_that_never_change():
    assert noise_seed_of_clip(0, "garden") == 1_008_839_452
    seeds = {
        noise_seed_of_clip(seed, name) for seed in range(50) for name in ("a", "b", "a b", "0 a")
    }
    assert len(seeds) == 200 and all(0 <= seed < 2**31 for seed in seeds)


OPTIONS = GenerateOptions(speaker="ann", steps=2)
SYSTEMS = ["globaldiff/local", "globaldiff/global", PRIORFLOW]
LENGTHS = [
    *(("globaldiff/global", n) for n in (15, 60, 61, 112, 113, 200)),
    *((name, 113) for name in ("globaldiff/local", PRIORFLOW)),
]


@pytest.fixture(params=SYSTEMS)
def system(request, loaded):
    return loaded(request.param)


@pytest.fixture
def small(loaded):
    return loaded("globaldiff/global")


def of_frames(num_frames: int):
    return made_speech(round(num_frames / 30 * 16_000))


def arrays(motion: Motion) -> np.ndarray:
    return np.concatenate([motion.poses, motion.trans, motion.expressions], axis=1)


@pytest.mark.parametrize("advance", [None, 20])
def test_each_window_fades_from_what_the_one_before_has_of_the_same_frames(small, advance):
    cut, chain = small.windowing, WindowChain(small, OPTIONS)

    def made(first: float) -> Window:
        """Its places count."""
        count = first + torch.arange(float(cut.frames))
        turns = torch.eye(3).expand(1, cut.frames, 55, 3, 3)
        return Window(turns, count[None, :, None].repeat(1, 1, 3), torch.zeros(1, cut.frames, 52))

    chain.join(made(0.0), advance)
    joined, shared = chain.join(made(1000.0), advance).root[0, :, 0], cut.overlap
    older = (advance or cut.advance) + torch.arange(float(shared))
    wanted = torch.lerp(older, made(1000.0).root[0, :shared, 0], fade_weights(shared))
    torch.testing.assert_close(joined[:shared], wanted)
    torch.testing.assert_close(joined[shared:], made(1000.0).root[0, shared:, 0])


@pytest.mark.parametrize(("name", "num_frames"), LENGTHS)
def test_pieces_are_the_whole(loaded, name, num_frames):
    system, speech = loaded(name), of_frames(num_frames)
    options = GenerateOptions(speaker="ann", steps=2, num_samples=2, guidance=1.5)
    whole = generate_motion(system, speech, options)
    pieces = list(motion_pieces(system, speech, options))
    lengths = [piece.motions[0].num_frames for piece in pieces]
    assert sum(lengths) == num_frames and all(n == 52 for n in lengths[:-1])
    assert [piece.progress for piece in pieces] == [
        (i + 1) / len(pieces) for i in range(len(pieces))
    ]
    count = -(-max(0, num_frames - 60) // 52)
    assert len(pieces) == count + 1
    for k, motion in enumerate(whole):
        assert motion.num_frames == num_frames == round(30 * speech.duration_s)
        assert motion.expression_basis == "arkit52" and (motion.expressions[:, 52:] == 0).all()
        assert (motion.trans[0, [0, 2]] == 0).all()
        made = concatenate([piece.motions[k] for piece in pieces])
        np.testing.assert_array_equal(arrays(made), arrays(motion))


def test_seed_and_sample_and_speaker_decide_the_motion(small):
    speech = of_frames(70)

    def poses(**changes) -> list[np.ndarray]:
        options = GenerateOptions(**{"speaker": "ann", "steps": 2, **changes})
        return [m.poses for m in generate_motion(small, speech, options)]

    first, second = poses(num_samples=2)
    np.testing.assert_allclose(first, poses()[0], atol=1e-4)
    assert np.abs(first - second).max() > 1e-3
    assert np.abs(poses(seed=1)[0] - first).max() > 1e-3
    assert np.abs(poses(speaker="bob")[0] - first).max() > 1e-4
    np.testing.assert_array_equal(poses()[0], poses()[0])


def test_joins_move_no_faster_than_the_inside(system):
    """Random weights give different windows; the fade must spread that over all shared frames."""
    (motion,) = generate_motion(system, of_frames(268), OPTIONS)
    _, positions = forward_kinematics(motion.local_rotations(), open_body_skeleton())
    step = positions[:, JOINT_INDEX["right_wrist"]].diff(dim=0).norm(dim=-1)
    shared = torch.zeros(len(step), dtype=torch.bool)
    for start in range(52, 268, 52):
        shared[start - 1 : start + 8] = True
    assert step[shared].max() < 1.5 * step[~shared].max()


def test_it_can_be_cancelled_before_each_window(small):
    answers = iter([False, False, True])
    with pytest.raises(Cancelled):
        generate_motion(small, of_frames(180), OPTIONS, lambda: next(answers))
    assert next(answers, None) is None


@pytest.mark.parametrize(
    "changes",
    [{"num_samples": 0}, {"steps": 0}, {"seed": -1}, {"guidance": -1.0}, {"guidance": 99.0}],
)
def test_options_out_of_range_are_refused(changes):
    with pytest.raises(ValueError, match=next(iter(changes))):
        GenerateOptions(speaker="ann", **changes)


def test_guidance_is_a_straight_line_through_deaf_and_heard(system):
    """One step of one window: x_1 is a straight function of the strength, up to the decoding."""
    speech, sizes, rows = of_frames(60), [], {}
    with system.network.register_forward_pre_hook(lambda _, args: sizes.append(len(args[0]))):
        for guidance in (0.0, 1.0, 2.0):
            options = GenerateOptions(speaker="ann", steps=1, guidance=guidance)
            (motion,) = generate_motion(system, speech, options)
            rows[guidance] = motion.trans[:, 1]  # the height is not turned nor summed
    assert sizes == [2, 1, 2]
    np.testing.assert_allclose(rows[2.0] - rows[1.0], rows[1.0] - rows[0.0], atol=1e-5)
    assert np.abs(rows[1.0] - rows[0.0]).max() > 1e-4


def test_generation_is_told_for_each_frame_of_each_sample(small, monkeypatch):
    clock = iter([0.0, 1.2])
    monkeypatch.setattr(windows, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
    found = windows.measure_ms_per_frame(small, of_frames(30), steps=1, num_samples=4)
    assert found == pytest.approx(10.0)  # 1.2 s for 4 x 30 frames


def test_motion_is_made_in_one_thread_and_as_many_as_before_work_after_it(small):
    seen, before = [], torch.get_num_threads()
    options = GenerateOptions(speaker="ann", steps=1)
    torch.set_num_threads(2)
    try:
        with pytest.raises(ZeroDivisionError), single_threaded():
            assert torch.get_num_threads() == 1
            raise ZeroDivisionError
        assert torch.get_num_threads() == 2
        generate_motion(
            small, of_frames(70), options, lambda: bool(seen.append(torch.get_num_threads()))
        )
        assert set(seen) == {1} and torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
