"""The tab for motion of one's own: what the form asks for, and what the tab then shows."""

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
from app.page.results.kept_runs import KeptRuns
from app.page.results.result_parts import ResultParts, build_results
from app.page.serving.jobs import JobBook
from app.page.serving.media import MediaDesk
from app.page.serving.workshop import Workshop
from app.page.tabs.own_motion import build_own_motion_tab
from app.page.tabs.own_motion_run import MAX_NAME, OwnMotionForm, OwnMotionRunner, display_names
from app.page.tabs.upload_check import UploadCheck
from app.page.tabs.videos_behind import VideosBehind
from app.run.diagnose import DiagnoseRequest, Diagnosis, OnShare
from app.run.pictures.own_videos import OnFile
from app.run.upload_check import refusal_of
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


def runner_of(diagnose: Any, folder: Path, parts: ResultParts) -> OwnMotionRunner:
    jobs = JobBook(folder)
    videos = VideosBehind(fakes.make_draw(), jobs, parts, KEPT, "own_videos")
    return OwnMotionRunner(diagnose, CONFIG, jobs, MediaDesk(), parts, KEPT, videos)


Runs = Callable[..., list[dict[Any, Any]]]


@pytest.fixture
def runs(tmp_path: Path) -> Runs:
    """Runs a diagnose of the test's own; gives the updates by the name of the part."""

    def run(diagnose: Any, *values: Any) -> list[dict[Any, Any]]:
        with gr.Blocks():
            parts = build_results()
        names = {getattr(parts, name): name for name in parts.__dataclass_fields__}
        runner = runner_of(diagnose, tmp_path, parts)
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
        build_own_motion_tab(
            page,
            CONFIG,
            JobBook(tmp_path),
            MediaDesk(),
            Workshop().diagnose,
            CHECK,
            KEPT,
            fakes.make_draw(),
        )
    assert "own_motion" in {each.api_name for each in page.fns.values()}
