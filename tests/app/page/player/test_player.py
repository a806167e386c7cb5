"""What the page's player is shown: rows while their files come, time line, the first example."""

import json
import shutil
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app import text
from app.config import EXAMPLES, AppConfig
from app.page.parts.catalogue import Catalogue, Example
from app.page.player.first_look_shown import EXAMPLE, FirstLooks, question
from app.page.player.player import Showing, gravest_of, picture_layout, write_timeline
from app.page.player.shown_plans import found_plans, planned
from app.page.player.timeline import (
    derivative_curve,
    heard_accents,
    make_timeline,
    point_curves,
    series_looks,
    tiers_of,
    waveform_peaks,
    worst_seconds,
)
from app.page.routes.media import MediaAddresses
from app.run.examples import CLEAN, FACTS, STEADY, TREMBLING, first_look
from app.run.followed_point import choose_tip_source
from app.run.pieces import HEADER, frames_message
from app.run.requests.request import Artefact, GenerateRequest, Piece
from model.faults.evidence import SEEN, WRONG, Finding
from model.motion.motion import first_frames, load_motion, save_motion
from model.plan.plan import GesturePlan, HandPhase, Nod, read_plan
from model.speech.audio import Speech, load_speech
from model.speech.transcript import Accent, GestureTier, Interval, Transcript, Word
from model.storage.cards import BUNDLED_WEIGHTS
from model.systems.globaldiff.config import BEST
from renderer.body.body import load_body
from renderer.figures.style import REFERENCE_STYLE, SYSTEM_STYLES
from tests.app.fakes import FakeWorker, made_motion
from tests.helpers import ROOT, smooth_motion_example
from tests.model.made import made_waveform
from tests.renderer.body.test_body import expanded_to_smplx

NAMES = ("globaldiff/local", "globaldiff/global", "reference")
PLAN = GesturePlan(
    2.0,
    right=(HandPhase(0.5, 1.0, "stroke", (0.2, -0.1, 0.3), "offer", "never"),),
    nods=(Nod(1.25, 6.0),),
)


@pytest.fixture
def asked(speech: Path, tmp_path: Path) -> GenerateRequest:
    """Of a run beside a recorded motion that is longer than the speech."""
    reference = tmp_path / "recorded.npz"
    save_motion(made_motion(60), reference)
    return GenerateRequest(speech, tmp_path / "out", tmp_path, reference=reference)


@pytest.fixture
def showing(asked: GenerateRequest, tmp_path: Path) -> Showing:
    said = Transcript(
        (Word(0.25, 0.5, "hello"),),
        (GestureTier("gesture_left", (Interval(0.2, 0.4, "stroke beat"),)),),
    )
    addresses = MediaAddresses()
    return Showing.of_run(asked, NAMES, tmp_path, addresses=addresses, visitor="", said=said)


def told(showing: Showing, kind: Any, name: str, folder: Path) -> None:
    path = folder / f"{name.replace('/', '-')}.{'npz' if kind == 'motion' else 'mp4'}"
    save_motion(made_motion(37), path) if kind == "motion" else path.touch()
    showing.take(Artefact(kind, name, path))


def rows(showing: Showing, **options: Any) -> list[dict[str, Any]]:
    return showing.value(**options)["rows"]


def test_rows_are_there_at_once_and_their_files_come_one_by_one(showing, tmp_path):
    assert [row["name"] for row in rows(showing)] == list(NAMES)
    assert [row["is_reference"] for row in rows(showing)] == [False, False, True]
    told(showing, "video", NAMES[1], tmp_path)
    assert ["video" in row for row in rows(showing)] == [False, True, False]
    told(showing, "video", "of another run", tmp_path)
    assert len(rows(showing)) == 3
    assert rows(showing)[1]["video"] == rows(showing)[1]["video"], "an address stays the same"


