"""Edits as they come from outside, what they do to a plan, and the motion made again."""

import base64
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from app.errors import Cancelled, RunError
from app.page.routes.media import WEB_FOLDER
from app.run.batch.saved_run import copy_run
from app.run.callbacks import NO_CALLBACKS, FolderUpdated, RunCallbacks, RunEvent
from app.run.output.run_folder import Row, drop_unfinished_edits, read_run, zip_run
from app.run.pipeline import generate
from app.run.plan_edits.edited_motion import EditResult, PlanEditRequest, regenerate_edited
from app.run.plan_edits.edits import MAX_EDITS, Edit, apply_edits, find_alternatives, parse_edits
from app.run.requests.convert import replace_fields
from app.run.requests.requests import AnyRun
from model.motion.motion import load_motion
from model.plan import editing
from model.plan.editing import GestureKey, add_gesture, gestures
from model.plan.files import read_plan_file, write_plan_file
from model.plan.kinds import USUAL_STROKE_GOALS
from model.plan.plan import GesturePlan, PlanError
from model.plan.style import style_of
from model.speech.audio import write_wav
from model.speech.transcript import Word
from model.systems.planned.config import PLANNED
from tests.app.requests import generate_request
from tests.model.made import made_waveform
from tests.model.plan.made import phase

SECONDS = 14.0
SPOKEN = 12.0
WORDS = (Word(1.0, 1.4, "and"), Word(4.0, 4.5, "You"), Word(9.0, 9.5, "there"))
FIRST = {"side": "right", "lands": 2.0}


@pytest.fixture
def plan() -> GesturePlan:
    still = (phase(0.0, SECONDS, "rest"),)
    made = GesturePlan(SECONDS, left=still, right=still)
    made = add_gesture(made, "offer", 2.0, "right").plan
    return add_gesture(made, "frame", 6.0, "both", "all").plan


def done(plan, *told):
    return apply_edits(plan, parse_edits(list(told)), WORDS)


def lands(plan, side):
    return [round(gesture.stroke_end_s, 3) for gesture in gestures(plan, side)]


def test_a_gesture_goes_to_a_time_or_a_word(plan):
    at_time = done(plan, {"do": "move", "side": "right", "lands": 2.0, "at": 2.8}).plan
    assert lands(at_time, "right") == [2.8, 6.0]
    on_word = done(plan, {"do": "move", "side": "right", "lands": 2.0, "word": 2}).plan
    assert lands(on_word, "right") == [6.0, 9.15]
    strokes = [one.word for one in on_word.right if one.phase == "stroke"]
    assert strokes == ["all", "there"]


def test_both_hands_of_a_gesture_go_together(plan):
    moved = done(plan, {"do": "move", "side": "left", "lands": 6.0, "at": 7.0}).plan
    assert lands(moved, "left") == [7.0] and lands(moved, "right") == [2.0, 7.0]
    gone = done(plan, {"do": "delete", "side": "right", "lands": 6.0}).plan
    assert lands(gone, "left") == [] and lands(gone, "right") == [2.0]
    one = done(plan, {"do": "hands", "side": "left", "lands": 6.0, "hands": "left"}).plan
    assert lands(one, "left") == [6.0] and lands(one, "right") == [2.0]


def test_a_point_is_added_on_a_word_with_the_hand_that_is_asked_for(plan):
    made = done(plan, {"do": "add", "kind": "you", "word": 1, "hands": "left"}).plan
    assert lands(made, "left") == [4.15, 6.0] and lands(made, "right") == [2.0, 6.0]
    (stroke,) = [one for one in made.left if one.kind == "you" and one.phase == "stroke"]
    assert stroke.word == "you"


def test_size_height_speed_and_hold_are_what_editing_makes_of_them(plan):
    first = GestureKey("right", 2.0)
    for told, made in (
        ({"do": "size", "size": 1.3}, editing.scale_gesture(plan, first, 1.3)),
        ({"do": "height", "by": 0.1}, editing.raise_gesture(plan, first, 0.1)),
        ({"do": "speed", "speed": 0.8}, editing.scale_gesture_speed(plan, first, 0.8)),
        ({"do": "hold", "hold": 1.0}, editing.set_hold(plan, first, 1.0)),
    ):
        assert done(plan, told | FIRST) == made


