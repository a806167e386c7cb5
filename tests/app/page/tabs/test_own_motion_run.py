"""Motion of one's own: what the tab shows of a run, of sets, and of a clip that is opened."""

import json
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gradio as gr
import pytest

from app import text
from app.config import AppConfig
from app.errors import RunError
from app.page.queue.jobs import JobBook
from app.page.results.kept_runs import KeptRuns
from app.page.results.result_parts import ResultParts, build_results
from app.page.results.sets_shown import KeptSets
from app.page.tabs.own_motion import build_own_motion_tab
from app.page.tabs.own_motion_run import ClipRunner, OwnMotionRunner
from app.page.tabs.own_sets_run import SetsTools, build_sets
from app.page.tabs.videos_run import VideosBehind
from app.run.diagnose import DiagnoseRequest, Diagnosis, OnShare
from app.run.many.sets import Sets, SetsRequest, measure_sets
from app.run.videos.own_videos import OnFile
from tests.app import fakes
from tests.app.fakes import measures
from tests.app.measured import diagnostics_of
from tests.app.page.made import VISITOR, browser, updates_of

ONE = (None, None, "right_middle", 0)
"""The rest of a form: no reference, no speech, point and start."""


@pytest.fixture
def kept() -> KeptRuns:
    return KeptRuns(3600.0)


@pytest.fixture
def parts() -> ResultParts:
    with gr.Blocks():
        return build_results()


def runner_of(
    diagnose: Any,
    folder: Path,
    parts: ResultParts,
    kept: KeptRuns,
    sets: SetsTools | None = None,
    kind: type[OwnMotionRunner] = OwnMotionRunner,
) -> OwnMotionRunner:
    does = {"diagnose": diagnose, "draw_behind": fakes.make_draw()}
    services = fakes.made_services(
        folder, does, config=AppConfig(), jobs=JobBook(folder), kept=kept
    )
    videos = VideosBehind(services, parts, "own_videos")
    if sets is None:
        with gr.Blocks():
            sets = SetsTools(measure_sets, build_sets(), KeptSets())
    return kind(services, parts, videos, sets)


def diagnose(request: DiagnoseRequest, on_progress: OnShare, on_file: OnFile) -> Diagnosis:
    on_progress(0.5)
    request.out.mkdir()
    files = tuple(request.out / name for name in ("diagnostics.json", "jitter.png"))
    for file in files:
        file.write_bytes(b"0")
    diagnostics = diagnostics_of(**{name: measures(120.0) for name in request.names})
    return Diagnosis(files, ("A <note>.",), diagnostics, None)


def test_numbers_figures_and_downloads_of_the_run_are_shown(
    parts: ResultParts, kept: KeptRuns, tmp_path: Path
) -> None:
    runner = runner_of(diagnose, tmp_path, parts, kept)
    *_, last = updates_of(runner, parts, ["/up/<b>.npz"], *ONE)
    assert "Measured 1 motion." in last["status"]
    assert "A &lt;note&gt;." in last["message"]["value"]
    assert "&lt;b&gt;" in last["numbers"]["value"] and "<b>.npz" not in last["numbers"]["value"]
    assert "?run=" in last["runs"]["value"]
    assert last["figures"]["visible"] and "<img" in last["figures"]["value"]
    assert last["downloads_part"]["visible"]
    assert [Path(file).name for file in last["files"]] == ["diagnostics.json", "jitter.png"]
    assert Path(last["bundle"]["value"]).stat().st_size > 0


def test_an_error_is_told_and_nothing_old_stays(
    parts: ResultParts, kept: KeptRuns, tmp_path: Path
) -> None:
    def refuse(request: DiagnoseRequest, on_progress: OnShare, on_file: OnFile) -> Diagnosis:
        raise RunError("a.npz has 60 frames a second; 30 are needed.")

    runner = runner_of(refuse, tmp_path, parts, kept)
    *_, shown, raised = updates_of(runner, parts, ["/up/a.npz"], *ONE)
    assert raised == {"error": "a.npz has 60 frames a second; 30 are needed."}
    assert "60 frames a second" in shown["message"]["value"]
    assert not shown["numbers"]["visible"] and not shown["downloads_part"]["visible"]


def test_cancel_is_answered_at_once_and_nothing_of_the_run_is_shown(
    parts: ResultParts, kept: KeptRuns, tmp_path: Path
) -> None:
    may_go_on = threading.Event()

    def wait(request: DiagnoseRequest, on_progress: OnShare, on_file: OnFile) -> Diagnosis:
        runner.cancel(VISITOR)
        may_go_on.wait(60)  # a step that cannot be interrupted
        on_progress(0.5)
        raise AssertionError("on_progress must end a run that was cancelled")

    runner = runner_of(wait, tmp_path, parts, kept)
    said = []
    for update in runner.run(VISITOR, ["/up/a.npz"], *ONE):
        said.append(update[parts.status])
        if text.STOPPING in said[-1]:
            may_go_on.set()
    assert text.STOPPING in said[-2] and text.CANCELLED in said[-1]


