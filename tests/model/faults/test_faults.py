"""Every fault of the table is found where it is planted, and none in motion of people."""

import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from app.findings.metric_table import metric_values
from app.findings.verdict import make_verdict
from app.run.examples import CLEAN
from conventions.joints import JOINT_INDEX
from model.diagnostics import analyse_raw
from model.faults.analysis import (
    AnalysedMotion,
    Finding,
    format_time,
    longest_true_ranges,
    most_serious_first,
    rank_findings,
)
from model.faults.table import FAULTS, STILL, drop_findings_on_missing_parts, find_faults
from model.formats.read import read_any_motion
from model.metrics.lag import speech_bands_by_frame
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, load_motion
from model.speech.audio import load_speech
from tests.helpers import beat2_folder, foreign_folder
from tests.model.faults.planted import PLANTED, Planted

SKELETON = open_body_skeleton()


@dataclass(frozen=True, eq=False)
class Person:
    motion: Motion
    heard: np.ndarray
    analysed: AnalysedMotion


def person(motion: Motion, heard: np.ndarray) -> Person:
    return Person(motion, heard, analyse_raw(motion, SKELETON))


@pytest.fixture(scope="module")
def example() -> Person:
    """14 s that come with the program."""
    return person(
        load_motion(CLEAN), speech_bands_by_frame(load_speech(CLEAN.with_suffix(".wav")).waveform)
    )


@pytest.fixture(scope="module")
def recorded() -> Person:
    folder = beat2_folder()
    sound = load_speech(folder / "wave16k" / "2_scott_0_1_1.wav")
    motion = load_motion(folder / "smplxflame_30" / "2_scott_0_1_1.npz")
    return person(motion, speech_bands_by_frame(sound.waveform))


def evidence_of(motion: Motion, person: Person, planted: Planted) -> AnalysedMotion:
    """A motion beside what the fault needs."""
    reference = None
    if planted.beside == "reference":
        reference = person.analysed
        if motion.num_frames != person.motion.num_frames:
            reference = analyse_raw(person.motion.part(slice(motion.num_frames)), SKELETON)
    heard = person.heard if planted.beside == "speech" else None
    return analyse_raw(motion, SKELETON, reference, planted.windows, speech_log_mel=heard)


@pytest.mark.parametrize("planted", PLANTED, ids=lambda p: f"{p.name}-{p.kind}-{p.beside}")
def test_a_planted_fault_is_found_and_told(example, planted):
    if planted.beside == "speech":  # a face that follows it from frame to frame
        mixed = np.random.default_rng(0).normal(size=(100, 12))
        example = replace(example, heard=example.motion.expressions @ mixed)
    analysed = evidence_of(planted.plant(example.motion), example, planted)
    found = find_faults(analysed)
    assert {finding.kind for finding in found} == {planted.kind, *planted.also}
    assert found == most_serious_first(found)
    assert found[0].kind == (planted.first or planted.kind)
    finding = next(finding for finding in found if finding.kind == planted.kind)
    assert finding.limit_ratio >= 1.0 and finding.sentence.endswith(".")
    assert planted.says in finding.sentence
    for name, value in planted.numbers.items():
        if isinstance(value, float):
            value = pytest.approx(value, rel=0.03, abs=0.01)
        assert finding.numbers.get(name) == value, (name, finding.numbers)
    if (unit := finding.numbers.get("unit")) == "%":
        (printed,) = re.findall(rf" ([\d.]+) {unit}", finding.message)
        assert finding.numbers["value"] == pytest.approx(float(printed), rel=0.06)
    for first, last in finding.frame_ranges:
        assert 0 <= first <= last < example.motion.num_frames
    measured = {"clean": example.analysed.metrics, "planted": analysed.metrics}
    numbers: Any = {name: {"raw": metric_values(raw)} for name, raw in measured.items()}
    headline = make_verdict("right_middle", [numbers], is_generated=False)
    assert rank_findings({"clean": [], "planted": found})[0][0] == "planted"
    if re.search("rotation noise|tremble", found[0].sentence.lower()) and headline is not None:
        worst = "Jerk of clean (lowest) compared with planted (highest): "
        assert headline.comparison.startswith(worst), "or of another point than the shaken"


def test_every_fault_of_the_table_is_planted():
    planted = {(planted.kind, planted.beside) for planted in PLANTED}
    assert {fault.kind for fault in (*FAULTS, STILL)} == {kind for kind, _ in planted}
    assert {
        (fault.kind, fault.required_input) for fault in FAULTS if fault.required_input
    } <= planted


def test_a_clean_clip_is_left_alone_whole_and_in_parts(example):
    assert find_faults(analyse_raw(example.motion, SKELETON, speech_log_mel=example.heard)) == []
    for part in (
        slice(0, 300),
        slice(60, 150),
        slice(100, 140),
        slice(4),
        slice(3),
        slice(2),
        slice(1),
    ):
        assert find_faults(analyse_raw(example.motion.part(part), SKELETON)) == []


