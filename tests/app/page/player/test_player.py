"""What the page's player is shown of a run while its files come."""

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from app.page.player.player import Showing, gravest_of, picture_layout, write_timeline
from app.page.player.shown_plans import found_plans, planned
from app.page.player.timeline import point_curves
from app.page.routes.media import MediaAddresses
from app.run.followed_point import choose_tip_source
from app.run.pieces import HEADER, frames_message
from app.run.requests.request import Artefact, GenerateRequest, Piece
from model.faults.evidence import MEASURED, SEEN, WRONG, Finding
from model.motion.motion import first_frames, load_motion, save_motion
from model.plan.plan import GesturePlan, HandPhase, Nod, read_plan
from model.speech.transcript import GestureTier, Interval, Transcript, Word
from renderer.body.body import load_body
from tests.app.fakes import made_motion
from tests.helpers import smooth_motion_example
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


def test_rows_are_there_at_once_and_their_files_come_one_by_one(
    showing: Showing, tmp_path: Path
) -> None:
    assert [row["name"] for row in rows(showing)] == list(NAMES)
    assert [row["is_reference"] for row in rows(showing)] == [False, False, True]
    told(showing, "video", NAMES[1], tmp_path)
    assert ["video" in row for row in rows(showing)] == [False, True, False]
    told(showing, "video", "of another run", tmp_path)
    assert len(rows(showing)) == 3
    assert rows(showing)[1]["video"] == rows(showing)[1]["video"], "an address stays the same"


def test_motion_is_there_window_by_window_and_in_the_end_as_the_whole_is(
    showing: Showing, tmp_path: Path
) -> None:
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
    showing: Showing, tmp_path: Path
) -> None:
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


def test_a_plan_is_shown_as_it_was_written_and_of_other_motion_as_it_is_found(
    tmp_path: Path,
) -> None:
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


def test_the_player_knows_where_close_ups_stand_in_a_picture() -> None:
    assert picture_layout("front", 400, ("face", "hands"), "whole") == {
        "aspect": 0.5,
        "body": [0.25, 0.75],
        "face": [0.0, 0.25],
        "hands": [0.75, 1.0],
    }
    alone = picture_layout("front", 400, (), "knees")
    assert alone == {"aspect": 0.75, "body": [0.0, 1.0]}


def test_the_time_line_follows_the_last_motion_and_holds_the_reference(
    showing: Showing, tmp_path: Path
) -> None:
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


def test_with_a_licensed_body_the_time_line_follows_its_vertex_as_the_numbers_do(
    asked: GenerateRequest, tmp_path: Path
) -> None:
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


def test_the_gravest_findings_come_first_each_with_its_second() -> None:
    findings = {
        "a": [Finding("seam", "It jumps.", {}, excess=3.0, worst_frame=45, gravity=SEEN)],
        "b": [
            Finding("still", "It stands.", {}, gravity=MEASURED),
            Finding("through", "A hand is in the chest.", {}, gravity=WRONG),
            Finding("noise", "It trembles.", {}, excess=9.0, gravity=SEEN),
        ],
    }
    assert gravest_of(findings) == [
        {"name": "b", "sentence": "A hand is in the chest.", "at": None},
        {"name": "b", "sentence": "It trembles.", "at": None},
        {"name": "a", "sentence": "It jumps.", "at": 1.5},
    ]
