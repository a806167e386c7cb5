"""A visitor's runs, from the example to two beside each other, as a test directs them."""

import re
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Locator, Page, Route, expect

from app import text
from app.config import AppConfig
from app.findings.metric_table import JERK
from app.page.tabs import own_motion
from model.motion.motion import save_motion
from model.plan.annotation_files import Interval, NamedTier, format_textgrid
from model.speech.audio import write_wav
from model.systems.globaldiff.config import PRIORFLOW
from tests.app import fakes
from tests.browser.conftest import (
    FRAMES,
    LOCKSTEP,
    LOOKS,
    SECONDS,
    STAGE,
    Fake,
    Look,
    bar_of,
    expect_fit,
    give,
    give_speech,
    opened,
    press,
    put_clock,
    served,
    staged,
    start,
    tabbed,
    tick,
    turn_to,
    turn_to_part,
    watched,
)
from tests.conftest import MadeOnce
from tests.model.made import TINY_BEST, TINY_SYSTEMS, made_waveform, make_weights

pytestmark = pytest.mark.browser

WAITS = f"() => {LOCKSTEP}.isWaiting"
PLAYS = f"() => {LOCKSTEP}.isPlaying && {LOCKSTEP}.frame > 0"
SOUND = "document.querySelector('#player audio')"
STILL = f"() => !{LOCKSTEP}.isPlaying && !{LOCKSTEP}.isWaiting && !{SOUND}.hasAttribute('src')"
ARGUED = "document.querySelector('#mechanism-player .lockstep')"
ARGUE = f"""() => {ARGUED}?.querySelector('.stage')?.dataset.bodies === '2'
    && {ARGUED}.lockstep.isPlaying && {ARGUED}.lockstep.time > 0.1"""
ENDED = f"() => {LOCKSTEP}.frame === {FRAMES - 1} && !{LOCKSTEP}.isPlaying"


