import json
from pathlib import Path

import numpy as np
import pytest

from app.page.player.timeline import (
    derivative_curve,
    heard_accents,
    make_timeline,
    series_looks,
    tiers_of,
    waveform_peaks,
)
from app.run.followed_point import choose_tip_source
from model.speech.audio import Speech, load_speech
from model.speech.transcript import Accent, Interval, Transcript, Word
from model.storage.cards import BUNDLED_WEIGHTS
from renderer.body.body import load_body
from renderer.figures.style import REFERENCE_STYLE, SYSTEM_STYLES
from tests.app.fakes import made_motion
from tests.model.made import made_waveform

TIP = choose_tip_source(load_body(), None)


def along_x(values: np.ndarray) -> np.ndarray:
    return np.stack([values, 0 * values, 0 * values], axis=1)


def test_jerk_and_speed_of_known_motion() -> None:
    seconds = np.arange(31) / 30
    jerk = derivative_curve(along_x(seconds**3), 3, decimals=6)
    assert jerk["values"] == pytest.approx([6.0] * 28)
    speed = derivative_curve(along_x(2 * seconds), 1, decimals=6)
    assert speed["values"] == pytest.approx([2.0] * 30)


@pytest.mark.parametrize("order", [1, 3])
def test_a_jump_stands_where_it_is_seen(order: int) -> None:
    """Between frames 49 and 50: the picture changes at 50 / 30 s."""
    curve = derivative_curve(along_x((np.arange(100) >= 50).astype(float)), order, 3)
    values = np.array(curve["values"])
    seconds = curve["start_s"] + curve["step_s"] * np.arange(len(values))
    assert np.average(seconds, weights=values) == pytest.approx(50 / 30, abs=1e-3)


def test_a_long_curve_keeps_its_peaks_where_they_are() -> None:
    track = along_x((np.arange(5000) >= 3333).astype(float))
    curve = derivative_curve(track, 1, 3, max_points=400)
    values = np.array(curve["values"])
    assert len(values) <= 400
    assert values.max() == pytest.approx(30.0)
    peak_s = curve["start_s"] + curve["step_s"] * values.argmax()
    assert abs(peak_s - 3333 / 30) <= curve["step_s"] / 2


@pytest.mark.parametrize("num_frames", [1, 2, 3])
def test_a_clip_too_short_for_jerk_has_an_empty_curve(num_frames: int) -> None:
    assert derivative_curve(np.zeros((num_frames, 3)), 3, 1)["values"] == []


def test_peaks_are_the_loudest_of_each_stretch() -> None:
    waveform = np.zeros(1000, np.float32)
    waveform[[10, 510]] = 0.5, -0.25
    assert waveform_peaks(waveform, num_peaks=4) == [100, 0, 50, 0]
    assert waveform_peaks(np.zeros(8, np.float32), num_peaks=4) == [0, 0, 0, 0]
    assert waveform_peaks(np.ones(2, np.float32), num_peaks=4) == [100, 100]


def test_the_time_line_holds_every_motion_raw_and_filtered() -> None:
    speech = Speech(made_waveform(16_000 * 2), "sha")
    timeline = make_timeline(speech, {"a": made_motion(60), "b": made_motion(45)}, "raw", TIP)
    assert timeline["duration_s"] == 2.0
    raw, filtered = (timeline["curves"]["a"][kind]["jerk_m_s3"]["values"] for kind in _KINDS)
    assert len(raw) == len(filtered) == 57
    assert 0 < np.mean(filtered) < np.mean(raw)
    assert len(timeline["curves"]["b"]["raw"]["speed_m_s"]["values"]) == 44
    assert {second["name"] for second in timeline["worst"]} <= {"a", "b"}
    assert timeline["worst"][0]["end_s"] - timeline["worst"][0]["start_s"] == 1.0
    assert all(0 <= onset <= 2 for onset in timeline["onsets_s"])
    json.dumps(timeline, allow_nan=False)


_KINDS = ("raw", "savgol")


def test_of_filtered_motion_nothing_is_claimed_to_be_raw() -> None:
    timeline = make_timeline(None, {"a": made_motion(60)}, "savgol", TIP)
    assert list(timeline["curves"]["a"]) == ["savgol"]
    assert (timeline["peaks"], timeline["duration_s"]) == ([], 2.0)


def test_curves_look_as_in_the_figures() -> None:
    looks = series_looks(("x", "y", "reference"))
    assert [look.color for look in looks.values()] == [
        *(style.color for style in SYSTEM_STYLES[:2]),
        REFERENCE_STYLE.color,
    ]


def test_phones_and_accents_of_a_transcript_are_handed_on() -> None:
    said = Transcript(
        (Word(0.2, 0.6, "no"),),
        phones=(Interval(0.2, 0.3, "N"), Interval(0.3, 0.6, "OW1")),
        accents=(Accent(0.31, 0.8),),
    )
    told = tiers_of(said)
    assert told["phones"] == [(0.2, 0.3, "N"), (0.3, 0.6, "OW1")]
    assert told["accents"] == [(0.31, 0.8)]


def test_accents_that_are_heard_are_told_with_their_strength() -> None:
    speech = load_speech(Path(__file__).resolve().parents[4] / "examples" / "the_huge_box.wav")
    heard = heard_accents(speech, BUNDLED_WEIGHTS)
    assert heard and all(0 < at < speech.duration_s and 0 <= much <= 1 for at, much in heard)
