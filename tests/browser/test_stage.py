"""All that is switched, read and found on one run of three systems: stage and time line."""

import base64
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from app import text
from app.page.tabs import live, own_motion
from app.run import display
from app.run.bodies import body_motion
from app.run.display import ViewerState
from app.run.frame_packets import frames_message
from model.motion.motion import Motion
from model.motion.transforms import exaggerate_tremor, smooth_motion
from renderer.body.body import load_body
from renderer.draw.probe import choose_backend
from renderer.scene.camera import (
    MAX_PAN_M,
    MAX_PITCH_RAD,
    ZOOM_RANGE,
    Camera,
    Orbit,
    fit_camera,
    view_axes,
)
from renderer.scene.camera_setup import make_camera_setup
from renderer.video.render import RenderSettings
from tests.browser.conftest import (
    BUILDS_ARE_THERE,
    FRAMES,
    LOCKSTEP,
    LOOKS,
    STAGE,
    Fake,
    bar_of,
    expect_fit,
    findings,
    opened,
    press,
    put_clock,
    saved,
    stage_digest,
    staged,
    start,
    tabbed,
    turn_to,
    turn_to_part,
    watched,
)
from tests.helpers import smooth_motion_example
from tests.renderer.drawn import render_stills

pytestmark = pytest.mark.browser

SYSTEMS = ("globaldiff/local", "globaldiff/global", "globaldiff/full")
LABELS = [name.rsplit("/")[-1] for name in SYSTEMS]
"""What the page calls them."""
SIZE_PX = 256
LOOK = "document.querySelector('.lockstep').look"
MODULES = """async (names) => {
    const found = await Promise.all(names.map((name) => {
        return import(new URL(`web/${name}.js`, document.baseURI));
    }));
    window.modules = Object.assign({}, ...found);
    window.facts = await (await fetch('stage/facts.json')).json();
    window.bytesOf = (text) => Uint8Array.from(atob(text), (each) => each.charCodeAt(0)).buffer;
}"""
USED = (
    *("stage/motion", "stage/mesh", "stage/displays", "stage/filters", "stage/framing"),
    *("stage/packing", "stage/look", "stage/painter", "body/orbit"),
)


@pytest.fixture(scope="module")
def done(browser: Browser, the_fake: Fake, fake_address: str, speech: Path) -> Iterator[Page]:
    """A run of three systems, of which the first performed a plan, that has ended."""
    the_fake.usual()
    context = browser.new_context(
        viewport={"width": 1280, "height": 900},
        reduced_motion="reduce",
    )
    page = opened(context, fake_address)
    start(page, speech)
    staged(page, 3).locator("#player .tier-lane .event").first.wait_for()
    expect(page.locator("#status")).to_contain_text(text.VIDEOS_DONE)
    page.evaluate(MODULES, USED)
    page.wait_for_function(BUILDS_ARE_THERE)
    yield page
    context.close()


@pytest.fixture
def page(done: Page) -> Page:
    """The shared page, at rest on its first frame with nothing switched."""
    turn_to(done, (1280, 900, "light"))
    done.evaluate(
        """() => {
            const { lockstep, look, stage } = document.querySelector('.lockstep');
            lockstep.pause(); lockstep.setLoop(null); lockstep.setRate(1); lockstep.seekFrame(0);
            look.reset(); stage.orbit.reset(); stage.setMode('grid'); stage.setCloseUp('hands');
            document.activeElement.blur();
        }"""
    )
    return done


def state(page: Page, *names: str) -> list[Any]:
    """Of the player's clock."""
    return page.evaluate(f"names => names.map((name) => {LOCKSTEP}[name])", list(names))


# ---------------------------------------------------------------- the stage


