"""What a browser tells of its stage and its editor: videos of what is seen, and takes."""

import json
from pathlib import Path
from typing import Any

import gradio as gr
import pytest

from app import text
from app.errors import RunError
from app.page.results.result_parts import ResultParts
from app.page.tabs.stage import EditMessage, EditRunner, ViewerVideoRunner
from app.page.visitors.job_folders import Job
from app.run.callbacks import FolderUpdated, RunCallbacks, StageProgress
from app.run.display import Display, ViewerState
from app.run.output.run_folder import EditInfo, locked_record, read_run
from app.run.plan_edits.edits import EditResult, PlanEditRequest, parse_edits
from app.run.requests.requests import ViewerVideoRequest
from app.run.run_writer import open_run_writer
from app.run.tasks import ViewerVideo
from model.plan.plan import GesturePlan, PlanError
from model.speech.transcript import Transcript, Word
from tests.app.fakes import made_services
from tests.app.page.made import browser
from tests.app.page.results.made_run import made_run
from tests.model.plan.made import phase

COOKIE = "a browser"
LOOK = {
    "factor": 6.5, "cutoff": 4, "hasTrail": True, "trailFrames": 60, "point": "left_index",
    "hasHeat": True, "heatScale": 300, "isAligned": False, "isWhole": True, "hasWords": True,
    "tone": "dark", "build": "broad", "hasBones": True, "hasAxes": False,
}  # fmt: skip


def told(**changes: Any) -> dict[str, Any]:
    """As app/page/web/player/player.js writes it."""
    return {
        "bodies": [
            {"label": label, "motionUrl": f"media/{name}", "color": "#d55e00"}
            for label, name in (("local", "a"), ("full", "b"))
        ],
        "shown": [1],
        "columns": 2,
        "mode": "grid",
        "wipe": 0.5,
        "isSmoothed": True,
        "pictureSize": [240, 420],
        "panels": [[{"view": None, "rect": [0, 0, 240, 300]}]],
        "settings": LOOK,
        "camera": [0.5, 0.2, 1.5, 0, -0.1],
        "soundUrl": "media/c",
        **changes,
    }


def test_everything_that_is_seen_is_read():
    seen = ViewerState.parse(json.dumps(told()))
    found = [(body.label, body.motion_url) for body in seen.bodies]
    assert found == [("local", "media/a"), ("full", "media/b")] and seen.sound_url == "media/c"
    assert (seen.visible, seen.columns, seen.mode, seen.picture_size) == (
        (1,),
        2,
        "grid",
        (240, 420),
    )
    assert seen.is_smoothed and seen.settings.shows_whole_body and not seen.settings.is_pair_aligned
    assert seen.settings.display == Display(6.5, True, "jerk", 4.0, 60, 300.0)
    assert seen.settings.tracked_point == "left_index" and seen.camera == (0.5, 0.2, 1.5, 0.0, -0.1)
    assert [(panel.view, *panel.rect) for panel in seen.panels[0]] == [(None, 0, 0, 240, 300)]


@pytest.mark.parametrize(
    "value",
    [
        None, 7, "", "nonsense", "[]", "null", "[" * 5000, "x" * 100_000,
        told(pictureSize=[240]), told(pictureSize=[240, "420"]), told(panels=3),
        told(pictureSize=[240, float("nan")]),
        told(camera=[0, 0, 1]), told(camera=None), told(shown=[0.5]), told(shown=[True]),
        told(shown="0"), told(settings={**LOOK, "hasHeat": 1}), told(settings=None),
        told(bodies={"a": 1}), told(bodies=[3]),
        told(bodies=[{"label": 3, "motionUrl": "media/a", "color": "#d55e00"}]),
        told(bodies=[{"label": "", "motionUrl": "media/a", "color": "#d55e0'"}]),
        told(bodies=70 * told()["bodies"]),
        told(mode=["grid"]), told(wipe="left"), told(columns=1e400), told(soundUrl=["x"]),
        told(panels=[[{"view": "body", "rect": [0, 0, 1]}]]), {"settings": LOOK},
    ],
    ids=lambda value: "",
)  # fmt: skip
def test_a_stage_that_tells_anything_else_is_refused_with_a_sentence(value):
    with pytest.raises(RunError, match="The viewer sent invalid data"):
        ViewerState.parse(json.dumps(value) if isinstance(value, dict) else value)


