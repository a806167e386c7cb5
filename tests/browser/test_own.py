"""Files of one's own on the real page: measured, seen, compared, kept; several clips at once."""

import base64
import io
import json
import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import BrowserContext, Page, expect

from app import text
from app.page.tabs.own_motion import CLIP_LABEL, TAB
from app.run.bodies import align_average_to_origin
from app.run.examples import CLEAN, add_foot_sliding
from conventions.joints import HANDS
from model.formats.convention_detection import MEAN_HANDS_SUBSTITUTE
from model.motion.motion import load_motion, save_motion
from model.plan.annotation_files import Interval, NamedTier, format_textgrid
from model.speech.audio import write_wav
from renderer.video.compose import label_band_height
from tests.browser.conftest import (
    AT_REST,
    LOCKSTEP,
    LOOKS,
    STAGED,
    bar_of,
    expect_fit,
    findings,
    give,
    opened,
    press,
    saved,
    staged,
    tick,
    turn_to,
    turn_to_part,
    watched,
)
from tests.helpers import smooth_motion_example
from tests.model.formats.made import FROM_Y, Person, joints_of, turned
from tests.model.made import made_waveform

pytestmark = [pytest.mark.browser, pytest.mark.gl]

FRAMES = 8
SHOWN = 5
TAG_PX = 34
"""Of a body's name, above its picture."""
SMALL = (96, 72)
"""Pictures are compared so coarsely that edges and an encoder's noise do not count."""
PLAYER = "document.querySelector('#own-player .lockstep')"
OWN_STAGED = STAGED.replace("#player", "#own-player")


@pytest.fixture
def page(visitor: Callable[..., BrowserContext], real_address: str) -> Page:
    """The page of a new visitor, as a laptop shows it: a second try begins anew, too."""
    return opened(visitor(), real_address)


def give_motions(page: Page, *paths: Path) -> None:
    if (clear := page.locator("#own-motions").get_by_label("Clear")).count():
        clear.first.click()
    give(page, "#own-motions", *paths)
    press(page, "Measure and compare")


def canvas_of(page: Page) -> np.ndarray:
    """The stage, once it rests on a frame."""
    page.evaluate(f"{PLAYER}.lockstep.seekFrame({SHOWN})")
    page.wait_for_function(AT_REST.replace("#player", "#own-player"))
    picture = page.locator("#own-player .stage canvas").screenshot()
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"))


def ask_for_video(page: Page) -> None:
    bar_of(page, "#own-player").locator(".more").click()
    press(page.locator("#own-player .more-box"), "Make a video of this view")


def made(page: Page, folder: Path) -> np.ndarray:
    """The picture of that frame in the video of what is seen, names and all."""
    link = page.locator("#own-seen a")
    before = link.get_attribute("href") if link.count() else ""
    ask_for_video(page)
    expect(page.locator(f"#own-seen a:not([href='{before}'])")).to_have_count(1)
    with av.open(str(saved(page, link, folder))) as file:
        frames = [frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)]
    assert len(frames) == FRAMES
    return frames[SHOWN]


def coarse(picture: np.ndarray) -> np.ndarray:
    return np.asarray(Image.fromarray(picture).resize(SMALL, Image.Resampling.BOX)).astype(float)


def away(canvas: np.ndarray, video: np.ndarray, page: Page) -> float:
    """Mean difference in grey levels of the pictures of all bodies, without their names."""
    told = json.loads(page.evaluate(f"{PLAYER}.viewState()"))
    width, height = told["pictureSize"]
    columns = min(told["columns"], len(told["shown"])) if told["mode"] == "grid" else 1
    seen = canvas[TAG_PX : TAG_PX + round(height), : round(columns * width)]
    band = video.shape[0] - round(video.shape[1] * seen.shape[0] / seen.shape[1])
    shorter = video.shape[1] // (columns if told["mode"] == "grid" else 2)
    assert abs(band - label_band_height(min(shorter, video.shape[0] - band))) < 8
    return float(np.abs(coarse(seen) - coarse(video[band:])).mean())


