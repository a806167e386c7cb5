"""Every fault of the table is found where it is planted, and none in motion of people."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from conventions.names import REFERENCE_NAME
from model.diagnostics import diagnose
from model.faults.evidence import Finding, by_gravity, clock, ranked, stretches_of
from model.faults.table import FAULTS, STILL, without
from model.formats.read import read_any_motion
from model.measures.seams import Windows
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, load_motion
from model.speech.audio import load_speech
from tests.helpers import beat2_folder, foreign_folder
from tests.model.faults.planted import PLANTED, Planted, loudness
from tests.tools.corpus.conftest import flite
from tests.tools.corpus.made_motion import motion_of
from tools.corpus.clip import make_clip
from tools.corpus.people.rig import open_body_rig
from tools.corpus.people.speaker import SPEAKERS

SKELETON = open_body_skeleton()
CUT_FRAMES = 300
__all__ = ["flite"]


@dataclass(frozen=True, eq=False)
class Person:
    motion: Motion
    loudness: np.ndarray


@pytest.fixture(scope="module")
def procedural(flite: None) -> Person:
    speaker = next(s for s in SPEAKERS if s.name == "ewan")
    clip = make_clip(open_body_rig(), speaker, "train", 33.0, [10, speaker.number])
    motion = motion_of(clip)
    return Person(motion, loudness(clip.utterance.waveform))


@pytest.fixture(scope="module")
def recorded() -> Person:
    folder = beat2_folder()
    motion = load_motion(folder / "smplxflame_30" / "2_scott_0_1_1.npz")
    sound = load_speech(folder / "wave16k" / "2_scott_0_1_1.wav")
    return Person(motion, loudness(sound.waveform))


def found_in(motion: Motion, person: Person, planted: Planted) -> dict[str, Finding]:
    """What is found in a motion beside what the fault needs."""
    frames = motion.num_frames
    diagnostics = diagnose(
        {"a": motion},
        SKELETON,
        reference=person.motion.part(slice(frames)) if planted.beside == "reference" else None,
        heard=person.loudness if planted.beside == "speech" else None,
        windows={"a": Windows(52, 8)} if planted.kind == "seams" else None,
    )
    return {finding.kind: finding for finding in diagnostics.findings["a"]}


@pytest.mark.parametrize("planted", PLANTED, ids=lambda p: f"{p.name}-{p.kind}-{p.beside}")
@pytest.mark.parametrize("who", ["procedural", "recorded"])
def test_a_planted_fault_is_found(who: str, planted: Planted, request: pytest.FixtureRequest):
    person: Person = request.getfixturevalue(who)
    found = found_in(planted.plant(person.motion), person, planted)
    assert planted.kind in found, list(found)
    finding = found[planted.kind]
    assert finding.excess >= 1.0 and finding.sentence.endswith(".")
    for first, last in finding.stretches:
        assert 0 <= first <= last < person.motion.num_frames


def test_every_fault_of_the_table_is_planted():
    planted = {(planted.kind, planted.beside) for planted in PLANTED}
    assert {fault.kind for fault in (*FAULTS, STILL)} == {kind for kind, _ in planted}
    needy = {(fault.kind, fault.needs) for fault in FAULTS if fault.needs}
    assert needy <= planted


@pytest.mark.parametrize("who", ["procedural", "recorded"])
def test_people_are_left_alone(who: str, request: pytest.FixtureRequest):
    person: Person = request.getfixturevalue(who)
    cuts = [(0, person.motion.num_frames)]
    cuts += [(at, at + CUT_FRAMES) for at in range(0, person.motion.num_frames - 300, CUT_FRAMES)]
    for first, last in cuts:
        motion = person.motion.part(slice(first, last))
        found = diagnose({"a": motion}, SKELETON, heard=person.loudness[first:last])
        assert found.findings == {"a": []}


@pytest.mark.beat2
def test_one_recording_beside_another_is_left_alone():
    folder = beat2_folder() / "smplxflame_30"
    motions = [load_motion(folder / f"2_scott_0_{clip}.npz") for clip in ("1_1", "2_2")]
    for motion, reference in (motions, motions[::-1]):
        assert diagnose({"a": motion}, SKELETON, reference=reference).findings == {
            "a": [],
            REFERENCE_NAME: [],
        }


EXPECTED = {
    "mambatalk_2_scott_0_2_2": {"foot_slide", "jerk", "high_frequency"},
    "semtalk_svib_2_scott_0_1_1": {"period"},
    "chgs_3_vq": {
        *("foot_slide", "still_translation", "still_face", "jerk", "high_frequency", "period"),
    },
    "emage_female": {"frozen", "foot_slide", "through_floor", "floating", "jerk"},
    "talkshow_french": {"speed"},
    "zeroeggs_067_Speech_2": {
        *("hand_in_body", "skipped_frames", "pops"),
        *("high_frequency", "jerk", "speed"),
    },
}


@pytest.mark.parametrize("name", EXPECTED)
def test_what_is_true_of_others_is_found(name: str):
    (path,) = foreign_folder().glob(f"{name}.[nb][pv][zyh]")
    read = read_any_motion(path)
    found = without(diagnose({"a": read.motion}, SKELETON).findings["a"], read.lacks)
    assert {finding.kind for finding in found} == EXPECTED[name]


def test_the_gravest_come_first(procedural: Person):
    planted = {p.name: p.plant for p in PLANTED}
    motion = planted["freeze of 2 s"](planted["7 Hz in the arms"](procedural.motion))
    found = diagnose({"a": motion}, SKELETON).findings["a"]
    assert found[0].kind == "frozen" and len(found) > 1
    assert found == by_gravity(found)
    assert found[0].worst_frame == 300 and found[0].stretches[0] == (300, 359)
    assert "0:10.0" in found[0].sentence
    told = found[0].as_json()
    assert (told["worst_frame"], told["worst_s"], told["frames"]) == (300, 10.0, [[300, 359]])
    assert told["gravity"] == 3 and told["excess"] > 1


def test_findings_of_several_motions_are_ranked_together():
    slight, grave = Finding("x", "X.", {}, gravity=1), Finding("y", "Y.", {}, gravity=3)
    further = replace(slight, excess=4.0)
    assert ranked({"a": [slight], "b": [grave, further]}) == [
        ("b", grave),
        ("b", further),
        ("a", slight),
    ]


def test_times_and_stretches():
    assert [clock(frame) for frame in (0, 45, 1799)] == ["0:00.0", "0:01.5", "1:00.0"]
    there = np.array([0, 1, 1, 0, 0, 1, 1, 1, 0, 1], bool)
    assert stretches_of(there) == ((5, 7), (1, 2), (9, 9))
