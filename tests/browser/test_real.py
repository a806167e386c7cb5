"""The real page: gestures edited, files of one's own, live speech, studies, what is kept."""

import base64
import io
import itertools
import json
import re
import shutil
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Locator, Page, expect

from app import text
from app.page.tabs import live as live_tab
from app.page.tabs.own_motion import CLIP_LABEL, TAB
from app.page.tabs.study_run import PREVIEW
from app.run.body_motion import in_register
from app.run.examples import CLEAN, slide
from app.study.leaks import check_study
from conventions.joints import HANDS
from model.formats.judged import RELAXED_HANDS
from model.motion.motion import load_motion, save_motion
from model.plan.editing import added, gestures
from model.plan.files import read_plan_file
from model.plan.plan import GesturePlan
from model.speech.audio import write_wav
from renderer.video.compose import band_height
from tests.browser.conftest import (
    AT_REST,
    BUILDS_ARE_THERE,
    LOCKSTEP,
    LOOKS,
    STAGED,
    bar_of,
    expect_fit,
    give,
    give_speech,
    opened,
    press,
    saved,
    staged,
    tick,
    turn_to,
    watched,
)
from tests.browser.test_stage import findings
from tests.browser.test_study import agree, answer_pairs, practise, saved_answers
from tests.helpers import smooth_motion_example
from tests.model.formats.made import FROM_Y, Person, joints_of, turned
from tests.model.made import made_waveform
from tests.model.plan.made import phase

pytestmark = [pytest.mark.browser, pytest.mark.gl]

LONG_S = 8.0
WORDS = [(0.0, 4.0, ""), (4.0, 4.5, "you"), (4.5, 5.5, ""), (5.5, 6.0, "there"), (6.0, 8.0, "")]
HEAD = 'File type = "ooTextFile"\nObject class = "TextGrid"\n'
GESTURES = """item [2]:
 class = "IntervalTier"
 name = "gesture_left"
 intervals [1]:
 xmin = 0
 xmax = 0.2
 text = "rest"
 intervals [2]:
 xmin = 0.2
 xmax = 0.4
 text = "stroke beat"
"""