def test_the_end_of_a_phase_moves_in_both_hands_with_the_word_that_it_is_on(plan):
    longer = done(plan, {"do": "end", "side": "left", "ends": 6.3, "at": 7.5}).plan
    for hand in (longer.left, longer.right):
        (hold,) = [one for one in hand if one.phase == "hold" and one.start_s == 6.0]
        assert hold.end_s == pytest.approx(7.5)

    def said(of):
        return {round(one.end_s, 2): one.word for one in of.right if one.phase == "stroke"}

    on_word = done(plan, {"do": "move", "side": "right", "lands": 2.0, "word": 1}).plan
    still_on = done(on_word, {"do": "end", "side": "right", "ends": 4.15, "at": 4.06}).plan
    assert said(still_on) == {4.06: "you", 6.0: "all"}
    slow = done(still_on, {"do": "end", "side": "right", "ends": 3.84, "at": 3.7}).plan
    assert said(slow) == {4.06: "you", 6.0: "all"}
    off = done(slow, {"do": "end", "side": "right", "ends": 4.06, "at": 3.95}).plan
    assert said(off) == {3.95: "", 6.0: "all"}


def test_head_and_eyes_are_edited_alike(plan):
    made = done(
        plan,
        {"do": "nod", "at": 3.0},
        {"do": "blink", "at": 3.5},
        {"do": "look", "at": 13.5, "yaw": 15.0, "pitch": 0.0},
    ).plan
    assert len(made.nods) == len(made.blinks) == 1 and made.looks[0].end_s == SECONDS
    there = (("nods", 3.01), ("looks", 13.5), ("blinks", 3.5))
    gone = done(made, *({"do": "remove", "list": each, "at": at} for each, at in there)).plan
    assert not gone.nods and not gone.looks and not gone.blinks
    with pytest.raises(PlanError, match=r"'nods' has no event at 8.00 s"):
        done(plan, {"do": "remove", "list": "nods", "at": 8.0})


def test_sliders_change_the_whole(plan):
    large = done(plan, {"do": "style", "size_m": 0.5}).plan
    assert style_of(large).size_m > style_of(plan).size_m
    calm = done(plan, {"do": "style", "excite": -1.0}).plan
    assert style_of(calm).size_m < style_of(plan).size_m


def test_a_plan_from_a_file_takes_its_place(plan):
    other = add_gesture(plan, "point_up", 10.0, "right").plan
    made = done(plan, {"do": "plan", "name": "x.json", "text": other.as_json()})
    assert lands(made.plan, "right") == [2.0, 6.0, 10.0]
    short = GesturePlan(3.0, left=(phase(0.0, 3.0, "rest"),))
    with pytest.raises(PlanError, match=r"lasts 3.00 s and the speech 14.00 s"):
        done(plan, {"do": "plan", "name": "x.json", "text": short.as_json()})
    with pytest.raises(PlanError, match=r"has the wrong suffix; a plan file must end in .json"):
        done(plan, {"do": "plan", "name": "x.exe", "text": ""})
    with pytest.raises(PlanError, match="not a plan of format"):
        done(plan, {"do": "plan", "name": "../../x.json", "text": "[1]"})


def test_where_there_is_no_time_the_nearest_place_and_that_of_what_is_there_are_offered(plan):
    for told, at, left in (
        ({"do": "move", **FIRST, "at": 6.1}, 6.6, [6.1]),
        ({"do": "add", "kind": "you", "at": 6.2}, 6.6, [2.0, 6.2]),
    ):
        (edit,) = parse_edits([told])
        with pytest.raises(PlanError, match="there is no time"):
            apply_edits(plan, (edit,), WORDS)
        nearest, instead = find_alternatives(plan, edit, WORDS)
        assert (
            nearest.label == f"Nearest free time, {at} s"
            and instead.label == "Replace the 'frame' gesture"
        )
        assert at in lands(done(plan, *(each.as_json() for each in nearest.edits)).plan, "right")
        made = done(plan, *(each.as_json() for each in instead.edits)).plan
        assert (lands(made, "right"), lands(made, "left")) == (left, [])
    (fits,) = parse_edits([{"do": "add", "kind": "you", "at": 9.0}])
    assert find_alternatives(plan, fits, WORDS) == ()


