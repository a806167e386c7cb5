"""What a visitor does and sees, in a real Chromium."""

import io
import re
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, expect

from app import text
from app.handlers import PAGE_PREVIEWS
from model.speech.audio import write_wav
from tests.browser.conftest import PATIENCE_MS

pytestmark = [pytest.mark.browser, pytest.mark.gl]

Visit = Callable[..., Page]
Wav = Callable[[float], Path]


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
    press_generate(page)

    page.locator("#video-0 video").wait_for()
    expect(page.locator("#empty")).not_to_be_visible()
    page.locator("#bundle").wait_for()
    expect(page.locator("#preview-0")).not_to_be_visible()
    for selector in ("#video-0 video", "#video-1 video", "#comparison video"):
        assert abs(duration_s(page, selector) - 1.5) < 0.05, selector
    expect(status_of(page)).to_contain_text("45 frames each")

    moved = page.evaluate(
        """async () => {
            const video = document.querySelector('#comparison video');
            video.muted = true;
            await video.play();
            await new Promise(done => setTimeout(done, 400));
            return video.currentTime;
        }"""
    )
    assert moved > 0.1
    assert page.locator("#figure img").evaluate("image => image.naturalWidth") > 500
    expect(page.locator("#numbers tbody tr")).to_have_count(2)
    expect(page.locator("#files")).to_contain_text("diagnostics")
    with page.expect_download() as download:
        page.locator("#bundle").click()
    assert download.value.suggested_filename.endswith(".zip")


@pytest.mark.skipif(PAGE_PREVIEWS == 0, reason="previews in 3D are off")
def test_the_motion_moves_in_3d_before_its_video_is_there(visit: Visit, wav: Wav) -> None:
    page = visit()
    give_speech(page, wav(30.0))
    press_generate(page)
    preview = page.locator("#preview-0 canvas")
    preview.wait_for()
    expect(page.locator("#video-0")).not_to_be_visible()
    expect(page.locator("#preview-0")).to_contain_text("3D preview")
    deadline = time.monotonic() + PATIENCE_MS / 1000
    before = as_array(preview.screenshot())
    while time.monotonic() < deadline:
        page.wait_for_timeout(250)
        now = as_array(preview.screenshot())
        num_dark = [(picture.sum(axis=2) < 300).sum() for picture in (before, now)]
        if min(num_dark) > 500 and (before != now).any():
            break  # trousers and hair, and they are no longer where they were
        before = now
    else:
        pytest.fail("the preview shows no body that moves")
    expect(page.locator("#video-0")).not_to_be_visible()
    page.get_by_role("button", name=text.CANCEL).click()
    expect(status_of(page)).to_have_text(text.CANCELLED, timeout=PATIENCE_MS)
    expect(page.locator("#preview-0")).not_to_be_visible()


def as_array(png: bytes) -> np.ndarray:
    """Cut to a common size: a page that settles moves a part by fractions of a pixel."""
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)[:320, :240]


def test_silence_gives_a_sentence_that_stays_and_the_next_run_works(
    visit: Visit, wav: Wav, tmp_path: Path
) -> None:
    silence = tmp_path / "silence.wav"
    write_wav(silence, np.zeros(32_000, np.float32))
    page = visit()
    give_speech(page, silence)
    press_generate(page)
    message = page.get_by_role("alert").filter(has_text=text.FAILED_TITLE)
    expect(message).to_contain_text("is silent", timeout=PATIENCE_MS)
    expect(page.locator("#video-0")).not_to_be_visible()
    page.wait_for_timeout(1_000)
    expect(message).to_be_visible()

    page.locator("#speech").get_by_label("Clear").click()
    give_speech(page, wav(0.6))
    press_generate(page)
    expect(message).not_to_be_visible(timeout=PATIENCE_MS)
    page.locator("#bundle").wait_for()


def test_without_speech_the_page_asks_for_it(visit: Visit) -> None:
    page = visit()
    press_generate(page)
    expect(page.locator("#message")).to_contain_text(text.NO_SPEECH, timeout=PATIENCE_MS)


def test_two_visitors_at_once_get_their_own_results(visit: Visit, wav: Wav) -> None:
    first, second = visit(), visit()
    give_speech(first, wav(0.6))
    give_speech(second, wav(1.2))
    press_generate(first)
    expect(status_of(first)).to_contain_text("so far", timeout=PATIENCE_MS)
    press_generate(second)
    expect(status_of(second)).to_contain_text("one run ahead of you", timeout=PATIENCE_MS)
    for page, seconds, frames in ((first, 0.6, 18), (second, 1.2, 36)):
        page.locator("#bundle").wait_for()
        assert abs(duration_s(page, "#comparison video") - seconds) < 0.05
        expect(status_of(page)).to_contain_text(f"{frames} frames each")


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
    expect(page.locator("#comparison")).not_to_be_visible()


@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_is_wider_than_the_window(visit: Visit, width: int) -> None:
    page = visit(width=width)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    for name in (text.TITLE, text.STEP_SPEECH, text.STEP_SYSTEMS):
        expect(page.get_by_role("heading", name=re.compile(name)).first).to_be_visible()
    box = page.get_by_role("button", name=text.GENERATE).bounding_box()
    assert box is not None and box["x"] >= 0 and box["x"] + box["width"] <= width


def test_an_example_fills_in_the_speech(visit: Visit) -> None:
    page = visit()
    page.locator("#examples button").first.click()
    page.locator("#speech").get_by_label("Play", exact=True).first.wait_for()