def test_displays_are_switched_at_once_and_nothing_is_asked_of_the_server(page: Page) -> None:
    asked: list[str] = []

    def note(request: Any) -> None:
        if ".wav" not in request.url:  # whose end may still come
            asked.append(request.url)

    page.on("request", note)
    bar, more = bar_of(page), page.locator("#player .more-box")
    seen: list[str] = []

    def look() -> None:
        seen.append(stage_digest(page))

    look()
    press(bar, "Jerk")
    expect(page.locator("#player .stage-legend")).to_contain_text("jerk: 0 to 500 m/s³")
    look()
    press(bar, "Trail")
    bar.get_by_label("Jitter exaggeration factor").fill("1")
    expect(page.locator("#player .stage-notice")).to_have_text("EXAGGERATED x20 above 5 Hz")
    look()
    bar.locator(".more").click()
    more.get_by_label("Whole body").check()
    look()
    for name in ("Skeleton", "Joint axes"):
        more.get_by_label(name).check()
        look()
        more.get_by_label(name).uncheck()
    more.get_by_label("Body shape").select_option("broad")
    look()
    more.get_by_label("Skin tone of the bodies").select_option("dark")
    press(bar, "Jerk")
    look()
    press(bar, "Ghost")
    expect(page.locator("#player .stage .ghost-legend")).to_contain_text("Aligned at the pelvis")
    look()
    press(bar, "Wipe")
    handle = page.locator("#player .stage-wipe")
    handle.press("ArrowRight")
    expect(handle).to_have_attribute("aria-valuenow", "52")
    bar.get_by_label("Close-up", exact=True).select_option("face")
    look()
    page.remove_listener("request", note)
    assert len(set(seen)) == len(seen) == 10, "each of them is another picture"
    assert asked == []

    # What the browser tells of it is what the server reads.
    page.evaluate(f"{LOOK}.set('trailFrames', 12)")
    seen = ViewerState.parse(page.evaluate("document.querySelector('.lockstep').viewState()"))
    assert seen.mode == "wipe" and seen.settings.display.trail_frames == 12
    assert [[panel.view for panel in each] for each in seen.panels] == 2 * [[None, "face"]]
    assert (seen.settings.build, seen.settings.tone, seen.settings.shows_whole_body) == (
        "broad",
        "dark",
        True,
    )
    assert [body.label for body in seen.bodies] == LABELS
    bar.locator(".more").click()


def test_a_link_shows_the_same_moment_side_and_displays(page: Page) -> None:
    filtered = "#player .timeline button[data-filter=savgol]"
    page.locator(filtered).click()
    page.keyboard.press("e")
    page.keyboard.press("j")
    page.evaluate(f"{STAGE}.orbit.turn(0.5, 0.2)")
    put_clock(page, 2.5)
    page.wait_for_url(re.compile(r"#stage&.*t=2\.5"))
    other = watched(page.context.new_page())
    other.set_viewport_size({"width": 390, "height": 844})
    other.goto(page.url)
    staged(other, 3).wait_for_function(f"() => {LOCKSTEP}.frame === 75")
    assert other.evaluate(f"[{LOOK}.get('factor'), {LOOK}.get('hasHeat')]") == [20, True]
    expect(other.locator(filtered)).to_have_attribute("aria-pressed", "true")
    assert other.evaluate(f"{STAGE}.orbit.state") == pytest.approx([0.5, 0.2, 1, 0, 0])

    # A phone shows hands first and the rest when asked.
    right = other.get_by_role("group", name="Right hand")
    right.locator(".stroke").wait_for()
    head = other.get_by_role("group", name="Head and gaze")
    expect(head).to_be_hidden()
    press(other, "All tiers")
    expect(head.locator(".nod")).to_be_visible()
    right.locator(".stroke").click()
    expect(other.locator("#player .why")).to_contain_text("Stroke (offer)")
    expect_fit(other)
    other.close()
    press(page.locator("#player .timeline"), text.AS_GENERATED)


ON_ONE_SCREEN = """() => {
  const rect = (what) => document.querySelector(`#player ${what}`).getBoundingClientRect();
  const view = rect('.stage-view');
  return view.top + scrollY >= 0 && view.height >= 250 && view.width > 1150
    && rect('.controls').height < 60 && rect('.timeline').bottom + scrollY <= innerHeight;
}"""
"""Bodies, one row of controls and all lanes, with nothing scrolled."""


def test_stage_controls_and_time_line_are_on_one_screen(page: Page) -> None:
    page.set_viewport_size({"width": 1280, "height": 800})
    fold = page.locator("#player .fold")
    if fold.get_attribute("aria-expanded") != "false":  # the form makes room
        fold.click()
    rest = page.locator("#player .tiers-head > button:not(.toggle)")
    if rest.get_attribute("aria-expanded") == "true":  # the window was higher before
        rest.click()
    page.wait_for_function(ON_ONE_SCREEN)
    expect(page.get_by_role("button", name=text.GENERATE)).to_be_visible()
    fold.click()
    expect(page.locator("#speech")).to_be_visible()


