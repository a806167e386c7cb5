"""One Chromium, a page over a worker that a test directs, and the real page with tiny weights."""

import os
import re
import shutil
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import (
    Browser,
    BrowserContext,
    ConsoleMessage,
    Locator,
    Page,
    expect,
    sync_playwright,
)
from playwright.sync_api import TimeoutError as TimedOut

from app import text
from app.config import AppConfig
from app.page.launch import launch
from app.run import tasks as run_tasks
from app.run.batch.saved_run import run_page_request
from app.run.callbacks import RunCallbacks
from app.run.requests.convert import replace_fields
from app.run.requests.requests import AnyRun, DiagnoseRequest
from app.study.design.plan import read_study_plan
from app.study.export import add_plan_and_zip, export_study
from app.study.make.export_folders import EXPORT_STUDY, ExportRequest
from model.plan.plan import GesturePlan, HandPhase, Nod
from model.speech.audio import write_wav
from model.speech.librosa_cache import load_librosa
from tests.app import fakes
from tests.app.study.made_study import draw_noise
from tests.conftest import MadeOnce
from tests.model.made import TINY_NETWORK, TINY_SYSTEMS, made_waveform, make_weights

if TYPE_CHECKING:
    from gradio import Blocks

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
UNUSED = (
    *("WebUIOmniboxPopup", "WebUIOmniboxFullPopup", "WebUIOmniboxAimPopup"),  # half a second each
    *("HttpsUpgrades", "PaintHolding", "Translate", "OptimizationHints", "MediaRouter"),
)
"""Features of Chromium."""
WAITED = re.compile(r'^ *- Expect "\w+".* with timeout \d+ms$', re.MULTILINE)
"""In what `expect` says of a wait."""
PATIENCE_MS = 180_000
"""Longest that any one thing may take on a busy machine."""
expect.set_options(timeout=PATIENCE_MS)
GRADIO_CAUGHT = "Error in watch callback"
"""What Gradio writes to the console where a part of the page throws on a new value."""

Scheme = Literal["light", "dark"]
Look = tuple[int, int, Scheme]
LOOKS: list[Look] = [
    (*size, scheme)
    for size in ((390, 844), (1280, 900), (1600, 1000))
    for scheme in ("light", "dark")
]
"""Width and height of a phone, a laptop and a large screen, each light and dark."""

SECONDS = 3.0
FRAMES = round(30 * SECONDS)
PLAN = GesturePlan(
    SECONDS,
    left=(HandPhase(0.0, 3.0, "rest", (0.2, -0.2, 0.2)),),
    right=(
        HandPhase(0.0, 0.7, "rest", (0.2, -0.2, 0.2)),
        HandPhase(0.7, 1.0, "preparation", (0.2, 0.0, 0.3), "offer"),
        HandPhase(1.0, 1.3, "stroke", (0.2, -0.1, 0.3), "offer", "never"),
        HandPhase(1.3, 2.0, "hold", (0.2, -0.1, 0.3), "offer"),
        HandPhase(2.0, 2.4, "retraction", (0.2, -0.2, 0.2), "offer"),
        HandPhase(2.4, 3.0, "rest", (0.2, -0.2, 0.2)),
    ),
    nods=(Nod(1.2, 5.0),),
)
"""That the first system of the fake page performs."""

LOCKSTEP = "document.querySelector('#player .lockstep').lockstep"
STAGE = "document.querySelector('#player .lockstep').stage"
STAGED = "count => Number(document.querySelector('#player .stage')?.dataset.bodies) === count"
"""Whether so many bodies are on the stage."""
AT_REST = f"() => {STAGE}.isAtRest"
"""Whether the stage has been drawn in full and stands."""
BUILDS_ARE_THERE = "() => !!document.querySelector('.stage[data-builds]')"
"""The one thing that a stage still asks for a while after its first body."""
WIDTHS = """async () => {
    for (let k = 0; k < 2; k++) await new Promise(requestAnimationFrame); // what follows a resize
    return [document.documentElement.scrollWidth, innerWidth];
}"""
IN_SIGHT = """(what) => {
    what.scrollIntoView({ block: "center" }); // again where the page has gone to news meanwhile
    const { top, bottom } = what.getBoundingClientRect();
    return top >= 0 && bottom <= innerHeight;
}"""
_FAILED_SCRIPTS: list[str] = []
_UPLOADS: dict[str, str] = {}
"""Where Gradio keeps the uploads to each page of this process, by its address."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A journey of a minute takes several where other work has the machine, and one that has waited
    in vain there begins once more."""
    again = pytest.mark.flaky(reruns=1, condition=has_timed_out)
    for item in items:
        if item.path.parent == Path(__file__).parent:
            item.add_marker(pytest.mark.timeout(900))
            item.add_marker(again)


