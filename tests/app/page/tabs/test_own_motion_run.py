"""The tab for motion of one's own: what the form asks for, and what the tab then shows."""

import json
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
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
from app.page.tabs.own_motion_run import (
    MAX_NAME,
    ClipRunner,
    OwnMotionForm,
    OwnMotionRunner,
    display_names,
)
from app.page.tabs.own_sets_run import SetsTools, build_sets
from app.page.tabs.services import UploadCheck
from app.page.tabs.videos_run import VideosBehind
from app.page.visitors.visitors import COOKIE
from app.run.diagnose import DiagnoseRequest, Diagnosis, OnShare
from app.run.many.sets import Sets, SetsRequest, measure_sets
from app.run.requests.upload_check import refusal_of
from app.run.videos.own_videos import OnFile
from tests.app import fakes
from tests.app.fakes import measures
from tests.app.measured import diagnostics_of

CONFIG = AppConfig()
KEPT = KeptRuns(CONFIG.keep_results_s)
CHECK = UploadCheck(refusal_of, 60.0)
VISITOR = SimpleNamespace(session_hash="visitor", cookies={})


def form(*motions: str, **changes: Any) -> OwnMotionForm:
    values = {"motions": list(motions), "reference": None, "speech": None}
    return OwnMotionForm(**{**values, "point": "right_middle", "start_frame": 0, **changes})


def test_the_form_becomes_the_request(tmp_path: Path) -> None:
    asked = form("/up/1/a.npz", "/up/2/a.npz", reference="/up/r.npz", start_frame=30.0).to_request(
        tmp_path, CONFIG
    )
    assert asked.names == ("a", "a (2)")
    assert asked.motions == (Path("/up/1/a.npz"), Path("/up/2/a.npz"))
    assert (asked.reference, asked.speech) == (Path("/up/r.npz"), None)
    assert (asked.start_frame, asked.joint, asked.out) == (30, "right_middle", tmp_path)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (form(), "at least one motion"),
        (form(*"abcdefghijklmnopqrstuvwxy"), "At most 24 files are measured at once; 25"),
        (form(*"abcdefgh", shown=[*"abcdefg"]), "At most 6 motions are shown"),
        (form(*"abcdefgh", shown=[*"abcdef"], reference="r.npz"), "At most 5 motions"),
        (form("a", start_frame=-1), "from 0 on; got -1"),
        (form("a", start_frame=1.5), "from 0 on; got 1.5"),
    ],
)
def test_a_form_that_cannot_be_done_gives_a_sentence(asked: OwnMotionForm, words: str) -> None:
    with pytest.raises(RunError, match=words):
        asked.to_request(Path("out"), CONFIG)


def test_the_shown_are_asked_for_only_where_not_all_fit() -> None:
    assert form(*"abcdefgh", shown=["b", "h"]).to_request(Path("out"), CONFIG).shown == ("b", "h")
    assert form(*"abc", shown=["b"]).to_request(Path("out"), CONFIG).shown == ()


def test_long_and_equal_names_are_told_apart() -> None:
    names = display_names(["x" * 100, "x" * 90, "b"])
    assert names == ("x" * MAX_NAME, "x" * MAX_NAME + " (2)", "b")


def runner_of(
    diagnose: Any,
    folder: Path,
    parts: ResultParts,
    sets: SetsTools | None = None,
    kind: type[OwnMotionRunner] = OwnMotionRunner,
) -> OwnMotionRunner:
    does = {"diagnose": diagnose, "draw_behind": fakes.make_draw()}
    services = fakes.made_services(folder, does, config=CONFIG, jobs=JobBook(folder), kept=KEPT)
    videos = VideosBehind(services, parts, "own_videos")
    if sets is None:
        with gr.Blocks():
            sets = SetsTools(measure_sets, build_sets(), KeptSets())
    return kind(services, parts, videos, sets)


Runs = Callable[..., list[dict[Any, Any]]]


