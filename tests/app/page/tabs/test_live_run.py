"""From the last minute of a live session to the run that keeps it."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from app.config import AppConfig
from app.errors import RunError
from app.live.session import LiveAsk
from app.live.sessions import LiveSessions
from app.page.queue.jobs import JobBook
from app.page.results.result_parts import build_results
from app.page.tabs.live import LiveRunner, offered
from app.page.tabs.motion import FormParts
from app.page.tabs.videos_run import VideosBehind
from app.page.visitors.visitors import COOKIE
from conventions.views import CLOSE_UPS
from model.motion.motion import load_motion
from model.speech.audio import load_speech
from tests.app.fakes import CATALOGUE, made_services, make_draw, make_generate
from tests.app.live.test_session import sound
from tests.app.live.test_sessions import ByHand, nothing

USUAL = "gan/5"


@pytest.fixture
def live(weights: Path) -> LiveSessions:
    return ByHand(weights)


@pytest.fixture
def runner(live: LiveSessions, weights: Path, tmp_path: Path) -> LiveRunner:
    import gradio as gr

    with gr.Blocks():
        form = FormParts((), gr.Button(), gr.Button())
        results = build_results("live-")
    does = {"generate": make_generate(), "draw_behind": make_draw()}
    config = AppConfig(weights=weights, temp=tmp_path)
    services = made_services(tmp_path, does, config=config, live=live)
    return LiveRunner(services, form, results, VideosBehind(services, results, "live_videos"))


def test_sound_and_motion_of_the_minute_lie_in_the_jobs_folder(
    runner: LiveRunner, live: LiveSessions, tmp_path: Path
) -> None:
    session = live.open(LiveAsk("globaldiff/global", "bob", 7), "mine", nothing)
    for block in sound(2.9):
        live.put(session, block)
    live._turn()
    live._turn()
    job = JobBook(tmp_path / "jobs").open("me", "live")
    asked = runner.asked(job, "mine", (session.token,))
    assert (asked.systems, asked.speaker, asked.seed) == (("globaldiff/global",), "bob", 7)
    assert asked.speech.parent == job.folder and asked.take is not None
    assert asked.close_ups == CLOSE_UPS and asked.has_posters  # as any other run on the page
    assert asked.take.motion.parent == job.folder and asked.out.parent == job.folder
    speech, motion = load_speech(asked.speech), load_motion(asked.take.motion)
    assert speech.num_frames == motion.num_frames == session.kept().minute.motion.num_frames
    for token, cookie in ((session.token, "yours"), ("", "mine"), (None, "mine"), ("x" * 9999, "")):
        with pytest.raises(RunError, match="no live minute"):
            runner.asked(job, cookie, (token,))


def test_keep_says_why_it_kept_less_than_was_spoken(
    runner: LiveRunner, live: LiveSessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.live.session.AHEAD_S", 10.0)  # nobody waits for sound here
    session = live.open(LiveAsk("globaldiff/global", "bob", 7), "mine", nothing)
    blocks = list(sound(5.5))
    for block in blocks[: len(blocks) // 2]:
        live.put(session, block)
    live._turn()
    live._turn()
    kept_s = session.kept().minute.motion.num_frames / 30
    assert session.kept().why_less == "", "it follows as closely as it can"
    for block in blocks[len(blocks) // 2 :]:
        live.put(session, block)
    request = SimpleNamespace(session_hash="me", cookies={COOKIE: "mine"}, client=None)
    updates = list(runner.run(request, session.token))  # type: ignore[arg-type]
    (line,) = [each[runner._status] for each in updates if "Done in" in str(each)]
    assert (
        f"{kept_s:.1f} s are kept: the last {5.5 - kept_s:.1f} s spoken had no motion yet" in line
    )


def test_what_is_usual_stands_first() -> None:
    from dataclasses import replace

    told = offered(replace(CATALOGUE, systems=("globaldiff/local", "gan/20", USUAL)))
    assert told["systems"] == [USUAL, "globaldiff/local", "gan/20"]
    assert told["speakers"] == list(CATALOGUE.speakers)


def test_what_needs_all_of_the_speech_is_not_offered() -> None:
    from dataclasses import replace

    told = offered(replace(CATALOGUE, systems=("official/authors", "workbench/planned", USUAL)))
    assert told["systems"] == [USUAL, "workbench/planned"]
