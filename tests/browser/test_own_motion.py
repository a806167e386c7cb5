"""A visitor compares motion files of their own, in a real Chromium."""

import base64
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Page, Position, expect

from app import text
from app.page.tabs.own_motion import TAB
from app.run.examples import CLEAN, slide, tremble
from model.motion.motion import load_motion, save_motion
from tests.browser.conftest import PATIENCE_MS, in_every_look, show_videos
from tests.helpers import smooth_motion_example

END: Position = {"x": 120, "y": 190}
GESTURES = """File type = "ooTextFile"
Object class = "TextGrid"
item [1]:
 class = "IntervalTier"
 name = "words"
 intervals [1]:
 xmin = 0.2
 xmax = 0.5
 text = "hello"
item [2]:
 class = "IntervalTier"
 name = "gesture_left"
 intervals [1]:
 xmin = 0
 xmax = 0.3
 text = "rest"
 intervals [2]:
 xmin = 0.3
 xmax = 0.6
 text = "stroke beat"
"""

pytestmark = [pytest.mark.browser, pytest.mark.gl]

TAKES_FILES = """() => {
    const dataTransfer = new DataTransfer();
    dataTransfer.items.add(new File([], "a"));
    const over = new DragEvent("dragover", { dataTransfer, bubbles: true, cancelable: true });
    document.querySelector("h1")?.dispatchEvent(over);
    return over.defaultPrevented;
}"""
DROPPED = """(content) => {
    const bytes = Uint8Array.from(atob(content), (letter) => letter.charCodeAt(0));
    const dataTransfer = new DataTransfer();
    dataTransfer.items.add(new File([bytes], "saved.run.zip"));
    const told = { dataTransfer, bubbles: true, cancelable: true };
    document.querySelector("h1").dispatchEvent(new DragEvent("drop", told));
}"""


def test_two_files_of_ones_own_are_measured_and_drawn(
    visit: Callable[..., Page], tmp_path: Path
) -> None:
    paths = [tmp_path / f"{name}.npz" for name in ("mine", "theirs")]
    for seed, path in enumerate(paths):
        save_motion(smooth_motion_example(45, seed=seed), path)
    transcript = tmp_path / "said.TextGrid"
    transcript.write_text(GESTURES)
    page = visit(motion="reduce")
    page.get_by_role("tab", name=TAB).click()
    page.get_by_role("button", name="Measure and compare").click()
    expect(page.locator("#own-message")).to_contain_text("at least one", timeout=PATIENCE_MS)

    page.set_input_files("#own-motions input[type=file]", [str(path) for path in paths])
    expect(page.locator("#own-motions")).to_contain_text("theirs")
    page.set_input_files("#own-transcript input[type=file]", str(transcript))
    expect(page.locator("#own-transcript")).to_contain_text("said")
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

    expect(page.locator("#own-status")).to_contain_text(text.VIDEOS_DONE, timeout=3 * PATIENCE_MS)

    # The link, in a second browser: in the tab that it came from.
    href = page.locator("#own-runs .link a").evaluate("link => link.href")
    other = visit(motion="reduce")
    other.goto(href)
    expect(other.locator("#own-numbers thead th[data-name]")).to_have_text(["mine", "theirs"])
    expect(other.get_by_role("tab", name=TAB)).to_have_attribute("aria-selected", "true")
    stage = other.locator("#own-player .stage")
    expect(stage).to_have_attribute("data-bodies", "2", timeout=PATIENCE_MS)
    show_videos(other, "#own-player")
    expect(other.locator("#own-player video")).to_have_count(2)
    for video in other.locator("#own-player video").all():
        other.wait_for_function("video => video.duration > 1", arg=video.element_handle())

    # Gestures stand below the words; rest is not drawn.
    lanes = other.locator("#own-player .lane:has(.words)")
    expect(lanes).to_contain_text(["Words", "Gesture left"])
    assert lanes.locator("span").evaluate_all("labels => labels.map((each) => each.className)") == [
        "",
        "stroke",
    ]

    # All of it fits a phone, a laptop and a large screen, light and dark.
    bar = other.locator("#own-player .controls")
    for height in in_every_look(other):
        for mode in ("Ghost", "All"):
            bar.get_by_role("button", name=mode, exact=True).click()
            picture = other.locator("#own-player .tile:visible .picture").first
            picture.scroll_into_view_if_needed()
            box = picture.bounding_box()
            assert box is not None and 100 < box["height"] < height
    other.set_viewport_size({"width": 1280, "height": 900})
    bar.get_by_role("button", name="Worst second", exact=True).click()
    expect(other.locator("#own-player .worst-line")).to_contain_text("1 of")
    other.reload()

    # On the stage, who turns the camera turns it for all, and keys bring it back.
    expect(stage).to_have_attribute("data-bodies", "2", timeout=PATIENCE_MS)
    canvas = stage.locator("canvas")
    canvas.scroll_into_view_if_needed()
    back = other.locator("#own-player").get_by_role("button", name="Back to the front")
    expect(back).not_to_be_visible()
    canvas.drag_to(canvas, source_position={"x": 60, "y": 160}, target_position=END)
    expect(back).to_be_visible()
    canvas.press("ArrowLeft")
    frame = other.locator("#own-player .lockstep").evaluate("root => root.lockstep.frame")
    assert frame == 0, "the arrow turned the bodies, not the time"
    canvas.press("Home")
    expect(back).not_to_be_visible()
    other.context.close()