def words_tier(words: list[tuple[float, float, str]]) -> str:
    intervals = "".join(
        f' intervals [{i}]:\n xmin = {start}\n xmax = {end}\n text = "{word}"\n'
        for i, (start, end, word) in enumerate(words, start=1)
    )
    return f'{HEAD}item [1]:\n class = "IntervalTier"\n name = "words"\n{intervals}'


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Speech, its words, and a plan of it."""
    folder = tmp_path_factory.mktemp("files")
    write_wav(folder / "talk.wav", made_waveform(round(16_000 * LONG_S)))
    (folder / "said.TextGrid").write_text(words_tier(WORDS))
    still = (phase(0.0, LONG_S, "rest"),)
    plan = GesturePlan(LONG_S, left=still, right=still)
    plan = added(added(plan, "offer", 2.0, "right").plan, "beat", 6.5, "right").plan
    (folder / "plan.json").write_text(plan.as_json())
    return {path.suffix: path for path in folder.iterdir()}


@pytest.fixture(scope="module")
def generated(browser: Browser, real_address: str, files: dict[str, Path]) -> Iterator[Page]:
    """A run that moves by the plan, done by the real pipeline, without videos."""
    context = browser.new_context(
        viewport={"width": 1280, "height": 900},
        reduced_motion="reduce",
        permissions=["clipboard-read", "clipboard-write", "microphone"],
    )
    page = opened(context, real_address)
    give_speech(page, files[".wav"])
    tick(page, ["planned"])
    page.get_by_role("button", name=text.ADVANCED_LABEL).first.click()
    give(page, "#transcript", files[".TextGrid"])
    give(page, "#plan", files[".json"])
    page.get_by_label(text.VIDEOS_LABEL).uncheck()
    press(page, text.GENERATE)
    page.locator("#downloads .bundle").wait_for()
    yield page
    context.close()


@pytest.fixture
def page(generated: Page) -> Page:
    """The page of all journeys here, with its first tab open."""
    turn_to(generated, (1280, 900, "light"))
    generated.get_by_role("tab", name=text.MOTION_TAB, exact=True).click()
    return generated


IN_ONE_VIEW = """() => {
  const rect = (what) => document.querySelector(`#player ${what}`).getBoundingClientRect();
  return rect('.stage-view').top + scrollY >= 0 && rect('.stage-view').height >= 250
    && rect('.timeline').bottom + scrollY <= innerHeight;
}"""
"""Bodies, editor and time line, with nothing scrolled."""


def editor(page: Page) -> Locator:
    return page.locator("#player .editing")


def palette(page: Page) -> Locator:
    """What is done with the gesture that is chosen."""
    return page.locator("#player .palette")


def add(page: Page, place: int, hands: str = "", kind: str = "you") -> None:
    editor(page).locator("summary", has_text="Add").click()
    editor(page).get_by_label("Gesture to be added").select_option(kind)
    editor(page).get_by_label("Where").select_option(str(place))
    editor(page).get_by_label("With", exact=True).select_option(hands)
    expected = page.locator("#player .event.expected")
    expect(expected).to_have_text([kind])  # before it is performed
    press(editor(page), "Add")
    expect(expected).to_have_count(0)


def said(page: Page, sentence: str) -> None:
    expect(editor(page).locator(".said-of-edits")).to_contain_text(sentence)
    expect(editor(page)).to_have_attribute("aria-busy", "false")


def stroke(page: Page, kind: str) -> Locator:
    return page.locator("#player .timeline .event.stroke").filter(has_text=kind).first


def plan_file(page: Page, ending: str, folder: Path) -> Path:
    """A file of the body on the stage that is edited."""
    name = editor(page).get_by_label("Take that is edited").evaluate("it => it.value")
    tag = page.locator(f"#player .stage-tag[data-name='{name}']")
    tag.locator("summary").click()
    return saved(page, tag.locator(f"a[download$='{ending}']"), folder)


def right_hand(page: Page, folder: Path) -> list[float]:
    """Where its gestures land in the plan that is edited, as its file says it."""
    plan = read_plan_file(plan_file(page, ".eaf", folder)).plan
    return [round(one.lands_s, 2) for one in gestures(plan, "right")]


def hold_ends(page: Page, folder: Path) -> float:
    right = read_plan_file(plan_file(page, ".eaf", folder)).plan.right
    return next(one.end_s for one in right if one.phase == "hold")


def drag(page: Page, what: Locator, seconds: float, is_edge: bool = False) -> None:
    """By so much of the time line, from its middle or its right edge."""
    what.hover()  # once it stands in its place
    box = what.bounding_box()
    plot = page.locator("#player .timeline .plot.tier").first.bounding_box()
    assert box is not None and plot is not None
    x = box["x"] + (box["width"] - 2 if is_edge else box["width"] / 2)
    y = box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + seconds * plot["width"] / LONG_S, y, steps=4)


def test_a_run_ends_with_everything_and_its_gestures_are_edited(
    page: Page, files: dict[str, Path], tmp_path: Path
) -> None:
    expect(page.locator("#status")).to_contain_text(f"{round(30 * LONG_S)} frames each")
    expect(page.locator("#numbers thead th[data-name]")).to_have_text(["planned"])
    figure = page.locator("#figures img").first
    page.wait_for_function("image => image.naturalWidth > 500", arg=figure.element_handle())
    assert page.evaluate("document.querySelector('#player audio').duration") == LONG_S
    expect(page.locator("#downloads li")).to_contain_text(["diagnostics"])
    assert saved(page, page.locator("#downloads .bundle"), tmp_path).suffix == ".zip"

    # What cannot be is refused in a sentence, and changes nothing.
    numbers = itertools.count(1)

    def done() -> None:
        said(page, text.TAKE_DONE.format(number=next(numbers)))

    press(page.locator("#player .tiers-head"), "Edit the gestures")
    said(page, text.EDITOR_READY)
    page.set_viewport_size({"width": 1280, "height": 800})
    page.wait_for_function(IN_ONE_VIEW)
    plan_field = editor(page).get_by_label("Plan from a file")
    plan_field.set_input_files({"name": "x.json", "mimeType": "text/json", "buffer": b"[]"})
    said(page, "is no plan of format 1")
    expect(editor(page).locator(".said-of-edits.refused")).to_be_visible()
    assert right_hand(page, tmp_path) == [2.0, 6.5]

    # Edits are performed beside each other, saved, and taken back.
    stroke(page, "offer").click()
    expect(palette(page).locator(".which")).to_have_text("2.00 s: offer, right hand")
    press(palette(page), "Later")
    done()
    staged(page, 2)
    assert right_hand(page, tmp_path) == [2.1, 6.5]
    page.wait_for_function(IN_ONE_VIEW)
    add(page, 0)
    done()
    assert right_hand(page, tmp_path) == [2.1, 4.15, 6.5]
    add(page, 0, kind="beat")  # where there is no time something else is offered
    said(page, "there is no time")
    offered = editor(page).locator(".said-of-edits + .row button")
    expect(offered).to_have_text(
        [re.compile(r"At \d\.\d s, the nearest free place"), "In place of you"]
    )
    offered.last.click()
    done()
    assert right_hand(page, tmp_path) == [2.1, 4.15, 6.5]
    expect(stroke(page, "you")).to_have_count(0)
    press(editor(page), "Undo")
    said(page, "Take 2 is there again, beside take 1")
    stroke(page, "beat").focus()
    page.keyboard.press("Delete")
    done()
    staged(page, 2)
    assert right_hand(page, tmp_path) == [2.1, 4.15]
    names = page.locator("#player .stage-tag header b").all_inner_texts()
    assert names == ["take 2", "take 4"]
    assert plan_file(page, ".bvh", tmp_path).read_text().startswith("HIERARCHY")
    grid = read_plan_file(plan_file(page, ".TextGrid", tmp_path)).plan
    assert [len(gestures(grid, side)) for side in ("left", "right")] == [0, 2]
    press(editor(page), "Undo")
    assert right_hand(page, tmp_path) == [2.1, 4.15, 6.5]
    press(editor(page), "Redo")
    assert right_hand(page, tmp_path) == [2.1, 4.15]
    eaf = plan_file(page, ".eaf", tmp_path)  # and it opens again
    press(editor(page), "Undo")
    plan_field.set_input_files(str(eaf))
    done()
    assert right_hand(page, tmp_path) == [2.1, 4.15]

    # A stroke is dragged to another time, and moved by keys.
    plan_field.set_input_files(str(files[".json"]))
    done()
    drag(page, stroke(page, "offer"), 1.0)
    page.mouse.up()
    done()
    dragged, beat = right_hand(page, tmp_path)
    assert abs(dragged - 3.0) < 0.05 and beat == 6.5
    stroke(page, "offer").focus()
    page.keyboard.press("Shift+ArrowRight")
    done()
    assert abs(right_hand(page, tmp_path)[0] - dragged - 0.1) < 0.02

    # So is the end of a hold, which keeps the focus, and any phase's end by the mouse.
    plan_field.set_input_files(shutil.copy(files[".json"], tmp_path / "the same.json"))
    done()
    page.locator("#player .timeline .event.hold").first.click()
    handle = page.get_by_role("slider", name="End of the hold")
    expect(handle).to_have_attribute("aria-valuetext", "hold ends at 2.30 s")
    drag(page, handle, 0.8)
    expect(palette(page).locator(".ends-at")).to_contain_text("hold ends at 3.")
    page.mouse.up()
    done()
    expect(handle).to_be_focused()
    ended = hold_ends(page, tmp_path)
    assert abs(ended - 3.1) < 0.05
    handle.press("ArrowRight")
    later = f"hold ends at {ended + 0.1:.2f} s"
    expect(handle).to_have_attribute("aria-valuetext", later)
    handle.press("Enter")  # rather than after a pause
    done()
    page.keyboard.press("Control+z")
    expect(handle).to_have_attribute("aria-valuetext", f"hold ends at {ended:.2f} s")
    expect(handle).to_be_focused()
    page.keyboard.press("Control+Shift+z")
    expect(handle).to_have_attribute("aria-valuetext", later)
    assert hold_ends(page, tmp_path) == pytest.approx(ended + 0.1, abs=0.011)
    width = stroke(page, "offer").evaluate("it => it.getBoundingClientRect().width")
    plot = page.locator("#player .timeline .plot.tier").first
    seconds = width / plot.evaluate("it => it.getBoundingClientRect().width") * LONG_S
    drag(page, stroke(page, "offer"), -0.9 * seconds, is_edge=True)
    page.mouse.up()
    said(page, "lasts 0.2 s at least")
    next(numbers)
    assert right_hand(page, tmp_path) == [1.89, 6.5]

    stroke(page, "offer").click()
    palette(page).locator("summary").click()
    press(palette(page), "Lock")
    page.keyboard.press("Escape")
    press(palette(page), "Delete")
    said(page, "is locked; unlock it to change it")
    assert right_hand(page, tmp_path) == [1.89, 6.5]

    # On a phone a gesture is added and deleted.
    turn_to(page, (390, 844, "dark"))
    add(page, 1, "left")
    done()
    added_one = page.locator("#player .timeline .event.stroke[data-list=left]")
    added_one.click()
    expect(palette(page).locator(".which")).to_have_text("5.65 s: you, left hand")
    press(palette(page), "Delete")
    done()
    expect(added_one).to_have_count(0)
    expect_fit(page)


# ---------------------------------------------------------------- files of one's own


FRAMES = 15
SHOWN = 10
TAG_PX = 34
"""Of a body's name, above its picture."""
SMALL = (96, 72)
"""Pictures are compared so coarsely that edges and an encoder's noise do not count."""
PLAYER = "document.querySelector('#own-player .lockstep')"
OWN_STAGED = STAGED.replace("#player", "#own-player")


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
    press(page.locator("#own-player .more-box"), "Make a video of this")


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
    told = json.loads(page.evaluate(f"{PLAYER}.seen()"))
    width, height = told["size"]
    columns = min(told["columns"], len(told["shown"])) if told["mode"] == "grid" else 1
    seen = canvas[TAG_PX : TAG_PX + round(height), : round(columns * width)]
    band = video.shape[0] - round(video.shape[1] * seen.shape[0] / seen.shape[1])
    shorter = video.shape[1] // (columns if told["mode"] == "grid" else 2)
    assert abs(band - band_height(min(shorter, video.shape[0] - band))) < 8
    return float(np.abs(coarse(seen) - coarse(video[band:])).mean())


