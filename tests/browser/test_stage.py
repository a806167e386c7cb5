"""The stage: bodies that the browser draws, in a real Chromium over a pipeline of made motion."""

import base64
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from app import text
from app.run.body_motion import body_motion
from app.run.pieces import frames_message
from model.motion.altered import exaggerate
from model.motion.filtering import smooth_motion
from model.motion.motion import Motion
from renderer.body.body import load_body
from renderer.draw.probe import choose_backend
from renderer.scene.camera import frame_points, view_axes
from renderer.scene.stage import set_stage
from renderer.video.render import render_stills
from renderer.video.settings import RenderSettings
from tests.browser.conftest import (
    BUILDS_ARE_THERE,
    PATIENCE_MS,
    STAGED,
    Stage,
    open_page,
    start,
)
from tests.helpers import smooth_motion_example

pytestmark = pytest.mark.browser

SIZE_PX = 256
LOOK = "document.querySelector('.lockstep').look"
MODULES = """async (names) => {
    const found = await Promise.all(names.map((name) => {
        return import(new URL(`web/stage/${name}.js`, document.baseURI));
    }));
    window.modules = Object.assign({}, ...found);
    window.facts = await (await fetch('stage/facts.json')).json();
    window.bytesOf = (text) => Uint8Array.from(atob(text), (each) => each.charCodeAt(0)).buffer;
}"""


@pytest.fixture(scope="module")
def done(browser: Browser, fake_address: str, stage: Stage, speech: Path) -> Iterator[Page]:
    """A run of three systems that has ended; tests share it."""
    stage.hold(12)
    page = open_page(browser, fake_address)
    start(page, speech)
    page.locator("#bundle").wait_for()
    page.locator("#player .lane canvas").first.wait_for()
    page.wait_for_function(STAGED, arg=3)
    page.evaluate("document.querySelector('.lockstep').lockstep.pause()")
    page.evaluate(MODULES, ["motion", "mesh", "displays", "filters", "framing", "packing"])
    yield page
    page.context.close()


@pytest.fixture
def staged(done: Page) -> Page:
    """The shared page, at rest on its first frame with nothing switched."""
    done.evaluate(
        """() => {
            const { lockstep, look, stage } = document.querySelector('.lockstep');
            lockstep.pause(); lockstep.setLoop(null); lockstep.setRate(1); lockstep.seekFrame(0);
            look.reset(); stage.orbit.reset(); stage.setMode('grid'); stage.setCloseUp('hands');
        }"""
    )
    return done


def drawn(page: Page) -> bytes:
    """The stage, once it has been drawn in full."""
    page.wait_for_timeout(800)
    return page.locator("#player .stage canvas").screenshot()


def test_bodies_move_with_the_sound_before_there_is_any_video(
    browser: Browser, fake_address: str, stage: Stage, speech: Path
) -> None:
    stage.hold(0)
    page = open_page(browser, f"{fake_address}#stage&x=4&t=1")  # left behind by a run before
    start(page, speech)
    page.wait_for_function(STAGED, arg=3)
    page.wait_for_function("() => document.querySelector('.lockstep').lockstep.time > 0.3")
    assert page.evaluate(f"{LOOK}.get('factor')") == 4
    page.wait_for_function("() => document.querySelector('.lockstep')?.stage?.pictures > 3")
    assert not page.evaluate("document.querySelector('#player audio').paused")
    expect(page.locator("#player video")).to_have_count(0)
    page.locator("#bundle").wait_for()  # measures, figures and downloads are there as well
    expect(page.locator("#numbers thead th[data-name]")).to_have_count(3)
    stage.hold(12)
    expect(page.locator("#status")).to_contain_text(text.VIDEOS_DONE, timeout=PATIENCE_MS)
    expect(page.locator("#player .stage-tag a[download$='.mp4']")).to_have_count(3)
    page.locator("#files-fold button").first.click()
    expect(page.locator("#files")).to_contain_text("comparison")
    page.context.close()