def test_a_zip_is_measured_as_a_set_and_its_worst_clip_opens_on_the_stage(
    visit: Callable[..., Page], tmp_path: Path
) -> None:
    zipped, clean = tmp_path / "mine.zip", load_motion(CLEAN)
    with zipfile.ZipFile(zipped, "w") as archive:
        for clip, motion in (("calm", clean), ("wild", tremble(clean))):
            save_motion(motion, tmp_path / f"{clip}.npz")
            archive.write(tmp_path / f"{clip}.npz", f"results/{clip}.npz")
    page = visit(motion="reduce")
    page.get_by_role("tab", name=TAB).click()
    page.set_input_files("#own-motions input[type=file]", str(zipped))
    expect(page.locator("#own-motions")).to_contain_text("mine")
    page.get_by_role("button", name="Measure and compare").click()
    sets = page.locator("#own-sets")
    expect(sets.locator(".findings li").first).to_contain_text("jerk", timeout=3 * PATIENCE_MS)
    expect(sets.locator("tbody tr").first).to_contain_text("[")
    worst = sets.locator(".findings li b").first.inner_text()
    sets.get_by_role("button", name="Open on the stage").first.click()
    stage = page.locator("#own-player .stage")
    expect(stage).to_have_attribute("data-bodies", "1", timeout=3 * PATIENCE_MS)
    expect(page.locator("#own-status")).to_contain_text(
        "Measured 1 motion", timeout=3 * PATIENCE_MS
    )
    expect(page.locator("#own-runs .link a")).to_be_visible()
    expect(sets.locator(".findings li b").first).to_have_text(worst)

    # The run as a file, dropped on another page: it opens again.
    with page.expect_download() as download:
        page.locator("#own-runs").get_by_role("link", name=text.SAVE_RUN).click()
    assert download.value.suggested_filename.endswith(".run.zip")
    with page.expect_download() as alone:
        page.locator("#own-runs").get_by_role("link", name=text.SAVE_PAGE).click()
    assert alone.value.suggested_filename.endswith(".run.html")
    other = visit(motion="reduce")
    content = base64.b64encode(download.value.path().read_bytes()).decode("ascii")
    other.wait_for_function(TAKES_FILES)
    other.evaluate(DROPPED, content)
    expect(other.locator("#own-status")).to_contain_text(
        "Opened from its file", timeout=3 * PATIENCE_MS
    )
    expect(other.locator("#own-player .stage")).to_have_attribute("data-bodies", "1")
    expect(other.locator("#own-runs .link a")).to_be_visible()
    page.context.close()


def test_the_gravest_findings_stand_beside_the_stage_and_lead_to_their_moment(
    visit: Callable[..., Page], tmp_path: Path
) -> None:
    save_motion(slide(load_motion(CLEAN)), tmp_path / "sliding feet.npz")
    page = visit(motion="reduce")
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.get_by_role("tab", name=TAB).click()
    page.locator("#own-videos input").uncheck()
    page.set_input_files("#own-motions input[type=file]", str(tmp_path / "sliding feet.npz"))
    expect(page.locator("#own-motions")).to_contain_text("sliding")
    page.get_by_role("button", name="Measure and compare").click()
    player = page.locator("#own-player")
    gravest = player.locator(".gravest li").first
    expect(gravest).to_contain_text("Feet on the ground slide", timeout=3 * PATIENCE_MS)
    page.wait_for_function("document.querySelector('#own-player .stage').dataset.bodies === '1'")

    # A click goes there: of the sentence's button, and of its flag on the time line.
    at = "document.querySelector('#own-player .lockstep').lockstep.time"
    gravest.get_by_role("button").click()
    worst_s = page.evaluate(at)
    assert worst_s > 0 and gravest.get_by_role("button").inner_text().startswith("Show 0:")
    page.evaluate("document.querySelector('#own-player .lockstep').lockstep.seekFrame(0)")
    player.locator(".lane .flag").first.click()
    assert page.evaluate(at) == worst_s

    # A link shows the same moment of this run, though no display is switched.
    player.locator(".controls .more").click()
    player.get_by_role("button", name="Copy link to this picture").click()
    link = page.evaluate("navigator.clipboard.readText()")
    other = visit(motion="reduce")
    other.goto(link)
    expect(other.locator("#own-player .gravest li").first).to_contain_text("Feet on the ground")
    other.wait_for_function(
        "at => Math.abs(document.querySelector('#own-player .lockstep').lockstep.time - at) < 0.05",
        arg=worst_s,
    )
