"""The argument on two bodies, which plays by itself where it is first looked at."""

import pytest
from playwright.sync_api import Browser, expect

from app import text
from app.run.experiments.mechanism import NAMES
from tests.browser.conftest import PATIENCE_MS, open_page

pytestmark = pytest.mark.browser

PLAYER = "document.querySelector('#mechanism-player .lockstep')"
BODIES = f"() => {PLAYER}.querySelector('.stage')?.dataset.bodies === '2'"
PLAYS = f"() => {PLAYER}.lockstep.isPlaying && {PLAYER}.lockstep.time > 0.3"


def test_two_bodies_play_by_themselves_and_anew_with_other_noise(
    browser: Browser, fake_address: str
) -> None:
    page = open_page(browser, fake_address)
    page.get_by_role("tab", name=text.LADDER_TAB).click()
    page.wait_for_function(BODIES, timeout=2 * PATIENCE_MS)
    page.wait_for_function(PLAYS)
    names = page.locator("#mechanism-player .stage-tag header b")
    expect(names).to_have_text(list(NAMES))
    expect(page.locator("#mechanism-says")).to_contain_text("Equal noise is an assumption")
    expect(page.locator("#mechanism-says video")).to_have_count(0)
    run = page.evaluate("document.querySelector('#mechanism-player audio').src")
    page.get_by_role("tab", name=text.MOTION_TAB, exact=True).click()
    page.get_by_role("tab", name=text.LADDER_TAB).click()  # it begins but once
    page.locator("#mechanism-noise input[type=number]").fill("0.05")
    page.locator("#mechanism-start").click()
    expect(page.locator("#mechanism-status")).to_contain_text("0.05 rad", timeout=2 * PATIENCE_MS)
    page.wait_for_function(BODIES)
    page.wait_for_function(PLAYS)
    assert page.evaluate("document.querySelector('#mechanism-player audio').src") != run
    page.context.close()
