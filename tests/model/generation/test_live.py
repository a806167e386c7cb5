import numpy as np
import pytest
import torch

from conventions.joints import JOINT_INDEX
from model.generation.live import LiveMotion, Pace
from model.generation.stitching import SpeechWindow
from model.generation.windows import GenerateOptions, PiecewiseMotion, WindowChain
from model.motion.kinematics import joint_positions_from_local, open_body_skeleton
from model.motion.rotations import matrix_from_axis_angle
from model.systems.globaldiff.config import BEST
from model.systems.registry import load_system
from tests.model.made import TINY_BEST, TINY_SYSTEMS, make_weights
from tests.model.systems.asynfusion.made import make_asynfusion
from tests.model.systems.gan.made_generator import make_gan_weights

PACE = Pace(hop=10, heard_ahead=12)
OPTIONS = GenerateOptions(speaker="ann", steps=2, seed=3)
FEATURES = torch.randn(400, 68, generator=torch.Generator().manual_seed(1))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = make_weights(tmp_path_factory.mktemp("weights"), {**TINY_SYSTEMS, BEST: TINY_BEST})
    make_gan_weights(folder)
    make_asynfusion(folder)
    return folder


@pytest.fixture(
    scope="module",
    params=["globaldiff/local", "globaldiff/global", BEST, "gan/5", "asynfusion/lcm-sync"],
)
def system(request, folder):
    return load_system(request.param, folder)


def streamed(system, features, sizes, pace=PACE):
    """All frames, and how many became final with each window."""
    live, pieces, start = LiveMotion(system, OPTIONS, pace), [], 0
    for k in range(10_000):
        size = sizes[k % len(sizes)]
        live.hear(features[start : start + size])
        start += size
        while live.is_due:
            pieces += live.step()
        if start >= len(features):
            break
    return pieces


def joined(pieces):
    return [
        np.concatenate([getattr(p, name) for p in pieces])
        for name in ("poses", "trans", "expressions")
    ]


def test_frames_are_final_ten_at_a_time_and_twelve_behind_the_speech(system):
    live = LiveMotion(system, OPTIONS, PACE)
    live.hear(FEATURES[:21])
    assert not live.is_due
    live.hear(FEATURES[21:22])
    assert live.is_due and live.step()[0].num_frames == 10
    assert not live.is_due and live.next_frame == 10
    live.hear(FEATURES[22:122])
    assert live.step()[0].num_frames == 52 and live.step()[0].num_frames == 48


def test_the_stream_equals_windows_of_the_same_hops_and_draws(system):
    """Made apart from the stream: every window from all of the speech that was heard by then."""
    sizes, pace = [3, 14, 6], Pace(hop=9, heard_ahead=11)
    pieces = streamed(system, FEATURES[:200], sizes, pace)
    chain, motion = WindowChain(system, OPTIONS), PiecewiseMotion(system)
    cut, start, arrived, offline, k = system.windowing, 0, 0, [], 0
    while arrived < 200:
        arrived = min(200, arrived + sizes[k % len(sizes)])
        k += 1
        hop = min(arrived - 11 - start, cut.advance)
        if hop < 9:
            continue
        held = FEATURES[:1].expand(50, -1)
        spoken = FEATURES[:arrived]
        all_speech = torch.cat([held, spoken, spoken.flip(0), held, held])
        first = 50 + start - cut.context
        speech = all_speech[first : first + cut.frames + 2 * cut.context]
        window = chain.window(SpeechWindow(speech, 60, False), hop)
        offline += motion.go_on(window.part(slice(hop)))
        start += hop
    assert len(pieces) == len(offline) > 12
    for one, other in zip(joined(pieces), joined(offline), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5)


def test_speech_to_come_changes_nothing(system):
    other = torch.cat([FEATURES[:150], torch.zeros(60, 68)])
    one, two = (joined(streamed(system, f, [10])) for f in (FEATURES[:150], other))
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a, b[: len(a)])
        assert len(a) == 138


def test_joins_move_no_faster_than_the_inside(system):
    """Random weights give different windows; each starts from the end of the one before."""
    pieces = streamed(system, FEATURES, [20], Pace(hop=20, heard_ahead=12))
    poses, _, faces = joined(pieces)
    local = matrix_from_axis_angle(torch.from_numpy(poses).unflatten(-1, (-1, 3)))
    _, positions = joint_positions_from_local(local, open_body_skeleton())
    for points in (positions[:, JOINT_INDEX["right_wrist"]], torch.from_numpy(faces)):
        step = points.diff(dim=0).norm(dim=-1)
        frames = torch.arange(len(step))
        shared = (frames >= 19) & ((frames + 1) % 20 < 9)
        assert step[shared].max() < 1.6 * step[~shared].max()


def test_memory_does_not_grow_and_place_does_not_drift(system):
    live, pieces = LiveMotion(system, OPTIONS, PACE), []
    for block in FEATURES.repeat(3, 1).split(52):
        live.hear(block)
        while live.is_due:
            pieces += live.step()
    assert len(live._speech) < 4 * 60 + 2 * 2 * system.windowing.context + 60
    if system.root_motion == "place":
        _, trans, _ = joined(pieces)
        assert np.abs(trans[:, [0, 2]]).max() < 3.0


@pytest.mark.parametrize("pace", [Pace(hop=7), Pace(hop=53), Pace(heard_ahead=7)])
def test_a_pace_that_windows_cannot_keep_is_refused(folder, pace):
    with pytest.raises(ValueError, match="gan/5 needs 8 to 52 and at least 8"):
        LiveMotion(load_system("gan/5", folder), OPTIONS, pace)
