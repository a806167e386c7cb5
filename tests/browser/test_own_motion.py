"""A visitor compares motion files of their own, in a real Chromium."""

from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from app.page.tabs.own_motion import TAB
from model.motion.motion import save_motion
from tests.browser.conftest import PATIENCE_MS
from tests.helpers import smooth_motion_example

pytestmark = [pytest.mark.browser, pytest.mark.gl]


def test_two_files_of_ones_own_are_measured_and_drawn(
    visit: Callable[..., Page], tmp_path: Path
) -> None:
    paths = [tmp_path / f"{name}.npz" for name in ("mine", "theirs")]
    for seed, path in enumerate(paths):
        save_motion(smooth_motion_example(45, seed=seed), path)
    page = visit()
    page.get_by_role("tab", name=TAB).click()
    page.get_by_role("button", name="Measure and compare").click()
    expect(page.locator("#own-message")).to_contain_text("at least one", timeout=PATIENCE_MS)

    page.set_input_files("#own-motions input[type=file]", [str(path) for path in paths])
    expect(page.locator("#own-motions")).to_contain_text("theirs")
    page.get_by_role("button", name="Measure and compare").click()

    expect(page.locator("#own-status")).to_contain_text(
        "Measured 2 motions", timeout=3 * PATIENCE_MS
    )
    expect(page.locator("#own-message")).not_to_be_visible()
    expect(page.locator("#own-numbers thead th[data-name]")).to_have_text(["mine", "theirs"])
    for figure in page.locator("#own-figures figure img").all():
        page.wait_for_function("image => image.naturalWidth > 500", arg=figure.element_handle())
    expect(page.locator("#own-figures")).to_contain_text("right middle fingertip jerk")
    page.locator("#own-files-fold button").first.click()
    expect(page.locator("#own-files")).to_contain_text("error_growth")

    # The link, in a second browser: in the tab that it came from.
    href = page.locator("#own-runs .link a").evaluate("link => link.href")
    other = visit()
    other.goto(href)
    expect(other.locator("#own-numbers thead th[data-name]")).to_have_text(["mine", "theirs"])
    expect(other.get_by_role("tab", name=TAB)).to_have_attribute("aria-selected", "true")
    expect(other.locator("#own-player video")).to_have_count(2)
    for video in other.locator("#own-player video").all():
        other.wait_for_function("video => video.duration > 1", arg=video.element_handle())