def test_motion_is_there_window_by_window_and_in_the_end_as_the_whole_is(showing, tmp_path):
    motion = made_motion(37)
    showing.begin()
    path = tmp_path / "globaldiff-local.frames"
    for start, end in pairwise([0, 10, 11, 37]):
        message = frames_message(start, motion.part(slice(start, end)))
        showing.take_piece(Piece(NAMES[0], message, end, 37, 0.1, (0.0, 0.2, 0.0)))
        first, second, recorded = rows(showing)
        place = {"bytes": path.stat().st_size, "place": [0.1, 0.0, 0.2, 0.0]}
        assert first["there"] == {"end": end, "num_frames": 37, **place}
        assert "there" not in second and "motion" not in first
        assert recorded["there"]["end"] == 37, "cut to the speech, and there from the first"
    url = first["frames"]
    assert path.stat().st_size == 3 * HEADER.size + 37 * 504
    told(showing, "motion", NAMES[0], tmp_path)
    (row, *_) = rows(showing)
    assert row["frames"] == url and row["there"]["bytes"] == path.stat().st_size
    told(showing, "motion", NAMES[1], tmp_path)
    (_, second, _) = rows(showing, is_over=True)
    assert second["there"]["bytes"] == HEADER.size + 37 * 504
    assert second["there"]["end"] == second["there"]["num_frames"] == 37
    assert "audio" in showing.value(is_over=True)


def test_each_row_has_the_plan_that_it_performed_or_one_that_is_found_once_all_is_there(
    showing, tmp_path
):
    written = tmp_path / "run.plan.json"
    GesturePlan(37 / 30, nods=(Nod(0.5, 6.0),)).write(written)
    showing.take(Artefact("plan", NAMES[0], written))
    told(showing, "motion", NAMES[0], tmp_path)
    assert ["plan" in row for row in rows(showing)] == [True, False, False]
    told(showing, "motion", NAMES[1], tmp_path)
    urls = [row["plan"] for row in rows(showing, is_over=True)]
    files = [showing._addresses.find(url.rsplit("/", 1)[-1], "") for url in urls]
    plans = [json.loads(file.read_text()) for file in files if file is not None]
    assert [plan["origin"] for plan in plans] == ["planned", "found", "found"]
    assert plans[0]["nods"] == [{"time_s": 0.5, "depth_deg": 6.0}]
    assert [plan["duration_s"] for plan in plans] == [pytest.approx(37 / 30, abs=1e-3)] * 3


def test_a_plan_is_shown_as_it_was_written_and_of_other_motion_as_it_is_found(tmp_path):
    written = tmp_path / "system.plan.json"
    PLAN.write(written)
    shown = planned(written, "family/system", tmp_path)
    written.unlink()  # the run's own folder moves
    plan = json.loads(shown.read_text())
    assert plan.pop("origin") == "planned"
    shown.write_text(json.dumps(plan))
    assert read_plan(shown) == PLAN
    paths = {name: tmp_path / f"{number}.npz" for number, name in enumerate(("a/b", "reference"))}
    for path in paths.values():
        save_motion(made_motion(45), path)
    found = found_plans(paths, tmp_path)
    assert found.keys() == paths.keys() and len(set(found.values())) == 2
    for path in found.values():
        plan = json.loads(path.read_text())
        assert plan["origin"] == "found" and plan["duration_s"] == 1.5
        assert (plan["right"][0]["start_s"], plan["right"][-1]["end_s"]) == (0.0, 1.5)


def test_the_time_line_follows_the_last_motion_and_holds_the_reference(showing, tmp_path):
    told(showing, "motion", NAMES[0], tmp_path)
    assert "timeline" not in showing.value(is_over=True)
    told(showing, "motion", NAMES[1], tmp_path)
    value = showing.value(is_over=True)
    assert value["audio"] != value["timeline"]
    timeline = json.loads((tmp_path / "timeline.json").read_text())
    assert timeline["duration_s"] == pytest.approx(37 / 30, abs=1e-3)
    assert (timeline["words"], timeline["words_origin"]) == ([[0.25, 0.5, "hello"]], "given")
    assert timeline["gestures"] == {"gesture_left": [[0.2, 0.4, "stroke beat"]]}
    curves = timeline["curves"].items()
    lengths = {name: len(curve["raw"]["jerk_m_s3"]["values"]) for name, curve in curves}
    assert lengths == {name: 37 - 3 for name in NAMES}  # the reference is cut to the speech
    before = showing.value(is_over=True)
    recognised = Transcript((Word(0.3, 0.4, "hell", 0.7),))
    showing.add_words(recognised)  # given, and shown from the first
    assert showing.value(is_over=True) == before
    showing.add_words(replace(recognised, origin="recognised"))
    after = showing.value()
    assert after["timeline"] != before["timeline"] and after["audio"] == before["audio"]
    anew = showing.timeline()
    assert (anew["words"], anew["words_origin"]) == ([[0.3, 0.4, "hell"]], "recognised")
    assert anew["curves"] == timeline["curves"]


