"""What a browser tells of its stage, and the video that comes of it."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gradio as gr
import pytest

from app import text
from app.errors import RunError
from app.page.results.result_parts import build_results
from app.page.tabs.videos_run import Asked, DrawSeen, SeenRunner
from app.run.requests.request import OnEvent, Progress, ShouldCancel
from app.run.videos.seen_video import SeenRequest, SeenVideo
from tests.app.fakes import made_services

COOKIE = "a browser"
LOOK = {
    "factor": 6.5, "cutoff": 4, "hasTrail": True, "trailFrames": 60, "point": "left_index",
    "hasHeat": True, "heatScale": 300, "isAligned": False, "isWhole": True, "hasWords": True,
    "tone": "dark", "build": "broad", "hasBones": True, "hasAxes": False,
}  # fmt: skip


def told(**changes: Any) -> dict[str, Any]:
    """As app/page/web/player/player.js writes it."""
    return {
        "bodies": [{"label": "local", "motion": "media/a"}, {"label": "full", "motion": "media/b"}],
        "shown": [1],
        "columns": 2,
        "mode": "grid",
        "wipe": 0.5,
        "isSmoothed": True,
        "size": [240, 420],
        "panels": [[{"view": None, "rect": [0, 0, 240, 300]}]],
        "look": LOOK,
        "camera": [0.5, 0.2, 1.5, 0, -0.1],
        "sound": "media/c",
        **changes,
    }


def test_everything_that_is_seen_is_read() -> None:
    asked = Asked.of(json.dumps(told()))
    seen = asked.seen
    assert (asked.labels, asked.motions, asked.sound) == (
        ("local", "full"),
        ("media/a", "media/b"),
        "media/c",
    )
    assert (seen.shown, seen.columns, seen.mode, seen.size) == ((1,), 2, "grid", (240, 420))
    assert (seen.is_smoothed, seen.is_aligned, seen.is_whole) == (True, False, True)
    display = seen.display
    assert (display.exaggeration, display.cutoff_hz, display.jerk_m_s3) == (6.5, 4, 300)
    assert (display.has_trail, display.trail_frames, display.coloring) == (True, 60, "jerk")
    assert seen.point == "left_index" and seen.camera.zoom == 1.5 and seen.camera.up_m == -0.1
    (panel,) = seen.panels[0]
    assert (panel.view, panel.width, panel.height) == ("body", 240, 300)
    seen.check(2)


@pytest.mark.parametrize(
    "value",
    [
        None, 7, "", "nonsense", "[]", "null", "[" * 5000, "x" * 100_000,
        told(size=[240]), told(size=[240, "420"]), told(size=[240, float("nan")]), told(panels=3),
        told(camera=[0, 0, 1]), told(camera=None), told(shown=[0.5]), told(shown=[True]),
        told(shown="0"), told(look={}), told(look=None), told(bodies={"a": 1}), told(bodies=[3]),
        told(bodies=[{"label": 3, "motion": "media/a"}]), told(bodies=70 * told()["bodies"]),
        told(mode=["grid"]), told(wipe="left"), told(columns=1e400), told(sound=["x"]),
        told(panels=[[{"view": "body", "rect": [0, 0, 1]}]]), {"look": LOOK},
    ],
)  # fmt: skip
def test_anything_else_is_refused_with_a_sentence(value: Any) -> None:
    with pytest.raises(RunError, match="What the stage told of itself cannot be used"):
        Asked.of(json.dumps(value) if isinstance(value, dict) else value)


class Page:
    """A tab whose stage shows two motions of this browser."""

    def __init__(self, folder: Path, draw: DrawSeen) -> None:
        with gr.Blocks():
            self.parts = build_results()
        services = made_services(folder, {"draw_seen": draw})
        self.addresses, self.jobs = services.addresses, services.jobs
        self.runner = SeenRunner(services, self.parts)
        self.files = {name: folder / name for name in ("a.npz", "b.npz", "c.wav")}
        for path in self.files.values():
            path.write_bytes(b"")
        self.asked = told(
            bodies=[
                {"label": "local", "motion": self.addresses.address(self.files["a.npz"], COOKIE)},
                {"label": "full", "motion": self.addresses.address(self.files["b.npz"], COOKIE)},
            ],
            sound=self.addresses.address(self.files["c.wav"], COOKIE),
        )

    def press(self, cookie: str = COOKIE) -> list[dict[Any, Any]]:
        cookies = {"study_visitor": cookie}
        request: Any = SimpleNamespace(session_hash="visitor", cookies=cookies, client=None)
        return list(self.runner.run(request, json.dumps(self.asked)))


def draw(request: SeenRequest, on_event: OnEvent, should_cancel: ShouldCancel) -> SeenVideo:
    on_event(Progress("video", 0.43))
    request.out.mkdir()
    video = request.out / "stage.mp4"
    video.write_bytes(bytes(2_100_000))
    return SeenVideo(video, 300, ("It is cut.",))


def test_a_video_comes_with_its_progress_and_a_way_to_save_it(tmp_path: Path) -> None:
    got: list[SeenRequest] = []

    def noted(request: SeenRequest, *how: Any) -> SeenVideo:
        got.append(request)
        return draw(request, *how)

    page = Page(tmp_path, noted)
    updates = page.press()
    lines = [each[page.parts.seen]["value"] for each in updates if page.parts.seen in each]
    assert text.SEEN_STARTING in lines[0]
    assert any("43%" in line and 'value="0.430"' in line for line in lines)
    assert (
        "one body, 10.0 s, 2.1 MB. It is cut." in lines[-1] and 'download="stage.mp4"' in lines[-1]
    )
    token = lines[-1].split('href="media/')[1].split('"')[0]
    video = page.addresses.find(token, COOKIE)
    assert video is not None and video.name == "stage.mp4"
    assert page.addresses.find(token, "another browser") is None
    (request,) = got
    assert [each.motion for each in request.bodies] == [page.files["a.npz"], page.files["b.npz"]]
    assert request.speech == page.files["c.wav"] and not page.jobs._jobs


@pytest.mark.parametrize(
    "address",
    ["", "media/", "media/../jobs", "/etc/passwd", "media/%2e%2e/b.npz", "file:///etc/passwd"],
)
def test_a_path_is_no_address(tmp_path: Path, address: str) -> None:
    page = Page(tmp_path, draw)
    page.asked["bodies"][0]["motion"] = address
    with pytest.raises(gr.Error, match="kept no longer"):
        page.press()
    assert not page.jobs._jobs


def test_files_of_another_browser_and_of_another_kind_are_not_taken(tmp_path: Path) -> None:
    page = Page(tmp_path, draw)
    with pytest.raises(gr.Error, match="kept no longer"):
        page.press("another browser")
    page.asked["sound"] = page.asked["bodies"][0]["motion"]
    with pytest.raises(gr.Error, match="kept no longer"):
        page.press()