def test_displays_are_switched_at_once_and_nothing_is_asked_of_the_server(staged: Page) -> None:
    asked: list[str] = []
    staged.wait_for_function(BUILDS_ARE_THERE)
    staged.on("request", lambda request: asked.append(request.url))
    bar = staged.locator("#player .controls")
    seen = [drawn(staged)]
    bar.get_by_role("button", name="Jerk", exact=True).click()
    expect(staged.locator("#player .stage-legend")).to_contain_text("jerk: 0 to 500 m/s³")
    seen.append(drawn(staged))
    bar.get_by_role("button", name="Trail", exact=True).click()
    bar.get_by_label("Tremble, times as large").fill("1")
    expect(staged.locator("#player .stage-notice")).to_have_text("EXAGGERATED x20: all above 5 Hz")
    seen.append(drawn(staged))
    bar.locator(".more").click()
    more = staged.locator("#player .more-box")
    more.get_by_label("Whole body").check()
    seen.append(drawn(staged))
    for name in ("Skeleton", "Axes of joints"):
        more.get_by_label(name).check()
        seen.append(drawn(staged))
        more.get_by_label(name).uncheck()
    more.get_by_label("Build of the bodies").select_option("broad")
    seen.append(drawn(staged))
    more.get_by_label("Tone of the bodies").select_option("dark")
    bar.get_by_role("button", name="Jerk", exact=True).click()
    seen.append(drawn(staged))
    bar.get_by_role("button", name="Ghost", exact=True).click()
    expect(staged.locator("#player .stage .ghost-legend")).to_contain_text("pelvis on pelvis")
    seen.append(drawn(staged))
    bar.get_by_role("button", name="Wipe", exact=True).click()
    handle = staged.locator("#player .stage-wipe")
    handle.focus()
    handle.press("ArrowRight")
    expect(handle).to_have_attribute("aria-valuenow", "52")
    bar.get_by_label("Close-up", exact=True).select_option("face")
    seen.append(drawn(staged))
    assert len(set(seen)) == len(seen), "each of them is another picture"
    assert asked == []
    bar.locator(".more").click()


def test_a_link_shows_the_same_moment_side_and_displays(staged: Page, browser: Browser) -> None:
    switch = "#player .timeline button[data-filter=savgol]"
    staged.locator(switch).click()
    staged.evaluate("document.activeElement.blur()")  # a list of choices keeps its keys
    staged.keyboard.press("e")
    staged.keyboard.press("j")
    staged.evaluate(
        """() => {
            const { lockstep, stage } = document.querySelector('.lockstep');
            stage.orbit.turn(0.5, 0.2);
            lockstep.seek(2.5);
        }"""
    )
    staged.wait_for_url(re.compile(r"#stage&.*t=2\.5"))
    link = staged.locator("#runs .link a").evaluate("link => link.href")
    other = browser.new_context(viewport={"width": 1280, "height": 900}).new_page()
    other.set_default_timeout(PATIENCE_MS)
    other.goto(link + staged.evaluate("location.hash"))
    other.wait_for_function(STAGED, arg=3)
    other.wait_for_function("() => document.querySelector('.lockstep').lockstep.frame === 75")
    assert other.evaluate(f"[{LOOK}.get('factor'), {LOOK}.get('hasHeat')]") == [20, True]
    expect(other.locator(switch)).to_have_attribute("aria-pressed", "true")
    camera = "document.querySelector('.lockstep').stage.orbit.state"
    assert other.evaluate(camera) == pytest.approx([0.5, 0.2, 1, 0, 0])
    other.context.close()


ON_ONE_SCREEN = """() => {
  const rect = (what) => document.querySelector(`#player ${what}`).getBoundingClientRect();
  const view = rect('.stage-view');
  return view.top + scrollY >= 0 && view.height >= 330 && view.width > 1150
    && rect('.controls').height < 60 && rect('.timeline').bottom + scrollY <= innerHeight;
}"""
"""Bodies, one row of controls and all lanes, with nothing scrolled."""