def test_files_of_ones_own_are_measured_seen_compared_and_made_a_video_of(
    page: Page, tmp_path: Path
) -> None:
    paths = [tmp_path / f"{name}.npz" for name in ("mine", "theirs")]
    for seed, path in enumerate(paths):
        save_motion(smooth_motion_example(FRAMES, seed=seed), path)
    transcript = tmp_path / "words.TextGrid"
    transcript.write_text(words_tier([(0.1, 0.3, "hello")]) + GESTURES)
    page.get_by_role("tab", name=TAB).click()
    press(page, "Measure and compare")
    expect(page.locator("#own-message")).to_contain_text("at least one")
    page.locator("#own-videos input").uncheck()
    give_motions(page, *paths, transcript)
    expect(page.locator("#own-status")).to_contain_text("Measured 2 motions")
    expect(page.locator("#own-message")).to_be_hidden()
    expect(page.locator("#own-numbers thead th[data-name]")).to_have_text(["mine", "theirs"])
    for figure in page.locator("#own-figures figure img").all():
        page.wait_for_function("image => image.naturalWidth > 500", arg=figure.element_handle())
    expect(page.locator("#own-figures")).to_contain_text("right middle fingertip jerk")
    expect(page.locator("#own-downloads")).to_contain_text("figure6")
    page.wait_for_function(OWN_STAGED, arg=2)
    lanes = page.locator("#own-player .lane:has(.words)")  # gestures below the words, no rest
    expect(lanes).to_contain_text(["Words", "Gesture left"])
    classes = "labels => labels.map((each) => each.className)"
    assert lanes.locator("span").evaluate_all(classes) == ["", "stroke"]

    # Who turns the camera turns it for all, and keys bring it back.
    canvas = page.locator("#own-player .stage canvas")
    canvas.scroll_into_view_if_needed()
    back = page.locator("#own-player").get_by_role("button", name="Back to the front")
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
    expect(page.locator("#own-seen")).to_contain_text("2 bodies, 0.5 s")
    page.evaluate(
        f"""() => {{
            const told = JSON.parse({PLAYER}.seen());
            told.camera[2] = 99;
            {PLAYER}.seen = () => JSON.stringify(told);
        }}"""
    )
    ask_for_video(page)
    expect(page.locator("#own-seen")).to_contain_text("zoom is 0.4 to 10; got 99")
    for look in ((390, 844, "dark"), (1280, 900, "light")):
        turn_to(page, look)
        for _ in range(2):  # one over another, and back
            press(bar_of(page, "#own-player"), "Ghost")
            expect_fit(page, page.locator("#own-player .stage-view"))

    # Beside another run of this visitor.
    with page.context.expect_page() as followed:
        page.locator("#own-runs").get_by_role("link", name=text.COMPARE_LAST).click()
    both = watched(followed.value)
    names = both.locator("#numbers thead th[data-name]")
    expect(names).to_contain_text(["(A)", "mine (B)", "theirs (B)"])
    both.close()


