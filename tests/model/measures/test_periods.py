"""Jerk that comes again after some frames is found, whatever their number; people have none."""

from dataclasses import replace

import numpy as np
import pytest

from conventions.joints import JOINT_INDEX, LOWER_BODY
from model.diagnostics import diagnose, measure_motion
from model.formats.read import read_any_motion
from model.measures.seams import Windows, find_period, part_jerk_by_phase
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, load_motion
from model.motion.tracks import Tracks, track_points
from tests.helpers import beat2_folder, foreign_folder

SKELETON = open_body_skeleton()
RECORDED = ("2_scott_0_1_1", "2_scott_0_2_2")


def rough(num_frames: int, seed: int = 0) -> Motion:
    """Joints that turn at random below 6 Hz or so, as loud at any frame as at another."""
    draws = np.random.default_rng(seed).standard_normal((num_frames + 8, 165))
    kernel = np.hanning(9)
    poses = np.apply_along_axis(lambda one: np.convolve(one, kernel, "valid"), 0, 0.006 * draws)
    return Motion(
        poses=poses.astype(np.float32),
        trans=np.zeros((num_frames, 3), np.float32),
        expressions=np.zeros((num_frames, 100), np.float32),
        expression_basis="flame100",
        betas=np.zeros(300, np.float32),
    )


def with_jumps(motion: Motion, period: int, joint: str | None = None, first: int = 5) -> Motion:
    """Turned by .04 rad back and forth every ``period`` frames."""
    poses = motion.poses.copy().reshape(-1, 55, 3)
    windows = (np.arange(len(poses)) + period - first) // period
    joints = slice(None) if joint is None else [JOINT_INDEX[joint]]
    poses[:, joints, 2] += 0.04 * (windows % 2)[:, None]
    return replace(motion, poses=poses.reshape(-1, 165))


def recorded(clip: str) -> Motion:
    return load_motion(beat2_folder() / "smplxflame_30" / f"{clip}.npz")


def tracks(motion: Motion) -> Tracks:
    return track_points(motion, SKELETON)


@pytest.mark.parametrize("period", [8, 33, 52, 60, 64, 124, 240])
def test_jumps_are_found_at_their_period_and_frame(period: int):
    found = find_period(tracks(with_jumps(rough(6 * period + 200), period, "right_shoulder")))
    assert found is not None and (found.frames, found.kind) == (period, "pulses")
    assert found.part in ("right arm", "right hand")
    assert (found.phase_frame - 5) % period in (0, 1, period - 1)
    assert found.peak_over_usual > 1.5
    for frame in found.worst_frames:
        assert (frame - found.phase_frame) % period == 0


@pytest.mark.parametrize("period", [2, 3, 4, 7])
def test_ripple_of_the_legs_is_found_in_the_legs(period: int):
    motion = rough(900)
    poses = motion.poses.copy().reshape(-1, 55, 3)
    steps = np.random.default_rng(1).standard_normal((900 // period + 1, 9, 3))
    hold = np.repeat(steps, period, axis=0)[:900]  # a code each `period` frames
    poses[:, list(LOWER_BODY)[1:]] += 0.004 * hold[:, 1:]
    found = find_period(tracks(replace(motion, poses=poses.reshape(-1, 165))))
    assert found is not None and (found.frames, found.part) == (period, "legs")


def test_what_repeats_nothing_has_no_period():
    found = [find_period(tracks(rough(length, seed))) for length in (300, 900) for seed in range(8)]
    assert found == [None] * len(found)


def test_one_jump_and_a_beat_of_the_hand_are_no_period():
    motion = rough(900)
    jump = with_jumps(motion, 450)
    assert find_period(tracks(jump)) is None
    poses = motion.poses.copy().reshape(-1, 55, 3)
    beat = np.sin(2 * np.pi * np.arange(60) / 10) > 0.9  # two seconds
    poses[300:360, JOINT_INDEX["left_wrist"], 0] += 0.1 * beat
    assert find_period(tracks(replace(motion, poses=poses.reshape(-1, 165)))) is None


@pytest.mark.parametrize("num_frames", [1, 4, 8, 40])
def test_short_and_still_motion_has_none(num_frames: int):
    assert find_period(tracks(rough(num_frames))) is None
    still = replace(rough(300), poses=np.zeros((300, 165), np.float32))
    assert find_period(tracks(still)) is None


def test_seams_are_folded_on_what_is_known_or_found():
    jumps = with_jumps(rough(900), 64, first=0)
    found = measure_motion(jumps, SKELETON, windows=None).seams
    assert found.folded_on_frames == len(found.jerk_by_window_phase_m_s3) == 64
    assert found.jerk_by_window_phase_m_s3.argmax() in (0, 1, 63)
    assert np.isnan(found.seam_jerk_ratio)  # a period has no first frame of its own
    known = measure_motion(jumps, SKELETON, windows=Windows(64, 0)).seams
    assert known.seam_jerk_ratio > 1.5 and known.folded_on_frames == 64
    nothing = measure_motion(rough(900), SKELETON, windows=None).seams
    assert nothing.folded_on_frames is None and not len(nothing.jerk_by_window_phase_m_s3)


def test_a_part_is_folded_as_all_joints_are():
    motion = with_jumps(rough(900), 30, "left_hip", first=7)
    by_phase = part_jerk_by_phase(tracks(motion), "legs", 30)
    assert by_phase.argmax() in (6, 7, 8)


def test_a_period_is_told_and_that_of_known_windows_only_once():
    jumps = with_jumps(rough(900), 64, "right_shoulder")
    found = diagnose({"a": jumps}, SKELETON).findings["a"]
    (finding,) = (each for each in found if each.kind == "period")
    assert "right arm" in finding.sentence or "right hand" in finding.sentence
    assert "every 64 frames (2.13 s)" in finding.sentence
    known = diagnose({"a": jumps}, SKELETON, windows={"a": Windows(64, 8)})
    kinds = [finding.kind for finding in known.findings["a"]]
    assert "seams" in kinds and "period" not in kinds
    assert known.as_json()["window_advance_frames"] == 64


@pytest.mark.parametrize(("advance", "overlap"), [(1, 0), (-3, 0), (52, 60), (52, -1)])
def test_windows_that_cannot_be_are_refused(advance: int, overlap: int):
    with pytest.raises(ValueError, match=f"got {advance} and {overlap}"):
        Windows(advance, overlap)


@pytest.mark.beat2
@pytest.mark.parametrize("clip", RECORDED)
def test_recordings_have_no_period_in_any_cut(clip: str):
    motion = recorded(clip)
    assert find_period(tracks(motion)) is None
    for start in range(0, motion.num_frames - 300, 300):
        assert find_period(tracks(motion.part(slice(start, start + 300)))) is None


@pytest.mark.beat2
@pytest.mark.parametrize("joint", [None, "right_shoulder", "left_hip"])
@pytest.mark.parametrize("period", [52, 60, 64, 124])
def test_jumps_planted_in_a_recording_are_found(period: int, joint: str | None):
    found = find_period(tracks(with_jumps(recorded(RECORDED[0]), period, joint)))
    assert found is not None and found.frames == period and found.chance < 1e-9


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("semtalk_svib_2_scott_0_1_1", (4, "legs")),
        ("chgs_3_vq", (4, "legs")),
        ("mambatalk_2_scott_0_2_2", None),
        ("emage_female", None),
    ],
)
def test_only_two_of_the_others_have_a_period(name: str, expected: tuple[int, str] | None):
    found = find_period(tracks(read_any_motion(foreign_folder() / f"{name}.npz").motion))
    assert (found and (found.frames, found.part)) == expected