def has_timed_out(error: BaseException | None) -> bool:
    """Whether a wait of Playwright's, or of an assertion of its, has come to its end: nothing else
    is ever run twice."""
    is_wait = isinstance(error, AssertionError) and bool(WAITED.search(str(error)))
    return isinstance(error, TimedOut) or is_wait


# ---------------------------------------------------------------- the browser


@pytest.fixture(scope="module")  # it holds the event loop of its thread
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """Its microphone hears a buzz that comes and goes."""
    if CHROMIUM is None:
        pytest.skip("Chromium is not installed (apt-get install chromium)")
    microphone = tmp_path_factory.mktemp("microphone") / "speech.wav"
    write_wav(microphone, made_waveform(16_000 * 8))
    arguments = [
        "--no-sandbox",
        "--autoplay-policy=no-user-gesture-required",
        "--disable-gpu-rasterization",  # there is no GPU
        "--disable-features=" + ",".join(UNUSED),
        "--use-fake-device-for-media-stream",
        "--use-fake-ui-for-media-stream",
        f"--use-file-for-fake-audio-capture={microphone}",
    ]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        yield browser
        browser.close()


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
def no_script_has_failed() -> Iterator[None]:
    """Of the pages that are watched. To fail where it is heard would end the browser's connection,
    and with it all later tests."""
    _FAILED_SCRIPTS.clear()
    yield
    assert not _FAILED_SCRIPTS, "\n".join(_FAILED_SCRIPTS)


def forget_failed_fetches() -> None:
    """Forget scripts that failed because a test had cut the page's connection."""
    _FAILED_SCRIPTS[:] = [each for each in _FAILED_SCRIPTS if "Failed to fetch" not in each]


@pytest.fixture
def visitor(browser: Browser) -> Iterator[Callable[..., BrowserContext]]:
    """A browser that shares nothing with the others, closed after the test."""
    contexts: list[BrowserContext] = []

    def come(
        width: int = 1280,
        height: int = 900,
        scheme: Scheme = "light",
        moves: bool = False,
        has_touch: bool = False,
    ) -> BrowserContext:
        """
        Args:
            moves: whether examples and runs play by themselves: bodies that nobody looks at cost a
                core.
        """
        context = browser.new_context(
            viewport={"width": width, "height": height},
            color_scheme=scheme,
            has_touch=has_touch,
            reduced_motion="no-preference" if moves else "reduce",
        )
        contexts.append(context)
        return context

    yield come
    for context in contexts:
        context.close()


def opened(context: BrowserContext, address: str) -> Page:
    """A page, ready to be used; uploads to it go where it looks for them."""
    if (uploads := _UPLOADS.get(address)) is not None:
        os.environ["GRADIO_TEMP_DIR"] = uploads
    page = watched(context.new_page())
    page.goto(address)
    return ready(page)


def ready(page: Page) -> Page:
    """The page, once it is filled in: what it shows at first comes no more."""
    page.locator("html[data-ready]").wait_for()
    return page


# ---------------------------------------------------------------- pages


@contextmanager
def served(
    config: AppConfig, preloads_models: bool = False, **does: Callable[..., Any]
) -> Iterator[str]:
    """The address of a page, as by `served_blocks`."""
    with served_blocks(config, preloads_models, **does) as page:
        assert page.local_url is not None
        yield page.local_url


