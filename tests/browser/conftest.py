"""The real page with tiny weights, and a real Chromium."""

import os
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Literal

import pytest
from playwright.sync_api import (
    Browser,
    BrowserContext,
    BrowserType,
    ConsoleMessage,
    Page,
    expect,
    sync_playwright,
)

from app import text
from app.config import AppConfig
from app.page.launch import launch
from model.plan.plan import GesturePlan, HandPhase, Nod
from model.speech.audio import write_wav
from renderer.draw.offscreen import GLError
from renderer.draw.probe import choose_backend
from tests.app import fakes
from tests.model.made import made_waveform, make_weights
from tests.model.systems.planned.made import make_planned_weights

CHROMIUM = next(
    (
        path
        for name in ("chromium", "chromium-browser", "google-chrome")
        if (path := shutil.which(name))
    ),
    None,
)
PATIENCE_MS = 120_000
"""Longest that any one thing may take on a busy machine."""
expect.set_options(timeout=PATIENCE_MS)
BUILDS_ARE_THERE = """() => performance.getEntriesByType('resource').some(
  ({ name, responseEnd }) => name.endsWith('stage/builds.bin') && responseEnd > 0)"""
"""The one thing that a stage still asks for a while after its first body."""
GRADIO_CAUGHT = "Error in watch callback"
"""What Gradio writes to the console where a part of the page throws on a new value."""

Motion = Literal["reduce", "no-preference"]
"""Whether examples and runs play by themselves: bodies that nobody looks at cost a core."""
Scheme = Literal["light", "dark"]
SCHEMES: tuple[Scheme, ...] = ("light", "dark")
WINDOWS = ((390, 844), (1280, 900), (1600, 1000))
LOOKS: list[tuple[int, int, Scheme]] = [(*size, scheme) for size in WINDOWS for scheme in SCHEMES]
"""Width and height of a phone, a laptop and a large screen, each light and dark."""

SECONDS = 6.0
FRAMES = round(30 * SECONDS)
FAKED_SYSTEMS = ("globaldiff/local", "globaldiff/global", "globaldiff/full")
"""Of the page over a pipeline that draws numbered pictures at once."""
PLAN = GesturePlan(
    SECONDS,
    left=(HandPhase(0.0, 6.0, "rest", (0.2, -0.2, 0.2)),),
    right=(
        HandPhase(0.0, 1.5, "rest", (0.2, -0.2, 0.2)),
        HandPhase(1.5, 2.0, "preparation", (0.2, 0.0, 0.3), "offer"),
        HandPhase(2.0, 2.5, "stroke", (0.2, -0.1, 0.3), "offer", "never"),
        HandPhase(2.5, 4.0, "hold", (0.2, -0.1, 0.3), "offer"),
        HandPhase(4.0, 4.6, "retraction", (0.2, -0.2, 0.2), "offer"),
        HandPhase(4.6, 6.0, "rest", (0.2, -0.2, 0.2)),
    ),
    nods=(Nod(2.3, 5.0),),
)
"""That the first of them performs."""


_FAILED_SCRIPTS: list[str] = []


def watched(page: Page) -> Page:
    """A page in which no script may fail, patient with a busy machine."""

    def read(line: ConsoleMessage) -> None:
        if GRADIO_CAUGHT in line.text:
            _FAILED_SCRIPTS.append(line.text)

    page.set_default_timeout(PATIENCE_MS)
    page.on("pageerror", lambda error: _FAILED_SCRIPTS.append(error.stack or str(error)))
    page.on("console", read)
    return page


@pytest.fixture(autouse=True)
def any_machine_is_quick_enough_to_be_live(monkeypatch: pytest.MonkeyPatch) -> None:
    """Busy machines refuse live systems by time, and the page runs beside the browser here."""
    monkeypatch.setattr("app.live.session.MAX_WINDOW_MS", 1e6)


