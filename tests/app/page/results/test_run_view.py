"""What the page's player is told of a run while its folder grows; the first example."""

import json

import pytest

from app.errors import RunError
from app.page.html_export import standalone_html
from app.page.results.run_view import example_player_value
from app.page.routes.media import SharedFolders
from app.run.callbacks import FolderUpdated, RunCallbacks, RunEvent
from app.run.output.provenance import PROVENANCE, WEIGHTS_ARE_KEY
from app.run.output.run_folder import RUN, TIMELINE, RunRecord, make_rows, read_run
from app.run.output.viewer_files import read_timeline
from model.motion.motion import save_motion
from model.plan.plan import GesturePlan, Nod
from tests.app.fakes import ASSUMED, made_motion, make_generate
from tests.app.page.results.made_run import made_run, showing_in
from tests.app.requests import generate_request

NAMES = ("globaldiff/local", "globaldiff/global", "reference")


def test_rows_are_there_at_once_and_their_files_come_one_by_one(speech, tmp_path):
    media, reference = SharedFolders(), tmp_path / "recorded.npz"
    save_motion(made_motion(60), reference)
    (tmp_path / "job").mkdir()
    out = tmp_path / "job/results"
    asked = generate_request(
        speech=speech, out=out, systems=NAMES[:2], reference=reference, is_incremental=True
    )
    run_view = showing_in(tmp_path / "job", media, "mine")
    values: list[dict] = []

    def noted(event: RunEvent) -> None:
        if isinstance(event, FolderUpdated):
            values.append(run_view.player_value())

    with pytest.raises(RunError, match=r"run\.json is missing"):
        run_view.player_value()
    plan = GesturePlan(1.0, nods=(Nod(0.5, 6.0),))
    make_generate(seconds=1.0, plan=plan)(asked, RunCallbacks(noted))
    rows = [value["rows"] for value in values if value["rows"]]
    assert all([row["name"] for row in each] == list(NAMES) for each in rows)
    assert [row["is_reference"] for row in rows[0]] == [False, False, True]
    num_ready = [row["frames_available"]["num_ready"] for row in rows[-1]]
    assert num_ready == [30] * 3, "cut to the speech"
    assert not any("input_plan" in row for each in rows for row in each)
    first = [each[0] for each in rows]
    for kind in ("frames", "motion", "plan"):
        has = [kind in row for row in first]
        assert has == sorted(has) and len({row[kind] for row in first if kind in row}) == 1
    last = values[-1]
    assert not last["running"] and all(value["running"] for value in values[:-1])
    assert last["run"] == "job"
    assert media.file_of_url(last["timeline"], "mine") and not media.file_of_url(last["audio"], "")
    assert all(media.file_of_url(row["plan"], "mine") for row in last["rows"][:2])
    assert [row["is_planned"] for row in last["rows"][:2]] == [True, False]
    assert run_view.original_rows_with_input_plan() == [NAMES[0]]


def test_another_browser_gets_addresses_of_its_own_and_changes_nothing(tmp_path):
    run_view = made_run(tmp_path / "job")
    run_view.set_editor_state()
    other = run_view.read_only_copy(lambda path: f"other/{path.name}")
    mine, theirs = run_view.player_value(), other.player_value()
    assert "editing" in mine and "editing" not in theirs
    assert theirs["audio"] == "other/speech.wav" and mine["audio"].startswith("media/")


def test_the_example_is_shown_to_every_visitor_without_a_cookie():
    media = SharedFolders()
    value = example_player_value(media)
    assert value["is_example"] and not value["running"] and value["noise"]["initial_rad"] == 0.02
    local, other = value["rows"]
    assert (local["noise_space"], other["noise_space"]) == ("local", "global")
    assert local["frames"] == other["frames"] and local["color"] != other["color"]
    assert (
        media.file_of_url(local["frames"], "of anybody") is not None
        and not local["will_have_video"]
    )
    assert media.file_of_url(value["timeline"], "") is not None


def test_a_damaged_folder_is_told_of_and_no_link_is_followed(tmp_path):
    (row,) = make_rows(["a"])
    record = RunRecord(kind="imported", tracked_point="right_wrist", rows=[row], timeline=TIMELINE)
    record.write(tmp_path / RUN)
    for content in ("[" * 10**5, "[1]", "{"):
        (tmp_path / TIMELINE).write_text(content)
        with pytest.raises(RunError, match=r"timeline\.json of this run is damaged"):
            read_timeline(tmp_path, record)
    told = json.loads((tmp_path / RUN).read_text())
    for assumed in (
        {"kind": "up"},
        {**ASSUMED, "alternatives": 3},
        {**ASSUMED, "confidence": "<b>"},
    ):
        told["rows"][0]["assumptions"] = [assumed]
        (tmp_path / RUN).write_text(json.dumps(told))
        with pytest.raises(RunError, match="is damaged"):
            read_run(tmp_path)
    told["rows"][0] |= {"assumptions": [ASSUMED], "files": {"frames": "a.frames"}}
    (tmp_path / RUN).write_text(json.dumps(told))
    (tmp_path / "a.frames").touch()
    secret = tmp_path.parent / "secret.json"
    secret.write_text(json.dumps({WEIGHTS_ARE_KEY: "a secret"}))
    (tmp_path / PROVENANCE).symlink_to(secret)
    assert "a secret" not in standalone_html(tmp_path)