def test_an_impossible_edit_is_a_sentence_and_none_of_its_batch_is_done(plan):
    with pytest.raises(PlanError, match="there is no time"):
        done(plan, {"do": "nod", "at": 3.0}, {"do": "move", **FIRST, "at": 6.1})
    with pytest.raises(RunError, match="The transcript has only 3 words"):
        done(plan, {"do": "add", "kind": "you", "word": 3})


def test_what_is_no_edit_is_refused() -> None:
    for told, match in [
        ({"do": "move"}, "`side` is missing"),
        ({"do": "move", "side": "right", "lands": 1.0}, "needs either a time or a word"),
        ({"do": "add", "kind": "you", "at": 1.0, "word": 1}, "needs either a time or a word"),
        ({"do": "move", "side": "up", "lands": 1.0, "at": 1.0}, "should be 'left' or 'right'"),
        ({"do": "delete", "side": "left", "lands": True}, "valid number"),
        ({"do": "delete", "side": "left", "lands": float("nan")}, "`lands`"),
        ({"do": "delete", "side": "left", "lands": -1}, "greater than or equal to 0"),
        ({"do": "delete", "side": "left", "lands": 10**400}, "`lands`"),
        ({"do": "delete", "side": ["left"], "lands": 1}, "should be 'left' or 'right'"),
        ({"do": "end", "side": "left", "ends": 1.0}, "`at` is missing"),
        ({"do": "size", "side": "left", "lands": 1, "size": 9}, "less than or equal to 4"),
        ({"do": "add", "kind": "x" * 41, "at": 1}, "at most 40 characters"),
        (
            {"do": "add", "kind": "you", "word": 1.5},
            "`word` cannot be 1.5: input should be",
        ),
        ({"do": "nod", "at": 1, "path": "/etc"}, "`path` is not a known key"),
        ({"do": ["nod"]}, "There is no kind of edit"),
        ({}, "There is no kind of edit"),
        ("nod", "must be an object"),
    ]:
        with pytest.raises(RunError, match=match):
            parse_edits([told])


def test_there_is_an_end_to_how_much_comes_at_once():
    with pytest.raises(RunError, match=f"at most {MAX_EDITS}"):
        parse_edits([{"do": "nod", "at": 1.0}] * (MAX_EDITS + 1))
    for told in ({"do": "nod"}, None, "x" * 100):
        with pytest.raises(RunError, match="a list"):
            parse_edits(told)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, planned_weights: Path) -> AnyRun:
    """Of a run that is there."""
    folder = tmp_path_factory.mktemp("take")
    write_wav(folder / "talk.wav", made_waveform(round(16_000 * SPOKEN)))
    still = (phase(0.0, SPOKEN, "rest"),)
    plan = add_gesture(GesturePlan(SPOKEN, left=still, right=still), "offer", 9.0, "right").plan
    write_plan_file(plan, folder / "plan.json")
    request = generate_request(
        speech=folder / "talk.wav", out=folder / "run", weights=planned_weights,
        systems=(PLANNED,), seed=4, plan=folder / "plan.json", steps=2, has_figures=False,
    )  # fmt: skip
    generate(request)
    return request