def test_files_of_ones_own_are_measured_seen_compared_and_made_a_video_of(
    page: Page, tmp_path: Path
) -> None:
    paths = [tmp_path / f"{name}.npz" for name in ("mine", "theirs")]
    for seed, path in enumerate(paths):
        save_motion(smooth_motion_example(FRAMES, seed=seed), path)
    transcript = tmp_path / "words.TextGrid"
    hand = Interval(0.0, 0.2, "rest"), Interval(0.2, 0.4, "stroke beat")
    tiers = NamedTier("words", (Interval(0.1, 0.3, "hello"),)), NamedTier("gesture_left", hand)
    transcript.write_text(format_textgrid(tiers, 0.4))
    page.get_by_role("tab", name=TAB).click()
    press(page, "Measure and compare")
    expect(page.locator("#own-message")).to_contain_text("at least one")
    page.locator("#own-videos input").uncheck()
    give_motions(page, *paths, transcript)
    expect(page.locator("#own-status")).to_contain_text("Measured 2 motions")
    expect(page.locator("#own-message")).to_be_hidden()
    expect(page.locator("#own-numbers thead th[data-name]")).to_have_text(["mine", "theirs"])
    expect(page.locator("#own-downloads")).to_contain_text("diagnostics")
    page.wait_for_function(OWN_STAGED, arg=2)
    lanes = page.locator("#own-player .lane:has(.words)")  # gestures below the words, no rest
    expect(lanes).to_contain_text(["Words", "Gesture left"])
    classes = "labels => labels.map((each) => each.className)"
    assert lanes.locator("span").evaluate_all(classes) == ["", "stroke"]

    # Who turns the camera turns it for all, and keys bring it back.
    canvas = page.locator("#own-player .stage canvas")
    canvas.scroll_into_view_if_needed()
    back = page.locator("#own-player").get_by_role("button", name="Front view")
    expect(back).to_be_hidden()
    end = {"x": 120, "y": 190}
    canvas.drag_to(canvas, source_position={"x": 60, "y": 160}, target_position=end)
    expect(back).to_be_visible()
    canvas.press("ArrowLeft")
    assert page.evaluate(f"{PLAYER}.lockstep.frame") == 0, "the arrow turned the bodies, not time"
    canvas.press("Home")
    expect(back).to_be_hidden()

    # A video shows what the stage does: not what it was like before.
    plain = canvas_of(page)
    page.evaluate(
        f"""() => {{
            const {{ look, stage }} = {PLAYER};
            look.set('hasTrail', false); look.set('hasHeat', true); look.set('isWhole', true);
            stage.orbit.place([0.6, 0.2, 1.2, 0.1, 0]);
            stage.setCloseUp('both');
        }}"""
    )
    seen = canvas_of(page)
    video = made(page, tmp_path)
    found, other = away(seen, video, page), away(plain, video, page)
    assert found < 10 and found < 0.4 * other, (found, other)
    expect(page.locator("#own-seen")).to_contain_text("2 bodies, 0.3 s")
    page.evaluate(
        f"""() => {{
            const told = JSON.parse({PLAYER}.viewState());
            told.camera[2] = 99;
            {PLAYER}.viewState = () => JSON.stringify(told);
        }}"""
    )
    ask_for_video(page)
    expect(page.locator("#own-seen")).to_contain_text("zoom must be from 0.4 to 10; got 99")
    for look in ((390, 844, "dark"), (1280, 900, "light")):
        turn_to(page, look)
        for _ in range(2):  # one over another, and back
            press(bar_of(page, "#own-player"), "Ghost")
            expect_fit(page, page.locator("#own-player .stage-view"))

    # Beside another run of this visitor.
    give_motions(page, paths[0])
    with page.context.expect_page() as followed:
        page.locator("#own-runs").get_by_role("link", name=text.COMPARE_LAST).click()
    both = watched(followed.value)
    names = both.locator("#numbers thead th[data-name]")
    expect(names).to_contain_text(["mine (A)", "mine (B)", "theirs (A)"])
    both.close()