def test_the_player_can_be_walked_through_by_keyboard(page: Page) -> None:
    """Tab goes through every control once and on; each does its work from the keyboard."""
    bar = bar_of(page)
    bar.get_by_role("button", name="Play", exact=True).focus()
    walked = ["Play"]
    while page.evaluate("() => Boolean(document.activeElement.closest('#player .controls'))"):
        walked.append(tabbed(page))
        assert len(walked) < 40
    wanted = ["Play", "One frame back", "One frame forward", "Speed", "Loop", "Sound off"]
    wanted += [
        "Highest-jerk second",
        "Jitter exaggeration factor",
        "\N{MULTIPLICATION SIGN}1",
        "Trail",
    ]
    wanted += ["Jerk", "Close-up", "All", "Wipe", "Flicker", "Ghost", "More displays and views"]
    assert walked[:-1] == [*wanted, "Keys"]
    keys = bar.locator(".keys")
    keys.locator("summary").press("Enter")
    expect(keys.get_by_text("jerk colours")).to_be_visible()
    page.keyboard.press("Escape")
    expect(keys.get_by_text("jerk colours")).to_be_hidden()

    page.get_by_role("button", name="Enlarge global", exact=True).press("Enter")
    alone = page.get_by_role("button", name="Show all again", exact=True)
    expect(alone).to_be_focused()  # though names are laid out anew
    alone.press("Enter")
    for name in ("One frame forward", "Ghost"):
        bar.get_by_role("button", name=name, exact=True).focus()
        page.keyboard.press("Enter")
    expect(bar.locator(".time")).to_have_attribute("title", "Frame 1")
    expect(page.locator("#player .stage")).to_have_attribute("data-mode", "ghost")


# ---------------------------------------------------------------- the time line


SHOWN = """() => {
    const lanes = document.querySelector('#player .lanes');
    const share = Number(getComputedStyle(lanes).getPropertyValue('--at'));
    return document.querySelector('#player .cursor').hidden ? null : share;
}"""
"""Where the present moment stands on the time line."""


def test_clicks_keys_and_the_wheel_lead_through_time(page: Page) -> None:
    for lane, share in (("globaldiff/global", 0.5), ("globaldiff/local", 0.81)):
        plot = page.locator(f'.lane[data-name="{lane}"] .plot')
        box = plot.bounding_box()
        assert box is not None
        plot.click(position={"x": box["width"] * share, "y": 10})
        assert abs(state(page, "frame")[0] - share * FRAMES) <= 1
        assert page.evaluate(SHOWN) == pytest.approx(share, abs=1 / FRAMES)

    page.keyboard.press("Home")
    for key, frame in ((".", 1), (".", 2), (",", 1), ("ArrowRight", 31), ("ArrowLeft", 1)):
        page.keyboard.press(key)
        assert state(page, "frame") == [frame], key
    page.keyboard.press("End")
    assert state(page, "frame") == [FRAMES - 1]
    page.keyboard.press("l")
    assert state(page, "loop") == [[1, 3]]
    page.keyboard.press("Space")
    page.wait_for_function(f"() => {LOCKSTEP}.isPlaying && {LOCKSTEP}.time < 2.5")
    page.keyboard.press("Space")
    assert state(page, "isPlaying") == [False]
    page.keyboard.press("l")

    zoom = page.get_by_role("group", name="Timeline zoom")
    whole = zoom.get_by_role("button", name="Show the whole clip")
    put_clock(page, 1.5)  # of 3
    expect(whole).to_be_disabled()
    press(zoom, "Zoom in")
    assert page.evaluate(SHOWN) == pytest.approx(0.5, abs=0.02)  # it stays where it was
    put_clock(page, 1.875)  # an eighth of the clip on, of 3 / 1.6 s that are shown
    assert page.evaluate(SHOWN) == pytest.approx(0.5 + 0.375 / 1.875, abs=0.02)
    put_clock(page, 0.0)  # the page turns
    assert page.evaluate(SHOWN) == pytest.approx(0.0, abs=0.02)
    page.keyboard.press("0")
    expect(whole).to_be_disabled()
    plot = page.locator("#player .lane .plot").first
    box = plot.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] - 1, box["y"] + 5)
    page.keyboard.down("Control")
    page.mouse.wheel(0, -300)
    page.keyboard.up("Control")
    expect(whole).to_be_enabled()
    page.wait_for_function(f"() => ({SHOWN})() === null")  # 0 s is not among the last ones
    page.mouse.click(box["x"] + 1, box["y"] + 5)
    assert state(page, "time")[0] > 1.5
    page.keyboard.press("0")
    assert page.evaluate(SHOWN) > 0.5
    press(zoom, "Zoom in")
    later = zoom.get_by_role("button", name="Later")
    later.press("Enter")
    expect(later).to_be_disabled()
    expect(later).to_be_focused()  # at the end, too
    page.keyboard.press("0")


