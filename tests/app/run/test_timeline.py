"""What is drawn under the bodies: curves, peaks, the worst seconds, words and accents."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.run.bodies import PointTracker, make_point_tracker
from app.run.timeline import (
    derivative_curve,
    make_timeline,
    point_curves,
    transcript_tiers,
    waveform_peaks,
    with_joint_snaps,
    worst_seconds,
)
from conventions.names import REFERENCE_NAME
from model.faults.analysis import Finding
from model.plan.annotation_files import Interval
from model.speech.audio import Speech, load_speech
from model.speech.transcript import Accent, Transcript, Word
from model.storage.cards import BUNDLED_WEIGHTS
from renderer.body.body import load_body
from tests.app.fakes import made_motion
from tests.helpers import ROOT, smooth_motion_example
from tests.model.made import made_waveform
from tests.renderer.body.test_body import expanded_to_smplx


def along_x(values: np.ndarray) -> np.ndarray:
    return np.stack([values, 0 * values, 0 * values], axis=1)


def test_jerk_and_speed_of_known_motion():
    seconds = np.arange(31) / 30
    jerk = derivative_curve(along_x(seconds**3), 3, decimals=6)
    assert jerk["values"] == pytest.approx([6.0] * 28)
    speed = derivative_curve(along_x(2 * seconds), 1, decimals=6)
    assert speed["values"] == pytest.approx([2.0] * 30)
    for num_frames in (1, 2, 3):
        assert derivative_curve(np.zeros((num_frames, 3)), 3, 1)["values"] == [], "too short"


@pytest.mark.parametrize("order", [1, 3])
def test_a_jump_stands_where_it_is_seen(order):
    """Between frames 49 and 50: the picture changes at 50 / 30 s."""
    curve = derivative_curve(along_x((np.arange(100) >= 50).astype(float)), order, 3)
    values = np.array(curve["values"])
    seconds = curve["start_s"] + curve["step_s"] * np.arange(len(values))
    assert np.average(seconds, weights=values) == pytest.approx(50 / 30, abs=1e-3)


@given(at=st.integers(1, 4998), most=st.integers(50, 900))
@settings(max_examples=25, deadline=None, derandomize=True)
def test_a_long_curve_keeps_its_peaks_where_they_are(at, most):
    track = along_x((np.arange(5000) >= at).astype(float))
    curve = derivative_curve(track, 1, 3, max_points=most)
    values = np.array(curve["values"])
    assert len(values) <= most and values.max() == pytest.approx(30.0)
    peak_s = curve["start_s"] + curve["step_s"] * values.argmax()
    assert abs(peak_s - at / 30) <= curve["step_s"] / 2 + 1e-3


def test_peaks_are_the_loudest_of_each_stretch():
    waveform = np.zeros(1000, np.float32)
    waveform[[10, 510]] = 0.5, -0.25
    assert waveform_peaks(waveform, num_peaks=4) == [100, 0, 50, 0]
    assert waveform_peaks(np.zeros(8, np.float32), num_peaks=4) == [0, 0, 0, 0]
    assert waveform_peaks(np.ones(2, np.float32), num_peaks=4) == [100, 100]


KINDS = ("raw", "savgol")


def test_the_time_line_holds_every_motion_raw_and_filtered():
    tracker = PointTracker()
    speech = Speech(made_waveform(16_000 * 2), "sha")
    timeline = make_timeline(speech, {"a": made_motion(60), "b": made_motion(45)}, "raw", tracker)
    assert timeline["duration_s"] == 2.0
    raw, filtered = (timeline["curves"]["a"][kind]["jerk_m_s3"]["values"] for kind in KINDS)
    assert len(raw) == len(filtered) == 57
    assert 0 < np.mean(filtered) < np.mean(raw)
    assert len(timeline["curves"]["b"]["raw"]["speed_m_s"]["values"]) == 44
    assert {second["name"] for second in timeline["worst"]} <= {"a", "b"}
    assert timeline["worst"][0]["end_s"] - timeline["worst"][0]["start_s"] == 1.0
    assert all(0 <= onset <= 2 for onset in timeline["onsets_s"])
    json.dumps(timeline, allow_nan=False)
    alone = make_timeline(None, {"a": made_motion(60)}, "savgol", tracker)
    assert list(alone["curves"]["a"]) == ["savgol"], "nothing is claimed to be raw"
    assert (alone["peaks"], alone["duration_s"]) == ([], 2.0)


def test_phones_and_accents_are_handed_on_and_those_that_are_heard_told_with_their_strength():
    phones = (Interval(0.2, 0.3, "N"), Interval(0.3, 0.6, "OW1"))
    said = Transcript((Word(0.2, 0.6, "no"),), phones=phones, accents=(Accent(0.31, 0.8),))
    told = transcript_tiers(said)
    assert told["phones"] == [(0.2, 0.3, "N"), (0.3, 0.6, "OW1")]
    assert told["accents"] == [(0.31, 0.8)]
    speech = load_speech(ROOT / "examples" / "the_huge_box.wav")
    line = make_timeline(speech, {"a": made_motion(8)}, "raw", PointTracker(), BUNDLED_WEIGHTS)
    heard = line["heard_accents"]
    assert heard and all(0 < at < speech.duration_s and 0 <= much <= 1 for at, much in heard)


def point(num_frames: int, **trembles: float) -> np.ndarray:
    """A point that stands still but trembles from a frame on, ``f60=0.01``, for a second."""
    track = np.zeros((num_frames, 3))
    for name, amount_m in trembles.items():
        start = int(name.removeprefix("f"))
        track[start : start + 30 : 2, 0] = amount_m
    return track


def test_the_worst_seconds_come_by_how_bad_they_are_whichever_motion_they_are_of():
    tracks = {"a": point(300, f60=0.01, f200=0.03), "b": point(300, f130=0.02)}
    found = worst_seconds(tracks, count=3)
    assert [second["name"] for second in found] == ["a", "b", "a"]
    for second, start in zip(found, (200, 130, 60), strict=True):
        assert abs(second["start_s"] - start / 30) <= 0.1
        assert second["end_s"] - second["start_s"] == 1.0
    jerks = [second["jerk_m_s3"] for second in found]
    assert jerks == sorted(jerks, reverse=True)
    # 15 Hz of amplitude x: third differences of 4 x, in m / (1/30 s)^3.
    assert abs(jerks[0] - 4 * 0.03 * 30**3) < 0.1 * jerks[0]


def test_no_two_of_them_overlap_and_a_short_clip_is_all_of_one():
    noise = np.random.default_rng(0).normal(0.0, 0.01, (2, 200, 3))
    found = worst_seconds({"a": noise[0], "b": noise[1]}, count=9)
    starts = sorted(second["start_s"] for second in found)
    assert len(starts) >= 3 and np.diff(starts).min() >= 1.0
    (found,) = worst_seconds({"a": point(20, f5=0.01)})
    assert (found["start_s"], found["end_s"]) == (0.0, round(20 / 30, 4))
    assert worst_seconds({"a": point(3)}) == worst_seconds({}) == []


def found(kind: str, limit_ratio: float, at: int) -> Finding:
    numbers = {"joint": "left_elbow", "snap_deg": 132.0}
    return Finding("It.", numbers, limit_ratio=limit_ratio, worst_frame=at, kind=kind)


def test_a_snap_is_the_worst_second_where_it_is_the_gravest_finding_and_else_among_them():
    tracks = {"a": point(300, f60=0.01, f200=0.03), "b": point(300)}
    line = {"duration_s": 10.0, "curves": tracks, "worst": worst_seconds(tracks, count=2)}
    by_jerk = [each["jerk_m_s3"] for each in line["worst"]]
    snap, jerk = found("snap", 4.0, 3), found("jerk", 2.0, 0)
    gravest = with_joint_snaps(
        line, {"b": [snap, jerk], "a": [jerk], REFERENCE_NAME: [snap]}, count=2
    )
    first, second = gravest["worst"]
    assert (first["name"], first["start_s"], first["end_s"]) == ("b", 0.0, 1.0)
    assert (first["joint"], first["snap_deg"]) == ("left elbow", 132.0)
    assert second["jerk_m_s3"] == by_jerk[0]
    _, last = with_joint_snaps(line, {"b": [jerk, snap]}, count=2)["worst"]
    assert last["snap_deg"] == 132.0 and not last["is_gravest"]
    within = with_joint_snaps(line, {"a": [jerk, found("snap", 4.0, 215)]}, count=2)
    assert within == with_joint_snaps(line, {}, count=2) == line, "a second shows it already"


@pytest.mark.slow
def test_with_a_licensed_body_the_curves_follow_its_vertex_as_the_numbers_do(tmp_path):
    body_path, motion = tmp_path / "SMPLX_NEUTRAL.npz", smooth_motion_example(37)
    expanded_to_smplx(load_body(), body_path)
    vertex = make_point_tracker(body_path)
    rigid = PointTracker()
    curves = make_timeline(None, {"a": motion}, "raw", vertex)["curves"]["a"]["raw"]
    assert curves == point_curves(vertex.track(motion)) != point_curves(rigid.track(motion))