@pytest.fixture
def runs(tmp_path: Path) -> Runs:
    """Runs a diagnose of the test's own; gives the updates by the name of the part."""

    def run(diagnose: Any, *values: Any) -> list[dict[Any, Any]]:
        with gr.Blocks():
            parts = build_results()
        names = {getattr(parts, name): name for name in parts.__dataclass_fields__}
        runner = runner_of(diagnose, tmp_path, parts)
        names[runner._sets.parts.shown] = "sets"
        updates = []
        try:
            for update in runner.run(VISITOR, *values):  # type: ignore[arg-type]
                updates.append({names[part]: value for part, value in update.items()})
        except gr.Error as error:
            updates.append({"error": str(error.message)})
        return updates

    return run


def test_numbers_figures_and_downloads_of_the_run_are_shown(runs: Runs) -> None:
    def diagnose(request: DiagnoseRequest, on_progress: OnShare, on_file: OnFile) -> Diagnosis:
        on_progress(0.5)
        request.out.mkdir()
        files = tuple(request.out / name for name in ("diagnostics.json", "jitter.png"))
        for file in files:
            file.write_bytes(b"0")
        diagnostics = diagnostics_of(**{name: measures(120.0) for name in request.names})
        return Diagnosis(files, ("A <note>.",), diagnostics, None)

    *_, last = runs(diagnose, ["/up/<b>.npz"], None, None, "right_middle", 0)
    assert "Measured 1 motion." in last["status"]
    assert "A &lt;note&gt;." in last["message"]["value"]
    assert "&lt;b&gt;" in last["numbers"]["value"] and "<b>.npz" not in last["numbers"]["value"]
    assert "?run=" in last["runs"]["value"]
    assert last["figures"]["visible"] and "<img" in last["figures"]["value"]
    assert last["downloads_part"]["visible"]
    assert [Path(file).name for file in last["files"]] == ["diagnostics.json", "jitter.png"]
    assert Path(last["bundle"]["value"]).stat().st_size > 0


def test_an_error_is_told_and_nothing_old_stays(runs: Runs) -> None:
    def diagnose(request: DiagnoseRequest, on_progress: OnShare, on_file: OnFile) -> Diagnosis:
        raise RunError("a.npz has 60 frames a second; 30 are needed.")

    *_, shown, raised = runs(diagnose, ["/up/a.npz"], None, None, "right_middle", 0)
    assert raised == {"error": "a.npz has 60 frames a second; 30 are needed."}
    assert "60 frames a second" in shown["message"]["value"]
    assert not shown["numbers"]["visible"] and not shown["downloads_part"]["visible"]


def test_cancel_is_answered_at_once_and_nothing_of_the_run_is_shown(tmp_path: Path) -> None:
    is_at_work, may_go_on = threading.Event(), threading.Event()

    def diagnose(request: DiagnoseRequest, on_progress: OnShare, on_file: OnFile) -> Diagnosis:
        is_at_work.set()
        may_go_on.wait(20)  # a step that cannot be interrupted
        on_progress(0.5)
        raise AssertionError("on_progress must end a run that was cancelled")

    with gr.Blocks():
        parts = build_results()
    runner = runner_of(diagnose, tmp_path, parts)

    def cancel() -> None:
        is_at_work.wait(20)
        runner.cancel(VISITOR)  # type: ignore[arg-type]

    threading.Thread(target=cancel).start()
    said = []
    for update in runner.run(VISITOR, ["/up/a.npz"], None, None, "right_middle", 0):  # type: ignore[arg-type]
        said.append(update[parts.status])
        if text.STOPPING in said[-1]:
            may_go_on.set()
    assert text.STOPPING in said[-2] and text.CANCELLED in said[-1]


def test_the_tab_is_built_with_its_endpoint(tmp_path: Path) -> None:
    with gr.Blocks() as page:
        build_own_motion_tab(page, fakes.made_services(tmp_path, config=CONFIG))
    assert "own_motion" in {each.api_name for each in page.fns.values()}


class _Measured:
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


@pytest.fixture
def measured(tmp_path: Path) -> _Measured:
    return _Measured(tmp_path)


@pytest.fixture
def sets(measured: _Measured) -> SetsTools:
    with gr.Blocks():
        return SetsTools(measured, build_sets(), KeptSets())


