"""The real page: gestures edited, files of one's own, live speech, studies, what is kept."""

import itertools
import json
import re
import tomllib
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Locator, Page, Route, expect

from app import text
from app.page.tabs import live as live_tab
from app.page.tabs.study import PREVIEW
from app.study.leaks import find_leaks
from model.plan.annotation_files import Interval, NamedTier, format_textgrid
from model.plan.editing import add_gesture, gestures
from model.plan.files import read_plan_file
from model.plan.plan import GesturePlan
from model.speech.audio import write_wav
from tests.browser.conftest import (
    AT_REST,
    BUILDS_ARE_THERE,
    LOOKS,
    expect_fit,
    give,
    give_speech,
    opened,
    press,
    ready,
    saved,
    staged,
    start,
    tick,
    turn_to,
    turn_to_part,
    watched,
)
from tests.browser.test_study import agree, answer_pairs, practise, saved_answers
from tests.model.made import made_waveform
from tests.model.plan.made import phase

pytestmark = [pytest.mark.browser, pytest.mark.gl]

LONG_S = 8.0
WORDS = NamedTier("words", (Interval(4.0, 4.5, "you"), Interval(5.5, 6.0, "there")))


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Speech, its words, and a plan of it."""
    folder = tmp_path_factory.mktemp("files")
    write_wav(folder / "talk.wav", made_waveform(round(16_000 * LONG_S)))
    (folder / "said.TextGrid").write_text(format_textgrid([WORDS], LONG_S))
    still = (phase(0.0, LONG_S, "rest"),)
    plan = GesturePlan(LONG_S, left=still, right=still)
    plan = add_gesture(add_gesture(plan, "offer", 2.0, "right").plan, "beat", 6.5, "right").plan
    (folder / "plan.json").write_text(plan.as_json())
    return {path.suffix: path for path in folder.iterdir()}


@pytest.fixture(scope="module")
def generated(browser: Browser, real_address: str, files: dict[str, Path]) -> Iterator[Page]:
    """A run that moves by the plan, done by the real pipeline, without videos."""
    context = browser.new_context(
        viewport={"width": 1280, "height": 900},
        reduced_motion="reduce",
        permissions=["microphone"],
    )
    page = opened(context, real_address)
    give_speech(page, files[".wav"])
    tick(page, ["planned"])
    page.get_by_role("button", name=text.ADVANCED_LABEL).first.click()
    give(page, "#transcript", files[".TextGrid"])
    give(page, "#plan", files[".json"])
    page.get_by_label(text.VIDEOS_LABEL).uncheck()
    press(page, text.GENERATE)
    staged(page, 1).locator("#downloads .bundle").wait_for(state="attached")
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
  return rect('.stage-view').top + scrollY >= 0 && rect('.stage-view').height >= 200
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
    editor(page).locator(f".kinds input[value={kind}]").check(force=True)
    editor(page).get_by_label("Where").select_option(str(place))
    editor(page).get_by_label("Hands", exact=True).select_option(hands)
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
    name = editor(page).get_by_label("Version to edit").evaluate("it => it.value")
    tag = page.locator(f"#player .stage-tag[data-name='{name}']")
    tag.locator("summary").click()
    return saved(page, tag.locator(f"a[download$='{ending}']"), folder)


def right_hand(page: Page, folder: Path) -> list[float]:
    """Where its gestures land in the plan that is edited, as its file says it."""
    plan = read_plan_file(plan_file(page, ".eaf", folder)).plan
    return [round(one.stroke_end_s, 2) for one in gestures(plan, "right")]


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
    expect(page.locator("#status")).to_contain_text(f"up to {round(30 * LONG_S)} frames")
    expect(page.locator("#numbers thead th[data-name]")).to_have_text(["planned"])
    lasts = "seconds => document.querySelector('#player audio').duration === seconds"
    page.wait_for_function(lasts, arg=LONG_S)
    expect(page.locator("#downloads li")).to_contain_text(["diagnostics"])
    turn_to_part(page, "Files")
    assert saved(page, page.locator("#downloads .bundle"), tmp_path).suffix == ".zip"
    turn_to_part(page, "Watch")

    # What cannot be is refused in a sentence, and changes nothing.
    numbers = itertools.count(1)

    def done() -> None:
        said(page, text.TAKE_DONE.format(number=next(numbers)))

    press(page.locator("#player .tiers-head"), "Edit the gestures")
    said(page, text.EDITOR_READY)
    page.set_viewport_size({"width": 1280, "height": 800})
    page.wait_for_function(IN_ONE_VIEW)
    plan_field = editor(page).get_by_label("Import a plan")
    plan_field.set_input_files({"name": "x.json", "mimeType": "text/json", "buffer": b"[]"})
    said(page, "is not a plan of format 1")
    expect(editor(page).locator(".said-of-edits.refused")).to_be_visible()
    assert right_hand(page, tmp_path) == [2.0, 6.5]

    # Edits are performed beside each other, saved, and taken back.
    stroke(page, "offer").click()
    expect(palette(page).locator(".which")).to_have_text("2.00 s: offer, right")
    page.evaluate("performance.now = () => 0")  # whatever glided would never be there
    press(palette(page), "Later")
    done()
    staged(page, 2).wait_for_function(AT_REST)
    page.evaluate("delete performance.now")
    assert right_hand(page, tmp_path) == [2.1, 6.5]
    page.wait_for_function(IN_ONE_VIEW)
    add(page, 0)
    done()
    assert right_hand(page, tmp_path) == [2.1, 4.15, 6.5]
    add(page, 0, kind="beat")  # where there is no time something else is offered
    said(page, "there is no time")
    offered = editor(page).locator(".said-of-edits + .row button")
    expect(offered).to_have_text(
        [re.compile(r"Nearest free time, \d\.\d s"), "Replace the 'you' gesture"]
    )
    offered.last.click()
    done()
    assert right_hand(page, tmp_path) == [2.1, 4.15, 6.5]
    expect(stroke(page, "you")).to_have_count(0)
    press(editor(page), "Undo")
    said(page, "Version 2: restored, compared with version 1")
    expect(stroke(page, "you")).to_have_count(1)  # its lanes, too
    stroke(page, "beat").focus()
    page.keyboard.press("Delete")
    done()
    staged(page, 2)
    assert right_hand(page, tmp_path) == [2.1, 4.15]
    names = page.locator("#player .stage-tag header b").all_inner_texts()
    assert names == ["version 2", "version 4"]
    assert plan_file(page, ".bvh", tmp_path).read_text().startswith("HIERARCHY")
    grid = read_plan_file(plan_file(page, ".TextGrid", tmp_path)).plan
    assert [len(gestures(grid, side)) for side in ("left", "right")] == [0, 2]
    press(editor(page), "Undo")
    said(page, "Version 2: restored")
    assert right_hand(page, tmp_path) == [2.1, 4.15, 6.5]
    press(editor(page), "Redo")
    said(page, "Version 4: restored")
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
    landed, held = right_hand(page, tmp_path)[0], hold_ends(page, tmp_path)
    page.locator("#player .timeline .event.hold").first.click()
    handle = page.get_by_role("slider", name="End of the hold")
    expect(handle).to_have_attribute("aria-valuetext", f"hold ends at {held:.2f} s")
    drag(page, handle, 0.8)
    expect(palette(page).locator(".ends-at")).to_contain_text("hold ends at 4.")
    page.mouse.up()
    done()
    expect(handle).to_be_focused()
    ended = hold_ends(page, tmp_path)
    assert abs(ended - held - 0.8) < 0.05
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
    said(page, "must last at least 0.2 s")
    next(numbers)
    shorter = right_hand(page, tmp_path)
    assert abs(shorter[0] - landed + 0.11) < 0.02 and shorter[1] == 6.5

    # On a phone a gesture is added.
    turn_to(page, (390, 844, "dark"))
    add(page, 1, "left")
    done()
    added_one = page.locator("#player .timeline .event.stroke[data-list=left]")
    added_one.click()
    expect(palette(page).locator(".which")).to_have_text("5.65 s: you, left")
    expect_fit(page)


# ---------------------------------------------------------------- other tabs


LIVE = "document.querySelector('.live').live"
HEARD = f"() => {LIVE}.latency !== null"
KEPT = "() => document.querySelector('#live-player .stage')?.dataset.bodies === '1'"


def test_one_speaks_and_the_body_moves_and_the_minute_is_kept(
    page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "app.live.sessions.SOUND_ARRIVAL_WINDOW_S", 1e9
    )  # a busy browser sends less
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
    expect(live.locator(".latency")).to_contain_text("audio window 0.60 s")
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
    press(bar, "Jerk")
    expect(live.locator(".stage-legend")).to_contain_text("jerk: 0 to 500 m/s³")
    place = page.evaluate(f"{LIVE}.place")
    moved = f"([place, stop]) => {LIVE}.place > place + 6 || !stop.checkVisibility()"
    page.wait_for_function(moved, arg=[place, stop.element_handle()])
    assert stop.is_visible(), status.inner_text()
    assert asked == []

    # A lost connection and a denied microphone are told, and what was heard can still be kept.
    page.wait_for_function(f"() => {LIVE}.place > 75")  # a minute that is kept has two seconds
    page.evaluate(f"{LIVE}.socket.close()")
    expect(status).to_contain_text("Connection to the server lost")
    expect(start).to_be_visible()
    page.get_by_role("button", name=live_tab.KEEP).click()
    expect(status).to_contain_text("is being saved")
    expect(page.locator("#live-status")).to_contain_text("Done in")
    expect(page.locator("#live-message")).to_contain_text("generated live")
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
    expect(status).to_contain_text("denied access to the microphone")

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
    page.get_by_role("button", name="Effect of the gesture size").click()
    expect(page.get_by_label("Slider ratings of all systems")).to_be_checked()
    for name, is_checked in (
        ("smaller", True),
        ("larger", True),
        ("strokes on other words", False),
    ):
        expect(page.get_by_label(name, exact=True)).to_be_checked(checked=is_checked)
    page.unroute("**/queue/join*")
    page.get_by_role("button", name="Effect of the gesture size").click()
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
    page.get_by_label("Pairwise comparison: human-likeness (without sound)").check()
    for name in ("smaller", "larger"):
        page.get_by_label(name, exact=True).uncheck()
    systems = page.locator("[role=tabpanel]:visible")
    systems.get_by_label("global", exact=True).check()
    page.get_by_label("Video length (s)").fill("0.5")
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
    assert [leak for leak in find_leaks(study) if not leak.startswith("time stamp")] == []
    key = study / "researcher_only" / "key.json"
    assert sorted(json.loads(key.read_text())["lists"]) == ["0", "1", "2"]

    # From the preview to the report: one participant, who takes whatever stands on the left.
    with page.expect_popup() as popup:
        page.get_by_role("link", name=PREVIEW).click()
    preview = watched(popup.value)
    agree(preview)
    practise(preview, skipped_ms=0)
    for look in (LOOKS[0], LOOKS[3]):
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
    for look in (LOOKS[0], LOOKS[3]):
        turn_to(page, look)
        expect_fit(page, page.locator("#study-researcher"))
    expect(researcher).to_be_hidden()
    researcher.evaluate("button => button.form.submit()")
    expect(page.get_by_text("There is nothing to download")).to_be_visible()
    page.go_back()
    ready(page)


def test_an_example_fills_in_the_speech_beside_a_link_and_after_all_files_were_swept(
    visitor: Callable[..., BrowserContext], real_address: str, page_files: Path, speech: Path
) -> None:
    page = opened(visitor(), real_address)
    tick(page, ["global"])
    page.get_by_label(text.VIDEOS_LABEL).uncheck()
    start(page, speech)
    page.locator("#downloads .bundle").wait_for(state="attached")
    held: list[Route] = []
    page.route("**/run/predict?run=*", lambda route: held.append(route))  # noqa: PLW0108
    page.goto(page.locator("#runs .link a").evaluate("link => link.href"))
    form = page.locator("#motion-form")  # which the run of the link would fill in anew
    expect(form).to_have_attribute("inert", "")
    for route in held:
        route.continue_()
    page.unroute("**/run/predict?run=*")
    ready(page)
    expect(form).not_to_have_attribute("inert", "")
    field = page.locator("#speech")
    for _ in range(2):
        field.get_by_label("Clear").click()
        with page.expect_response("**/examples/*.wav") as sound:
            page.locator("#examples button").first.click()
        assert sound.value.ok
        expect(field.locator("time").last).not_to_have_text("0:00")  # it was read
        expect(field.get_by_label("Play", exact=True)).to_be_visible()
        for file in page_files.rglob("*.wav"):
            file.unlink()
