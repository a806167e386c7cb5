"""Runs of the tabs as handlers give them: own motion, live, studies; opened again, with videos."""

import json
import re
import shutil
import threading
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import gradio as gr
import pytest
from starlette.datastructures import QueryParams

from app import text
from app.config import AppConfig
from app.errors import Cancelled, RunError
from app.findings.metric_table import JERK
from app.page.parts import markup
from app.page.parts.markup import Updates
from app.page.results.result_parts import ResultParts
from app.page.results.saved_runs import SavedRuns, add_host_run
from app.page.routes.media import SharedFolders
from app.page.tabs.live import LiveRecordingRunner, live_choices
from app.page.tabs.motion import FormParts, build_form
from app.page.tabs.motion_run import GenerateRunner, PageLoader
from app.page.tabs.own_motion import ClipRunner, DiagnoseRunner, build_own_motion_form
from app.page.tabs.stage import BackgroundVideos, RemainingTime
from app.page.tabs.study import NO_COOKIE, StudyPlanRunner, StudyRunner, build_study_tab
from app.page.visitors.job_folders import Job
from app.run.batch.archives import UNPACKED
from app.run.batch.saved_run import UNPACKED_ZIP_FOLDER
from app.run.callbacks import RunCallbacks, StageProgress
from app.run.output.run_folder import RUN, zip_run
from app.run.requests.parts import VideoOptions
from app.run.requests.requests import DiagnoseRequest
from app.run.tasks import SetResults
from app.study.make.export_folders import ExportRequest
from conventions.views import CLOSE_UPS
from model.motion.motion import load_motion
from model.speech.audio import load_speech
from tests.app import fakes
from tests.app.fakes import CATALOGUE, made_services, make_draw, make_generate
from tests.app.live.test_live import ByHand, sound
from tests.app.page.made import VISITOR, browser, updates_of
from tests.app.page.results.made_run import keep, made_run
from tests.waiting import wait_for

ONE = ("", "right_middle", 0)
"""The rest of a form: no reference, point and start."""


def saved(downloads: Any) -> list[str]:
    """Names of the files that can be had one by one."""
    return re.findall(r' download="([^"]+)"', downloads["value"])


class Own:
    """The tab for motion of one's own, over a diagnose and sets of the test's."""

    def __init__(self, folder: Path, diagnose: Any, measure_uploaded_sets: Any = None) -> None:
        does = {"run_page_request": diagnose, "measure_uploaded_sets": measure_uploaded_sets}
        services = fakes.made_services(folder, does, config=AppConfig())
        with gr.Blocks():
            self.parts = ResultParts()
            self.sets_shown, self.sets_clip = gr.HTML(), gr.Dropdown()
            form = build_own_motion_form(services)
        of_sets = self.sets_shown, self.sets_clip
        self.runner = DiagnoseRunner(services, form, self.parts, of_sets)
        self.opener = ClipRunner(services, form, self.parts, self.runner)


def test_numbers_figures_and_downloads_of_the_run_are_shown(tmp_path):
    own = Own(tmp_path, fakes.diagnose)
    *updates, last = updates_of(own.runner, own.parts, ["/up/<b>.npz"], *ONE)
    stages = "".join(str(update.get("status")) for update in updates)
    assert text.STAGE_NAMES["numbers"] in stages and text.STAGE_NAMES["motion"] not in stages
    assert "Measured 1 motion." in last["status"]
    assert "A &lt;note&gt;." in last["message"]["value"]
    assert "&lt;b&gt;" in last["numbers"]["value"] and "<b>.npz" not in last["numbers"]["value"]
    assert "?run=" in last["runs"]["value"]
    assert last["figures"]["visible"] and "<img" in last["figures"]["value"]
    assert saved(last["downloads"]) == ["diagnostics.json", "jitter.png"]
    assert 'href="media/run/' in last["downloads"]["value"]
    read = [{**fakes.ASSUMED, "reason": "so"}]
    assert last["player"]["rows"][0]["interpretation"] == {
        "file_pattern": "*.npz",
        "assumptions": read,
    }


