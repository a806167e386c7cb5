"""A video of what the stage shows, made by the real renderer and held against the canvas."""

import io
import json
from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page, expect

from app.page.tabs.videos_run import Asked
from app.run.requests import display
from model.motion.motion import Motion, save_motion
from model.speech.audio import write_wav
from renderer.scene.camera import FARTHEST_M, STEEPEST_RAD, ZOOMS, Camera, Orbit, view_axes
from renderer.video.compose import band_height
from tests.app.fakes import made_motion
from tests.browser.conftest import PATIENCE_MS, STAGED, Stage, faked, open_page, start
from tests.model.made import made_waveform

pytestmark = [pytest.mark.browser, pytest.mark.gl]

FRAME = 45
SHORT_S = 2.0
"""Each picture of a video takes its time."""
SMALL = (96, 72)
"""Pictures are compared so coarsely that edges and an encoder's noise do not count."""
SETTLED = """() => {
    const { stage } = document.querySelector('.lockstep');
    const now = stage.pictures;
    const been = window.drawnBefore;
    window.drawnBefore = now;
    return now === been;
}"""


@pytest.fixture(scope="module")
def fake_address(stage: Stage, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with faked(stage, tmp_path_factory, SHORT_S) as url:
        yield url


@pytest.fixture(scope="module")
def speech(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("speech") / "speech.wav"
    write_wav(path, made_waveform(round(16_000 * SHORT_S)))
    return path


def opened(browser: Browser, address: str, stage: Stage, speech: Path) -> Page:
    stage.hold(12)
    page = open_page(browser, address)
    start(page, speech)
    page.locator("#bundle").wait_for()
    page.wait_for_function(STAGED, arg=3)
    return page


def canvas_of(page: Page, player: str) -> np.ndarray:
    """The stage at `FRAME`, once it rests."""
    page.evaluate(
        f"""() => {{
            const {{ lockstep }} = document.querySelector('{player} .lockstep');
            lockstep.pause(); lockstep.setLoop(null); lockstep.seekFrame({FRAME});
        }}"""
    )
    page.wait_for_function(SETTLED, polling=900)
    picture = page.locator(f"{player} .stage canvas").screenshot()
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"))


def made(page: Page, tmp_path: Path, prefix: str = "") -> np.ndarray:
    """The picture of `FRAME` in the video, names and all."""
    player = f"#{prefix}player"
    box = page.locator(f"{player} .more-box")
    if not box.is_visible():
        page.locator(f"{player} .controls .more").click()
    link = page.locator(f"#{prefix}seen a")
    before = link.get_attribute("href") if link.count() else None
    box.get_by_role("button", name="Make a video of this").click()
    page.wait_for_function(
        """([id, before]) => {
            const link = document.querySelector(`#${id}seen a`);
            return link && link.getAttribute('href') !== before;
        }""",
        arg=[prefix, before],
        timeout=2 * PATIENCE_MS,
    )
    with page.expect_download() as download:
        link.click()
    path = tmp_path / "stage.mp4"
    download.value.save_as(path)
    with av.open(str(path)) as file:
        assert file.streams.audio
        frames = [frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)]
    assert len(frames) == round(30 * SHORT_S)
    return frames[FRAME]


def coarse(picture: np.ndarray) -> np.ndarray:
    return np.asarray(Image.fromarray(picture).resize(SMALL, Image.Resampling.BOX)).astype(float)


def away(canvas: np.ndarray, video: np.ndarray, page: Page, player: str = "#player") -> float:
    """Mean difference in grey levels of the pictures of all bodies, without their names."""
    told = json.loads(page.evaluate(f"document.querySelector('{player} .lockstep').seen()"))
    width, height = told["size"]
    columns = min(told["columns"], len(told["shown"])) if told["mode"] == "grid" else 1
    under = canvas.shape[0] - height if told["mode"] == "grid" else 0
    seen = canvas[round(under) :, : round(columns * width)]
    band = video.shape[0] - round(video.shape[1] * seen.shape[0] / seen.shape[1])
    shorter = video.shape[1] // (columns if told["mode"] == "grid" else 2)
    assert abs(band - band_height(min(shorter, video.shape[0] - band))) < 8
    return float(np.abs(coarse(seen) - coarse(video[band:])).mean())


def test_a_video_shows_what_the_stage_does(
    browser: Browser, fake_address: str, stage: Stage, speech: Path, tmp_path: Path
) -> None:
    page = opened(browser, fake_address, stage, speech)
    plain = canvas_of(page, "#player")
    page.evaluate(
        """() => {
            const { look, stage } = document.querySelector('.lockstep');
            look.set('hasTrail', false); look.set('hasHeat', true); look.set('isWhole', true);
            stage.orbit.place([0.6, 0.2, 1.2, 0.1, 0]);
            stage.setCloseUp('both');
        }"""
    )
    canvas = canvas_of(page, "#player")
    video = made(page, tmp_path)
    found, other = away(canvas, video, page), away(plain, video, page)
    assert found < 10 and found < 0.4 * other, (found, other)
    expect(page.locator("#seen")).to_contain_text(f"3 bodies, {SHORT_S} s")
    page.evaluate(
        """() => {
            const { look, stage } = document.querySelector('.lockstep');
            look.reset(); look.set('hasTrail', false);
            stage.orbit.reset(); stage.setCloseUp('hands'); stage.setMode('ghost');
        }"""
    )
    ghost = canvas_of(page, "#player")
    found = away(ghost, made(page, tmp_path), page)
    assert found < 10, found
    page.context.close()


@pytest.mark.slow  # the same video of motion that another tab shows
def test_own_motion_is_made_a_video_of_too(
    browser: Browser, fake_address: str, tmp_path: Path
) -> None:
    page = open_page(browser, fake_address)
    page.get_by_role("tab", name="Your motion").click()
    motion: Motion = made_motion(round(30 * SHORT_S), 0.01)
    save_motion(motion, tmp_path / "own.npz")
    page.set_input_files("#own-motions input[type=file]", str(tmp_path / "own.npz"))
    page.locator("#own-videos input").uncheck()
    page.locator("#own-motions .file-preview, #own-motions .file-name").first.wait_for()
    page.get_by_role("button", name="Measure and compare").click()
    page.locator("#own-bundle").wait_for()
    page.wait_for_function(
        "() => document.querySelector('#own-player .stage')?.dataset.bodies === '1'"
    )
    canvas = canvas_of(page, "#own-player")
    video = made(page, tmp_path, "own-")
    assert away(canvas, video, page, "#own-player") < 10
    page.context.close()


def test_what_is_refused_is_told_under_the_stage(
    browser: Browser, fake_address: str, stage: Stage, speech: Path
) -> None:
    page = opened(browser, fake_address, stage, speech)
    page.evaluate(
        """() => {
            const root = document.querySelector('.lockstep');
            const told = JSON.parse(root.seen());
            told.camera[2] = 99;
            root.seen = () => JSON.stringify(told);
        }"""
    )
    page.locator("#player .controls .more").click()
    page.locator("#player .more-box").get_by_role("button", name="Make a video of this").click()
    expect(page.locator("#seen")).to_contain_text("zoom is 0.4 to 10; got 99")
    page.context.close()


MOVED = """async ([states, camera, around]) => {
    const { Orbit } = await import(new URL('web/body/orbit.js', document.baseURI));
    const back = [2, 6, 10].map((i) => camera[i]);
    const distance = back.reduce((sum, part, k) => sum + part * (camera[4 * k + 3] - around[k]), 0);
    return states.map((state) => {
        const orbit = new Orbit();
        orbit.place(state);
        return orbit.from(camera, distance);
    });
}"""


RANGES = """async () => {
    const { DISPLAYS } = await import(new URL('web/stage/look.js', document.baseURI));
    const ranged = Object.entries(DISPLAYS).filter(([, { range }]) => range);
    return Object.fromEntries(ranged.map(([name, { range }]) => [name, range]));
}"""


def test_limits_and_cameras_are_those_of_the_stage(browser: Browser, fake_address: str) -> None:
    page = open_page(browser, fake_address)
    ranges = page.evaluate(RANGES)
    told = display.TOLD.values()
    assert ranges == {each.name: list(each.limits) for each in told if each.limits}
    rng = np.random.default_rng(0)
    states = rng.uniform([-4, -1.4, 0.4, -1, -1], [4, 1.4, 10, 1, 1], (40, 5))
    right, up, back = view_axes("front")
    eye, around = np.array([0.2, 1.5, 4.5]), np.array([0.1, 1.0, 0.3])
    rows = np.column_stack([right, up, back, eye])
    before = [rows.ravel().tolist(), around.tolist()]
    found = np.array(page.evaluate(MOVED, [states.tolist(), *before]))
    camera = Camera(tuple(eye), tuple(eye - back))
    points = rng.uniform(-0.5, 0.5, (30, 3)) + around
    for state, flat in zip(states, found.reshape(-1, 3, 4), strict=True):
        moved = Orbit(*state).moved(camera, around)
        assert moved.eye == pytest.approx(flat[:, 3], abs=1e-9)
        assert np.allclose(moved.axes(), flat[:, :3].T, atol=1e-9)
        theirs = Camera(tuple(flat[:, 3]), tuple(flat[:, 3] - flat[:, 2]))
        pixels = [each.project(points, 640, 480) for each in (moved, theirs)]
        assert np.allclose(*pixels, atol=1e-4, equal_nan=True), "a known point, in both pictures"
    farthest = page.evaluate(MOVED, [[[0, 9, 99, 9, -9]], *before])
    edge = Orbit(0.0, STEEPEST_RAD, ZOOMS[1], FARTHEST_M, -FARTHEST_M).moved(camera, around)
    assert edge.eye == pytest.approx(np.reshape(farthest, (3, 4))[:, 3]), "the same limits"
    page.context.close()


def test_the_page_tells_what_the_server_reads(
    browser: Browser, fake_address: str, stage: Stage, speech: Path
) -> None:
    page = opened(browser, fake_address, stage, speech)
    page.evaluate(
        """() => {
            const { look, stage } = document.querySelector('.lockstep');
            look.set('trailFrames', 12); stage.setCloseUp('face'); stage.setMode('wipe');
        }"""
    )
    asked = Asked.of(page.evaluate("document.querySelector('.lockstep').seen()"))
    asked.seen.check(3)
    assert asked.seen.mode == "wipe" and asked.seen.display.trail_frames == 12
    assert [[panel.view for panel in each] for each in asked.seen.panels] == 2 * [["body", "face"]]
    assert asked.labels == ("local", "global", "full")
    page.context.close()
