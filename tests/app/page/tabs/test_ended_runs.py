"""Runs that have ended: opened by an address in the tab that they came from; videos behind them."""

import shutil
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gradio as gr
import pytest
from starlette.datastructures import QueryParams

from app import text
from app.errors import RunError
from app.page.parts import markup
from app.page.player.player import Showing, Writers
from app.page.queue.in_turn import Updates
from app.page.results.kept_runs import KeptRuns
from app.page.results.result_parts import ResultParts, build_results
from app.page.routes.media import MediaAddresses
from app.page.tabs.motion_run import Opening
from app.page.tabs.videos_run import Draw, VideosBehind, Wanted
from app.run.output.result_folder import zip_files
from app.run.requests.request import Artefact
from app.run.videos.behind import VideosRequest, names_that_fit
from model.motion.motion import save_motion
from tests.app import fakes
from tests.app.page.made import VISITOR, browser
from tests.app.page.results.made_run import ended_run, keep

NAMES = ("globaldiff/local", "globaldiff/global")


class Page:
    """Two tabs, the runs that are kept, and two fields of the first one's form."""

    def __init__(self, folder: Path) -> None:
        self.runs = KeptRuns(3600.0)
        with gr.Blocks():
            self.first, self.own = build_results(), build_results("own-")
            self.seed, self.samples = gr.Number(0), gr.Number(1)
            places = {"generate": self.first, "own_motion": self.own}
            fields = {"seed": self.seed, "samples": self.samples}
            services = fakes.made_services(folder, kept=self.runs)
            self.opening = Opening(services, gr.Tabs(), places, fields)

    def opened(self, cookie: str = "", *tokens: str) -> Updates:
        query = QueryParams([("run", token) for token in tokens])
        return self.opening.opened(browser(cookie, query=query))


@pytest.fixture
def page(tmp_path: Path) -> Page:
    return Page(tmp_path)


@pytest.mark.parametrize(
    ("tab", "place"), [("generate", "generate"), ("live", "generate"), ("own_motion", "own_motion")]
)
def test_a_link_opens_the_run_in_its_own_tab_and_fills_in_the_form_that_asked_for_it(
    page: Page, tmp_path: Path, tab: Any, place: str
) -> None:
    run = keep(page.runs, tmp_path / "job", "mine", ended_run(tmp_path, form={"seed": 7}), tab)
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


def test_two_runs_open_beside_each_other(page: Page, tmp_path: Path) -> None:
    first = keep(page.runs, tmp_path / "1", "mine", ended_run(tmp_path, "first"))
    second = keep(page.runs, tmp_path / "2", "mine", ended_run(tmp_path, "second"), "own_motion")
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


def test_every_tab_lists_the_visitors_runs_and_of_one_that_is_gone_a_sentence_says_so(
    page: Page, tmp_path: Path
) -> None:
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

    def __init__(self, folder: Path, draw: Draw) -> None:
        with gr.Blocks():
            self.parts: ResultParts = build_results()
        services = fakes.made_services(folder, {"draw_behind": draw})
        self.jobs, self.kept = services.jobs, services.kept
        self.videos = VideosBehind(services, self.parts, "videos")
        run_folder = folder / "run"
        run_folder.mkdir()
        writers = Writers(lambda paths: run_folder, lambda paths: run_folder)
        self.showing = Showing(NAMES, NAMES, {}, writers, run_folder, MediaAddresses(), "")
        for name in NAMES:
            path = run_folder / f"{name.rsplit('/', 1)[-1]}.npz"
            save_motion(fakes.made_motion(30), path)
            self.showing.take(Artefact("motion", name, path))
        files = tuple(self.showing.drawn().values())
        bundle = zip_files(files, run_folder / "all.zip")
        run = ended_run(run_folder, showing=self.showing, files=files, bundle=bundle)
        self.run = keep(self.kept, run_folder, "cookie", run)
        self.videos.want("visitor", Wanted(self.run, VideosRequest(self.showing.drawn(), folder)))

    def updates(self) -> Iterator[dict[Any, Any]]:
        return self.videos.run(VISITOR)


def test_videos_come_into_the_player_the_zip_and_the_run_that_a_link_opens(tmp_path: Path) -> None:
    tab = Tab(tmp_path, fakes.make_draw(seconds=0.2))
    told = list(tab.updates())
    assert text.VIDEOS_DONE in told[-1][tab.parts.status] and "Done." in told[-1][tab.parts.status]
    names = ["local.npz", "global.npz"]
    names += ["globaldiff-local.mp4", "globaldiff-global.mp4", "comparison.mp4"]
    assert [Path(path).name for path in told[-1][tab.parts.files]] == names
    players = [each[tab.parts.player] for each in told if tab.parts.player in each]
    assert all("video" in row for row in players[-1]["rows"]) and not players[-1]["begins"]
    opened = tab.kept.find(tab.run.token)
    assert opened is not None and [path.name for path in opened.run.files] == names
    assert opened.run.bundle.stat().st_size > sum(path.stat().st_size for path in opened.run.files)
    assert list(tab.updates()) == [{tab.parts.status: gr.skip()}], "once, and all stays"
    assert not tab.jobs.in_use()


def test_another_run_ends_them_without_a_word(tmp_path: Path) -> None:
    never = threading.Event()
    tab = Tab(tmp_path, fakes.make_draw(lambda number: never))
    updates = tab.updates()
    next(updates)
    tab.videos.give_up("visitor")
    assert all(tab.parts.files not in each for each in updates) and not tab.jobs.in_use()


def test_a_failure_is_told_beside_how_the_run_went_and_leaves_that_as_it_was(
    tmp_path: Path,
) -> None:
    def draw(*_: object) -> tuple[Path, ...]:
        raise RunError("No OpenGL backend works here.")

    tab = Tab(tmp_path, draw)
    (*_, last) = list(tab.updates())
    assert list(last) == [tab.parts.status]
    assert "Done." in last[tab.parts.status] and "No OpenGL backend" in last[tab.parts.status]


def test_no_more_stand_side_by_side_than_fit_and_the_reference_does() -> None:
    for number in (1, 5, 6, 8):
        names = [f"system{i}" for i in range(number)]
        assert names_that_fit([*names, "reference"]) == [*names[:5], "reference"]
