import threading
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from app import text
from app.config import AppConfig
from app.errors import CancelledRun, RunError
from app.page.serving.follow import (
    Form,
    RunView,
    follow_run,
    request_from_form,
    row_names,
    visitor_sentence,
)
from app.page.serving.jobs import JobBook
from app.run.request import Artefact, GenerateRequest, GenerateResult, Progress
from tests.app import fakes

FORM = Form(
    speech="/speech.wav",
    systems=["globaldiff/global", "globaldiff/local"],
    speaker="scott",
    seed=3,
    samples=2,
    steps=7,
    sampler="heun",
    is_smoothed=True,
    reference="/reference.npz",
    point="left_index",
    start_frame=12,
    transcript=None,
)
CONFIG = AppConfig(weights=Path("/weights"))


def read(form: Form) -> GenerateRequest:
    return request_from_form(form, Path("/job"), fakes.CATALOGUE, CONFIG)


def test_every_field_of_the_form_reaches_the_run() -> None:
    request = read(FORM)
    assert request == GenerateRequest(
        speech=Path("/speech.wav"),
        out=Path("/job/results"),
        weights=Path("/weights"),
        systems=("globaldiff/local", "globaldiff/global"),  # in the catalogue's order
        speaker="scott",
        seed=3,
        samples=2,
        steps=7,
        sampler="heun",
        post_filter="savgol",
        reference=Path("/reference.npz"),
        joint="left_index",
        start_frame=12,
        has_previews=True,
    )
    assert row_names(request) == (
        *("globaldiff/local", "globaldiff/local.s2"),
        *("globaldiff/global", "globaldiff/global.s2"),
        "reference",
    )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"speech": None}, "no speech yet"),
        ({"systems": []}, "No system is chosen"),
        ({"systems": ["nonsense"]}, "no system 'nonsense'; the systems are globaldiff/local"),
        ({"seed": None}, "seed must be a whole number"),
        ({"seed": -1}, "got -1"),
        ({"seed": 1.5}, "got 1.5"),
        ({"seed": 2**31}, "got 2147483648"),
        ({"samples": 0}, "at least 1"),
        ({"samples": 7}, "15 videos"),
        ({"steps": 0}, "at least 1"),
        ({"start_frame": -1}, "got -1"),
        ({"start_frame": 0.5}, "got 0.5"),
        ({"sampler": "magic"}, "no sampler 'magic'"),
    ],
)
def test_a_form_that_cannot_be_done_gives_a_sentence(changes: dict, words: str) -> None:
    with pytest.raises(RunError, match=words):
        read(replace(FORM, **changes))


def test_the_mesh_of_a_licensed_body_is_not_handed_out(tmp_path: Path) -> None:
    body = tmp_path / "SMPLX_NEUTRAL.npz"
    body.touch()
    licensed = AppConfig(weights=Path("/weights"), body=body)
    assert not request_from_form(FORM, Path("/job"), fakes.CATALOGUE, licensed).has_previews


def test_events_come_in_order_then_the_result_and_files_outlive_the_run(tmp_path: Path) -> None:
    job = JobBook(tmp_path).open("one", "generate")
    request = replace(read(FORM), out=job.folder / "results", samples=1, reference=None)
    events, result = [], None
    for news in follow_run(partial(fakes.make_generate(), request), job):
        if isinstance(news, GenerateResult):
            result = news
        else:
            events += news
    assert result is not None and result.num_frames == 30
    assert [(e.kind, e.name) for e in events if isinstance(e, Artefact)] == [
        ("motion", "globaldiff/local"),
        ("motion", "globaldiff/global"),
        ("video", "globaldiff/local"),
        ("video", "globaldiff/global"),
        ("comparison", "comparison"),
        ("figure", "figure6"),
    ]
    for event in events:
        if isinstance(event, Artefact):
            assert event.path.is_file()
    view = RunView()
    for event in events:
        view.take(event)
    assert set(view.fractions.values()) == {1.0}


def test_a_failure_inside_the_run_reaches_the_caller(tmp_path: Path) -> None:
    job = JobBook(tmp_path).open("one", "generate")
    request = replace(read(FORM), out=job.folder / "results")
    with pytest.raises(RunError, match="it is broken"):
        generate = fakes.make_generate(error=RunError("it is broken"))
        for _ in follow_run(partial(generate, request), job):
            pass


def test_a_visitor_who_leaves_stops_the_run(tmp_path: Path) -> None:
    job = JobBook(tmp_path).open("one", "generate")
    request = replace(read(FORM), out=job.folder / "results")
    never = threading.Event()
    following = follow_run(partial(fakes.make_generate(hold=never), request), job)
    next(following)
    following.close()  # what Gradio does when the connection ends
    assert job.is_cancelled()
    never.set()


def test_known_errors_keep_their_sentence_and_faults_get_a_number(
    caplog: pytest.LogCaptureFixture,
) -> None:
    assert visitor_sentence(RunError("Say this.")) == "Say this."
    assert visitor_sentence(CancelledRun()) == text.CANCELLED
    shown = visitor_sentence(KeyError("secret /path"))
    assert "secret" not in shown
    number = shown.rsplit(" ", 1)[1].rstrip(".")
    assert number in caplog.text and "secret /path" in caplog.text


def test_a_full_disk_is_told_as_such() -> None:
    error = OSError(28, "No space left on device", "/results/a.mp4")
    assert visitor_sentence(error) == (
        "The disk at /results is full; free some space or write to another folder."
    )


def test_the_line_names_the_stage_at_work() -> None:
    view = RunView()
    assert view.line == text.STARTING
    view.take(Progress("speech", 1.0))
    view.take(Progress("motion", 0.5, "globaldiff/local"))
    assert view.line.startswith(text.STAGE_NAMES["motion"])
