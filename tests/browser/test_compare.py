"""Anything compared with anything: other speech, other runs, one's own files, and eight seeds."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, Route, expect

from app import text
from app.page.tabs.own_motion import TAB
from model.motion.motion import save_motion
from model.speech.audio import write_wav
from tests.browser.conftest import PATIENCE_MS, STAGED, Stage, open_page, start, watched
from tests.helpers import smooth_motion_example
from tests.model.made import made_waveform

pytestmark = pytest.mark.browser

SECONDS = "document.querySelector('#player .lockstep').lockstep.duration"
SYSTEMS = 3


@pytest.fixture
def first(browser: Browser, fake_address: str, stage: Stage, speech: Path) -> Iterator[Page]:
    """A run of three systems that has ended."""
    stage.hold(12)
    page = open_page(browser, fake_address)
    start(page, speech)
    page.locator("#bundle").wait_for()
    page.wait_for_function(STAGED, arg=SYSTEMS)
    yield page
    page.context.close()


def followed(page: Page, link: str) -> Page:
    """The page of both, opened by the link below a run."""
    with page.context.expect_page() as opened:
        page.get_by_role("link", name=link, exact=True).click()
    both = watched(opened.value)
    both.locator("#player .lane[data-name] canvas").first.wait_for()
    return both


def test_of_two_speeches_either_sounds_under_all_bodies(
    first: Page, browser: Browser, tmp_path: Path
) -> None:
    other = tmp_path / "another.wav"
    write_wav(other, made_waveform(round(16_000 * 1.5)))
    first.locator("#speech").get_by_label("Clear").click()
    start(first, other)
    link = first.get_by_role("link", name=text.COMPARE_OTHER, exact=True)
    link.wait_for()
    both = followed(first, text.COMPARE_OTHER)
    both.wait_for_function(STAGED, arg=2 * SYSTEMS)
    expect(both.locator("#verdict")).to_contain_text("choose whose sound plays")
    sounds = both.locator("#player .sounds button")
    expect(sounds).to_have_text(["A: speech", "B: another"])
    expect(sounds.first).to_have_attribute("aria-pressed", "true")
    long_s = both.evaluate(SECONDS)
    assert long_s > 1.6
    both.evaluate("document.querySelector('#player .lockstep').lockstep.seek(1)")
    sounds.last.click()
    both.wait_for_function(f"Math.abs({SECONDS} - 1.5) < 0.05")
    frame = "document.querySelector('#player .lockstep').lockstep.frame"
    both.wait_for_function(f"{frame} === 30")  # the same moment of the other speech
    expect(both.locator("#player .plot[role=slider]")).to_have_attribute("aria-valuemax", "1.50")

    # A link has the choice; and of the two in one place it is said how far apart they are.
    bar = both.locator("#player .controls")
    bar.get_by_role("button", name="Ghost", exact=True).click()
    apart = both.locator("#player .apart li")
    expect(apart).to_have_count(7)
    expect(apart.filter(has_text="right arm")).to_contain_text(re.compile(r"\d°.*now [\d.]+°"))
    # The address follows once all is still: a slow machine writes it with the sound alone before.
    both.wait_for_function("/&t=1&mode=ghost&.*sound=1/.test(location.hash)")
    again = watched(browser.new_context(viewport={"width": 1280, "height": 900}).new_page())
    held: list[Route] = []  # what the stage is drawn by comes after the sound, on a busy machine

    def hold(route: Route) -> None:
        held.append(route)

    again.route("**/stage/facts.json", hold)
    again.goto(both.evaluate("location.href"))
    expect(again.locator("#player .sounds button").last).to_have_attribute(
        "aria-pressed", "true", timeout=PATIENCE_MS
    )
    for route in held:
        route.continue_()
    again.wait_for_function(f"{frame} === 30 && Math.abs({SECONDS} - 1.5) < 0.05")
    again.locator("#player .apart li").first.wait_for()
    again.context.close()


@pytest.mark.gl
def test_own_files_stand_beside_generated_systems(
    first: Page, speech: Path, tmp_path: Path
) -> None:
    mine = tmp_path / "mine.npz"
    save_motion(smooth_motion_example(60), mine)
    first.get_by_role("tab", name=TAB).click()
    first.set_input_files("#own-motions input[type=file]", str(mine))
    first.set_input_files("#own-speech input[type=file]", str(speech))
    expect(first.locator("#own-motions")).to_contain_text("mine")
    expect(first.locator("#own-speech")).to_contain_text("speech")
    first.get_by_role("button", name="Measure and compare").click()
    first.locator("#own-bundle").wait_for()
    both = followed(first, text.COMPARE_LAST)
    both.wait_for_function(STAGED, arg=SYSTEMS + 1)
    names = both.locator("#player .stage-tag header b").all_inner_texts()
    assert names[-1] == "mine (B)" and names[0].endswith("(A)")
    expect(both.locator("#player .sounds")).to_be_hidden()  # it is the same
    both.close()


def test_eight_seeds_move_as_small_bodies(
    browser: Browser, fake_address: str, stage: Stage, speech: Path
) -> None:
    stage.hold(12)
    page = open_page(browser, fake_address)
    for name in ("global", "full"):
        page.locator("#systems label", has_text=re.compile(f"{name}$")).locator("input").uncheck()
    page.get_by_role("slider", name=re.compile(text.SAMPLES_LABEL)).fill("8")
    start(page, speech)
    page.wait_for_function(STAGED, arg=8)
    tags = page.locator("#player .stage-tag")
    expect(tags).to_have_count(8)
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
    assert page.evaluate("document.documentElement.scrollWidth") <= 1280
    page.context.close()
