import threading
from functools import partial
from pathlib import Path

import pytest

from app import text
from app.errors import RunError, sentence_of, visitor_sentence
from app.page.queue.in_turn import follow_run
from app.page.queue.jobs import Job, JobBook
from app.run.requests.request import Artefact, GenerateRequest, GenerateResult, Progress
from tests.app import fakes


def asked(job: Job) -> GenerateRequest:
    """A run of both systems."""
    systems = fakes.CATALOGUE.systems
    return GenerateRequest(Path("/speech.wav"), job.folder / "results", Path("/weights"), systems)


def test_events_come_in_order_then_the_result_and_files_outlive_the_run(tmp_path: Path) -> None:
    job = JobBook(tmp_path).open("one", "generate")
    events, result = [], None
    for news in follow_run(partial(fakes.make_generate(), asked(job)), job):
        if isinstance(news, GenerateResult):
            result = news
        else:
            events += news
    assert result is not None and result.num_frames == 30
    assert [(e.kind, e.name) for e in events if isinstance(e, Artefact)] == [
        ("motion", "globaldiff/local"),
        ("motion", "globaldiff/global"),
        ("figure", "figure6"),
    ]
    for event in events:
        if isinstance(event, Artefact):
            assert event.path.is_file()
    last = {event.stage: event.fraction for event in events if isinstance(event, Progress)}
    assert set(last.values()) == {1.0}


def test_a_failure_inside_the_run_reaches_the_caller(tmp_path: Path) -> None:
    job = JobBook(tmp_path).open("one", "generate")
    with pytest.raises(RunError, match="it is broken"):
        generate = fakes.make_generate(error=RunError("it is broken"))
        for _ in follow_run(partial(generate, asked(job)), job):
            pass


def test_a_visitor_who_leaves_stops_the_run(tmp_path: Path) -> None:
    job = JobBook(tmp_path).open("one", "generate")
    never = threading.Event()
    following = follow_run(partial(fakes.make_generate(hold=never), asked(job)), job)
    next(following)
    following.close()  # what Gradio does when the connection ends
    assert job.is_cancelled()
    never.set()


def test_known_errors_keep_their_sentence_and_faults_get_a_number(
    caplog: pytest.LogCaptureFixture,
) -> None:
    assert visitor_sentence(RunError("Say this.")) == "Say this."
    shown = visitor_sentence(KeyError("secret /path"))
    assert "secret" not in shown
    number = shown.rsplit(" ", 1)[1].rstrip(".")
    assert number in caplog.text and "secret /path" in caplog.text


def test_a_full_disk_is_told_as_such() -> None:
    error = OSError(28, "No space left on device", "/results/a.mp4")
    assert sentence_of(error) == (
        "The disk at /results is full; free some space or write to another folder."
    )
    assert visitor_sentence(error) == text.DISK_FULL


def test_a_visitor_is_shown_no_folder_and_nothing_that_a_terminal_obeys() -> None:
    error = RunError("No weights in /srv/app/weights; /tmp/a/b\x1b[2J.npz is bad: see http://a/b/c")
    assert visitor_sentence(error) == "No weights in weights; b?[2J.npz is bad: see http://a/b/c"
