"""Videos that are drawn once a run has ended, and shown beside what was shown then."""

import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gradio as gr
import pytest

from app import text
from app.errors import RunError
from app.page.player.player import Showing, Writers
from app.page.results.result_parts import build_results
from app.page.routes.media import MediaAddresses
from app.page.tabs.videos_run import Draw, VideosBehind, Wanted
from app.run.output.result_folder import zip_files
from app.run.requests.request import Artefact
from app.run.videos.behind import VideosRequest
from model.motion.motion import save_motion
from tests.app import fakes
from tests.app.page.results.made_run import ended_run, keep

VISITOR = SimpleNamespace(session_hash="visitor", cookies={}, client=None)
NAMES = ("globaldiff/local", "globaldiff/global")


class Tab:
    """A run that has ended, whose videos are wanted."""

    def __init__(self, folder: Path, draw: Draw) -> None:
        with gr.Blocks():
            self.parts = build_results()
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
        request = VideosRequest(self.showing.drawn(), run_folder)
        self.videos.want("visitor", Wanted(self.run, request))

    def updates(self) -> Iterator[dict[Any, Any]]:
        return self.videos.run(VISITOR)  # type: ignore[arg-type]  # all that is read of a request


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
    assert not tab.jobs._jobs


def test_another_run_ends_them_without_a_word(tmp_path: Path) -> None:
    never = threading.Event()
    tab = Tab(tmp_path, fakes.make_draw(lambda number: never))
    updates = tab.updates()
    next(updates)
    tab.videos.give_up("visitor")
    assert all(tab.parts.files not in each for each in updates) and not tab.jobs._jobs


def test_a_failure_is_told_beside_how_the_run_went_and_leaves_that_as_it_was(
    tmp_path: Path,
) -> None:
    def draw(*_: object) -> tuple[Path, ...]:
        raise RunError("No OpenGL backend works here.")

    tab = Tab(tmp_path, draw)
    (*_, last) = list(tab.updates())
    assert list(last) == [tab.parts.status]
    assert "Done." in last[tab.parts.status] and "No OpenGL backend" in last[tab.parts.status]


@pytest.mark.parametrize("number", [1, 8])
def test_no_more_stand_side_by_side_than_fit_and_the_reference_does(number: int) -> None:
    from app.run.videos.behind import names_that_fit

    names = [f"system{i}" for i in range(number)]
    fitting = names_that_fit([*names, "reference"])
    assert fitting == [*names[:5], "reference"]