def test_the_worst_of_a_set_shows_its_findings_and_is_kept_as_a_file_and_a_page(
    page: Page, tmp_path: Path
) -> None:
    page.get_by_role("tab", name=TAB).click()
    page.locator("#own-videos input").uncheck()
    zipped, clean = tmp_path / "mine.zip", load_motion(CLEAN).part(slice(180))
    with zipfile.ZipFile(zipped, "w") as archive:
        for clip, motion in (("calm", clean), ("sliding", slide(clean))):
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
    expect(gravest).to_contain_text("Feet on the ground slide")
    gravest.get_by_role("button").click()
    worst_s = page.evaluate(f"{PLAYER}.lockstep.time")
    assert worst_s > 0 and gravest.get_by_role("button").inner_text().startswith("Show 0:")
    page.evaluate(f"{PLAYER}.lockstep.seekFrame(0)")
    player.locator(".lane .flag").first.click()
    assert page.evaluate(f"{PLAYER}.lockstep.time") == worst_s

    # A link shows the same moment in the same tab, though no display is switched.
    bar_of(page, "#own-player").locator(".more").click()
    press(player, "Copy link to this picture")
    other = watched(page.context.new_page())
    other.goto(page.evaluate("navigator.clipboard.readText()"))
    expect(other.locator("#own-player .gravest li").first).to_contain_text("Feet on the ground")
    expect(other.get_by_role("tab", name=TAB)).to_have_attribute("aria-selected", "true")
    other.wait_for_function(f"at => Math.abs({PLAYER}.lockstep.time - at) < 0.05", arg=worst_s)

    # The run as a file, dropped anywhere, opens again; and as a page of its own.
    saving = page.locator("#own-downloads")
    kept = saved(page, saving.get_by_role("link", name=text.SAVE_RUN), tmp_path)
    alone = saved(page, saving.get_by_role("link", name=text.SAVE_PAGE), tmp_path)
    assert kept.name.endswith(".zip") and alone.name.endswith(".html")
    other.get_by_role("tab", name=text.MOTION_TAB, exact=True).click()
    other.evaluate(DROPPED, base64.b64encode(kept.read_bytes()).decode("ascii"))
    expect(other.locator("#own-status")).to_contain_text("Opened from its file")
    other.wait_for_function(OWN_STAGED, arg=1)
    expect(other.locator("#own-runs .link a")).to_be_visible()
    other.goto(alone.as_uri())
    other.locator(".stage[data-bodies='1']").wait_for()
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