def test_a_run_that_fails_keeps_the_motion_that_it_has_and_says_why(tmp_path, speech):
    failing = make_generate(late_error=RunError("The disk is full."))
    services = made_services(tmp_path, {"run_page_request": failing})
    with gr.Blocks():
        form, parts = build_form(services), ResultParts()
    runner = GenerateRunner(services, form, parts)
    values = [str(speech), ["globaldiff/local"], None, 0, 1, "", "", False, None, "right_middle", 0]
    *_, last = updates_of(runner, parts, *values, None)
    assert "The disk is full." in last["message"]["value"] and text.STOPPED in last["status"]
    (row,) = last["player"]["rows"]
    assert row["frames_available"]["num_ready"] == 30 and not last["player"]["running"]
    assert "globaldiff-local.npz" in saved(last["downloads"])
    early = make_generate(error=RunError("No such system."))
    services = made_services(tmp_path / "early", {"run_page_request": early})
    runner = GenerateRunner(services, form, parts)
    assert updates_of(runner, parts, *values, None)[-1] == {"error": "No such system."}


def test_the_button_is_free_while_figures_are_drawn_and_what_it_begins_waits(tmp_path, speech):
    figures = threading.Event()
    services = made_services(tmp_path, {"run_page_request": make_generate(before_figures=figures)})
    with gr.Blocks():
        form, parts = build_form(services), ResultParts()
    runner = GenerateRunner(services, form, parts)
    values = [str(speech), ["globaldiff/local"], None, 0, 1, "", "", False, None, "right_middle", 0]

    def start(update: Updates) -> bool | None:
        return update[form.start]["interactive"] if form.start in update else None

    assert start(runner.waiting_updates(VISITOR)) is False
    free = []
    for update in runner.run(VISITOR, *values, None):
        if parts.numbers in update:
            assert not update[parts.numbers]["visible"] or start(update) or free
        free.append(start(update)) if start(update) is not None else None
        if free == [False, True] and not figures.is_set():
            assert start(runner.waiting_updates(VISITOR)) is False, "a second click"
            figures.set()
    assert free == [False, True, False], "of the click that waits"
    runner.cancel(VISITOR)
    assert [start(each) for each in runner.run(VISITOR, *values, None)][-1] is True


def test_a_run_that_finds_no_place_in_the_queue_leaves_no_line_that_it_waits(tmp_path, speech):
    services = made_services(tmp_path, {"run_page_request": make_generate(error=RunError("No."))})
    with gr.Blocks():
        form, parts = build_form(services), ResultParts()
    runner = GenerateRunner(services, form, parts)
    assert "Waiting" in runner.waiting_updates(VISITOR)[parts.status]
    refused = runner.reset_updates_on_failure(VISITOR)
    assert text.READY in refused[parts.status] and refused[form.start]["interactive"]
    runner.waiting_updates(VISITOR)
    services.jobs.quota.max_bytes = -1
    assert "the limit is" in updates_of(runner, parts, str(speech))[-1]["error"]
    assert parts.status not in runner.reset_updates_on_failure(VISITOR), (
        "which says already that it has failed"
    )


def test_videos_tell_when_they_are_ready_from_the_rate_so_far():
    remaining = RemainingTime()
    assert remaining.suffix(0.0, 10.0) == remaining.suffix(0.02, 18.0) == ""
    assert remaining.suffix(0.1, 20.0) == "", "too early"
    assert remaining.suffix(0.22, 28.0) == ", ready in about 40 s"  # 2 % a second
    assert remaining.suffix(0.99, 60.0) == ", ready in about 5 s"
    assert RemainingTime((0.0, 0.0)).suffix(0.1, 30.0) == ", ready in about 4 min"


def test_a_run_that_is_refused_or_fails_leaves_nothing_that_it_unpacked(tmp_path):
    left: list[Path] = []

    def unpack(place: str) -> Any:
        def do(ask: Any, callbacks: RunCallbacks) -> None:
            left.append(ask.output.out.parent / place / "a.npz")
            left[-1].parent.mkdir(parents=True)
            left[-1].touch()
            raise RunError("It is too large.")

        return do

    own = Own(tmp_path, unpack(UNPACKED_ZIP_FOLDER), unpack(f"results/{UNPACKED}"))
    for name in ("a.npz", "a.zip"):
        last = updates_of(own.runner, own.parts, [str(tmp_path / name)], *ONE)[-1]
        assert last == {"error": "It is too large."}
    wait_for(lambda: not any(path.parent.exists() for path in left))
    assert len(left) == 2