@pytest.fixture(autouse=True)
def no_script_has_failed() -> Iterator[None]:
    """Of the pages that are watched. To fail where it is heard would end the browser's connection,
    and with it all later tests."""
    _FAILED_SCRIPTS.clear()
    yield
    assert not _FAILED_SCRIPTS, "\n".join(_FAILED_SCRIPTS)


def in_every_look(page: Page) -> Iterator[int]:
    """The page in each of `LOOKS`, no wider than the window; gives the window's height."""
    for width, height, scheme in LOOKS:
        page.set_viewport_size({"width": width, "height": height})
        page.emulate_media(color_scheme=scheme)
        if page.locator("gradio-app, .gradio-container").count():  # it asks but once
            page.evaluate("dark => document.body.classList.toggle('dark', dark)", scheme == "dark")
        page.wait_for_timeout(300)
        wide = page.evaluate("document.documentElement.scrollWidth")
        assert wide <= width, (width, scheme, wide)
        yield height


@contextmanager
def served(
    config: AppConfig, is_warmed_up: bool = False, **does: Callable[..., Any]
) -> Iterator[str]:
    """The address of a page that is open meanwhile. Gradio keeps uploads where the environment
    says, for all pages of a process: a page that was open before gets its place back.

    Args:
        does: runs by functions of a test's own, as of `FakeProcesses`.
    """
    before = os.environ.get("GRADIO_TEMP_DIR")
    page = launch(config, is_warmed_up, partial(fakes.FakeProcesses, does=does))
    assert page.local_url is not None
    yield page.local_url
    page.close()
    if before is not None:
        os.environ["GRADIO_TEMP_DIR"] = before


@pytest.fixture(scope="session")
def page_config(tmp_path_factory: pytest.TempPathFactory) -> AppConfig:
    """Of the page that is open for all tests."""
    weights = make_weights(tmp_path_factory.mktemp("weights"))
    return AppConfig(port=0, weights=weights, temp=tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="session")
def address(page_config: AppConfig) -> Iterator[str]:
    """Where the page is."""
    try:
        choose_backend()
    except GLError as error:
        pytest.skip(str(error))
    with served(page_config) as url:
        yield url


@pytest.fixture(scope="session")
def chromium() -> Iterator[BrowserType]:
    """What starts browsers: there can be only one in a process."""
    if CHROMIUM is None:
        pytest.skip("Chromium is not installed (apt-get install chromium)")
    with sync_playwright() as playwright:
        yield playwright.chromium


@pytest.fixture(scope="session")
def browser(chromium: BrowserType) -> Iterator[Browser]:
    browser = chromium.launch(
        executable_path=CHROMIUM,
        args=["--no-sandbox", "--autoplay-policy=no-user-gesture-required"],
    )
    yield browser
    browser.close()


@pytest.fixture
def visit(
    browser: Browser, address: str, page_config: AppConfig, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[..., Page]]:
    """Open the page as a new visitor, who shares nothing with the others. Another page of this
    process may have been opened since the first."""
    monkeypatch.setenv("GRADIO_TEMP_DIR", str(page_config.cache_folder))
    contexts: list[BrowserContext] = []

    def open_page(width: int = 1280, height: int = 900, motion: Motion = "no-preference") -> Page:
        viewport = {"width": width, "height": height}
        contexts.append(browser.new_context(viewport=viewport, reduced_motion=motion))
        page = watched(contexts[-1].new_page())
        page.goto(address)
        page.get_by_role("button", name="Generate motion").wait_for()
        return page

    yield open_page
    for context in contexts:
        context.close()


@pytest.fixture
def wav(tmp_path: Path) -> Callable[[float], Path]:
    """A file with so many seconds of something that is no silence."""

    def make(duration_s: float) -> Path:
        path = tmp_path / f"speech-{duration_s:g}.wav"
        write_wav(path, made_waveform(round(16_000 * duration_s)))
        return path

    return make