def test_several_clips_are_one_run_each_is_seen_and_all_come_back_from_one_file(
    page: Page, real_address: str, tmp_path: Path
) -> None:
    short, talk = tmp_path / "short.wav", tmp_path / "talk.wav"
    write_wav(short, made_waveform(16_000 * 2))
    write_wav(talk, made_waveform(16_000 * 4))
    other = opened(page.context, real_address)
    other.get_by_role("button", name=text.CLIPS_LABEL).first.click()
    give(other, "#several", talk, short)
    tick(other, ["local", "global"])
    press(other, text.GENERATE)
    rows = other.locator("#clips tbody tr")
    expect(other.locator("#status")).to_contain_text("2 of 2 clips are done")
    expect(rows).to_have_count(2)
    expect(other.locator("#clips .verdict")).to_contain_text("mean over 2 clips: local")
    expect(other.locator("#clips tfoot td").first).to_contain_text("[")
    staged(other, 2)
    lasts = f"seconds => Math.round({LOCKSTEP}.duration) === seconds"
    other.wait_for_function(lasts, arg=2)
    other.locator("#clip").get_by_role("radio", name="talk").check()
    other.wait_for_function(lasts, arg=4)
    other.reload()
    staged(other, 2)
    expect(other.locator("#clip").get_by_role("radio", name="talk")).to_be_checked()
    other.wait_for_function(lasts, arg=4)
    for look in (LOOKS[0], LOOKS[2]):
        turn_to(other, look)
        expect_fit(other)

    saving = other.locator("#downloads")
    kept = saved(other, saving.get_by_role("link", name=text.SAVE_RUN), tmp_path)
    alone = saved(other, saving.get_by_role("link", name=text.SAVE_PAGE), tmp_path)
    other.evaluate(DROPPED, base64.b64encode(kept.read_bytes()).decode("ascii"))
    expect(other.locator("#own-status")).to_contain_text("2 of 2 clips are done")
    expect(other.locator("#own-clips tbody tr")).to_have_count(2)
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
    poses[:, list(HANDS)] -= RELAXED_HANDS
    theirs = tmp_path / "theirs.npz"
    arrays = {"poses": poses.reshape(len(poses), -1), "trans": 100 * trans, "betas": truth.betas}
    np.savez(theirs, **arrays, expressions=truth.expressions, mocap_frame_rate=30)
    page.get_by_role("tab", name=TAB).click()
    page.locator("#own-videos input").uncheck()
    give_motions(page, theirs)
    expect(page.locator("#own-status")).to_contain_text("Measured 1 motion")
    chips = page.locator("#own-player .stage .reading summary")
    expect(chips).to_have_text(["how it was read"])
    told = page.locator("#own-player .stage .reading li")
    page.wait_for_function(OPENED)
    chips.focus()
    for words in ("z up: spine, head", "cm: in metres", "flat hand: fingers bend by"):
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
    expect(chips).to_have_text(["mean hand", "how it was read"])
    files = page.locator("#own-player .stage .files")
    shown = []
    for ending in (".npz", ".bvh"):
        files.locator("summary").click()
        shown.append(saved(page, files.locator(f"a[download$='{ending}']").first, tmp_path))
    npz, bvh = shown
    wanted = joints_of(load_motion(npz))
    np.testing.assert_allclose(wanted, joints_of(in_register(truth)), atol=1e-3)

    # What was said of that file is not said of this one.
    give_motions(page, bvh.rename(tmp_path / "again.bvh"))
    expect(page.locator("#own-player .stage-tag header > b")).to_have_text(["again"])
    expect(chips).to_have_text(["how it was read"])
    files.locator("summary").click()
    again = load_motion(saved(page, files.locator("a[download$='.npz']").first, tmp_path))
    np.testing.assert_allclose(joints_of(again), wanted, atol=1e-3)


