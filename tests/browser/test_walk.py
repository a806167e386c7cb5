"""A visitor's whole way through the page at three widths, over a pipeline that draws at once.

Motion of one's own and the way from a study to its report have tests of their own
(`test_own_motion`, `test_study_tab`), over the real pipeline.
"""

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from app import text
from app.config import EXAMPLES, AppConfig
from app.page.player.first_look_shown import EXAMPLE
from app.page.tabs import own_motion
from app.run.examples import CLEAN, FACTS, STEADY, TREMBLING, first_look
from app.run.requests.request import GenerateRequest
from model.motion.motion import load_motion, save_motion
from model.systems.globaldiff.config import BEST
from tests.app import fakes
from tests.browser.conftest import LOOKS, PATIENCE_MS, STAGED, Scheme, served, watched
from tests.model.made import TINY_BEST, TINY_SYSTEMS, make_weights

pytestmark = pytest.mark.browser

LOOK_S = 2.0
EACH_ONCE: list[tuple[int, int, Scheme]] = [
    (390, 844, "dark"),
    (1280, 900, "light"),
]
"""Looks of every run of the tests: a phone and a window, and both schemes; the others are slow."""
MOVES = "() => document.querySelector('#player .lockstep')?.stage?.pictures > 5"
"""Whether some pictures of the stage have been drawn."""
Walk = tuple[str, list[GenerateRequest]]


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Walk]:
    """The address of a page whose example has been made, and what it has been asked for."""
    weights = make_weights(tmp_path_factory.mktemp("weights"), {**TINY_SYSTEMS, BEST: TINY_BEST})
    folder = tmp_path_factory.mktemp("walk")
    config = AppConfig(port=0, weights=weights, temp=folder / "page", kept=folder / "kept")
    look = first_look(config.kept, weights, BEST, EXAMPLES / f"{EXAMPLE}.wav")
    look.folder.mkdir(parents=True)
    shutil.copyfile(look.speech, look.beginning)
    motion = load_motion(CLEAN).part(slice(round(30 * LOOK_S)))
    for name in (STEADY, TREMBLING):
        save_motion(motion, look.folder / f"{name}.npz")
    facts = {"jerk_m_s3": {STEADY: 100, TREMBLING: 2000}, "noise_rad": 0.012, "provenance": {}}
    (look.folder / FACTS).write_text(json.dumps(facts))
    asked: list[GenerateRequest] = []
    generate = fakes.make_generate(on_start=asked.append, seconds=3.0)
    draw = fakes.make_draw(seconds=3.0)
    with served(config, is_warmed_up=True, generate=generate, draw_behind=draw) as address:
        yield address, asked
    shutil.rmtree(look.folder)


def example_of(page: Page, address: str) -> None:
    """Open the page and wait for its example: right after a start it may still be read."""
    page.goto(address)
    page.locator(".first-look").wait_for()


def within(page: Page, selector: str, height: int) -> bool:
    """Whether all of an element is in the window, not scrolled."""
    box = page.locator(selector).first.bounding_box()
    return box is not None and box["y"] >= 0 and box["y"] + box["height"] <= height


@pytest.mark.parametrize(
    ("width", "height", "scheme"),
    [pytest.param(*look, marks=() if look in EACH_ONCE else pytest.mark.slow) for look in LOOKS],
)
def test_a_visitor_walks_from_the_example_to_a_link_for_somebody_else(
    browser: Browser,
    walk: Walk,
    tmp_path: Path,
    width: int,
    height: int,
    scheme: Scheme,
) -> None:
    address, asked = walk
    context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)
    page = watched(context.new_page())

    # The example moves, and all of its picture is in the first window, the hands below the body.
    example_of(page, address)
    expect(page.get_by_role("heading", name=text.LOOK_QUESTION)).to_be_visible()
    page.wait_for_function(MOVES)
    assert within(page, "#player .stage-view", height)
    page.get_by_text(text.LOOK_SHOW).click()
    expect(page.locator(".first-look details")).to_contain_text("2,000")

    # Speech of one's own, tremble made large; the page goes to what the click began.
    page.set_input_files("#speech input[type=file]", str(EXAMPLES / f"{EXAMPLE}.wav"))
    page.locator("#speech").get_by_label("Play", exact=True).first.wait_for()
    page.get_by_role("button", name=text.GENERATE).click()
    page.locator("#bundle").wait_for()
    expect(page.locator("#status [role=status]")).to_be_in_viewport()
    page.wait_for_function(STAGED, arg=len(asked[-1].systems))

    # Worst second, close-up, ghost.
    bar = page.locator("#player .controls")
    bar.get_by_role("button", name="Worst second", exact=True).click()
    expect(page.locator("#player .worst-line")).to_contain_text(re.compile(r"1 of \d"))
    bar.get_by_label("Close-up", exact=True).select_option("face")
    bar.get_by_role("button", name="Ghost", exact=True).click()
    expect(page.locator("#player .stage .ghost-legend")).to_contain_text("Grey where both agree")
    assert page.evaluate("document.documentElement.scrollWidth") <= width

    # The link, in a second browser that shares nothing with the first.
    href = page.locator("#runs .link a").evaluate("link => link.href")
    other = watched(browser.new_context(viewport={"width": width, "height": height}).new_page())
    other.goto(href)
    other.locator("#player .lane canvas").first.wait_for()
    other.wait_for_function(STAGED, arg=len(asked[-1].systems))
    expect(other.locator("#empty")).not_to_be_visible()
    other.context.close()

    # Another seed of the same speech, beside the first run: in one player, in one table.
    page.get_by_label(text.SEED_LABEL).fill("7")
    page.get_by_role("button", name=text.GENERATE).click()
    with context.expect_page() as opened:
        page.locator("#runs").get_by_role("link", name=text.COMPARE_LAST).click()
    both = watched(opened.value)
    expect(both.locator("#verdict")).to_contain_text("Seed 0 against 7.", timeout=PATIENCE_MS)
    both.locator("#player .lane[data-name] canvas").first.wait_for()
    both.wait_for_function(STAGED, arg=2 * len(asked[-1].systems))
    names = both.locator("#player .stage-tag header b")
    shown = 1 if width < 600 else 2  # a phone shows one body at a time
    assert names.all_inner_texts()[:2] == ["priorflow (A)", "priorflow (B)"][:shown]
    both.locator("#player .controls .play").click()
    both.wait_for_function(MOVES)
    expect(both.locator('#numbers tr[data-measure="Jerk"]')).to_contain_text("110")
    assert both.evaluate("document.documentElement.scrollWidth") <= width
    both.close()

    # The same by ticking two in the list.
    page.locator("#runs summary").click()
    compare = page.locator("#runs").get_by_role("button", name=text.COMPARE)
    expect(compare).to_be_disabled()  # the run that is shown is ticked, and no other
    page.locator("#runs input[type=checkbox]:not(:checked)").first.check()
    with context.expect_page() as opened:
        compare.click()
    assert opened.value.url.count("run=") == 2
    opened.value.close()

    # The other tabs fit the window.
    for tab in (own_motion.TAB, text.LADDER_TAB, text.STUDY_TAB):
        page.get_by_role("tab", name=tab, exact=True).click()
        page.wait_for_timeout(200)
        assert page.evaluate("document.documentElement.scrollWidth") <= width, tab
    context.close()