class Stage:
    """A tab whose stage shows two motions of this browser."""

    def __init__(self, folder: Path, draw: Any) -> None:
        with gr.Blocks():
            self.parts = ResultParts()
        services = made_services(folder, {"draw_viewer_video": draw})
        self.media, self.jobs, self.characters = services.media, services.jobs, services.characters
        self.runner = ViewerVideoRunner(services, self.parts)
        self.files = {name: folder / name for name in ("a.npz", "b.npz", "c.wav")}
        for path in self.files.values():
            path.write_bytes(b"")
        a, b, c = map(self.media.share(folder, COOKIE), self.files.values())
        self.asked = told(soundUrl=c)
        for body, address in zip(self.asked["bodies"], (a, b), strict=True):
            body["motionUrl"] = address

    def press(self, cookie: str = COOKIE) -> list[dict[Any, Any]]:
        return list(self.runner.run(browser(cookie), json.dumps(self.asked)))


def draw(request: ViewerVideoRequest, callbacks: RunCallbacks) -> ViewerVideo:
    callbacks.on_event(StageProgress("video", 0.43))
    request.out.mkdir()
    video = request.out / "stage.mp4"
    video.write_bytes(bytes(2_100_000))
    return ViewerVideo(video, 300, ("It is cut.",))


def test_a_video_comes_with_its_progress_and_a_way_to_save_it(tmp_path):
    got: list[ViewerVideoRequest] = []

    def noted(request: ViewerVideoRequest, *how: Any) -> ViewerVideo:
        got.append(request)
        return draw(request, *how)

    stage = Stage(tmp_path, noted)
    updates = stage.press()
    seen = [each[stage.parts.viewer_video] for each in updates]
    lines = [each["value"] for each in seen if each != gr.skip()]
    assert text.VIEWER_VIDEO_STARTING in lines[0]
    assert any("43 %" in line and 'value="0.430"' in line for line in lines)
    assert "one body, 10.0 s, 2.1 MB. It is cut." in lines[-1]
    assert 'download="stage.mp4"' in lines[-1]
    address = lines[-1].split('href="')[1].split('"')[0]
    video = stage.media.file_of_url(address, COOKIE)
    assert video is not None and video.name == "stage.mp4"
    assert stage.media.file_of_url(address, "another browser") is None
    (request,) = got
    assert request.motions == (stage.files["a.npz"], stage.files["b.npz"])
    assert request.speech == stage.files["c.wav"] and not stage.jobs.in_use()


def test_a_path_is_no_address_and_files_of_another_browser_or_kind_are_not_taken(tmp_path):
    stage = Stage(tmp_path, draw)
    good = stage.asked["bodies"][0]["motionUrl"]
    paths = ("", "media/", "media/../jobs", "/etc/passwd", "media/%2e%2e/b.npz", "file:///etc/a")
    for cookie, motion, sound in (
        *((COOKIE, path, stage.asked["soundUrl"]) for path in paths),
        ("another browser", good, stage.asked["soundUrl"]),
        (COOKIE, good, good),
    ):
        stage.asked["bodies"][0]["motionUrl"], stage.asked["soundUrl"] = motion, sound
        with pytest.raises(gr.Error, match="has expired"):
            stage.press(cookie)
        assert not stage.jobs.in_use()


def test_video_shows_the_character_that_the_stage_shows(tmp_path):
    bodies: list[bytes | None] = []

    def noted(request: ViewerVideoRequest, *how: Any) -> ViewerVideo:
        bodies.append(request.body and request.body.read_bytes())
        return draw(request, *how)

    stage = Stage(tmp_path, noted)
    (tmp_path / "hero.glb").write_bytes(b"hero")
    stage.characters.keep(COOKIE, tmp_path / "hero.glb")
    stage.press()
    stage.asked["hasCharacter"] = True
    stage.press()
    assert bodies == [None, b"hero"]
    stage.characters.drop(COOKIE)
    with pytest.raises(gr.Error, match="choose its file again"):
        stage.press()


ROW = "workbench/planned"
FRAMES = 90
NOD = {"do": "nod", "at": 1.0}


def make(request: PlanEditRequest, callbacks: RunCallbacks) -> EditResult:
    number = 0
    with locked_record(request.run) as record:
        start = record.row(request.source_row)
        if start is None:
            raise RunError(text.EDITS_GONE)
        row = start.model_copy(deep=True)
        if request.edits:
            number = len(record.rows)
            take = EditInfo(
                take_number=number,
                original_row=ROW,
                parent_row=start.name,
                regenerated_s=[(0.5, 1.0)],
            )
            row.name, row.label, row.edit = f"{ROW}.take{number}", f"version {number}", take
            row.files.pop("editor", None)
            record.set_row(row)
    if number:
        callbacks.on_event(FolderUpdated(request.run))
    with locked_record(request.run) as record:
        row.files["editor"] = "told.json"
        (request.run / "told.json").write_text("{}")
        record.set_row(row)
    return EditResult(number, ("It was mended.",) if number else ())