def test_tiers_are_read_lit_chosen_by_mouse_and_keys_and_found_where_none_was_planned(
    page: Page,
) -> None:
    bodies = page.get_by_label("Motion whose tiers are shown")
    expect(bodies.locator("option")).to_have_text(["No gestures", *LABELS])
    bodies.select_option(SYSTEMS[0])
    right = page.get_by_role("group", name="Right hand")
    expect(right.locator(".event")).to_have_count(6)
    expect(right.locator(".stroke")).to_have_text("offer")
    put_clock(page, 1.5)
    expect(right.locator(".now")).to_have_class(re.compile(r"\bhold\b"))
    right.locator(".stroke").click()
    why = page.locator("#player .why")
    expect(why).to_have_text(
        "Stroke (offer) of the right hand on the word “never”; 1.00 to 1.30 s, planned."
    )
    page.wait_for_function(f"() => Math.abs({LOCKSTEP}.time - 1) < 0.05")
    expect(right.locator(".now")).to_have_class(re.compile(r"\bstroke\b"))

    right.locator(".stroke").focus()
    page.keyboard.press("ArrowRight")
    expect(right.locator(".hold")).to_be_focused()
    assert state(page, "time")[0] <= 1.05, "arrows go from event to event here, not through time"
    page.keyboard.press("Enter")
    expect(why).to_contain_text("Hold of the right hand after: stroke (offer)")
    expect(right.locator(".hold")).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("ArrowUp")
    expect(page.get_by_role("group", name="Left hand").locator(".event")).to_be_focused()

    page.locator('#player .lane[data-name="globaldiff/global"] .name').click()
    expect(bodies).to_have_value("globaldiff/global")
    lanes = page.locator("#player .tier-lane:visible")
    expect(lanes.first).to_have_attribute("data-origin", "detected")
    expect(why).to_have_text("")
    bodies.select_option(SYSTEMS[0])
    expect(lanes.first).to_have_attribute("data-origin", "planned")


def test_the_worst_second_is_played_slowly_again_and_again(page: Page) -> None:
    bar, line = bar_of(page), page.locator("#player .worst-line")
    worst = bar.get_by_role("button", name="Highest-jerk second", exact=True)
    before = bar.bounding_box()
    worst.click()
    expect(worst).to_have_attribute("aria-pressed", "true")
    assert bar.bounding_box() == before
    rate, first = state(page, "rate", "loop")
    assert rate == 0.25 and first[1] - first[0] == pytest.approx(1.0)
    expect(line).to_contain_text(re.compile(r"1 of \d: (local|global|full),"))
    page.wait_for_function(
        """([start, end]) => {
            const { isPlaying, time } = document.querySelector('#player .lockstep').lockstep;
            return isPlaying && time > start && time < end;
        }""",
        arg=first,
    )
    press(page, "Next (less jerk)")
    expect(line).to_contain_text(re.compile(r"2 of \d"))
    assert abs(state(page, "loop")[0][0] - first[0]) >= 1.0
    press(page, "Previous (more jerk)")
    assert state(page, "loop") == [first]
    page.keyboard.press("l")  # another loop is another matter
    expect(worst).to_have_attribute("aria-pressed", "false")
    page.keyboard.press("w")
    page.keyboard.press("w")
    assert state(page, "loop", "rate") == [None, 1]


# ---------------------------------------------------------------- numbers and what others find