def test_a_take_changes_what_was_edited_keeps_the_rest_and_goes_where_its_run_goes(
    run: AnyRun, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    shutil.copytree(run.output.out, folder)
    asked = PlanEditRequest(run=folder, weights=run.sampling.weights, source_row=PLANNED)
    assert regenerate_edited(asked, NO_CALLBACKS) == EditResult(0)
    rows: list[Row] = []

    def noted(event: RunEvent) -> None:
        if isinstance(event, FolderUpdated):
            rows.append(read_run(event.folder).rows[-1])

    edit = Edit("move", {"side": "right", "lands": 9.0, "at": 9.5})
    take = regenerate_edited(replace_fields(asked, edits=(edit,)), RunCallbacks(noted))
    record = read_run(folder)
    assert (take.take_number, record.state) == (1, "done") and record.message
    own, made = record.rows
    assert (made.name, made.label) == (f"{PLANNED}.take1", "version 1") and made.edit is not None
    (part,) = made.edit.regenerated_s
    assert 5 < part[0] < 9 and part[1] == SPOKEN
    old, new = (load_motion(folder / row.files["motion"]) for row in record.rows)
    stays = round(30 * part[0])
    for name in ("poses", "trans", "expressions"):  # performed once more, it is the run's motion
        np.testing.assert_array_equal(getattr(old, name)[:stays], getattr(new, name)[:stays])
    assert not np.array_equal(old.poses[stays:], new.poses[stays:])
    there = [row.available for row in rows if row.available is not None]
    assert there[-1].num_ready == old.num_frames and {row.name for row in rows} == {made.name}
    assert len({one.num_ready for one in there}) > 1, "it comes window by window"
    assert own.available is not None and {one.root_transform for one in there} == {
        own.available.root_transform
    }
    assert made.color != own.color
    curves = json.loads((folder / "timeline.json").read_text())["curves"]
    assert {PLANNED, made.name} <= curves.keys(), "the jerk of both stands in the time line"
    jerk = [
        float(np.mean(curves[each]["raw"]["jerk_m_s3"]["values"])) for each in (made.name, PLANNED)
    ]
    assert take.notes[0].endswith(f": {jerk[0]:.0f} m/s³, before the edit {jerk[1]:.0f} m/s³.")
    plan = read_plan_file(folder / made.files["input_plan"]).plan
    assert [one.stroke_end_s for one in gestures(plan, "right")] == [9.5]
    (gesture,) = json.loads((folder / made.files["editor"]).read_text())["gestures"]
    assert (gesture["lands"], gesture["kind"], gesture["partner"]) == (9.5, "offer", None)

    elsewhere = copy_run(zip_run(folder, tmp_path / "run.zip"), tmp_path / "elsewhere")
    assert read_run(elsewhere) == record
    assert all((elsewhere / made.files[kind]).is_file() for kind in ("frames", "motion", "plan"))
    assert not (elsewhere / made.files["state"]).exists(), "which are large, and made again"
    back = Edit("move", {"side": "right", "lands": 9.5, "at": 9.0})
    again = replace_fields(asked, run=elsewhere, source_row=made.name, edits=(back,))
    assert regenerate_edited(again, NO_CALLBACKS).take_number == 2
    last = read_run(elsewhere).rows[-1]
    assert last.edit is not None and (last.edit.original_row, last.edit.parent_row) == (
        PLANNED,
        made.name,
    )
    plan = read_plan_file(elsewhere / last.files["input_plan"]).plan
    assert [one.stroke_end_s for one in gestures(plan, "right")] == [9.0]


def test_what_cannot_be_leaves_nothing(run: AnyRun, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(run.output.out, folder)
    late = Edit("move", {"side": "right", "lands": 9.0, "at": 40.0})
    asked = PlanEditRequest(
        run=folder, weights=run.sampling.weights, source_row=PLANNED, edits=(late,)
    )
    before = read_run(folder)
    with pytest.raises(Cancelled):
        regenerate_edited(asked, RunCallbacks(should_cancel=lambda: True))
    assert read_run(folder) == before
    with pytest.raises(PlanError, match=r"before the speech does, at 12.00 s"):
        regenerate_edited(asked, NO_CALLBACKS)
    drop_unfinished_edits(folder)
    assert [row.name for row in read_run(folder).rows] == [PLANNED]


def test_each_gesture_of_the_palette_has_a_moving_picture() -> None:
    content = json.loads((WEB_FOLDER / "player" / "gestures.json").read_text())
    assert content["points"].keys() == USUAL_STROKE_GOALS.keys()
    num_points = 1 + max(max(chain) for chain in content["chains"])
    for kind, points in content["points"].items():
        frames = np.frombuffer(base64.b64decode(points), np.uint8).reshape(-1, num_points, 2)
        assert len(frames) == content["frames"] > content["still"]
        assert np.ptp(frames.astype(int), axis=0).max() > 10, f"{kind} moves"