class Editor:
    """A tab with one run of this browser's."""

    def __init__(self, folder: Path, make: Any = make) -> None:
        with gr.Blocks():
            self.parts = ResultParts()
        services = made_services(folder, {"regenerate_edited": make})
        self.runner = EditRunner(services, self.parts)
        said = Transcript((Word(0.2, 0.5, "you"),))
        self.view = made_run(folder / "run", jerk={ROW: 1.0}, said=said)
        folder = self.view.folder
        with open_run_writer(folder, read_run(folder), is_incremental=True) as run:
            run.write_plan(ROW, GesturePlan(3.0, left=(phase(0.0, 3.0, "rest"),)))
        job = Job("me", "generate", folder.parent, COOKIE)
        services.saved_runs.add_run(job, {"": self.view})

    def ask(self, *edits: Any, start: str = ROW, cookie: str = COOKIE) -> dict[str, Any]:
        """What the player shows in the end."""
        asked = {"run": "run", "source_row": start, "edits": list(edits)}
        *_, last = self.runner.run(browser(cookie), json.dumps(asked))
        return last[self.parts.player]


def rows(value: dict[str, Any]) -> list[str]:
    return [row["name"] for row in value["rows"]]


def test_a_take_stands_beside_the_run_and_the_next_begins_from_it(tmp_path):
    editor = Editor(tmp_path)
    ready = editor.ask()
    assert ready["editing"]["message"] == text.EDITOR_READY and rows(ready) == [ROW]
    last = editor.ask(NOD)
    assert rows(last) == [ROW, f"{ROW}.take1"]
    take = last["rows"][1]
    assert (take["label"], take["take_number"], take["original_row"]) == ("version 1", 1, ROW)
    assert take["noise_key"] == last["rows"][0]["noise_key"]
    assert take["frames_available"]["num_ready"] == 8
    editing = last["editing"]
    assert editing["message"] == f"{text.TAKE_DONE.format(number=1)} It was mended."
    assert editing["editable"][f"{ROW}.take1"]["from"] == ROW and not editing["is_working"]
    again = editor.ask(NOD, start=f"{ROW}.take1")
    assert again["editing"]["editable"][f"{ROW}.take2"]["from"] == f"{ROW}.take1"
    other = editor.view.read_only_copy(str).player_value()
    assert rows(other) == rows(again) and "editing" not in other, "whoever has the link sees them"
    with locked_record(editor.view.folder) as record:  # as where its page was closed meanwhile
        record.rows[-1].files.pop("editor")
    assert rows(editor.ask(NOD)) == rows(again)


def test_what_cannot_be_done_is_said_and_leaves_no_row(tmp_path):
    def fails(request: PlanEditRequest, callbacks: RunCallbacks) -> EditResult:
        made = make(request, callbacks)
        with locked_record(request.run) as record:  # as where its process is killed
            record.rows[-1].files.pop("editor")
        raise PlanError(f"The hand has no time for {made.take_number}.")

    editor = Editor(tmp_path, fails)
    last = editor.ask(NOD)
    editing = last["editing"]
    assert rows(last) == [ROW] and not editing["editable"]
    said = (editing["message"], editing["is_refused"], editing["is_working"])
    assert said == ("The hand has no time for 1.", True, False)
    wrong = editor.ask({"do": "nod", "at": "now"})["editing"]
    assert wrong["is_refused"] and "input should be a valid number" in wrong["message"]
    unknown = editor.ask(NOD, start="gan/20")["editing"]
    assert unknown["is_refused"] and unknown["message"] == text.EDITS_GONE


def test_nobody_reaches_the_run_of_another(tmp_path):
    editor = Editor(tmp_path)
    for cookie in ("another", ""):
        with pytest.raises(gr.Error, match="belongs to another browser"):
            editor.ask(NOD, cookie=cookie)
    assert "editing" not in editor.view.read_only_copy(str).player_value()
    assert "editing" in editor.view.player_value()


def edits(**changes: Any) -> str:
    return json.dumps({"run": "run", "source_row": ROW, "edits": [], **changes})


@pytest.mark.parametrize(
    "value",
    [
        None, 7, "", "nonsense", "[]", "null", "[" * 100_000, "x" * 3_000_000, edits(run=3),
        edits(run="x" * 300), edits(edits={}), edits(edits=[{"do": "rm"}]),
        edits(edits=[{"do": "nod", "at": float("nan")}]),
    ],
    ids=lambda value: "",
)  # fmt: skip
def test_an_editor_that_tells_anything_else_is_refused_with_a_sentence(value):
    def read(told: object) -> object:
        return parse_edits(EditMessage.parse(told).edits)

    assert read(edits(edits=[NOD]))
    with pytest.raises(RunError):
        read(value)
