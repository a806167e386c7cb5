import numpy as np
import pytest
import torch

from conventions.joints import JOINT_INDEX
from model.generation.windows import (
    Cancelled,
    GenerateOptions,
    generate_motion,
    motion_pieces,
    stream_motion,
)
from model.motion.kinematics import joint_positions_from_local, open_body_skeleton
from model.motion.motion import put_together
from model.systems.globaldiff.config import BEST
from model.systems.registry import load_system
from tests.model.made import TINY_BEST, TINY_SYSTEMS, made_speech, make_weights


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    systems = {**TINY_SYSTEMS, BEST: TINY_BEST}
    return make_weights(tmp_path_factory.mktemp("weights"), systems)


@pytest.fixture(scope="module", params=["globaldiff/local", "globaldiff/global", BEST])
def system(request, folder):
    return load_system(request.param, folder)


OPTIONS = GenerateOptions(speaker="ann", steps=2)


@pytest.mark.parametrize("num_frames", [15, 59, 60, 61, 111, 112, 113, 200])
def test_frames_equal_the_rounded_duration(system, num_frames):
    speech = made_speech(round(num_frames / 30 * 16_000))
    assert speech.num_frames == num_frames
    (motion,) = generate_motion(system, speech, OPTIONS)
    assert motion.num_frames == num_frames == round(30 * speech.duration_s)
    assert motion.expression_basis == "arkit52" and (motion.expressions[:, 52:] == 0).all()
    assert (motion.trans[0, [0, 2]] == 0).all()


def test_length_does_not_change_what_came_before(system):
    long = made_speech(16_000 * 6)
    short = made_speech(16_000 * 4)
    (a,), (b,) = (generate_motion(system, s, OPTIONS) for s in (long, short))
    # The level of the whole clip enters the features, so they agree closely but not to the bit.
    assert np.abs(a.poses[:52] - b.poses[:52]).max() < 0.05


def test_seed_and_sample_decide_the_noise(system):
    speech = made_speech(16_000 * 3)

    def poses(**changes):
        options = GenerateOptions(**{"speaker": "ann", "steps": 2, **changes})
        return [m.poses for m in generate_motion(system, speech, options)]

    first, second = poses(samples=2)
    np.testing.assert_allclose(first, poses()[0], atol=1e-4)
    assert np.abs(first - second).max() > 1e-3
    assert np.abs(poses(seed=1)[0] - first).max() > 1e-3
    assert np.abs(poses(speaker="bob")[0] - first).max() > 1e-4
    np.testing.assert_array_equal(poses()[0], poses()[0])


def test_joins_move_no_faster_than_the_inside(system):
    """Random weights give different windows; the fade must spread that over all shared frames."""
    (motion,) = generate_motion(system, made_speech(16_000 * 12), OPTIONS)
    _, positions = joint_positions_from_local(motion.local_rotations(), open_body_skeleton())
    wrist = positions[:, JOINT_INDEX["right_wrist"]]
    step = wrist.diff(dim=0).norm(dim=-1)
    shared = torch.zeros(len(step), dtype=torch.bool)
    for start in range(52, 360, 52):
        shared[start - 1 : start + 8] = True
    assert step[shared].max() < 1.5 * step[~shared].max()


def test_progress_rises_to_one_and_cancel_stops_before_the_next_window(system):
    speech, seen = made_speech(16_000 * 6), []
    generate_motion(system, speech, OPTIONS, on_progress=seen.append)
    assert seen == sorted(seen) and seen[-1] == 1.0 and len(seen) == 4
    seen.clear()
    with pytest.raises(Cancelled):
        generate_motion(system, speech, OPTIONS, seen.append, lambda: len(seen) == 2)
    assert len(seen) == 2


@pytest.mark.parametrize(
    "changes", [{"samples": 0}, {"steps": 0}, {"seed": -1}, {"guidance": -1.0}, {"guidance": 99.0}]
)
def test_options_out_of_range_are_refused(changes):
    with pytest.raises(ValueError, match=next(iter(changes))):
        GenerateOptions(speaker="ann", **changes)


