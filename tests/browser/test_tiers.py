"""The tiers of the time line: what each body does, in a real Chromium over made motion."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.browser.conftest import PATIENCE_MS, STAGED, Stage, open_page, start

pytestmark = pytest.mark.browser

TIME = "document.querySelector('.lockstep').lockstep.time"


@pytest.fixture(scope="module")
def page(browser: Browser, fake_address: str, stage: Stage, speech: Path) -> Iterator[Page]:
    """A run of three systems, the first of which performed a plan, at rest."""
    stage.hold(12)
    page = open_page(browser, fake_address)
    start(page, speech)
    page.locator("#bundle").wait_for()
    page.wait_for_function(STAGED, arg=3)
    page.locator("#player .tier-lane .event").first.wait_for()
    page.evaluate("document.querySelector('.lockstep').lockstep.pause()")
    yield page
    page.context.close()


def test_tiers_are_read_lit_chosen_by_mouse_and_keys_and_found_where_none_was_planned(
    page: Page,
) -> None:
    bodies = page.get_by_label("Whose tiers are shown")
    expect(bodies.locator("option")).to_have_count(3, timeout=PATIENCE_MS)
    right = page.get_by_role("group", name="Right hand")
    expect(right.locator(".event")).to_have_count(6)
    expect(right.locator(".stroke")).to_have_text("offer")

    page.evaluate("document.querySelector('.lockstep').lockstep.seek(3)")
    expect(right.locator(".now")).to_have_class(re.compile(r"\bhold\b"))
    right.locator(".stroke").click()
    why = page.locator("#player .why")
    expect(why).to_have_text(
        "Stroke (offer) of the right hand on the word “never”; 2.00 to 2.50 s, planned."
    )
    page.wait_for_function(f"{TIME} >= 1.95 && {TIME} <= 2.05")
    expect(right.locator(".now")).to_have_class(re.compile(r"\bstroke\b"))

    right.locator(".stroke").focus()
    page.keyboard.press("ArrowRight")
    expect(right.locator(".hold")).to_be_focused()
    assert page.evaluate(TIME) <= 2.05, "arrows go from event to event here, not through time"
    page.keyboard.press("Enter")
    expect(why).to_contain_text("The right hand stays after: stroke (offer)")
    expect(right.locator(".hold")).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("ArrowUp")
    expect(page.get_by_role("group", name="Left hand").locator(".event")).to_be_focused()

    page.locator('#player .lane[data-name="globaldiff/global"] .name').click()
    expect(bodies).to_have_value("globaldiff/global")
    lanes = page.locator("#player .tier-lane:visible")
    expect(lanes.first).to_have_attribute("data-origin", "found")
    expect(why).to_have_text("")
    bodies.select_option("globaldiff/local")
    expect(lanes.first).to_have_attribute("data-origin", "planned")


def test_a_phone_shows_hands_first_and_the_rest_when_asked(page: Page, fake_address: str) -> None:
    link = page.locator(".runs .link a").first.get_attribute("href")
    assert link is not None
    page.set_viewport_size({"width": 390, "height": 844})
    page.goto("about:blank")
    page.goto(fake_address + link)
    right = page.get_by_role("group", name="Right hand")
    right.locator(".stroke").wait_for()
    head = page.get_by_role("group", name="Head and gaze")
    expect(head).to_be_hidden()
    page.get_by_role("button", name="All tiers").click()
    expect(head.locator(".nod")).to_be_visible()
    right.locator(".stroke").click()
    expect(page.locator("#player .why")).to_contain_text("Stroke (offer)")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
