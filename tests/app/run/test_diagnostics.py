import csv
import json
from pathlib import Path

import numpy as np
import pytest

from app.errors import CancelledRun
from app.run.diagnostics import measure_motions, onsets_of, write_diagnostics
from app.run.followed_point import choose_tip_source
from app.run.output.result_folder import ResultFolder
from model.diagnostics import diagnose
from model.measures.beats import speech_onsets
from model.measures.point import Spectrum
from model.motion.kinematics import open_body_skeleton
from model.speech.audio import Speech
from model.speech.transcript import Interval, Transcript, Word
from renderer.body.body import load_body
from tests.app.measured import both, diagnostics_of
from tests.helpers import smooth_motion_example
from tests.model.made import made_waveform


def test_the_json_is_what_was_measured_and_the_csv_has_each_number_once(tmp_path: Path) -> None:
    spectrum = Spectrum(np.array([0.0, 5.0]), np.array([0.25, 0.75]))
    found = diagnostics_of(
        both(foot_slide_m_s=0.5), **{"a/b": both(tip_jerk_m_s3=1.5, tip_spectrum=spectrum)}
    )
    said = Transcript(
        (Word(0.2, 0.5, "hello", 0.75),), (), "recognised", (Interval(0.2, 0.3, "HH"),)
    )
    with ResultFolder(tmp_path) as folder:
        write_diagnostics(found, folder, said)
        folder.publish()
    content = json.loads((tmp_path / "diagnostics.json").read_text())
    (word,) = content.pop("words")
    assert word == {"start_s": 0.2, "end_s": 0.5, "text": "hello", "confidence": 0.75}
    assert content.pop("words_origin") == "recognised"
    assert content.pop("phones") == [{"start_s": 0.2, "end_s": 0.3, "text": "HH"}]
    assert content == found.as_json()
    assert content["systems"]["a/b"]["raw"]["tip_path_m_s"] is None
    with (tmp_path / "diagnostics.csv").open() as file:
        header, *rows = csv.reader(file)
    assert header == ["name", "post_filter", "measure", "index", "value"]
    assert rows[:5] == [
        ["a/b", "raw", "tip_jerk_m_s3", "", "1.5"],
        ["a/b", "raw", "tip_spectrum", "frequency_hz/0", "0.0"],
        ["a/b", "raw", "tip_spectrum", "frequency_hz/1", "5.0"],
        ["a/b", "raw", "tip_spectrum", "velocity_power/0", "0.25"],
        ["a/b", "raw", "tip_spectrum", "velocity_power/1", "0.75"],
    ]
    assert ["reference", "savgol", "foot_slide_m_s", "", "0.5"] in rows
    assert len({tuple(row[:4]) for row in rows}) == len(rows)


def test_each_motion_can_be_stopped_at_as_it_is_and_filtered() -> None:
    motions = {"a": smooth_motion_example(40), "reference": smooth_motion_example(40, seed=1)}
    tip = choose_tip_source(load_body(), None)
    told: list[float] = []
    found = measure_motions(motions, tip, on_share=told.append)
    assert told == [0.0, 0.25, 0.5, 0.75]
    assert list(found.systems) == ["a"] and found.reference is not None

    def stop(share: float) -> None:
        if share >= 0.5:
            raise CancelledRun

    with pytest.raises(CancelledRun):
        measure_motions(motions, tip, on_share=stop)


def test_the_point_is_the_one_that_the_measures_follow_of_themselves() -> None:
    motions = {"a": smooth_motion_example(40)}
    for point in ("left_index", "right_wrist"):
        found = measure_motions(motions, choose_tip_source(load_body(), None, point))
        assert found.as_json() == diagnose(motions, open_body_skeleton(), joint=point).as_json()


def test_onsets_are_those_of_the_clip() -> None:
    first, second = (
        Speech(made_waveform(32_000), "first"),
        Speech(np.roll(made_waveform(32_000), 4_000), "second"),
    )
    for speech in (first, second, first):
        np.testing.assert_array_equal(onsets_of(speech), speech_onsets(speech.waveform))