def test_stage_controls_and_time_line_are_on_one_screen(staged: Page) -> None:
    staged.set_viewport_size({"width": 1280, "height": 800})
    staged.locator("#player .fold").click()  # the form makes room
    rest = staged.locator("#player .tiers-head > button")
    if rest.get_attribute("aria-expanded") == "true":  # the window was higher before
        rest.click()
    staged.wait_for_function(ON_ONE_SCREEN)
    expect(staged.get_by_role("button", name="Generate motion")).to_be_visible()
    staged.locator("#player .fold").click()
    expect(staged.locator("#speech")).to_be_visible()
    staged.set_viewport_size({"width": 1280, "height": 900})


def test_a_phone_shows_one_body_after_the_other(staged: Page) -> None:
    staged.set_viewport_size({"width": 390, "height": 844})
    names = staged.locator("#player .stage-tag header b")
    expect(names).to_have_text(["local"])
    staged.evaluate("document.querySelector('.lockstep').stage.showNext(1)")
    expect(names).to_have_text(["global"])
    bar = staged.locator("#player .controls").bounding_box()
    assert bar is not None and bar["height"] <= 64
    assert staged.evaluate("document.documentElement.scrollWidth") <= 390
    staged.set_viewport_size({"width": 1280, "height": 900})


def test_without_webgl_there_are_videos_and_a_sentence(
    browser: Browser, fake_address: str, stage: Stage, speech: Path
) -> None:
    stage.hold(12)
    context = browser.new_context()
    context.add_init_script(
        """const getContext = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
            return kind === 'webgl2' ? null : getContext.call(this, kind, ...rest);
        };"""
    )
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(fake_address)
    start(page, speech)
    page.locator("#bundle").wait_for()
    expect(page.locator("#player video")).to_have_count(3, timeout=PATIENCE_MS)
    expect(page.locator("#player .no-stage")).to_contain_text("draws no 3D graphics")
    context.close()


# ---------------------------------------------------------------- the numbers behind it


def told(motion: Motion) -> str:
    return base64.b64encode(frames_message(0, motion)).decode("ascii")


def trembling(num_frames: int = 40) -> Motion:
    motion = smooth_motion_example(num_frames)
    noise = np.random.default_rng(0).normal(0, 0.01, motion.poses.shape).astype(np.float32)
    return replace(motion, poses=motion.poses + noise)


SHOWN = """async ([text, factor, cutoff, isSmoothed]) => {
    const mesh = await modules.theBody();
    const motion = modules.unpacked(bytesOf(text));
    const shown = new modules.Shown(motion, mesh, facts.exaggeration.max_turn);
    const found = [];
    for (let frame = 0; frame < motion.length; frame++) {
        const world = shown.world(frame, { factor, cutoff, isSmoothed });
        for (let at = 0; at < 12 * 55; at += 12) {
            found.push(world[at + 3], world[at + 7], world[at + 11]);
        }
    }
    return found;
}"""


def joints(motion: Motion) -> np.ndarray:
    return load_body().joint_positions(replace(body_motion(motion), betas=np.zeros(10)))


@pytest.mark.parametrize(
    ("factor", "is_smoothed"), [(1, False), (1, True), (5, False), (20, False), (20, True)]
)
def test_motion_is_displayed_as_videos_have_it(done: Page, factor: int, is_smoothed: bool) -> None:
    motion = trembling()
    base = smooth_motion(motion) if is_smoothed else motion
    wanted = joints(exaggerate(base, factor))
    found = np.array(done.evaluate(SHOWN, [told(motion), factor, 5, is_smoothed]))
    away_m = np.abs(found.reshape(wanted.shape) - wanted).max()
    assert away_m < (0.002 if factor == 1 else 0.01)
    if factor > 1:
        assert np.abs(wanted - joints(base)).max() > 0.03, "there is something to be seen"