@pytest.mark.slow
def test_with_a_licensed_body_the_time_line_follows_its_vertex_as_the_numbers_do(asked, tmp_path):
    path, body_path = tmp_path / "a.npz", tmp_path / "SMPLX_NEUTRAL.npz"
    save_motion(smooth_motion_example(37), path)
    expanded_to_smplx(load_body(), body_path)
    asked = replace(asked, body=body_path)
    timeline = write_timeline(asked, {"a": path}, tmp_path)
    curves = json.loads(timeline.read_text())["curves"]

    vertex = choose_tip_source(load_body(body_path), body_path, asked.joint)
    rigid = choose_tip_source(load_body(), None, asked.joint)
    motion = load_motion(path)
    assert curves["a"]["raw"] == point_curves(vertex.track(motion))
    assert curves["a"]["raw"] != point_curves(rigid.track(motion))
    recorded = first_frames(load_motion(asked.reference), 37)
    assert curves["reference"]["raw"] == point_curves(vertex.track(recorded))


def test_the_player_knows_where_close_ups_stand_in_a_picture():
    beside = {"body": [0.25, 0.75], "face": [0.0, 0.25], "hands": [0.75, 1.0]}
    assert picture_layout("front", 400, ("face", "hands"), "whole") == {"aspect": 0.5, **beside}
    alone = picture_layout("front", 400, (), "knees")
    assert alone == {"aspect": 0.75, "body": [0.0, 1.0]}


def test_the_gravest_findings_come_first_each_with_its_second():
    findings = {
        "a": [Finding("seam", "It jumps.", {}, excess=3.0, worst_frame=45, gravity=SEEN)],
        "b": [
            Finding("through", "A hand is in the chest.", {}, gravity=WRONG),
            Finding("noise", "It trembles.", {}, excess=9.0, gravity=SEEN),
        ],
    }
    assert gravest_of(findings) == [
        {"name": "b", "sentence": "A hand is in the chest.", "at": None},
        {"name": "b", "sentence": "It trembles.", "at": None},
        {"name": "a", "sentence": "It jumps.", "at": 1.5},
    ]


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
    tip = choose_tip_source(load_body(), None)
    speech = Speech(made_waveform(16_000 * 2), "sha")
    timeline = make_timeline(speech, {"a": made_motion(60), "b": made_motion(45)}, "raw", tip)
    assert timeline["duration_s"] == 2.0
    raw, filtered = (timeline["curves"]["a"][kind]["jerk_m_s3"]["values"] for kind in KINDS)
    assert len(raw) == len(filtered) == 57
    assert 0 < np.mean(filtered) < np.mean(raw)
    assert len(timeline["curves"]["b"]["raw"]["speed_m_s"]["values"]) == 44
    assert {second["name"] for second in timeline["worst"]} <= {"a", "b"}
    assert timeline["worst"][0]["end_s"] - timeline["worst"][0]["start_s"] == 1.0
    assert all(0 <= onset <= 2 for onset in timeline["onsets_s"])
    json.dumps(timeline, allow_nan=False)
    alone = make_timeline(None, {"a": made_motion(60)}, "savgol", tip)
    assert list(alone["curves"]["a"]) == ["savgol"], "nothing is claimed to be raw"
    assert (alone["peaks"], alone["duration_s"]) == ([], 2.0)


def test_curves_look_as_in_the_figures():
    looks = series_looks(("x", "y", "reference"))
    assert [look.color for look in looks.values()] == [
        *(style.color for style in SYSTEM_STYLES[:2]),
        REFERENCE_STYLE.color,
    ]