@pytest.fixture(scope="module")
def address(
    the_fake: Fake, made_once: MadeOnce, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[str]:
    """Of a page over `Fake`, with its example."""
    systems = {**TINY_SYSTEMS, PRIORFLOW: TINY_BEST}
    weights = made_once("with-best", lambda folder: make_weights(folder, systems))
    folder = tmp_path_factory.mktemp("walk")
    config = AppConfig(port=0, weights=weights, temp_folder=folder / "page")
    with served(config, preloads_models=True, **the_fake.does) as address:
        yield address


def errors_of(headline: Locator) -> list[float]:
    """The error on local and on global rotations (cm) that the first screen tells."""
    return [float(each) for each in re.findall(r"([\d.]+) cm", headline.inner_text())]


def followed(page: Page, link: str, bodies: int) -> Page:
    """The page of two runs, opened by the link below one."""
    with page.context.expect_page() as both:
        page.locator("#runs").get_by_role("link", name=link, exact=True).click()
    staged(watched(both.value), bodies)
    both.value.locator("#player .lane[data-name] canvas").first.wait_for()
    return both.value


@pytest.mark.parametrize(
    "look",
    [pytest.param(look, marks=() if look == LOOKS[1] else pytest.mark.slow) for look in LOOKS],
    ids=str,
)
def test_a_visitor_walks_from_the_example_to_a_link_and_two_runs_beside_each_other(
    visitor: Callable, fake: Fake, address: str, speech: Path, tmp_path: Path, look: Look
) -> None:
    width, height, scheme = look
    fake.comes_in_windows = True
    fake.windows.let(1)
    fake.videos.let(0)
    fake.figures.clear()
    context = visitor(width, height, scheme, moves=True)
    page = watched(context.new_page())
    page.goto(f"{address}#stage&x=4&t=1")  # left by a run before

    # Two bodies move with equal noise; the sentence says at once what the slider makes of them.
    headline = page.locator("#player .argument-head")
    expect(headline).to_contain_text(re.compile(r"moves the fingertip 2\.\d times as far"))
    page.wait_for_function("() => document.querySelector('#player .lockstep')?.stage?.pictures > 5")
    expect(page.locator("#player .stage-view")).to_be_in_viewport(ratio=0.99)
    assert page.evaluate(f"{LOCKSTEP}.isPlaying && {SOUND}.muted")
    slider = page.get_by_label("Noise on every joint").first
    expect(page.locator("#player .controls")).to_be_in_viewport(ratio=0.99)
    few = errors_of(headline)
    slider.fill("0.06")
    expect(headline).to_contain_text("3.4° about each axis")
    for more, less in zip(errors_of(headline), few, strict=True):
        assert 2.7 < more / less < 3.3, "three times the noise"
    page.evaluate(f"{LOCKSTEP}.pause()")
    page.get_by_role("tab", name=text.MOTION_TAB, exact=True).focus()
    reached = [tabbed(page)]  # by the keyboard alone
    while reached[-1] != text.GENERATE:
        reached.append(tabbed(page))
        assert len(reached) < 60
    assert {"Upload file", "Record audio"} <= {*reached}
    expect(page.locator("ul.options:visible")).to_have_count(0)  # lists that were passed
    page.keyboard.press("Enter")
    expect(page.locator("#message")).to_contain_text(text.NO_SPEECH)
    expect(page.get_by_text(text.NO_SPEECH)).to_have_count(1)  # and by no toast

    # Of speech of one's own the first window, of 52 frames, moves at once, and waits for more.
    tick(page, ["local", "priorflow"])
    page.evaluate("scrollTo(0, document.body.scrollHeight)")
    give_speech(page, speech)
    generate = page.get_by_role("button", name=text.GENERATE)
    generate.click()
    expect(page.locator("#status [role=status]")).to_be_in_viewport()  # where the click began it
    expect(generate).to_be_disabled()
    page.wait_for_function(PLAYS)
    staged(page, 2).evaluate(f"{LOCKSTEP}.seekFrame(30)")
    page.wait_for_function(WAITS)
    assert 45 <= page.evaluate(f"{LOCKSTEP}.frame") < 52
    assert (
        page.evaluate(f"{SOUND}.paused && !{SOUND}.muted")
        and page.evaluate(f"{STAGE}.pictures") > 3
    )
    waiting = page.locator("#player .stage .said", has_text="Waiting for the next window")
    expect(waiting).to_be_visible()
    assert page.evaluate("document.querySelector('.lockstep').look.get('factor')") == 4
    expect(headline).to_be_hidden()

    # Whoever comes meanwhile is told the place in the queue.
    other = watched(context.new_page())
    other.goto(f"{address}?run={'x' * 43}")
    expect(other.locator("#message")).to_contain_text("has expired")
    expect(other.locator("#player .argument-head")).to_contain_text("fingertip")
    give_speech(other, speech)
    other.get_by_role("button", name=text.GENERATE).click()
    expect(other.locator("#status").get_by_text("queue: 1/1")).to_be_visible()
    other.close()

    # A run that is cancelled leaves nothing, and the next one moves.
    press(page, text.CANCEL)
    expect(page.locator("#status")).to_contain_text(text.CANCELLED)
    expect(page.locator("#player .stage")).to_be_hidden()
    page.wait_for_function(STILL)
    page.keyboard.press("Tab")
    generate.press("Enter")
    page.wait_for_function(PLAYS)
    page.evaluate(f"{LOCKSTEP}.seekFrame(45)")
    page.wait_for_function(WAITS)
    fake.windows.let(2)
    page.wait_for_function(ENDED)
    expect(generate).to_be_focused()  # once more, though it was disabled meanwhile
    expect(waiting).to_be_hidden()
    page.emulate_media(reduced_motion="reduce", color_scheme=scheme)

    # Numbers do not wait for figures, nor figures for videos.
    expect(page.locator(f'#numbers tr[data-measure="{JERK}"] td .raw').first).to_have_text("110")
    expect(page.locator("#verdict")).to_contain_text("110")
    expect(page.locator("#figures img")).to_have_count(0)
    expect(page.locator("#downloads .bundle")).to_be_hidden()
    fake.figures.set()
    page.locator("#downloads .bundle").wait_for(state="attached")
    turn_to_part(page, "Figures")
    expect(page.locator("#figures img").first).to_be_visible()
    turn_to_part(page, "Watch")
    expect(page.locator("#player video")).to_have_count(0)
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    put_clock(page, 0.1)
    assert page.evaluate(f"{LOCKSTEP}.frame") == 3
    assert not [url for url in asked if "/media/" in url], "all of it is there"

    # Videos come one by one into the tags of their bodies and into the downloads.
    videos = page.locator("#player .stage-tag a[download$='.mp4']")
    fake.videos.let(1)
    expect(videos).to_have_count(1)  # of two that a phone shows one after the other
    fake.videos.let(12)
    expect(page.locator("#status")).to_contain_text(text.VIDEOS_DONE)
    turn_to_part(page, "Files")
    page.locator("#downloads summary").click()
    expect(page.locator("#downloads li a").last).to_be_visible()
    expect(page.locator("#downloads")).to_contain_text("comparison")
    turn_to_part(page, "Watch")

    # Worst second, close-up, ghost.
    bar = bar_of(page)
    if width < 600:  # the rest is behind one sign
        bar.locator(".more").click()
    press(bar, "Highest-jerk second")
    expect(page.locator("#player .worst-line")).to_contain_text(re.compile(r"1 of \d"))
    press(bar, "Highest-jerk second")
    page.evaluate(f"{LOCKSTEP}.pause()")
    bar.get_by_label("Close-up", exact=True).select_option("face")
    press(bar, "Ghost")
    expect(page.locator("#player .stage .ghost-legend")).to_contain_text("dark where they overlap")
    expect_fit(page)

    # The link, in a second browser that shares nothing with the first, and has no 3D graphics.
    href = page.locator("#runs .link a").evaluate("link => link.href")
    assert re.search(r"[?]run=[\w-]{43}$", href)
    other = visitor(width, height)
    other.add_init_script(
        """const getContext = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
            return kind === 'webgl2' ? null : getContext.call(this, kind, ...rest);
        };"""
    )
    theirs = watched(other.new_page())
    theirs.goto(href)
    expect(theirs.locator("#player video")).to_have_count(2)
    theirs.wait_for_function(f"() => {LOCKSTEP}.duration > 0")
    put_clock(theirs, 1.0)  # where the clock stands, videos do
    theirs.wait_for_function(
        """() => [...document.querySelectorAll('#player video')].every(
            ({ currentTime, controls }) => controls && Math.abs(currentTime - 1) < 0.05)"""
    )
    expect(theirs.locator("#player .no-stage")).to_contain_text("does not support 3D graphics")
    expect(theirs.locator(f'#numbers tr[data-measure="{JERK}"] td .raw').first).to_have_text("110")
    expect(theirs.locator("#status")).to_contain_text(f"up to {FRAMES} frames")
    expect(theirs.locator("#runs .link")).to_contain_text("expires in")
    expect(theirs.locator("#runs li")).to_have_count(0)  # it is another's
    turn_to_part(theirs, "Files")
    with theirs.expect_download() as download:
        theirs.locator("#downloads .bundle").click()
    assert download.value.suggested_filename.endswith(".zip")
    sound = page.evaluate(f"{SOUND}.src")
    assert theirs.evaluate(f"{SOUND}.src") != sound, "each browser has addresses of its own"
    assert page.request.get(sound).status == 200 and theirs.request.get(sound).status == 404
    theirs.goto(re.sub(r"=.*", "=" + "x" * 43, href))
    expect(theirs.locator("#message")).to_contain_text("has expired")
    expect(theirs.locator("#player video")).to_have_count(0)
    other.close()

    # Another seed of the same speech, beside the first run: by ticking both.
    page.get_by_label(text.SEED_LABEL).fill("7")
    press(page, text.GENERATE)
    page.locator("#runs").get_by_role("link", name=text.COMPARE_LAST).wait_for()
    page.locator("#runs summary").click()
    compare = page.locator("#runs").get_by_role("button", name=text.COMPARE)
    expect(compare).to_be_disabled()  # the run that is shown is ticked, and no other
    expect(page.locator("#runs time").first).to_have_text(re.compile(r"\d\d?:\d\d"))
    page.locator("#runs input[type=checkbox]:not(:checked)").first.check()
    with page.context.expect_page() as ticked:
        compare.click()
    both = watched(ticked.value)
    assert both.url.count("run=") == 2
    expect(both.locator("#verdict")).to_contain_text("Different settings: seed (0 in A, 7 in B).")
    bar = bar_of(staged(both, 4))
    if width < 600:
        bar.locator(".more").click()
    press(bar, "All")
    names = both.locator("#player .stage-tag header b")
    for i in range(1 if width < 600 else 2):  # a phone shows one body at a time
        expect(names.nth(i)).to_have_text(f"priorflow ({'AB'[i]})")
    expect(both.locator("#player .sounds")).to_be_hidden()  # it is the same
    expect_fit(both)
    both.close()

    # Another speech: either sounds under all bodies, from the same moment on.
    brief = tmp_path / "brief.wav"
    write_wav(brief, made_waveform(24_000))
    fake.seconds = 1.5
    page.locator("#speech").get_by_label("Clear").click()
    start(page, brief)
    page.get_by_role("link", name=text.COMPARE_OTHER, exact=True).wait_for()
    both = followed(page, text.COMPARE_OTHER, 4)
    expect(both.locator("#verdict")).to_contain_text("Choose which audio plays")
    sounds = both.get_by_label("Audio track")
    expect(sounds.locator("option")).to_have_text(["A: speech", "B: brief"])
    expect(sounds).to_have_value("A: speech")
    assert both.evaluate(f"{LOCKSTEP}.duration") == pytest.approx(SECONDS, abs=0.05)
    put_clock(both, 1.0)
    sounds.select_option("B: brief")
    moved = f"{LOCKSTEP}.frame === 30 && Math.abs({LOCKSTEP}.duration - 1.5) < 0.05"
    both.wait_for_function(moved)
    expect(both.locator("#player .plot[role=slider]")).to_have_attribute("aria-valuemax", "1.50")

    # A link has the choice.
    press(bar_of(both), "Ghost")
    both.wait_for_function("/&t=1&mode=ghost&.*sound=1/.test(location.hash)")
    held: list[Route] = []  # what the stage is drawn by comes after the sound, on a busy machine
    is_free = threading.Event()

    def hold(route: Route) -> None:
        if is_free.is_set():
            route.continue_()
        else:
            held.append(route)

    again = watched(both.context.new_page())
    again.route("**/stage/facts.json", hold)
    again.goto(both.evaluate("location.href"))
    expect(again.get_by_label("Audio track")).to_have_value("B: brief")
    is_free.set()
    for route in held:
        route.continue_()
    again.wait_for_function(moved)
    both.close()
    again.close()

    # The other tabs; in one of them the same two bodies.
    for tab in (own_motion.TAB, text.STUDY_TAB):
        page.get_by_role("tab", name=tab, exact=True).click()
        expect_fit(page)
    expect(page.get_by_text("Upload the participants' answer files")).to_be_visible()
    page.emulate_media(reduced_motion="no-preference", color_scheme=scheme)
    page.get_by_role("tab", name=text.LADDER_TAB).click()
    expect(page.locator(".ladder li")).to_have_count(5)
    expect(page.locator(".ladder .equation .katex-html")).to_have_count(5)
    expect(page.locator(".ladder .katex-error")).to_have_count(0)
    page.wait_for_function(ARGUE)
    told = page.locator("#mechanism-player .argument-head")
    expect(told).to_contain_text("1.1° about each axis")
    page.locator("#mechanism-noise input[type=number]").fill("0.05")
    expect(told).to_contain_text("2.9° about each axis")  # before anything is asked of the server
    run = page.evaluate("document.querySelector('#mechanism-player audio').src")
    page.locator("#mechanism-start").click()
    expect(page.locator("#mechanism-status")).to_contain_text("0.05 rad")
    expect(page.locator("#mechanism-says")).to_contain_text("This assumes equal noise")
    page.wait_for_function(
        f"run => ({ARGUE})() && {ARGUED}.querySelector('audio').src !== run", arg=run
    )
    expect_fit(page)


@pytest.mark.slow  # its parts are held one by one in test_stage.py
def test_a_run_of_many_beside_a_reference_with_words_and_without_videos(
    visitor: Callable, fake: Fake, address: str, speech: Path, tmp_path: Path
) -> None:
    """On a phone; then eight seeds, on a large window."""
    reference, words = tmp_path / "reference.npz", tmp_path / "words.TextGrid"
    save_motion(fakes.made_motion(FRAMES), reference)
    said = NamedTier("words", (Interval(1.0, 2.0, "<b>hello</b>"),))
    words.write_text(format_textgrid([said], 2.0))
    page = opened(visitor(390, 844), address)
    silence = tmp_path / "silence.wav"
    write_wav(silence, np.zeros(32_000, np.float32))
    give_speech(page, silence)
    expect(page.locator("#speech-refusal [role=alert]")).to_contain_text("is silent")
    page.locator("#speech").get_by_label("Clear").click()
    expect(page.locator("#speech-refusal [role=alert]")).to_have_count(0)
    page.get_by_role("button", name=text.ADVANCED_LABEL).click()
    give(page, "#reference", reference)
    give(page, "#transcript", words)
    page.get_by_label(text.VIDEOS_LABEL).uncheck()
    start(page, speech)
    staged(page, 4)
    expect(page.locator("#player .lane[data-name]")).to_have_count(4)
    expect(page.locator("#player .words span")).to_have_text("<b>hello</b>")
    names = page.locator("#player .stage-tag header b")  # one body after the other
    expect(names).to_have_text(["priorflow"])
    page.evaluate(f"{STAGE}.showNext(1)")
    expect(names).to_have_text(["local"])
    bar = bar_of(page).bounding_box()
    assert bar is not None and bar["height"] <= 64
    expect_fit(page)
    turn_to_part(page, "Numbers")  # beside which a phone keeps its bodies
    table = page.locator("#numbers .scroll")
    assert table.evaluate("box => box.scrollWidth > box.clientWidth")
    expect(page.locator("#player .stage-view")).to_be_in_viewport(ratio=0.99)
    turn_to_part(page, "Watch")

    turn_to(page, (1280, 900, "light"))
    page.locator("#player .fold").click()  # the form had made room
    for field in ("#transcript", "#reference"):
        page.locator(field).get_by_label("Clear").click()
    page.get_by_label(text.WORDS_LABEL).check()
    tick(page, ["local"])
    page.get_by_role("slider", name=re.compile(text.SAMPLES_LABEL)).fill("8")
    press(page, text.GENERATE)
    staged(page, 8)
    expect(page.locator("#player .stage-tag")).to_have_count(8)
    page.wait_for_function(  # in two rows at most, each body in its place inside
        """() => {
            const box = (one) => one.getBoundingClientRect();
            const view = box(document.querySelector('#player .stage-view'));
            const tags = [...document.querySelectorAll('#player .stage-tag')].map(box);
            const rows = new Set(tags.map(({ top }) => Math.round(top)));
            const isInside = ({ left, right }) => left >= view.left - 1 && right <= view.right + 1;
            return rows.size <= 2 && tags.every(isInside);
        }"""
    )
    expect_fit(page)
    expect(page.locator("#player .words span")).to_have_text("hello")
    expect(page.locator("#player .lane:has(.words) .name")).to_have_text("Words (recognised)")