# ---------------------------------------------------------------- other tabs


LIVE = "document.querySelector('.live').live"
HEARD = f"() => {LIVE}.latency !== null"
KEPT = "() => document.querySelector('#live-player .stage')?.dataset.bodies === '1'"


def test_one_speaks_and_the_body_moves_and_the_minute_is_kept(
    page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.live.sound.WATCHED_S", 1e9)  # a busy browser sends less than is said
    page.set_viewport_size({"width": 720, "height": 700})
    page.get_by_role("tab", name=live_tab.TAB).click()
    live, status = page.locator(".live"), page.locator(".live .asked").get_by_role("status")
    start, stop = (live.get_by_role("button", name=name) for name in ("Start", "Stop"))
    sockets: list[str] = []
    page.on("websocket", lambda socket: sockets.append(socket.url))
    live.locator("select[name=system]").select_option("globaldiff/global")
    start.click()
    expect(stop).to_be_visible()
    page.wait_for_function(HEARD)
    assert sockets and sockets[0].endswith("/live/speak")
    expect(live.locator(".latency")).to_contain_text("hears 0.60 s")
    latency_ms = float(live.get_attribute("data-latency") or "nan")
    assert latency_ms > 600  # what it is depends on the machine; it is measured
    page.wait_for_function("() => document.querySelector('.live meter').value > 0.3")
    expect(live.locator(".stage")).to_have_attribute("data-bodies", "1")
    expect(live.locator(".planned")).to_be_hidden()  # this system performs no plans

    # The stage of any run: displays act while the body moves, and the server is not asked.
    page.wait_for_function(BUILDS_ARE_THERE)
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    bar = live.get_by_role("toolbar", name="Displays")
    bar.get_by_label("Close-up").select_option("both")
    bar.get_by_role("button", name="Jerk", exact=True).click()
    bar.get_by_label("Tremble, times as large").fill("1")
    expect(live.locator(".stage-legend")).to_contain_text("jerk: 0 to 500 m/s³")
    expect(live.locator(".stage-notice")).to_have_text("EXAGGERATED x20: all above 5 Hz")
    bar.locator(".more").click()
    live.get_by_label("Whole body").check()
    live.get_by_role("button", name="Side").click()
    expect(live.get_by_role("button", name="Back to the front")).to_be_visible()
    place = page.evaluate(f"{LIVE}.place")
    moved = f"([place, stop]) => {LIVE}.place > place + 6 || !stop.checkVisibility()"
    page.wait_for_function(moved, arg=[place, stop.element_handle()])
    assert stop.is_visible(), status.inner_text()
    canvas = live.locator(".stage canvas")
    canvas.press("Home")
    canvas.press("e")
    expect(live.locator(".stage-notice")).to_be_hidden()
    bar.locator(".more").click()
    assert asked == []

    # A lost connection and a denied microphone are told, and what was heard can still be kept.
    page.wait_for_function(f"() => {LIVE}.place > 75")  # a minute that is kept has two seconds
    page.evaluate(f"{LIVE}.socket.close()")
    expect(status).to_contain_text("The connection to the server was lost")
    expect(start).to_be_visible()
    page.get_by_role("button", name=live_tab.KEEP).click()
    expect(status).to_contain_text("is being kept")
    expect(page.locator("#live-status")).to_contain_text("Done in")
    expect(page.locator("#live-message")).to_contain_text("made while the speech was spoken")
    page.wait_for_function(KEPT)
    expect(page.locator("#live-downloads")).to_contain_text("provenance")
    page.wait_for_function("() => document.querySelector('#live-player audio').duration > 2")
    expect(page.locator("#live-runs .link a")).to_have_attribute("href", re.compile(r"^\?run="))
    expect(page.locator("#live-runs li").first).to_contain_text("live:")
    page.evaluate(
        "() => { navigator.mediaDevices.getUserMedia = () => "
        "Promise.reject(new DOMException('no', 'NotAllowedError')); }"
    )
    start.click()
    expect(status).to_contain_text("The microphone was denied")

    # An example is played as if it were spoken.
    live.locator("select[name=source]").select_option(label="Example: Three reasons")
    start.click()
    expect(status).to_contain_text("Playing")
    page.wait_for_function(HEARD)
    stop.click()
    expect(status).to_contain_text("Stopped")


def test_a_study_is_made_taken_part_in_and_analysed(page: Page, tmp_path: Path) -> None:
    page.get_by_role("tab", name=text.STUDY_TAB).click()
    page.locator("#study-make").click()
    expect(page.locator("#study-status")).to_contain_text("There is no speech yet")

    # A study that is ready is filled in by the click itself.
    page.route("**/queue/join*", lambda route: None)  # a server too busy to answer
    page.get_by_role("button", name="Do words matter?").click()
    expect(page.get_by_label("Rank all systems on three questions")).to_be_checked()
    expect(page.get_by_label("on wrong words")).to_be_checked()
    expect(page.get_by_label("half as many")).not_to_be_checked()
    page.unroute("**/queue/join*")
    page.get_by_role("button", name="How large?").click()
    expect(page.get_by_label("Rate all systems with sliders")).to_be_checked()
    for name, is_checked in (("smaller", True), ("larger", True), ("on wrong words", False)):
        expect(page.get_by_label(name, exact=True)).to_be_checked(checked=is_checked)
    expect(page.locator("#study-speech")).to_contain_text("three_reasons")
    page.locator("#study-write").click()
    plan = saved(page, page.locator("#study-plan a"), tmp_path)
    written = tomllib.loads(plan.read_text())
    assert written["protocol"] == "rating"
    names = ["workbench/planned", "smaller", "larger"]
    assert [each["name"].split()[-1] for each in written["systems"]] == names

    # Another one is made.
    page.locator("#study-speech").get_by_label("Clear").first.click()
    speeches = [tmp_path / f"speech-{name}.wav" for name in ("one", "two")]
    for seed, speech in enumerate(speeches):
        write_wav(speech, made_waveform(9_600 + 1_600 * seed, seed))
    give(page, "#study-speech", *speeches)
    page.get_by_label("Pairs, which is more real? (silent)").check()
    for name in ("smaller", "larger"):
        page.get_by_label(name, exact=True).uncheck()
    systems = page.locator("[role=tabpanel]:visible")
    systems.get_by_label("global", exact=True).check()
    page.get_by_label("Seconds a video").fill("0.5")
    page.get_by_label("Participants", exact=True).fill("3")
    page.locator("#study-make").click()
    researcher = page.locator("#study-researcher button")
    researcher.wait_for()
    plan = tomllib.loads(saved(page, page.locator("#study-plan a"), tmp_path).read_text())
    assert (plan["participants"], plan["length_s"], len(plan["systems"])) == (3, 0.5, 2)
    study = tmp_path / "study"
    for link in (page.locator("#study-participants a"), researcher):
        with zipfile.ZipFile(saved(page, link, tmp_path)) as archive:
            assert {info.date_time for info in archive.infolist()} == {(2000, 1, 1, 0, 0, 0)}
            archive.extractall(study)
    # Unpacking gives the files new times; everything else is as the leak test wants it.
    assert [leak for leak in check_study(study) if not leak.startswith("time stamp")] == []
    key = study / "researcher_only" / "key.json"
    assert sorted(json.loads(key.read_text())["lists"]) == ["0", "1", "2"]

    # From the preview to the report: one participant, who takes whatever stands on the left.
    with page.expect_popup() as popup:
        page.get_by_role("link", name=PREVIEW).click()
    preview = watched(popup.value)
    agree(preview)
    practise(preview, skipped_ms=0)
    for look in LOOKS:
        turn_to(preview, look)
        expect_fit(preview)
        expect(preview.locator("#next")).to_be_in_viewport(ratio=0.99)
    answer_pairs(preview)
    answers = saved_answers(preview, tmp_path)
    assert answers.name.startswith("preview-")
    preview.close()
    give(page, "#analysis-answers", answers)
    give(page, "#analysis-key", key)
    page.locator("#analysis-start").click()
    report = page.frame_locator("#analysis-report iframe")
    expect(report.locator("body")).to_contain_text("How people move when they talk")
    expect(page.locator("#analysis-report .downloads")).to_contain_text("results")
    for look in LOOKS:
        turn_to(page, look)
        expect_fit(page, researcher)
    researcher.click()
    expect(page.get_by_text("There is nothing to fetch here")).to_be_visible()
    page.go_back()


def test_an_example_fills_in_the_speech_also_after_all_files_were_swept(
    page: Page, page_files: Path
) -> None:
    for _ in range(2):
        if (clear := page.locator("#speech").get_by_label("Clear")).count():
            clear.first.click()
        with page.expect_response(lambda response: ".wav" in response.url) as sound:
            page.locator("#examples button").first.click()
        assert sound.value.ok
        page.locator("#speech").get_by_label("Play", exact=True).first.wait_for()
        for file in page_files.rglob("*.wav"):
            file.unlink()