def test_the_tab_is_built_with_its_endpoint(tmp_path: Path) -> None:
    with gr.Blocks() as page:
        build_own_motion_tab(page, fakes.made_services(tmp_path, config=AppConfig()))
    assert "own_motion" in {each.api_name for each in page.fns.values()}


class Measured:
    """Sets that somebody has brought."""

    def __init__(self, folder: Path) -> None:
        self.asked: list[SetsRequest] = []
        self._folder = folder

    def __call__(self, request: SetsRequest, on_progress: Callable[[float], None]) -> Sets:
        self.asked.append(request)
        on_progress(0.5)
        request.out.mkdir()
        table = request.out / "many.csv"
        table.write_text("0")
        row = {"measure": "Followed point: Jerk", "unit": "m/s³", "clips": 2, "difference_to": ""}
        rows = [
            {**row, "system": name, "mean": mean, "low": mean - 1, "high": mean + 1}
            for name, mean in (("<i>mine", 2345.6), ("reference", 120.0))
        ]
        kinds = ["foot_slide", "jerk"]
        worst = [{"system": "<i>mine", "clip": "b<u>", "kinds": kinds, "jerk": 2400.0}]
        told = {"clips": ["a", "b<u>"], "measures": rows, "worst": worst}
        clips = {
            name: {clip: self._folder / f"{name} {clip}.npz" for clip in told["clips"]}
            for name in ("<i>mine", "reference")
        }
        return Sets((table,), ("A <note>.",), told, clips, {"a": self._folder / "a.wav"})


def test_zips_are_measured_as_sets_and_their_browser_opens_any_clip(
    parts: ResultParts, kept: KeptRuns, tmp_path: Path
) -> None:
    opened: list[DiagnoseRequest] = []

    def noted(request: DiagnoseRequest, *how: Any) -> Diagnosis:
        opened.append(request)
        return diagnose(request, *how)

    measured = Measured(tmp_path)
    with gr.Blocks():
        sets = SetsTools(measured, build_sets(), KeptSets())
    runner = runner_of(noted, tmp_path / "jobs", parts, kept, sets)
    asked = ["/up/<i>mine.zip"], "/up/gt.zip", None, "right_middle", 0
    mine, stranger = browser("mine" * 20, "mine"), browser("else" * 20, "else")
    first, *_, last = updates_of(runner, parts, *asked, visitor=mine)
    assert first[sets.parts.shown] == {"value": "", "visible": False, "__type__": "update"}
    (request,) = measured.asked
    assert (request.names, request.reference) == (("<i>mine",), Path("/up/gt.zip"))
    html = last[sets.parts.shown]["value"]
    assert "foot slide, jerk; jerk 2,400 m/s³" in html and 'data-clip="b&lt;u&gt;"' in html
    assert "2,350 [2,340, 2,350]" in html and "120 [119, 121]" in html
    assert "<i>" not in html and "<u>" not in html
    assert "Measured 2 clips of 2 sets" in last["status"]
    assert "A &lt;note&gt;." in last["message"]["value"]

    token = html.split('data-sets="')[1].split('"')[0]
    opener = runner_of(noted, tmp_path / "others", parts, kept, sets, ClipRunner)
    good = json.dumps({"sets": token, "clip": "a"})
    *updates, end = updates_of(opener, parts, good, visitor=mine)
    (one,) = opened
    assert (one.names, one.motions) == (("<i>mine",), (tmp_path / "<i>mine a.npz",))
    assert (one.reference, one.speech) == (tmp_path / "reference a.npz", tmp_path / "a.wav")
    assert all(sets.parts.shown not in update for update in (*updates, end)), "the sets stay"
    assert "a of &lt;i&gt;mine" in end["runs"]["value"]

    for visitor, told in (
        (mine, json.dumps({"sets": token, "clip": "../secret"})),
        (mine, json.dumps({"sets": "x" * 43, "clip": "a"})),
        (mine, json.dumps([token, "a"])),
        (mine, "[" * 1000),
        (mine, good.ljust(3000)),
        (mine, None),
        (stranger, good),
    ):
        error = updates_of(opener, parts, told, visitor=visitor)[-1]["error"]
        assert "kept no longer" in error or "load the page again" in error
    assert len(opened) == 1