@contextmanager
def served_blocks(
    config: AppConfig, preloads_models: bool = False, **does: Callable[..., Any]
) -> "Iterator[Blocks]":
    """A page that is open meanwhile. Gradio keeps uploads where the environment
    says, for all pages of a process: a page that was open before gets its place back.

    Args:
        does: tasks by functions of a test's own, as of `FakeWorker`.
    """
    tasks = [
        each for each in vars(run_tasks).values() if isinstance(each, run_tasks.ImportedFunction)
    ]
    known = {run_page_request.__name__, *(task.name for task in (*tasks, EXPORT_STUDY))}
    assert does.keys() <= known, "a task of another name would be done by the real one"
    load_librosa()  # where nothing is kept it compiles, for longer than a browser waits for a run
    before = os.environ.get("GRADIO_TEMP_DIR")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("app.page.worker.Worker", partial(fakes.FakeWorker, does=does))
        page = launch(config, preloads_models)
    if page.local_url is not None:
        _UPLOADS[page.local_url] = os.environ["GRADIO_TEMP_DIR"]
    yield page
    page.close()
    if before is not None:
        os.environ["GRADIO_TEMP_DIR"] = before


def _of_noise(request: ExportRequest, callbacks: RunCallbacks) -> Any:
    """A study of small noise."""
    plan = replace(read_study_plan(request.plan), video_size_px=64)
    asked = (request.out, request.weights, request.body)
    made = export_study(plan, *asked, callbacks, draw_noise)
    return add_plan_and_zip(made, request)


class Gate:
    """What lets the first so many of something be done."""

    def __init__(self) -> None:
        self._open = [threading.Event() for _ in range(12)]

    def __getitem__(self, index: int) -> threading.Event:
        return self._open[index]

    def let(self, count: int) -> None:
        for index, event in enumerate(self._open):
            (event.set if index < count else event.clear)()


class Fake:
    """Does the runs of a page at once, without models, as a test says."""

    def __init__(self) -> None:
        self.windows, self.videos, self.figures = Gate(), Gate(), threading.Event()
        self.asked: list[AnyRun] = []

    def usual(self) -> None:
        """Nothing is held back."""
        self.windows.let(12)
        self.videos.let(12)
        self.figures.set()
        self.comes_in_windows = False
        self.seconds = SECONDS

    def generate(self, *arguments: Any) -> Any:
        if isinstance(arguments[0], DiagnoseRequest):
            return run_page_request(*arguments)
        before = self.windows.__getitem__ if self.comes_in_windows else None
        given: dict[str, Any] = {"before_window": before, "before_figures": self.figures}
        run = fakes.make_generate(self.asked.append, seconds=self.seconds, plan=PLAN, **given)
        return run(*arguments)

    def draw_run_videos(self, *arguments: Any) -> Any:
        draw = fakes.make_draw(before_video=self.videos.__getitem__, seconds=self.seconds)
        return draw(*arguments)

    @property
    def does(self) -> dict[str, Any]:
        return {
            "run_page_request": self.generate,
            "draw_run_videos": self.draw_run_videos,
            "export_from_request": _of_noise,
        }


@pytest.fixture(scope="session")
def the_fake() -> Fake:
    return Fake()


@pytest.fixture
def fake(the_fake: Fake) -> Fake:
    """What the fake page's worker does: at first everything, at once."""
    the_fake.usual()
    return the_fake