def test_the_worst_of_a_set_shows_its_findings_and_is_kept_as_a_file(
    page: Page, tmp_path: Path
) -> None:
    page.get_by_role("tab", name=TAB).click()
    page.locator("#own-videos input").uncheck()
    zipped, clean = tmp_path / "mine.zip", load_motion(CLEAN).part(slice(180))
    with zipfile.ZipFile(zipped, "w") as archive:
        for clip, motion in (("calm", clean), ("sliding", add_foot_sliding(clean))):
            save_motion(motion, tmp_path / f"{clip}.npz")
            archive.write(tmp_path / f"{clip}.npz", f"results/{clip}.npz")
    give_motions(page, zipped)
    sets = page.locator("#own-sets")
    expect(sets.locator("tbody tr").first).to_contain_text("[")
    worst = sets.locator(".findings li", has_text="slid")
    sentence = worst.locator("b").inner_text()
    page.get_by_label(CLIP_LABEL).click()
    page.get_by_role("option", name="sliding: ").click()
    expect(page.locator("#own-status")).to_contain_text("Measured 1 motion")
    page.wait_for_function(OWN_STAGED, arg=1)
    expect(sets.locator(".findings li b", has_text=sentence)).to_have_count(1)

    # A click goes there: of the sentence's button, and of its flag on the time line.
    player = page.locator("#own-player")
    gravest = player.locator(".gravest li").first
    expect(gravest).to_contain_text("Feet slide")
    gravest.get_by_role("button").click()
    worst_s = page.evaluate(f"{PLAYER}.lockstep.time")
    assert page.evaluate(f"{PLAYER}.stage.orbit.state[2]") > 2, "the feet are seen from near"
    assert page.evaluate(f"{PLAYER}.look.get('isWhole')"), "and not cut off"
    assert worst_s > 0 and gravest.get_by_role("button").inner_text().startswith("Show 0:")
    page.evaluate(f"{PLAYER}.lockstep.seekFrame(0)")
    player.locator(".lane .flag").first.click()
    assert page.evaluate(f"{PLAYER}.lockstep.time") == worst_s

    # A link shows the same moment in the same tab, though no display is switched.
    page.wait_for_url(re.compile(r"[?]run=.*#stage&.*t="))
    other = watched(page.context.new_page())
    other.goto(page.url)
    expect(other.locator("#own-player .gravest li").first).to_contain_text("Feet slide")
    expect(other.get_by_role("tab", name=TAB)).to_have_attribute("aria-selected", "true")
    other.wait_for_function(f"at => Math.abs({PLAYER}.lockstep.time - at) < 0.05", arg=worst_s)

    # The run as a file, dropped anywhere, opens again.
    turn_to_part(page, "Files", "#own-player")
    saving = page.locator("#own-downloads")
    kept = saved(page, saving.get_by_role("link", name=text.SAVE_RUN), tmp_path)
    assert kept.name.endswith(".zip")
    other.get_by_role("tab", name=text.MOTION_TAB, exact=True).click()
    other.evaluate(DROPPED, base64.b64encode(kept.read_bytes()).decode("ascii"))
    expect(other.locator("#own-status")).to_contain_text("Opened the saved run")
    other.wait_for_function(OWN_STAGED, arg=1)
    expect(other.locator("#own-runs .link a")).to_be_visible()
    other.close()


DROPPED = """async (content) => {
    const bytes = Uint8Array.from(atob(content), (letter) => letter.charCodeAt(0));
    const dataTransfer = new DataTransfer();
    dataTransfer.items.add(new File([bytes], "saved.run.zip"));
    const told = { dataTransfer, bubbles: true, cancelable: true };
    const heading = document.querySelector("h1");
    const isTaken = () => {
        const over = new DragEvent("dragover", told);
        heading.dispatchEvent(over);
        return over.defaultPrevented;
    };
    while (!isTaken()) await new Promise(requestAnimationFrame);
    heading.dispatchEvent(new DragEvent("drop", told));
}"""