def test_cameras_stand_where_those_of_videos_do(done: Page) -> None:
    rng = np.random.default_rng(1)
    points, radii = rng.normal(size=(40, 3)), rng.uniform(0, 0.2, 40)
    for view in ("front", "side", "left_hand"):
        eye = done.evaluate(
            """([points, radii, view, aspect]) => modules.framePoints(
                points, radii, facts.views[view], aspect, facts.camera)""",
            [points.ravel().tolist(), radii.tolist(), view, 0.7],
        )
        camera = frame_points(points, view, aspect=0.7, radius_m=radii)
        assert eye == pytest.approx(camera.eye, abs=1e-9)
        assert done.evaluate("view => facts.views[view]", view) == view_axes(view).tolist()


@pytest.mark.parametrize(
    ("count", "size", "columns"),
    [(5, (1210, 510), 5), (12, (1210, 510), 6), (1, (390, 560), 1), (2, (790, 500), 2)],
)
def test_bodies_are_as_large_as_the_room_allows(
    done: Page, count: int, size: tuple[int, int], columns: int
) -> None:
    assert done.evaluate("([n, w, h]) => modules.grid(n, w, h)", [count, *size])["columns"] == (
        columns
    )
    rects = done.evaluate("([n, w, h, c]) => modules.cells(n, w, h, c)", [count, *size, columns])
    assert len(rects) == count
    covered = np.zeros(size, int)
    for left, top, width, height in rects:
        covered[left : left + width, top : top + height] += 1
    assert covered.max() == 1, "none stands on another"
    if count % columns == 0:
        assert covered.min() == 1, "and no room is left"


PICTURE = """async ([text, eye, size, isSlow, ground]) => {
    const { Painter } = await import(new URL('web/stage/painter.js', document.baseURI));
    const mesh = await modules.theBody();
    const motion = modules.unpacked(bytesOf(text));
    const canvas = Object.assign(document.createElement('canvas'), { width: size, height: size });
    const gl = canvas.getContext('webgl2', { alpha: false, antialias: true });
    const painter = new Painter(gl, mesh, facts, isSlow);
    painter.setBodies(1);
    const shown = new modules.Shown(motion, mesh, 1);
    const world = shown.world(0, { factor: 1, cutoff: 5, isSmoothed: false });
    painter.pose(0, world, null, shown.faces(0), [0, 2]);
    painter.upload();
    painter.clear();
    painter.castShadow(0, isSlow ? 2 : 0, ground);
    const matrix = modules.lens({ axes: facts.views.front, eye }, 1, facts.camera);
    const told = { matrix, eye, number: 0, level: 0, part: mesh.level(0), ground };
    painter.panel([0, 0, size, size], told);
    const pixels = new Uint8Array(4 * size * size);
    gl.readPixels(0, 0, size, size, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    return Array.from(pixels);
}"""


@pytest.mark.gl
@pytest.mark.parametrize("is_slow", [False, True], ids=["on the card", "by the processor"])
def test_pictures_look_as_those_of_videos(done: Page, is_slow: bool) -> None:
    motion = smooth_motion_example(1)
    expressions = motion.expressions.copy()
    expressions[:, load_body().expression_names.index("jawOpen")] = 1.0
    motion = replace(motion, expressions=expressions, expression_basis="arkit52")
    body, moved = load_body(), body_motion(motion)
    stage = set_stage(body, [moved])
    settings = RenderSettings(SIZE_PX, SIZE_PX, backend=choose_backend())
    wanted = render_stills(body, moved, [0], settings, stage=stage)[0].astype(int)
    ground = {
        "centre": stage.centre_xz,
        "floor": stage.floor_m,
        "halfSize": 2.0 + stage.extent_m / 2,
    }
    arguments = [told(motion), list(stage.camera.eye), SIZE_PX, is_slow, ground]
    pixels = np.array(done.evaluate(PICTURE, arguments)).reshape(SIZE_PX, SIZE_PX, 4)
    found = pixels[::-1, :, :3]
    away = np.abs(found - wanted).mean(axis=-1)
    assert away.mean() < 2.5, "grey levels of 255: body, clothes, light and shadow"
    assert np.quantile(away, 0.99) < (40 if is_slow else 30), "but for edges"
    assert wanted.std() > 30