class Measured:
    """Sets that somebody has brought."""

    def __init__(self, folder: Path) -> None:
        self.asked: list[DiagnoseRequest] = []
        self._folder = folder

    def __call__(self, request: DiagnoseRequest, callbacks: RunCallbacks) -> SetResults:
        self.asked.append(request)
        callbacks.on_event(StageProgress("numbers", 0.5))
        request.output.out.mkdir()
        table = request.output.out / "batch.csv"
        table.write_text("0")
        row = {"measure": JERK, "protocol": "workbench/1", "unit": "m/s³", "clips": 2}
        row |= {"difference_to": ""}
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
        sounds = {"a": self._folder / "a.wav"}
        return SetResults(request, (table,), ("A <note>.",), told, clips, sounds)


def test_zips_are_measured_as_sets_and_their_browser_opens_any_clip(tmp_path):
    opened: list[DiagnoseRequest] = []

    def noted(request: DiagnoseRequest, *how: Any) -> None:
        opened.append(request)
        fakes.diagnose(request, *how)

    measured = Measured(tmp_path)
    own = Own(tmp_path / "jobs", noted, measured)
    more = None, None, None, False, False, "motions:up=z,*.bvh:up=x", "left"
    asked = ["/up/<i>mine.tar.gz", "/up/gt.zip"], "gt", "right_middle", 0, *more
    mine, stranger = browser("mine" * 20, "mine"), browser("else" * 20, "else")
    first, *_, last = updates_of(own.runner, own.parts, *asked, visitor=mine)
    assert first[own.sets_shown] == {"value": "", "visible": False, "__type__": "update"}
    (request,) = measured.asked
    assert (request.motions.names, request.imports.reference) == (("<i>mine",), Path("/up/gt.zip"))
    html = last[own.sets_shown]["value"]
    assert "foot sliding, jerk; jerk 2,400 m/s³" in html and "<b>b&lt;u&gt;</b>" in html
    assert "2,350 [2,340, 2,350]" in html and "120 [119, 121]" in html
    assert "<i>" not in html and "<u>" not in html
    assert "Measured 2 clips per set (2 sets)" in last["status"]
    assert "A &lt;note&gt;." in last["message"]["value"]

    (worst, _), (_, good) = last[own.sets_clip]["choices"]
    assert worst == "b<u>: foot sliding, jerk" and good.endswith("/a")
    *updates, end = updates_of(own.opener, own.parts, good, visitor=mine)
    (one,) = opened
    assert (one.motions.names, one.motions.motions) == (("<i>mine",), (tmp_path / "<i>mine a.npz",))
    assert (one.imports.reference, one.speech.path) == (
        tmp_path / "reference a.npz",
        tmp_path / "a.wav",
    )
    assert (one.imports.import_overrides.entries, one.speech.channel) == (
        (("motions", "up", "z"),),
        0,
    )
    assert all(own.sets_shown not in update for update in (*updates, end)), "the sets stay"
    assert "a of &lt;i&gt;mine" in end["runs"]["value"]

    for visitor, told in (
        (mine, good.replace("/a", "/../secret")),
        (mine, f"{'x' * 43}/a"),
        (mine, None),
        (stranger, good),
    ):
        error = updates_of(own.opener, own.parts, told, visitor=visitor)[-1]["error"]
        assert "expired" in error or "reload the page" in error
    assert len(opened) == 1


def test_the_page_reads_no_more_of_a_zip_than_a_short_list_of_its_files(tmp_path, monkeypatch):
    """Only the worker unpacks one, however often a form names it."""
    limits: list[float] = []

    class Watched(zipfile.ZipFile):
        def __init__(self, file: Any, mode: Any = "r", *more: Any, **named: Any) -> None:
            limits.extend([file.max_read] if mode == "r" else [])
            super().__init__(file, mode, *more, **named)

        def open(self, *how: Any, **named: Any) -> Any:
            assert self.mode != "r", "a file of it was read"
            return super().open(*how, **named)

    upload = tmp_path / "mine.zip"
    with zipfile.ZipFile(upload, "w") as archive:
        archive.writestr("a.npz", b"")
    monkeypatch.setattr(zipfile, "ZipFile", Watched)
    own = Own(tmp_path / "jobs", fakes.diagnose, Measured(tmp_path))
    *_, last = updates_of(own.runner, own.parts, 4 * [str(upload)], *ONE)
    assert "Measured 2 clips" in last["status"] and max(limits, default=0) < 2**20