@pytest.mark.parametrize("sizes", [[15], [1, 60, 17, 200, 3], [100, 12], [60], [112, 1]])
def test_streamed_pieces_equal_the_whole(system, sizes):
    """Blocks of any size; whole windows, so that nothing must be held at the end."""
    speech = made_speech(round(sum(sizes) / 30 * 16_000))
    options = GenerateOptions(speaker="ann", steps=2, samples=2, guidance=1.5)
    whole = generate_motion(system, speech, options)
    count = -(-max(0, sum(sizes) - 60) // 52)
    features = torch.from_numpy(system.encoder.encode(speech.waveform, 60 + 52 * count))
    blocks = features.split([*sizes, len(features) - sum(sizes)])
    pieces = list(stream_motion(system, blocks, options))
    assert [p[0].num_frames for p in pieces] == [52] * count + [60]
    for k, motion in enumerate(whole):
        for field in ("poses", "trans", "expressions"):
            streamed = np.concatenate([getattr(piece[k], field) for piece in pieces])
            np.testing.assert_allclose(
                streamed[: motion.num_frames], getattr(motion, field), atol=2e-4
            )


@pytest.mark.parametrize("num_frames", [15, 59, 60, 61, 111, 112, 113])
def test_pieces_put_together_are_the_whole_to_the_bit(system, num_frames):
    speech = made_speech(round(num_frames / 30 * 16_000))
    options = GenerateOptions(speaker="ann", steps=2, samples=2)
    whole = generate_motion(system, speech, options)
    pieces = list(motion_pieces(system, speech, options))
    lengths = [piece.motions[0].num_frames for piece in pieces]
    assert sum(lengths) == num_frames and all(n == 52 for n in lengths[:-1])
    assert [piece.share for piece in pieces] == [(i + 1) / len(pieces) for i in range(len(pieces))]
    for k, motion in enumerate(whole):
        made = put_together([piece.motions[k] for piece in pieces])
        for field in ("poses", "trans", "expressions"):
            np.testing.assert_array_equal(getattr(made, field), getattr(motion, field))


def test_systems_that_are_asked_in_turn_make_what_each_makes_alone(folder):
    speech = made_speech(16_000 * 5)
    systems = [load_system(f"globaldiff/{name}", folder) for name in ("local", "global")]
    turns = zip(*(motion_pieces(each, speech, OPTIONS) for each in systems), strict=True)
    for each, pieces in zip(systems, zip(*turns, strict=True), strict=True):
        (alone,) = generate_motion(each, speech, OPTIONS)
        made = put_together([piece.motions[0] for piece in pieces])
        np.testing.assert_array_equal(made.poses, alone.poses)


def test_a_piece_comes_before_the_speech_after_it_is_asked_for(system):
    features = torch.from_numpy(system.encoder.encode(made_speech(16_000 * 8).waveform, 240))
    asked = []

    def arriving():
        for frame in range(240):
            asked.append(frame)
            yield features[frame : frame + 1]

    pieces = stream_motion(system, arriving(), OPTIONS)
    next(pieces)
    assert len(asked) <= 60 + 59
    next(pieces)
    assert len(asked) <= 112 + 59


def test_speech_that_ends_inside_a_window_is_held_and_the_motion_cut(system):
    features = torch.from_numpy(system.encoder.encode(made_speech(16_000 * 3).waveform, 90))
    pieces = list(stream_motion(system, [features], OPTIONS))
    assert sum(piece[0].num_frames for piece in pieces) == 90
    with pytest.raises(ValueError, match="no frame 0"):
        list(stream_motion(system, [], OPTIONS))


def test_guidance_is_a_straight_line_through_deaf_and_heard(system):
    """One step of one window: x_1 is a straight function of the strength, up to the decoding."""
    speech, sizes = made_speech(16_000 * 2), []
    motions = {}
    with system.network.register_forward_pre_hook(lambda _, args: sizes.append(len(args[0]))):
        for guidance in (0.0, 1.0, 2.0):
            options = GenerateOptions(speaker="ann", steps=1, guidance=guidance)
            (motions[guidance],) = generate_motion(system, speech, options)
    assert sizes == [2, 1, 2]
    rows = {g: m.trans[:, 1] for g, m in motions.items()}  # the height is not turned nor summed
    np.testing.assert_allclose(rows[2.0] - rows[1.0], rows[1.0] - rows[0.0], atol=1e-5)
    assert np.abs(rows[1.0] - rows[0.0]).max() > 1e-4