def test_phones_and_accents_are_handed_on_and_those_that_are_heard_told_with_their_strength():
    phones = (Interval(0.2, 0.3, "N"), Interval(0.3, 0.6, "OW1"))
    said = Transcript((Word(0.2, 0.6, "no"),), phones=phones, accents=(Accent(0.31, 0.8),))
    told = tiers_of(said)
    assert told["phones"] == [(0.2, 0.3, "N"), (0.3, 0.6, "OW1")]
    assert told["accents"] == [(0.31, 0.8)]
    speech = load_speech(ROOT / "examples" / "the_huge_box.wav")
    heard = heard_accents(speech, BUNDLED_WEIGHTS)
    assert heard and all(0 < at < speech.duration_s and 0 <= much <= 1 for at, much in heard)
    assert heard_accents(speech, Path("nowhere")) == []


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


SPEECH = EXAMPLES / f"{EXAMPLE}.wav"
CARD = f"{BEST.replace('/', '-')}.json"


def test_other_weights_or_speech_are_another_example(tmp_path):
    speech, card = tmp_path / "s.wav", tmp_path / CARD
    speech.write_bytes(b"1")
    card.write_text("{}")
    folder = first_look(tmp_path, tmp_path, BEST, speech).folder
    assert first_look(tmp_path, tmp_path, BEST, speech).folder == folder
    assert tmp_path in folder.parents
    card.write_text('{"steps": 2}')
    other = first_look(tmp_path, tmp_path, BEST, speech).folder
    speech.write_bytes(b"2")
    assert len({folder, other, first_look(tmp_path, tmp_path, BEST, speech).folder}) == 3


@pytest.fixture
def config(tmp_path: Path) -> AppConfig:
    weights = tmp_path / "weights"
    weights.mkdir()
    (weights / CARD).write_text("{}")
    return AppConfig(weights=weights, kept=tmp_path / "kept")


def test_what_has_been_made_is_shown_to_every_visitor_without_a_cookie(config, tmp_path):
    media = MediaAddresses()

    def fail(*asked: Any) -> None:
        raise AssertionError("it was there, or cannot be made")

    worker = FakeWorker(does={"make_first_look": fail})

    def begun() -> FirstLooks:
        catalogue = Catalogue((BEST,), ("ann",), "", (Example("Three reasons", SPEECH),))
        return FirstLooks(config, catalogue, media, worker)

    looks = begun()
    looks.make()
    assert not looks.is_coming and not isinstance(looks.updates()[1], str), "it is not there"
    look = first_look(config.kept, config.weights, BEST, SPEECH)
    look.folder.mkdir(parents=True)
    shutil.copyfile(SPEECH, look.beginning)
    clean = load_motion(CLEAN).part(slice(40))
    for name in (STEADY, TREMBLING):
        save_motion(clean, look.folder / f"{name}.npz")
    (look.folder / FACTS).write_text(
        '{"jerk_m_s3": {"A": 110, "B": 2300}, "noise_rad": 0.012, "provenance": {}}'
    )
    looks = begun()
    assert not isinstance(looks.updates()[0].get("rows"), list)
    assert looks.is_coming and text.LOOK_COMING in looks.updates()[1]
    looks.make()
    assert not looks.is_coming and looks.version == 2
    value, told = looks.updates()
    assert value["plays"] and [row["name"] for row in value["rows"]] == [STEADY, TREMBLING]
    for row in value["rows"]:
        assert media.find(row["frames"].rsplit("/", 1)[-1], "of anybody") is not None
        assert not row["is_drawn"] and "video" not in row
    assert media.find(value["timeline"].rsplit("/", 1)[-1], "") is not None
    before, after = told.split("<summary>")
    assert "Which hand trembles?" in told, "the answer is folded away and has the numbers"
    assert TREMBLING not in before.split("<p>")[0] and "2,300" not in before
    assert "2,300" in after and "110" in after
    assert "a&lt;b" in question({"jerk_m_s3": {"A": 1, "B": 2}, "noise_rad": 0.012}, "a<b")