class Stage:
    """What lets the fake draw its videos."""

    def __init__(self) -> None:
        self.may_draw = [threading.Event() for _ in range(12)]
        self.hold(0)

    def hold(self, drawn: int) -> None:
        """Let only the first ``drawn`` videos be drawn."""
        for index, event in enumerate(self.may_draw):
            if index < drawn:
                event.set()
            else:
                event.clear()


def open_page(
    browser: Browser, address: str, width: int = 1280, motion: Motion = "no-preference"
) -> Page:
    viewport = {"width": width, "height": 900}
    page = watched(browser.new_context(viewport=viewport, reduced_motion=motion).new_page())
    page.goto(address)
    page.get_by_role("button", name=text.GENERATE).wait_for()
    return page


def start(page: Page, speech: Path) -> None:
    page.set_input_files("#speech input[type=file]", str(speech))
    page.locator("#speech").get_by_label("Play", exact=True).first.wait_for()
    page.get_by_role("button", name=text.GENERATE).click()


def show_videos(page: Page, player: str = "#player") -> None:
    """Videos in place of the bodies that the browser draws."""
    page.locator(f"{player} .controls .more").click()
    page.locator(f"{player} .more-box").get_by_role("button", name="Videos").click()
    page.locator(f"{player} .tile").first.wait_for()


STAGED = "count => Number(document.querySelector('#player .stage')?.dataset.bodies) === count"
"""Whether so many bodies are on the stage."""


@pytest.fixture(scope="module")
def stage() -> Stage:
    return Stage()


@contextmanager
def faked(
    stage: Stage,
    tmp_path_factory: pytest.TempPathFactory,
    seconds: float,
    plan: GesturePlan | None = None,
) -> Iterator[str]:
    """The address of a page over a pipeline that draws at once, of speech of so many seconds."""
    weights = make_weights(tmp_path_factory.mktemp("weights"))
    for ending in ("json", "safetensors"):
        shutil.copy(weights / f"globaldiff-global.{ending}", weights / f"globaldiff-full.{ending}")
    config = AppConfig(port=0, weights=weights, temp=tmp_path_factory.mktemp("page"))
    draw = fakes.make_draw(before_video=stage.may_draw.__getitem__, seconds=seconds)
    generate = fakes.make_generate(seconds=seconds, plan=plan)
    with served(config, generate=generate, draw_behind=draw) as url:
        yield url


@pytest.fixture(scope="module")
def fake_address(stage: Stage, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with faked(stage, tmp_path_factory, SECONDS, PLAN) as url:
        yield url


@pytest.fixture(scope="module")
def planned_address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Of a page with a system that performs plans."""
    weights = make_planned_weights(tmp_path_factory.mktemp("planned"))
    with served(AppConfig(port=0, weights=weights, temp=tmp_path_factory.mktemp("page"))) as url:
        yield url


class Windows:
    """What lets the fake make its windows of motion."""

    def __init__(self) -> None:
        self.may_make = [threading.Event() for _ in range(8)]
        self.may_draw = threading.Event()
        """Figures."""

    def let(self, count: int) -> None:
        """Let the first ``count`` be made, and no more."""
        for index, event in enumerate(self.may_make):
            if index < count:
                event.set()
            else:
                event.clear()


@pytest.fixture(scope="module")
def windows() -> Windows:
    return Windows()


@pytest.fixture(scope="module")
def windowed_address(windows: Windows, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Of a page whose motion comes window by window."""
    weights = make_weights(tmp_path_factory.mktemp("weights"))
    config = AppConfig(port=0, weights=weights, temp=tmp_path_factory.mktemp("page"))
    generate = fakes.make_generate(
        seconds=SECONDS,
        before_window=windows.may_make.__getitem__,
        before_figures=windows.may_draw,
    )
    with served(config, generate=generate) as url:
        yield url


@pytest.fixture(scope="module")
def speech(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("speech") / "speech.wav"
    write_wav(path, made_waveform(round(16_000 * SECONDS)))
    return path
