"""Runs of the live tab and of the tab of studies, without a browser."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import gradio as gr
import pytest

from app import text
from app.config import AppConfig
from app.errors import RunError
from app.live.session import LiveAsk
from app.live.sessions import LiveSessions
from app.page.queue.jobs import JobBook
from app.page.results.result_parts import build_results
from app.page.tabs.live import LiveRunner, offered
from app.page.tabs.motion import FormParts
from app.page.tabs.study_run import NO_COOKIE, StudyParts, StudyRunner
from app.page.tabs.videos_run import VideosBehind
from conventions.views import CLOSE_UPS
from model.motion.motion import load_motion
from model.speech.audio import load_speech
from tests.app.fakes import CATALOGUE, made_services, make_draw, make_generate
from tests.app.live.test_session import sound
from tests.app.live.test_sessions import ByHand, nothing
from tests.app.page.made import VISITOR, browser

USUAL = "gan/5"
ASK = LiveAsk("globaldiff/global", "bob", 7)


@pytest.fixture
def live(weights: Path) -> LiveSessions:
    return ByHand(weights)


@pytest.fixture
def keeps(live: LiveSessions, weights: Path, tmp_path: Path) -> LiveRunner:
    with gr.Blocks():
        form = FormParts((), gr.Button(), gr.Button())
        results = build_results("live-")
    does = {"generate": make_generate(), "draw_behind": make_draw()}
    config = AppConfig(weights=weights, temp=tmp_path)
    services = made_services(tmp_path, does, config=config, live=live)
    return LiveRunner(services, form, results, VideosBehind(services, results, "live_videos"))


def test_sound_and_motion_of_the_minute_lie_in_the_jobs_folder_and_keep_says_why_it_kept_less(
    keeps: LiveRunner, live: LiveSessions, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.live.session.AHEAD_S", 10.0)  # nobody waits for sound here
    session = live.open(ASK, "mine", nothing)
    blocks = list(sound(5.5))
    for block in blocks[: len(blocks) // 2]:
        live.put(session, block)
    live._turn()
    live._turn()
    job = JobBook(tmp_path / "jobs").open("me", "live")
    asked = keeps.asked(job, "mine", (session.token,))
    assert (asked.systems, asked.speaker, asked.seed) == (("globaldiff/global",), "bob", 7)
    assert asked.speech.parent == job.folder and asked.take is not None
    assert asked.close_ups == CLOSE_UPS and asked.has_posters  # as any other run on the page
    assert asked.take.motion.parent == job.folder and asked.out.parent == job.folder
    speech, motion = load_speech(asked.speech), load_motion(asked.take.motion)
    kept = session.kept()
    assert speech.num_frames == motion.num_frames == kept.minute.motion.num_frames
    for token, cookie in ((session.token, "yours"), ("", "mine"), (None, "mine"), ("x" * 9999, "")):
        with pytest.raises(RunError, match="no live minute"):
            keeps.asked(job, cookie, (token,))

    assert kept.why_less == "", "it follows as closely as it can"
    for block in blocks[len(blocks) // 2 :]:
        live.put(session, block)
    updates = list(keeps.run(browser("mine", "me"), session.token))
    (line,) = [each[keeps._status] for each in updates if "Done in" in str(each)]
    kept_s = motion.num_frames / 30
    less = f"the last {5.5 - kept_s:.1f} s spoken had no motion yet"
    assert f"{kept_s:.1f} s are kept: {less}" in line


def test_what_is_usual_stands_first_and_what_needs_all_of_the_speech_is_not_offered() -> None:
    told = offered(replace(CATALOGUE, systems=("globaldiff/local", "gan/20", USUAL)))
    assert told["systems"] == [USUAL, "globaldiff/local", "gan/20"]
    assert told["speakers"] == list(CATALOGUE.speakers)
    told = offered(replace(CATALOGUE, systems=("official/authors", "workbench/planned", USUAL)))
    assert told["systems"] == [USUAL, "workbench/planned"]


@pytest.fixture
def study(tmp_path: Path) -> StudyRunner:
    with gr.Blocks():
        shown = (gr.HTML(), gr.HTML(), gr.HTML(), gr.DownloadButton(), gr.DownloadButton())
    return StudyRunner(made_services(tmp_path), StudyParts(*shown))


def form(speech: Path, length_s: float = 1, participants: float = 4) -> list[Any]:
    systems = ["globaldiff/local", "globaldiff/full"]
    protocol = "Rank all systems on three questions"
    given = ["A study", protocol, [str(speech)], systems, None]
    return [*given, length_s, participants, 0, ["front"], ""]


def click(study: StudyRunner, speech: Path, cookie: str = "cookie") -> Iterator[str]:
    """What the tab says, update by update."""
    for updates in study.run(browser(cookie), *form(speech)):
        (status,) = [value for part, value in updates.items() if part is study._parts.status]
        yield status


def test_a_study_that_is_cancelled_says_so_and_leaves_nothing(
    study: StudyRunner, speech: Path, tmp_path: Path
) -> None:
    clicked = click(study, speech)
    assert text.STARTING in next(clicked)
    study.cancel(VISITOR)
    *_, last = clicked
    assert text.CANCELLED in last and "error" not in last
    assert list((tmp_path / "private").iterdir()) == []


def test_without_a_cookie_no_study_is_made(study: StudyRunner, speech: Path) -> None:
    clicked = click(study, speech, cookie="")
    assert NO_COOKIE.split(",")[0] in next(clicked)
    with pytest.raises(gr.Error, match="cookie"):
        next(clicked)


def test_the_plan_alone_is_checked_and_copies_no_upload(
    study: StudyRunner, speech: Path, tmp_path: Path
) -> None:
    for changes, words in (({"length_s": 500.0}, "`length_s`"), ({"participants": 1.5}, "got 1.5")):
        with pytest.raises(gr.Error, match=words):
            study.write_plan(VISITOR, *form(speech, **changes))
    study.write_plan(VISITOR, *form(speech, 2))
    left = {path.name for path in (tmp_path / "jobs").rglob("*") if path.is_file()}
    assert left == {"plan.toml"}