USUAL = "gan/5"
LIVE = {"system": "globaldiff/global", "speaker": "bob", "seed": 7}


@pytest.fixture
def live(weights: Path) -> ByHand:
    return ByHand(weights)


@pytest.fixture
def keeps(live: ByHand, weights: Path, tmp_path: Path) -> LiveRecordingRunner:
    with gr.Blocks():
        form = FormParts({}, gr.Button(), gr.Button())
        results = ResultParts("live-")
    does = {"run_page_request": make_generate(), "draw_run_videos": make_draw()}
    config = AppConfig(weights=weights, temp_folder=tmp_path)
    services = made_services(tmp_path, does, config=config, live=live)
    return LiveRecordingRunner(services, form, results)


def test_sound_and_motion_of_the_minute_lie_in_the_jobs_folder_and_keep_says_why_it_kept_less(
    keeps, live, tmp_path, monkeypatch
):
    monkeypatch.setattr("app.live.sessions.MAX_AHEAD_S", 10.0)  # nobody waits for sound here
    monkeypatch.setattr("app.live.sessions.SOUND_ARRIVAL_WINDOW_S", 1e9)
    ready: list[Any] = []
    number = live.open(LIVE, "mine", ready.append)
    own = ready[0]["token"]
    blocks = list(sound(5.5))
    for block in blocks[: len(blocks) // 2]:
        live.add_audio(number, block)
    live.performers.generate_next_window()
    live.performers.generate_next_window()
    job = Job("me", "live", tmp_path / "kept", "mine")
    job.folder.mkdir()
    asked = keeps.make_request(job, (own,))
    assert (asked.sampling.systems, asked.sampling.speaker, asked.sampling.seed) == (
        ("globaldiff/global",),
        "bob",
        7,
    )
    assert asked.speech.path.parent == job.folder and asked.live_recording is not None
    assert asked.video.close_ups == CLOSE_UPS  # as any other run on the page
    assert (
        asked.live_recording.motion.parent == job.folder and asked.output.out.parent == job.folder
    )
    speech, motion = load_speech(asked.speech.path), load_motion(asked.live_recording.motion)
    assert speech.num_motion_frames == motion.num_frames > 60
    for token, cookie in ((own, "yours"), ("", "mine"), (None, "mine"), ("x" * 9999, "")):
        with pytest.raises(RunError, match="no live recording"):
            keeps.make_request(Job("me", "live", job.folder, cookie), (token,))

    assert asked.live_recording.truncation_note == "", "it follows as closely as it can"
    for block in blocks[len(blocks) // 2 :]:
        live.add_audio(number, block)
    updates = list(keeps.run(browser("mine", "me"), own))
    (line,) = [each[keeps.status] for each in updates if "Done in" in str(each)]
    kept_s = motion.num_frames / 30
    assert f"The saved run ends {5.5 - kept_s:.1f} s before the end of your speech" in line


def test_what_is_usual_stands_first_and_what_needs_all_of_the_speech_is_not_offered():
    told = live_choices(replace(CATALOGUE, systems=("globaldiff/local", "gan/20", USUAL)))
    assert told["systems"] == [USUAL, "globaldiff/local", "gan/20"]
    assert told["speakers"] == list(CATALOGUE.speakers)
    told = live_choices(
        replace(CATALOGUE, systems=("official/authors", "workbench/planned", USUAL))
    )
    assert told["systems"] == [USUAL, "workbench/planned"]


@pytest.fixture
def study(tmp_path: Path) -> StudyRunner:
    return made_study(StudyRunner, tmp_path)


def made_study(kind: Any, folder: Path, **does: Any) -> StudyRunner:
    services = made_services(folder, does)
    with gr.Blocks():
        return kind(services, build_study_tab(services), gr.HTML(), gr.HTML())


def form(speech: Path, length_s: float = 1, participants: float = 4) -> list[Any]:
    systems = ["globaldiff/local", "globaldiff/full"]
    protocol = "ranking"
    given = ["A study", protocol, [str(speech)], systems, None, []]
    return [*given, length_s, participants, 0, ["front"], ""]


def click(study: StudyRunner, speech: Path, cookie: str = "cookie") -> Iterator[str]:
    """What the tab says, update by update."""
    for updates in study.run(browser(cookie), *form(speech)):
        (status,) = [value for part, value in updates.items() if part is study.status]
        yield status


@pytest.mark.parametrize("is_page_gone", [False, True])
def test_a_study_that_is_cancelled_leaves_nothing_though_its_process_writes_until_it_hears_that(
    speech, tmp_path, is_page_gone
):
    private, may_end = tmp_path / "private", threading.Event()

    def export(asked: ExportRequest, callbacks: RunCallbacks) -> None:
        callbacks.on_event(StageProgress("motion", 0.5))
        wait_for(callbacks.should_cancel)
        assert may_end.wait(60)
        for path in (asked.output.out, *asked.zips):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch()
        raise Cancelled

    study = made_study(StudyRunner, tmp_path, export_from_request=export)
    clicked = study.run(browser("cookie"), *form(speech))
    next(clicked)
    while "50 %" not in str(next(clicked)):
        pass
    assert len(list(private.iterdir())) == 2
    if is_page_gone:
        clicked.close()
    else:
        study.cancel(VISITOR)
        *_, last = clicked
        assert text.CANCELLED in str(last) and "error" not in str(last)
    may_end.set()
    for run in (each for each in threading.enumerate() if each.name == "run"):
        run.join(60)
    assert not list(private.iterdir())


def test_without_a_cookie_no_study_is_made(study, speech):
    clicked = click(study, speech, cookie="")
    next(clicked)
    assert NO_COOKIE.split(".")[0] in next(clicked)
    with pytest.raises(gr.Error, match="cookie"):
        next(clicked)


def test_the_plan_alone_is_checked_and_copies_no_upload(speech, tmp_path):
    study = made_study(StudyPlanRunner, tmp_path)
    for changes, words in (({"length_s": 500.0}, "length_s"), ({"participants": 1.5}, "got 1.5")):
        with pytest.raises(gr.Error, match=words):
            list(study.run(VISITOR, *form(speech, **changes)))
    shutil.rmtree(tmp_path / "jobs")
    *_, last = study.run(VISITOR, *form(speech, 2))
    assert 'download="plan.toml"' in last[study.result_part]["value"]
    left = {path.name for path in (tmp_path / "jobs").rglob("*") if path.is_file()}
    assert left == {"plan.toml"}


NAMES = ("globaldiff/local", "globaldiff/global")


class Page:
    """Two tabs, the runs that are kept, and two fields of the first one's form."""

    def __init__(self, folder: Path) -> None:
        self.runs = SavedRuns(3600.0)
        with gr.Blocks():
            self.first, self.own = ResultParts(), ResultParts("own-")
            self.seed, self.samples = gr.Number(0), gr.Number(1)
            places = {"generate": self.first, "own_motion": self.own}
            fields = {"seed": self.seed, "samples": self.samples}
            services = fakes.made_services(folder, saved_runs=self.runs)
            self.opening = PageLoader(services, gr.Tabs(), places, fields)

    def opened(self, cookie: str = "", *tokens: str) -> Updates:
        query = QueryParams([("run", token) for token in tokens])
        return self.opening.on_load(browser(cookie, query=query))


def test_each_tab_lists_the_visitors_runs_and_the_example_stays_without_one(tmp_path):
    page = Page(tmp_path)
    keep(page.runs, tmp_path / "job", "mine")
    for _ in range(2):
        assert page.first.player not in page.opened("mine", "expired")
        updates = page.opened("mine")
        assert page.first.player not in updates
        lists = [updates[parts.runs].pop("value") for parts in (page.first, page.own)]
        assert lists[0] == lists[1]


@pytest.mark.parametrize(
    ("tab", "place"), [("generate", "generate"), ("live", "generate"), ("own_motion", "own_motion")]
)
def test_a_link_opens_the_run_in_its_own_tab_and_fills_in_the_form_that_asked_for_it(
    tmp_path, tab, place
):
    page = Page(tmp_path)
    run = keep(page.runs, tmp_path / "job", "mine", tab, {"seed": 7})
    updates = page.opened("of a stranger", run.token)
    tabs, *_ = page.opening.outputs
    assert updates[tabs].selected == place
    parts, other = page.first, page.own
    if place == "own_motion":
        parts, other = other, parts
    assert updates[parts.status] == markup.sentence_status("Done.")
    assert "data-measure" in updates[parts.numbers]["value"]
    assert other.status not in updates and run.token not in updates[other.runs]["value"]
    assert updates[page.seed]["value"] == 7 and page.samples not in updates
    assert {page.seed, page.samples} <= set(page.opening.outputs)


def test_results_that_the_page_is_started_for_are_shown_to_everybody(tmp_path):
    """Made elsewhere; a visitor's link comes first."""
    made = made_run(tmp_path / "elsewhere", "made elsewhere", kind="imported", jerk={"mine": 9.0})
    page = Page(tmp_path / "page")
    own = add_host_run(page.runs, made.folder, tmp_path / "opened", SharedFolders())
    page.opening.services = replace(page.opening.services, opened_run_tokens=(own,))
    updates = page.opened("of anybody")
    assert [row["name"] for row in updates[page.own.player]["rows"]] == ["mine"]
    assert "made elsewhere" not in updates[page.own.runs]["value"], "it is nobody's own"
    assert "data-measure" in updates[page.own.numbers]["value"]
    assert saved(updates[page.own.downloads])
    mine = keep(page.runs, tmp_path / "job", "mine")
    assert page.own.player not in page.opened("mine", mine.token)
    (tmp_path / "empty").mkdir()
    with pytest.raises(RunError, match=r"run\.json is missing"):
        add_host_run(page.runs, tmp_path / "empty", tmp_path / "none", SharedFolders())


def test_several_clips_are_one_run_of_which_each_is_opened_and_all_are_saved(tmp_path):
    job = tmp_path / "job"
    for number, clip in enumerate("ab"):
        made_run(job, f"{clip}: local", jerk={"local": 10.0 + 2 * number}, out=f"results/{clip}")
    (job / "results/summary.md").touch()
    page = Page(tmp_path / "page")
    token = add_host_run(page.runs, job / "results", tmp_path / "opened", SharedFolders())
    first = page.runs.find(token)
    assert first is not None and list(first.clips) == ["a", "b"]
    second = first.clips["b"]
    updates = page.opened("of anybody", second.token)
    parts = page.first
    assert "mean over 2 clips: local 11" in updates[parts.clips]["value"]
    chosen = updates[parts.clip]
    assert chosen["value"] == second.token and dict(chosen["choices"])["a"] == token
    address = updates[parts.player]["audio"]
    assert address.split("?")[0].endswith("b/speech.wav")
    assert "summary.md" in updates[parts.downloads]["value"]
    assert not updates[parts.verdict]["visible"], "one verdict, over all clips"
    assert ">12<" in updates[parts.numbers]["value"] and "2 of 2" in updates[parts.status]
    packed = zip_run(second.folder, tmp_path / "all.zip")
    with zipfile.ZipFile(packed) as archive:
        assert {"a/run.json", "b/run.json", "b/speech.wav", "summary.md"} <= set(archive.namelist())
    mine = [keep(page.runs, tmp_path / "alone", "mine")]
    assert page.runs.runs_of("mine") == mine
    single = page.opened("mine", mine[0].token)
    assert not single[parts.clips]["visible"] and not single[parts.clip]["visible"]


def test_two_runs_open_beside_each_other(tmp_path):
    page = Page(tmp_path)
    first = keep(page.runs, tmp_path / "1", "mine", title="first")
    second = keep(page.runs, tmp_path / "2", "mine", "own_motion", title="second")
    updates = page.opened("mine", second.token, first.token)
    assert text.PAIR_SAME_SETTINGS in updates[page.first.verdict]["value"]
    assert "local (B)" in updates[page.first.numbers]["value"]
    listed = updates[page.first.runs]["value"]
    assert f"?run={first.token}&amp;run={second.token}" in listed and text.PAIR_LINK in listed
    assert listed.count(" checked") == 2
    alone = page.opened("mine", second.token)[page.own.runs]["value"]
    assert text.COMPARE_LAST in alone  # the same speech, and the run before it
    gone = page.opened("mine", first.token, "x")
    assert "deleted after" in gone[page.first.message]["value"] and page.first.numbers not in gone


def test_every_tab_lists_the_visitors_runs_and_of_one_that_is_gone_a_sentence_says_so(tmp_path):
    page = Page(tmp_path)
    run = keep(page.runs, tmp_path / "job", "mine")
    for parts in (page.first, page.own):
        assert run.token in page.opened("mine")[parts.runs]["value"]
        assert not page.opened("yours")[parts.runs]["visible"]
    shutil.rmtree(run.job.folder)
    updates = page.opened("mine", run.token)
    assert "deleted after 60 minutes" in updates[page.first.message]["value"]
    assert page.first.status not in updates


class Tab:
    """A run that has ended, whose videos are wanted."""

    def __init__(self, folder: Path, draw: Any) -> None:
        with gr.Blocks():
            self.parts: ResultParts = ResultParts()
        services = fakes.made_services(folder, {"draw_run_videos": draw})
        self.jobs, self.kept = services.jobs, services.saved_runs
        self.videos = BackgroundVideos(services, self.parts, "generate")
        self.run = keep(self.kept, folder / "run", "cookie", jerk=dict.fromkeys(NAMES, 100.0))
        for row in self.run.record.rows:
            (self.run.view.folder / row.files["video"]).unlink()
        self.videos.request_videos(self.run, VideoOptions())

    def updates(self) -> Iterator[dict[Any, Any]]:
        return self.videos.run(VISITOR)


def test_videos_come_into_the_player_the_zip_and_the_run_that_a_link_opens(tmp_path):
    first, second = threading.Event(), threading.Event()
    tab = Tab(tmp_path, fakes.make_draw(lambda number: (first, second)[number], seconds=0.2))
    assert "3 of 3 videos are not rendered yet" in tab.run.downloads_html(tab.run.view)
    first.set()
    updates = tab.updates()
    told = [next(updates)]
    wait_for(lambda: len(tab.run.record.pending_videos) == 2)
    packed = zip_run(tab.run.folder, tmp_path / "meanwhile.zip")
    with zipfile.ZipFile(packed) as archive:
        lacks = json.loads(archive.read(RUN))["pending_videos"]
        assert lacks == ["globaldiff-global.mp4", "comparison.mp4"]
        assert "globaldiff-local.mp4" in archive.namelist() and not {*lacks} & {*archive.namelist()}
    assert "2 of 3 videos are not rendered yet" in tab.run.downloads_html(tab.run.view)
    second.set()
    told += updates
    assert (
        "lacks" not in told[-1][tab.parts.downloads]["value"] and not tab.run.record.pending_videos
    )
    assert text.VIDEOS_DONE in told[-1][tab.parts.status] and "Done." in told[-1][tab.parts.status]
    names = ["globaldiff-local.mp4", "globaldiff-global.mp4", "comparison.mp4"]
    listed = saved(told[-1][tab.parts.downloads])
    assert [name for name in listed if name.endswith(".mp4")] == names
    players = [each[tab.parts.player] for each in told if tab.parts.player in each]
    assert (
        all("video" in row for row in players[-1]["rows"]) and not players[-1]["plays_when_ready"]
    )
    opened = tab.kept.find(tab.run.token)
    assert opened is not None
    shown = "viewer/globaldiff-local.frames"
    assert {shown, *names} <= {*opened.record.all_files}, "of which the zip is made"
    assert list(tab.updates()) == [{tab.parts.status: gr.skip()}], "once, and all stays"
    assert not tab.jobs.in_use()


def test_another_run_ends_them_without_a_word_and_a_failure_is_told_beside_how_the_run_went(
    tmp_path,
):
    def fail(*_: object) -> tuple[Path, ...]:
        raise RunError("No OpenGL backend works here.")

    never = threading.Event()
    tab = Tab(tmp_path, fakes.make_draw(lambda number: never))
    updates = tab.updates()
    next(updates)
    tab.videos.cancel_videos("visitor")
    assert all(tab.parts.downloads not in each for each in updates) and not tab.jobs.in_use()
    (tmp_path / "again").mkdir()
    tab = Tab(tmp_path / "again", fail)
    (*_, last) = list(tab.updates())
    assert list(last) == [tab.parts.status]
    assert "Done." in last[tab.parts.status] and "No OpenGL backend" in last[tab.parts.status]