def all_updates(runner: OwnMotionRunner, visitor: Any, *values: Any) -> list[dict[Any, Any]]:
    return list(runner.run(visitor, *values))


def test_zips_are_measured_as_sets_and_any_clip_is_opened(
    tmp_path: Path, measured: _Measured, sets: SetsTools
) -> None:
    with gr.Blocks():
        parts = build_results()

    def diagnose(request: DiagnoseRequest, on_progress: OnShare, on_file: OnFile) -> Diagnosis:
        opened.append(request)
        request.out.mkdir()
        file = request.out / "diagnostics.json"
        file.write_text("0")
        return Diagnosis(
            (file,), (), diagnostics_of(**dict.fromkeys(request.names, measures(1.0))), None
        )

    opened: list[DiagnoseRequest] = []
    runner = runner_of(diagnose, tmp_path / "jobs", parts, sets)
    asked = ["/up/<i>mine.zip"], "/up/gt.zip", None, "right_middle", 0
    mine, stranger = (
        SimpleNamespace(session_hash=name, cookies={COOKIE: name * 20}, client=None, headers={})
        for name in ("mine", "else")
    )
    first, *_, last = all_updates(runner, mine, *asked)
    assert first[sets.parts.shown] == {"value": "", "visible": False, "__type__": "update"}
    (request,) = measured.asked
    assert (request.names, request.reference) == (("<i>mine",), Path("/up/gt.zip"))
    html = last[sets.parts.shown]["value"]
    assert "foot slide, jerk; jerk 2,400 m/s³" in html and 'data-clip="b&lt;u&gt;"' in html
    assert "2,350 [2,340, 2,350]" in html and "120 [119, 121]" in html
    assert "<i>" not in html and "<u>" not in html
    assert "Measured 2 clips of 2 sets" in last[parts.status]
    assert "A &lt;note&gt;." in last[parts.message]["value"]

    token = html.split('data-sets="')[1].split('"')[0]
    opener = runner_of(diagnose, tmp_path / "others", parts, sets, ClipRunner)
    *updates, end = all_updates(opener, mine, json.dumps({"sets": token, "clip": "a"}))
    (one,) = opened
    assert (one.names, one.motions) == (("<i>mine",), (tmp_path / "<i>mine a.npz",))
    assert (one.reference, one.speech) == (tmp_path / "reference a.npz", tmp_path / "a.wav")
    assert all(sets.parts.shown not in update for update in (*updates, end)), "the sets stay"
    assert "a of &lt;i&gt;mine" in end[parts.runs]["value"]

    for visitor, told in (
        (mine, json.dumps({"sets": token, "clip": "../secret"})),
        (mine, json.dumps({"sets": "x" * 43, "clip": "a"})),
        (mine, json.dumps([token, "a"])),
        (mine, "[" * 1000),
        (mine, json.dumps({"sets": token, "clip": "a"}).ljust(3000)),
        (mine, None),
        (stranger, json.dumps({"sets": token, "clip": "a"})),
    ):
        with pytest.raises(gr.Error, match=r"kept no longer|load the page again"):
            all_updates(opener, visitor, told)
    assert len(opened) == 1


@pytest.mark.parametrize(
    ("motions", "changes", "said"),
    [
        (["a.zip", "b.npz"], {}, "zips of results only, or motion files only"),
        (["a.ZIP"], {"reference": "r.npz"}, "the reference comes as a zip"),
        (["a.zip"], {"speech": "r.wav"}, "the speech comes as a zip"),
        ([f"{n}.zip" for n in range(7)], {}, "At most 6 motions"),
    ],
)
def test_zips_beside_other_files_are_refused(
    motions: list[str], changes: dict[str, str], said: str
) -> None:
    asked = form(*motions, **changes)
    assert asked.has_sets
    with pytest.raises(RunError, match=said):
        asked.to_sets(Path("out"))


def test_a_zip_beside_motion_files_is_refused() -> None:
    for changes in ({"reference": "r.zip"}, {"speech": "r.zip"}):
        asked = form("a.npz", **changes)
        assert not asked.has_sets
        with pytest.raises(RunError, match="A zip goes beside zips"):
            asked.to_request(Path("out"), CONFIG)
