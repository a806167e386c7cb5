"""What a visitor does and sees, in a real Chromium."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from app import text
from app.config import AppConfig
from model.speech.audio import write_wav
from tests.browser.conftest import PATIENCE_MS, STAGED, show_videos

pytestmark = [pytest.mark.browser, pytest.mark.gl]

Visit = Callable[..., Page]
Wav = Callable[[float], Path]
SYSTEMS = ("globaldiff/local", "globaldiff/global")


def give_speech(page: Page, path: Path) -> None:
    page.set_input_files("#speech input[type=file]", str(path))
    page.locator("#speech").get_by_label("Play", exact=True).first.wait_for()


def press_generate(page: Page) -> None:
    page.get_by_role("button", name=text.GENERATE).click()


def duration_s(page: Page, selector: str) -> float:
    """Of a video, once the browser has understood it."""
    page.wait_for_function("s => document.querySelector(s)?.duration > 0", arg=selector)
    return page.evaluate("s => document.querySelector(s).duration", selector)


def status_of(page: Page):
    return page.locator("#status [role=status]")


def test_speech_becomes_videos_that_play_a_figure_numbers_and_downloads(
    visit: Visit, wav: Wav
) -> None:
    page = visit()
    expect(page.locator("#empty")).to_be_visible()
    give_speech(page, wav(1.5))
    page.evaluate("scrollTo(0, document.body.scrollHeight)")
    press_generate(page)

    expect(status_of(page)).to_be_in_viewport()  # the page goes to what the click began
    page.wait_for_function(STAGED, arg=len(SYSTEMS))  # before there is any video
    expect(page.locator("#empty")).not_to_be_visible()
    page.locator("#bundle").wait_for()
    show_videos(page)
    expect(status_of(page)).to_contain_text(text.VIDEOS_DONE, timeout=2 * PATIENCE_MS)
    expect(page.locator("#player video").first).to_have_attribute(
        "poster", re.compile("^data:image/jpeg")
    )
    for selector in (
        *(f'#player .tile[data-name="{name}"] video' for name in SYSTEMS),
        "#player audio",
    ):
        assert abs(duration_s(page, selector) - 1.5) < 0.05, selector
    expect(status_of(page)).to_contain_text("45 frames each")

    page.locator("#player .controls .play").click()
    page.wait_for_function("() => document.querySelector('#player video').currentTime > 0.1")
    figure = page.locator("#figures img").first
    page.wait_for_function("image => image.naturalWidth > 500", arg=figure.element_handle())
    expect(page.locator("#numbers thead th[data-name]")).to_have_text(["local", "global"])
    expect(page.locator('#numbers tr[data-measure="Jerk"] td .raw').first).to_have_text(
        re.compile(r"\d")
    )
    page.locator("#files-fold button").first.click()
    expect(page.locator("#files")).to_contain_text("diagnostics")
    with page.expect_download() as download:
        page.locator("#bundle").click()
    assert download.value.suggested_filename.endswith(".zip")


def test_silence_is_refused_before_any_run_and_the_next_run_works(
    visit: Visit, wav: Wav, tmp_path: Path
) -> None:
    silence = tmp_path / "silence.wav"
    write_wav(silence, np.zeros(32_000, np.float32))
    page = visit()
    give_speech(page, silence)
    refusal = page.locator("#speech-refusal [role=alert]")
    expect(refusal).to_contain_text("is silent", timeout=PATIENCE_MS)
    start = page.get_by_role("button", name=text.GENERATE)
    expect(start).to_be_disabled(timeout=PATIENCE_MS)
    expect(page.get_by_text(text.UNUSABLE)).to_be_visible()
    expect(page.locator("#player .lockstep")).not_to_be_visible()

    page.locator("#speech").get_by_label("Clear").click()
    give_speech(page, wav(0.6))
    page.get_by_label(text.VIDEOS_LABEL).uncheck()
    expect(refusal).to_have_count(0, timeout=PATIENCE_MS)
    expect(start).to_be_enabled(timeout=PATIENCE_MS)
    press_generate(page)
    page.locator("#bundle").wait_for()


def test_without_speech_the_page_asks_for_it(visit: Visit) -> None:
    page = visit()
    press_generate(page)
    expect(page.locator("#message")).to_contain_text(text.NO_SPEECH, timeout=PATIENCE_MS)
    expect(page.get_by_text(text.NO_SPEECH)).to_have_count(1)  # and by no toast


def test_two_visitors_at_once_get_their_own_results(visit: Visit, wav: Wav) -> None:
    first, second = visit(), visit()
    give_speech(first, wav(5.0))
    give_speech(second, wav(1.2))
    for page in (first, second):
        page.get_by_label(text.VIDEOS_LABEL).uncheck()
    press_generate(first)
    expect(status_of(first)).to_contain_text("so far", timeout=PATIENCE_MS)
    press_generate(second)
    expect(status_of(second)).to_contain_text("one run ahead of you", timeout=PATIENCE_MS)
    for page, seconds, frames in ((first, 5.0, 150), (second, 1.2, 36)):
        page.locator("#bundle").wait_for()
        assert abs(duration_s(page, "#player audio") - seconds) < 0.05
        expect(status_of(page)).to_contain_text(f"{frames} frames each", timeout=PATIENCE_MS)


def test_cancel_ends_the_run_and_gives_the_button_back(visit: Visit, wav: Wav) -> None:
    page = visit()
    give_speech(page, wav(20.0))
    press_generate(page)
    cancel = page.get_by_role("button", name=text.CANCEL)
    cancel.wait_for()
    expect(page.get_by_role("button", name=text.GENERATE)).to_be_disabled()
    cancel.click()
    expect(status_of(page)).to_have_text(text.CANCELLED, timeout=PATIENCE_MS)
    expect(page.get_by_role("button", name=text.GENERATE)).to_be_enabled()
    expect(page.locator("#player .lockstep")).not_to_be_visible()


@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_is_wider_than_the_window(visit: Visit, width: int) -> None:
    page = visit(width=width)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    for name in (text.TITLE, text.STEP_SPEECH, text.STEP_SYSTEMS):
        expect(page.get_by_role("heading", name=re.compile(name)).first).to_be_visible()
    box = page.get_by_role("button", name=text.GENERATE).bounding_box()
    assert box is not None and box["x"] >= 0 and box["x"] + box["width"] <= width


def test_an_example_fills_in_the_speech(visit: Visit, page_config: AppConfig) -> None:
    """For the first visitor, and for one who comes after all files were swept."""
    for _ in range(2):
        page = visit()
        with page.expect_response(lambda response: ".wav" in response.url) as sound:
            page.locator("#examples button").first.click()
        assert sound.value.ok
        page.locator("#speech").get_by_label("Play", exact=True).first.wait_for()
        for file in page_config.cache_folder.rglob("*.wav"):
            file.unlink()