def test_one_step_of_a_joint_is_no_seam(example):
    poses = example.motion.poses.copy()
    poses[104:, 3 * JOINT_INDEX["right_shoulder"]] += 0.3
    found = find_faults(analyse_raw(replace(example.motion, poses=poses), SKELETON))
    assert not {finding.kind for finding in found} & {"seams", "period", "pops"}


@pytest.mark.slow  # as those of test_false_alarms.py
@pytest.mark.beat2
def test_one_recording_beside_another_is_left_alone(recorded):
    other = load_motion(beat2_folder() / "smplxflame_30" / "2_scott_0_2_2.npz")
    frames = min(other.num_frames, recorded.motion.num_frames)
    one, two = (analyse_raw(m.part(slice(frames)), SKELETON) for m in (recorded.motion, other))
    first = recorded.motion.part(slice(frames))
    assert find_faults(analyse_raw(first, SKELETON, speech_log_mel=recorded.heard[:frames])) == []
    for analysed, reference in ((one, two), (two, one)):
        beside = analyse_raw(analysed.motion, SKELETON, reference)
        assert find_faults(beside) == []


EXPECTED = {
    "mambatalk_2_scott_0_2_2": {"foot_slide", "jerk"},
    "semtalk_svib_2_scott_0_1_1": {"period"},
    "chgs_3_vq": {"foot_slide", "still_translation", "still_face", "jerk", "period"},
    "emage_female": {"frozen", "foot_slide", "through_floor", "jerk"},
    "talkshow_french": {"speed"},
    "zeroeggs_067_Speech_2": {"hand_in_body", "skipped_frames", "pops", "snap", "jerk", "speed"},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPECTED)
def test_what_is_true_of_others_is_found(name):
    (path,) = foreign_folder().glob(f"{name}.[nb][pv][zyh]")
    read = read_any_motion(path)
    found = drop_findings_on_missing_parts(
        find_faults(analyse_raw(read.motion, SKELETON)), read.missing_parts
    )
    assert {finding.kind for finding in found} == EXPECTED[name]


def test_a_finding_tells_where_it_is_worst_and_the_gravest_come_first(example):
    plant = {p.name: p.plant for p in PLANTED}
    motion = plant["freeze of 2 s"](plant["7 Hz in the arms"](example.motion))
    found = find_faults(analyse_raw(motion, SKELETON))
    assert found[0].kind == "frozen" and len(found) > 1
    assert found[0].worst_frame == 300 and found[0].frame_ranges[0] == (300, 359)
    told = found[0].as_json()
    assert (told["worst_frame"], told["worst_time_s"], told["frames"]) == (300, 10.0, [[300, 359]])
    assert told["severity"] == 3 and told["limit_ratio"] > 1


def test_of_each_motion_the_gravest_comes_first_the_worst_motion_before_all():
    twice, narrow = (
        Finding(f"{each}.", {}, limit_ratio=2.0, max_ratio_between_clips=ratio)
        for each, ratio in (("X", 4.0), ("Y", 2.0))
    )
    angles, grave = replace(narrow, severity=1), Finding("Z.", {}, severity=3)
    assert [each.deviation for each in (twice, narrow, angles, grave)] == [0.5, 1.0, 0.5, 0.0]
    found = {"a": [narrow], "b": [twice, angles, twice], "c": [angles, grave], "d": []}
    far = Finding("W.", {}, limit_ratio=9.0)
    assert rank_findings({"a": [far, angles], "b": [grave, narrow]})[2:] == [
        ("b", narrow),
        ("a", angles),
    ]
    assert rank_findings(found) == [
        *(("c", grave), ("b", twice), ("a", narrow)),
        *(("c", angles), ("b", angles), ("b", twice)),
    ]


@pytest.mark.parametrize("frames", [90, 300])
def test_of_motions_that_shake_the_one_whose_fingertips_jerk_most_is_told_first(example, frames):
    """As the headline has it, also of clips that are too short for other levels."""
    plant = next(p.plant for p in PLANTED if p.name == "noise everywhere")
    clean = example.motion.part(slice(frames))
    noise = plant(example.motion).part(slice(frames)).poses - clean.poses
    noisy = {f"x{k}": replace(clean, poses=clean.poses + k * noise) for k in (2, 4, 1)}
    found = {name: find_faults(analyse_raw(each, SKELETON)) for name, each in noisy.items()}
    names = list(dict.fromkeys(name for name, _ in rank_findings(found)))
    assert names == ["x4", "x2", "x1"]
    assert all("jerk" in {each.kind for each in found[name]} for name in names)


def test_times_and_stretches():
    assert [format_time(frame) for frame in (0, 45, 1799)] == ["0:00.0", "0:01.5", "1:00.0"]
    there = np.array([0, 1, 1, 0, 0, 1, 1, 1, 0, 1], bool)
    assert longest_true_ranges(there) == ((5, 7), (1, 2), (9, 9))