def test_measures_are_filtered_and_saved_and_a_figure_opens_large(
    page: Page, tmp_path: Path
) -> None:
    jerk = page.locator('#numbers tr[data-measure="tracked_point_jerk_m_s3"]')
    expect(jerk.locator("td .raw").first).to_have_text("110")
    press(page.locator("#player .timeline"), text.FILTERED)  # one switch for plots and measures
    turn_to_part(page, "Numbers")
    expect(jerk.locator("td .savgol").first).to_be_visible()
    expect(jerk.locator("td .raw").first).to_be_hidden()
    press(page.locator("#numbers"), text.AS_GENERATED)
    expect(jerk.locator("td .raw").first).to_be_visible()
    button = page.locator("#player .timeline button[data-filter=raw]")
    expect(button).to_have_attribute("aria-pressed", "true")

    term, told = page.locator("#numbers abbr").first, page.locator(".help-bubble")
    for tell in (term.click, lambda: term.press("Enter")):
        tell()
        expect(told).to_have_text(term.get_attribute("title") or "")
        page.keyboard.press("Escape")
        expect(told).to_be_hidden()

    heads = page.locator("#numbers thead th[data-name]")
    expect(heads).to_have_text(LABELS)
    csv = page.get_by_role("link", name=text.CSV_LABEL)
    lines = saved(page, csv, tmp_path).read_text("utf-8").splitlines()
    jerk_of_global = "tracked_point_jerk_m_s3,m/s³,globaldiff/global,raw,120.0,"
    assert any(line.startswith(jerk_of_global) for line in lines)

    with page.context.expect_page() as large:
        turn_to_part(page, "Figures")
        page.locator("#figures .zoom").first.click()
    large.value.wait_for_function("() => document.images[0]?.naturalWidth === 160")
    large.value.close()
    page.go_back()  # within the page
    pressed = page.locator("#player .parts-bar [aria-pressed=true]")
    expect(pressed).to_have_text("Numbers")
    turn_to_part(page, "Watch")


TABS = (live.TAB, own_motion.TAB, text.LADDER_TAB, text.STUDY_TAB, text.MOTION_TAB)


@pytest.mark.parametrize(
    "look",
    [pytest.param(look, marks=() if look == LOOKS[3] else pytest.mark.slow) for look in LOOKS],
    ids=str,
)
def test_no_tab_has_a_grave_finding(page: Page, look: tuple) -> None:
    turn_to(page, look)
    found = {}
    for tab in TABS if look != LOOKS[3] else TABS[-2:]:
        page.get_by_role("tab", name=tab, exact=True).click()
        expect_fit(page)
        found[tab] = findings(page)
    assert not any(found.values()), found


# ---------------------------------------------------------------- the numbers behind the stage


def told(motion: Motion) -> str:
    return base64.b64encode(frames_message(0, motion)).decode("ascii")