def test_several_clips_are_one_run_each_is_seen_and_all_are_kept_as_one_page(
    page: Page, tmp_path: Path
) -> None:
    short, talk = tmp_path / "short.wav", tmp_path / "talk.wav"
    write_wav(short, made_waveform(16_000))
    write_wav(talk, made_waveform(16_000 * 2))
    page.get_by_role("tab", name=text.MOTION_TAB, exact=True).click()
    page.get_by_role("button", name=text.CLIPS_LABEL).first.click()
    give(page, "#several", talk, short)
    tick(page, ["local", "global"])
    press(page, text.GENERATE)
    rows = page.locator("#clips tbody tr")
    for step in ("[12] of 2", "2 of 2", "2 of 2 clips are done"):  # one wait for each clip
        expect(page.locator("#status")).to_contain_text(re.compile(step))
    expect(rows).to_have_count(2)
    expect(page.locator("#clips .dots li")).to_have_count(2)
    expect(page.locator("#clips tfoot td").first).to_contain_text("[")
    staged(page, 2)
    lasts = f"seconds => Math.round({LOCKSTEP}.duration) === seconds"
    page.wait_for_function(lasts, arg=1)
    page.locator("#clip").get_by_role("radio", name="talk").check()
    page.wait_for_function(lasts, arg=2)
    page.reload()
    staged(page, 2)
    expect(page.locator("#clip").get_by_role("radio", name="talk")).to_be_checked()
    page.wait_for_function(lasts, arg=2)
    for look in (LOOKS[0], LOOKS[2]):
        turn_to(page, look)
        expect_fit(page)

    turn_to_part(page, "Files")
    link = page.locator("#downloads").get_by_role("link", name=text.SAVE_PAGE)
    alone = saved(page, link, tmp_path)
    other = watched(page.context.new_page())
    other.goto(alone.as_uri())
    expect(other.locator("header tbody tr")).to_have_count(2)
    other.locator("header select").select_option("talk")
    other.locator(".lane[data-name]").first.wait_for()
    other.locator(".stage[data-bodies='2']").wait_for()
    other.close()


OPENED = """() => {
    const box = document.querySelector("#own-player .stage .reading details");
    if (box && !box.open) box.querySelector("summary").click();
    return box?.querySelector("li").checkVisibility();
}"""


def test_a_file_seen_wrong_is_put_right_by_chips_and_comes_back_from_a_bvh(
    page: Page, tmp_path: Path
) -> None:
    """Z up, in centimetres, with hands told from the mean hand, as no file of this layout has."""
    truth = Person(3).motion(20)
    poses, trans = turned(truth, FROM_Y["z"])
    poses[:, list(HANDS)] -= MEAN_HANDS_SUBSTITUTE
    theirs = tmp_path / "theirs.npz"
    arrays = {"poses": poses.reshape(len(poses), -1), "trans": 100 * trans, "betas": truth.betas}
    np.savez(theirs, **arrays, expressions=truth.expressions, mocap_frame_rate=30)
    page.get_by_role("tab", name=TAB).click()
    page.locator("#own-videos input").uncheck()
    give_motions(page, theirs)
    expect(page.locator("#own-player .stage-tag header > b")).to_have_text(["theirs"])
    chips = page.locator("#own-player .stage .reading summary")
    expect(chips).to_have_text(["import details"])
    told = page.locator("#own-player .stage .reading li")
    page.wait_for_function(OPENED)
    chips.focus()
    for words in ("z up: the body (spine, head", "cm: in metres", "flat hand: fingers bend by"):
        expect(told.filter(has_text=words)).to_be_visible()
    turn_to(page, (390, 844, "dark"))
    expect(chips).to_be_focused()  # though all names are laid out anew
    expect_fit(page, page.locator("#own-player .reading ul"))
    assert findings(page, "#own-player .stage") == []
    turn_to(page, (1280, 900, "light"))
    chips.press("Escape")
    expect(told.first).to_be_hidden()

    chips.click()
    press(page.locator("#own-player .stage .reading"), "mean hand")
    expect(chips).to_have_text(["mean hand", "import details"])
    files = page.locator("#own-player .stage .files")
    shown = []
    for ending in (".npz", ".bvh"):
        files.locator("summary").click()
        shown.append(saved(page, files.locator(f"a[download$='{ending}']").first, tmp_path))
    npz, bvh = shown
    wanted = joints_of(load_motion(npz))
    np.testing.assert_allclose(wanted, joints_of(align_average_to_origin(truth)), atol=1e-3)

    # What was said of that file is not said of this one.
    give_motions(page, bvh.rename(tmp_path / "again.bvh"))
    expect(page.locator("#own-player .stage-tag header > b")).to_have_text(["again"])
    expect(chips).to_have_text(["import details"])
    files.locator("summary").click()
    again = load_motion(saved(page, files.locator("a[download$='.npz']").first, tmp_path))
    np.testing.assert_allclose(joints_of(again), wanted, atol=1e-3)
