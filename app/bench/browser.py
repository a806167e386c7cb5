"""What a visitor waits for and sees, measured in a real Chromium: for `app.bench`."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.bench.measured import Figure, served_page
from model.systems.registry import list_systems, usual_systems

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

WINDOW = {"width": 1280, "height": 800}
WITHOUT = (
    "The browser's rows are left out: they need playwright (requirements-dev.txt) and Chromium "
    "(apt-get install chromium)."
)
_FIRST_S, _LATER_S = 4.0, 6.0
"""To settle on how coarsely to draw, and to count pictures."""
WARM_UP_S = 30.0
"""In which a page that nobody uses has read all models."""
_PATIENCE_MS = 300_000
_NOTE = """() => {
    const times = (window.benchTimes = {});
    let asked = 0; // bodies; an example plays on until the run has begun
    const note = (name) => (times[name] ??= performance.now());
    document.addEventListener("click", ({ target }) => {
        if (!target.closest("button")?.matches("#generate, #generate *")) return;
        for (const name of Object.keys(times)) delete times[name];
        asked = document.querySelectorAll("#systems input:checked").length;
        note("click");
    }, true);
    let drawn = 0;
    setInterval(() => {
        const root = document.querySelector("#player .lockstep");
        const { lockstep, stage } = root ?? {};
        const isOther = asked > 0 && root?.classList.contains("opening");
        if (!stage || root.hidden || !stage.hasBodies || isOther) return;
        if (lockstep.isPlaying && lockstep.frame > 0 && stage.pictures > drawn) note("moves");
        drawn = stage.pictures;
        if (stage.names.some((name) => stage.isWhole(name))) note("whole");
        if (stage.names.filter((name) => stage.isWhole(name)).length === asked) note("all");
        if (document.querySelector("#numbers tr")?.offsetParent) note("measured");
        if (document.querySelector("#bundle")?.offsetParent) note("done");
    }, 10);
}"""
"""Notes in the page when what a visitor waits for is there, in milliseconds."""


@dataclass(frozen=True)
class Waits:
    """Seconds from the click on the button."""

    moves: float
    """Until bodies are seen to move."""
    whole: float
    """Until all of one body's motion is on the stage, as a page without windows begins with."""
    all: float
    """Until all motion of all bodies is."""
    measured: float
    done: float
    """With figures."""


def chromium_path() -> str | None:
    """The browser of this machine."""
    names = ("chromium", "chromium-browser", "google-chrome")
    return next((path for name in names if (path := shutil.which(name))), None)


@contextmanager
def opened_browser() -> Iterator[Browser | None]:
    """Chromium, or None where it or what steers it is missing."""
    path = chromium_path()
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        path = None
    if path is None:
        yield None
        return
    flags = ["--no-sandbox", "--autoplay-policy=no-user-gesture-required"]
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=path, args=flags)
        yield opened
        opened.close()


def opened_page(browser: Browser, address: str) -> Page:
    """The page as a new visitor sees it; it notes its times."""
    page = browser.new_context(viewport=WINDOW).new_page()  # type: ignore[arg-type]
    page.set_default_timeout(_PATIENCE_MS)
    page.add_init_script(f"window.addEventListener('DOMContentLoaded', {_NOTE})")
    page.goto(address)
    page.locator("#generate").wait_for()
    return page


def opening_s(browser: Browser, address: str) -> float:
    """From the address to a body that moves, with nothing clicked."""
    started = time.monotonic()
    page = opened_page(browser, address)
    page.wait_for_function("() => window.benchTimes?.moves")
    seconds = time.monotonic() - started
    page.context.close()
    return seconds


def run_waits(page: Page, clip: Path, systems: Sequence[str]) -> Waits:
    """A run of some systems, from the click to its end, in a page that is loaded anew."""
    page.reload()
    page.locator("#generate").wait_for()
    page.set_input_files("#speech input[type=file]", str(clip))
    page.locator("#speech").get_by_label("Play", exact=True).first.wait_for()
    for box in page.locator("#systems input[type=checkbox]").all():
        if box.is_checked() != (box.get_attribute("name") in systems):
            box.click()
    page.wait_for_timeout(1_000)
    page.locator("#generate").click()
    names = tuple(field.name for field in fields(Waits))
    page.wait_for_function("names => names.every(name => name in window.benchTimes)", arg=names)
    times = page.evaluate("window.benchTimes")
    return Waits(*((times[name] - times["click"]) / 1000 for name in names))


def pictures_per_second(page: Page, level: int | None = None) -> tuple[float, dict[str, Any]]:
    """Of the stage while it plays, and how coarsely it is drawn then.

    Args:
        level: of coarseness, held; None lets the page find out.
    """
    page.evaluate(
        """level => {
            const { lockstep, stage } = document.querySelector("#player .lockstep");
            stage.pace.hold(level);
            lockstep.setLoop([0, lockstep.duration]);
            lockstep.seekFrame(0);
            return lockstep.isPlaying || lockstep.play();
        }""",
        level,
    )
    page.wait_for_timeout(1000 * _FIRST_S)
    counts = []
    for wait_s in (_LATER_S, 0.0):
        counts.append(
            page.evaluate(
                "[performance.now(), document.querySelector('#player .lockstep').stage.pictures]"
            )
        )
        page.wait_for_timeout(1000 * wait_s)
    (begun, first), (ended, last) = counts
    found = page.evaluate("document.querySelector('#player .lockstep').stage.pace.level")
    return 1000 * (last - first) / (ended - begun), found


def time_browser(clip: Path, weights: Path, folder: Path) -> list[Figure]:
    """What a visitor waits for and sees in a Chromium that draws on the processor: from the address
    to the example that moves, from the click to the first movement and to the end, and pictures a
    second of one body and of five; each beside what it would be without windows, and without
    coarser bodies."""
    five = [name for name in usual_systems("bench-browser") if name in list_systems(weights)]
    with opened_browser() as browser:
        if browser is None:
            sys.stderr.write(WITHOUT + "\n")
            return []
        with served_page(weights, folder) as address:
            fresh = opening_s(browser, address)
            figures = [Figure("opening a fresh page to movement", fresh, "s", "at most 10 s")]
            time.sleep(WARM_UP_S)
            warm = opening_s(browser, address)
            figures.append(Figure("opening the page again to movement", warm, "s", "at most 3 s"))
            page = opened_page(browser, address)
            run_waits(page, clip, five)  # each family's first motion takes longer
            for systems in (five[-1:], five):
                waits = run_waits(page, clip, systems)
                what = f"{len(systems)} system{'s' if len(systems) > 1 else ''}, 10 s clip"
                finest, _ = pictures_per_second(page, level=0)
                rate, level = pictures_per_second(page)
                whose = f"stage, {len(systems)} of {WINDOW['width']} px"
                coarse = f"{whose}, at {level['pixels']:g} of the pixels"
                figures += [
                    Figure(f"click to movement, {what}", waits.moves, "s", "at most 2 s"),
                    Figure(f"click to a first whole motion, {what}", waits.whole, "s"),
                    Figure(f"click to all motion, {what}", waits.all, "s"),
                    Figure(f"click to measures, {what}", waits.measured, "s", "at most 6 s"),
                    Figure(f"click to figures, {what}", waits.done, "s", "at most 11 s"),
                    Figure(f"{whose}, whole meshes", finest, "pictures/s"),
                    Figure(coarse, rate, "pictures/s", "at least 15"),
                ]
    return figures