@pytest.fixture(scope="session")
def fake_address(
    the_fake: Fake, made_once: MadeOnce, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[str]:
    """Of a page over `Fake`, which offers globaldiff/local, /global and /full."""
    systems = {**TINY_SYSTEMS, "globaldiff/full": TINY_NETWORK}
    weights = made_once("three-systems", lambda folder: make_weights(folder, systems))
    config = AppConfig(port=0, weights=weights, temp_folder=tmp_path_factory.mktemp("page"))
    with served(config, **the_fake.does) as url:
        yield url


@pytest.fixture(scope="session")
def page_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the real page keeps all files."""
    return tmp_path_factory.mktemp("page")


def _without_figures(ask: AnyRun, *told: Any) -> None:
    """They are three quarters of a short run's time, and looked at where `Fake` makes one."""
    run_page_request(replace_fields(ask, has_figures=False), *told)


@pytest.fixture(scope="session")
def real_address(all_weights: Path, page_files: Path) -> Iterator[str]:
    """Of the real page, with a system that performs plans among its tiny ones."""
    config = AppConfig(port=0, weights=all_weights, temp_folder=page_files)
    with served(config, run_page_request=_without_figures, export_from_request=_of_noise) as url:
        yield url


@pytest.fixture(scope="session")
def speech(made_once: MadeOnce) -> Path:
    """As long as the fake's motion."""
    folder = made_once(
        "three-seconds",
        lambda at: write_wav(at / "speech.wav", made_waveform(round(16_000 * SECONDS))),
    )
    return folder / "speech.wav"


# ---------------------------------------------------------------- what visitors do


def give(page: Page, field: str, *paths: Path) -> None:
    """Files for a field, which tells of each once it is there."""
    page.set_input_files(f"{field} input[type=file]", [str(path) for path in paths])
    for path in paths:
        page.locator(field).get_by_text(path.stem[:12]).first.wait_for()


def give_speech(page: Page, path: Path) -> None:
    page.set_input_files("#speech input[type=file]", str(path))
    page.locator("#speech").get_by_label("Play", exact=True).first.wait_for()


def start(page: Page, speech: Path) -> None:
    give_speech(page, speech)
    page.get_by_role("button", name=text.GENERATE).click()


def turn_to_part(page: Page, part: str, player: str = "#player") -> None:
    """Choose a part of the results: Watch, Numbers, Figures or Files."""
    press(page.locator(f"{player} .parts-bar"), part)


def staged(page: Page, count: int) -> Page:
    page.wait_for_function(STAGED, arg=count)
    return page


def tick(page: Page, systems: Sequence[str]) -> None:
    """These alone, as the page calls them."""
    for label in page.locator("#systems label").all():
        label.locator("input").set_checked((label.inner_text()).strip() in systems)


def stage_digest(page: Page) -> str:
    """Return the digest of the stage's picture at rest: a failed assertion would take minutes to
    compare the bytes of two pictures line by line."""
    page.wait_for_function(AT_REST)
    return sha256(page.locator("#player .stage canvas").screenshot()).hexdigest()


def bar_of(page: Page, player: str = "#player") -> Locator:
    return page.locator(f"{player} .controls")


def press(place: Page | Locator, name: str | re.Pattern[str]) -> None:
    place.get_by_role("button", name=name, exact=True).click()


def tabbed(page: Page) -> str:
    """The name of what Tab leads to, where a keyboard's user sees that it is."""
    page.keyboard.press("Tab")
    name, outline = page.evaluate(
        """() => {
            const at = document.activeElement;
            const name = at.getAttribute('aria-label') ?? at.textContent.trim();
            return [name, getComputedStyle(at).outlineStyle];
        }"""
    )
    assert outline != "none", name
    return name


def put_clock(page: Page, seconds: float) -> None:
    page.evaluate(f"seconds => {LOCKSTEP}.seek(seconds)", seconds)


def saved(page: Page, link: Locator, folder: Path) -> Path:
    """What a click downloads, under the name that it suggests."""
    with page.expect_download() as download:
        link.click()
    path = folder / download.value.suggested_filename
    download.value.save_as(path)
    return path


def turn_to(page: Page, look: Look) -> None:
    """Give the page another window and scheme, as its visitor's system would."""
    width, height, scheme = look
    page.set_viewport_size({"width": width, "height": height})
    page.emulate_media(color_scheme=scheme)
    if page.locator("gradio-app, .gradio-container").count():  # it asks but once
        page.evaluate("dark => document.body.classList.toggle('dark', dark)", scheme == "dark")


def expect_fit(page: Page, what: Locator | None = None) -> None:
    """In its window's width; and an element, once scrolled to, is all in sight."""
    width, window = page.evaluate(WIDTHS)
    assert width <= window
    if what is not None:
        page.wait_for_function(IN_SIGHT, arg=what.element_handle())


def findings(page: Page, place: str = "html") -> list[str]:
    """Of axe's grave ones each rule with the elements that break it."""
    found: dict[str, Any] = Axe().run(page, context=place).response
    return [
        f"{each['id']}: {node['html'][:160]} {node['failureSummary'][:200]}"
        for each in found["violations"]
        if each["impact"] in ("serious", "critical")
        for node in each["nodes"]
    ]
