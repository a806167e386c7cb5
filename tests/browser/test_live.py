"""A visitor speaks into a fake microphone, in a real Chromium, and the body moves."""

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import BrowserType, Page, expect

from app.page.tabs.live import KEEP, TAB
from model.speech.audio import write_wav
from tests.browser.conftest import BUILDS_ARE_THERE, CHROMIUM, PATIENCE_MS
from tests.model.made import made_waveform

pytestmark = [pytest.mark.browser, pytest.mark.gl]


@pytest.fixture(scope="module")
def speaking(
    chromium: BrowserType, address: str, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Page]:
    """The tab "Live" in a browser whose microphone hears a buzz that comes and goes."""
    wav = tmp_path_factory.mktemp("microphone") / "speech.wav"
    write_wav(wav, made_waveform(16_000 * 8))
    browser = chromium.launch(
        executable_path=CHROMIUM,
        args=[
            "--no-sandbox",
            "--use-fake-device-for-media-stream",
            "--use-fake-ui-for-media-stream",
            f"--use-file-for-fake-audio-capture={wav}",
        ],
    )
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.set_default_timeout(PATIENCE_MS)
    page.goto(address)
    page.get_by_role("tab", name=TAB).click()
    yield page
    browser.close()


def test_one_speaks_and_the_body_moves_and_the_minute_is_kept(speaking: Page) -> None:
    page = speaking
    live = page.locator(".live")
    live.get_by_role("button", name="Start").click()
    expect(live.get_by_role("button", name="Stop")).to_be_visible()
    page.wait_for_function("() => document.querySelector('.live').live.latency !== null")
    expect(live.locator(".latency")).to_contain_text("hears 0.60 s")
    latency_ms = float(live.get_attribute("data-latency") or "nan")
    assert 600 < latency_ms < 60_000  # what it is depends on the machine; it is measured
    assert page.evaluate("() => document.querySelector('.live meter').value") > 0.3
    place = "document.querySelector('.live').live.place"
    for _ in range(3):
        page.wait_for_function(f"place => {place} > place", arg=page.evaluate(place))
    expect(live.locator(".stage")).to_have_attribute("data-bodies", "1")
    expect(live.locator(".planned")).to_be_hidden()  # this system performs no plans

    # The stage of any run: displays act while the body moves, and the server is not asked.
    asked: list[str] = []
    page.wait_for_function(BUILDS_ARE_THERE)
    page.on("request", lambda request: asked.append(request.url))
    bar = live.get_by_role("toolbar", name="Displays")
    canvas = live.locator(".stage canvas")
    bar.get_by_label("Close-up").select_option("both")
    bar.get_by_role("button", name="Jerk", exact=True).click()
    bar.get_by_label("Tremble, times as large").fill("1")
    expect(live.locator(".stage-legend")).to_contain_text("jerk: 0 to 500 m/s³")
    expect(live.locator(".stage-notice")).to_have_text("EXAGGERATED x20: all above 5 Hz")
    bar.locator(".more").click()
    live.get_by_label("Whole body").check()
    live.get_by_role("button", name="Side").click()
    expect(live.get_by_role("button", name="Back to the front")).to_be_visible()
    page.wait_for_function(f"place => {place} > place + 6", arg=page.evaluate(place))
    canvas.focus()
    canvas.press("Home")
    canvas.press("e")
    expect(live.locator(".stage-notice")).to_be_hidden()
    bar.locator(".more").click()
    assert asked == []

    page.wait_for_timeout(4_000)  # a minute that is kept has two seconds at least
    page.get_by_role("button", name=KEEP).click()
    expect(live.locator(".asked").get_by_role("status")).to_contain_text("is being kept")
    expect(page.locator("#live-status")).to_contain_text("Done in", timeout=4 * PATIENCE_MS)
    expect(page.locator("#live-message")).to_contain_text("made while the speech was spoken")
    page.wait_for_function(
        "() => document.querySelector('#live-player .stage')?.dataset.bodies === '1'"
    )
    page.locator("#live-files-fold button").first.click()
    expect(page.locator("#live-files")).to_contain_text("provenance")
    page.wait_for_function("() => document.querySelector('#live-player audio').duration > 2")
    expect(page.locator("#live-runs .link a")).to_have_attribute("href", re.compile(r"^\?run="))
    expect(page.locator("#live-runs li")).to_contain_text("live:")


def test_a_lost_connection_and_a_denied_microphone_are_told(speaking: Page) -> None:
    page = speaking
    live = page.locator(".live")
    status = live.locator(".asked").get_by_role("status")
    sockets: list[str] = []
    page.on("websocket", lambda socket: sockets.append(socket.url))
    live.get_by_role("button", name="Start").click()
    page.wait_for_function("() => document.querySelector('.live').live.latency !== null")
    assert sockets and sockets[0].endswith("/live/speak")
    page.evaluate("() => document.querySelector('.live').live.socket.close()")
    expect(status).to_contain_text("The connection to the server was lost")
    expect(live.get_by_role("button", name="Start")).to_be_visible()

    page.evaluate(
        "() => { navigator.mediaDevices.getUserMedia = () => "
        "Promise.reject(new DOMException('no', 'NotAllowedError')); }"
    )
    live.get_by_role("button", name="Start").click()
    expect(status).to_contain_text("The microphone was denied")
    expect(live.get_by_role("button", name="Start")).to_be_visible()


def test_an_example_is_played_as_if_it_were_spoken(speaking: Page) -> None:
    page = speaking
    live = page.locator(".live")
    live.locator("select[name=source]").select_option(label="Example: Three reasons")
    live.get_by_role("button", name="Start").click()
    expect(live.locator(".asked").get_by_role("status")).to_contain_text("Playing")
    page.wait_for_function("() => document.querySelector('.live').live.latency !== null")
    live.get_by_role("button", name="Stop").click()
    expect(live.locator(".asked").get_by_role("status")).to_contain_text("Stopped")