DISPLAYED = """async ([text, factor, cutoff, isSmoothed]) => {
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


def test_motion_is_displayed_as_videos_have_it(page: Page) -> None:
    body = load_body()

    def joints(motion: Motion) -> np.ndarray:
        return body.joint_positions(replace(body_motion(motion), betas=np.zeros(10)))

    motion = smooth_motion_example(40)
    noise = np.random.default_rng(0).normal(0, 0.01, motion.poses.shape).astype(np.float32)
    motion = replace(motion, poses=motion.poses + noise)
    for factor, is_smoothed in ((1, False), (1, True), (5, False), (20, False), (20, True)):
        base = smooth_motion(motion) if is_smoothed else motion
        wanted = joints(exaggerate_tremor(base, factor))
        found = np.array(page.evaluate(DISPLAYED, [told(motion), factor, 5, is_smoothed]))
        away_m = np.abs(found.reshape(wanted.shape) - wanted).max()
        assert away_m < (0.002 if factor == 1 else 0.01), (factor, is_smoothed)
        if factor > 1:
            assert np.abs(wanted - joints(base)).max() > 0.03, "there is something to be seen"


MOVED = """([states, camera, around]) => states.map((state) => {
    const orbit = new modules.Orbit();
    orbit.place(state);
    return orbit.from(camera, around);
})"""
RANGES = """() => Object.fromEntries(Object.entries(modules.DISPLAYS)
    .filter(([, { range }]) => range).map(([name, { range }]) => [name, range]))"""


def test_limits_and_cameras_are_those_of_videos(page: Page) -> None:
    told = display.ViewerSettings.model_fields
    limits = {told[name].alias: [*limits[:2]] for name, limits in display.DISPLAY_LIMITS.items()}
    assert page.evaluate(RANGES) == limits
    rng = np.random.default_rng(1)
    points, radii = rng.normal(size=(40, 3)), rng.uniform(0, 0.2, 40)
    for view in ("front", "side", "left_hand"):
        eye = page.evaluate(
            """([points, radii, view, aspect]) => modules.framePoints(
                points, radii, facts.views[view], aspect, facts.camera)""",
            [points.ravel().tolist(), radii.tolist(), view, 0.7],
        )
        camera = fit_camera(points, view, aspect=0.7, radius_m=radii)
        assert eye == pytest.approx(camera.eye, abs=1e-9)
        assert page.evaluate("view => facts.views[view]", view) == view_axes(view).tolist()

    states = rng.uniform([-4, -1.4, 0.4, -1, -1], [4, 1.4, 10, 1, 1], (40, 5))
    axes = view_axes("front")
    eye, around = np.array([0.2, 1.5, 4.5]), np.array([0.1, 1.0, 0.3])
    before = [{"axes": axes.tolist(), "eye": eye.tolist()}, around.tolist()]
    found = page.evaluate(MOVED, [states.tolist(), *before])
    camera = Camera(tuple(eye), tuple(eye - axes[2]))
    for orbit, seen in zip(states, found, strict=True):
        moved = Orbit(*orbit).apply(camera, around)
        assert moved.eye == pytest.approx(seen["eye"], abs=1e-9)
        assert np.allclose(moved.axes(), seen["axes"], atol=1e-9)
    (farthest,) = page.evaluate(MOVED, [[[0, 9, 99, 9, -9]], *before])
    edge = Orbit(0.0, MAX_PITCH_RAD, ZOOM_RANGE[1], MAX_PAN_M, -MAX_PAN_M).apply(camera, around)
    assert edge.eye == pytest.approx(farthest["eye"]), "the same limits"


PICTURE = """async ([text, eye, size, isSlow, ground]) => {
    const mesh = await modules.theBody();
    const motion = modules.unpacked(bytesOf(text));
    const canvas = Object.assign(document.createElement('canvas'), { width: size, height: size });
    const gl = canvas.getContext('webgl2', { alpha: false, antialias: true });
    const painter = new modules.Painter(gl, mesh, facts, isSlow);
    painter.setBodies(1);
    const shown = new modules.Shown(motion, mesh, 1);
    const world = shown.world(0, { factor: 1, cutoff: 5, isSmoothed: false });
    painter.pose(0, world, null, shown.faces(0), [0, 2]);
    painter.upload();
    painter.clear();
    painter.castShadow(0, isSlow ? 2 : 0, ground);
    const matrix = modules.lens({ axes: facts.views.front, eye }, 1, facts.camera);
    const told = { matrix, eye, number: 0, faces: mesh.level(0), isWhole: true, ground };
    painter.panel([0, 0, size, size], told);
    const pixels = new Uint8Array(4 * size * size);
    gl.readPixels(0, 0, size, size, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    return Array.from(pixels);
}"""


@pytest.mark.slow  # a picture in a video is held against the stage's in test_own.py
@pytest.mark.gl
def test_pictures_look_as_those_of_videos(page: Page) -> None:
    """Those of a card, and those that a processor draws."""
    motion = smooth_motion_example(1)
    expressions = motion.expressions.copy()
    expressions[:, load_body().expression_names.index("jawOpen")] = 1.0
    motion = replace(motion, expressions=expressions, expression_basis="arkit52")
    body, moved = load_body(), body_motion(motion)
    scene = make_camera_setup(body, [moved])
    settings = RenderSettings(SIZE_PX, SIZE_PX, backend=choose_backend())
    wanted = render_stills(body, moved, [0], settings, stage=scene)[0].astype(int)
    assert wanted.std() > 30
    half = 2.0 + scene.horizontal_span_m / 2
    ground = {"centre": scene.centre_xz, "floor": scene.floor_m, "halfSize": half}
    for is_slow in (False, True):
        arguments = [told(motion), list(scene.camera.eye), SIZE_PX, is_slow, ground]
        pixels = np.array(page.evaluate(PICTURE, arguments)).reshape(SIZE_PX, SIZE_PX, 4)
        away = np.abs(pixels[::-1, :, :3] - wanted).mean(axis=-1)
        assert away.mean() < 2.5, "grey levels of 255: body, clothes, light and shadow"
        assert np.quantile(away, 0.99) < (40 if is_slow else 30), "but for edges"
