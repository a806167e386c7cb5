"""Gestures edited on the time line, performed again, compared and saved."""

import json
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from app import text
from model.plan.editing import added, gestures
from model.plan.files import read_plan_file
from model.plan.plan import GesturePlan
from model.speech.audio import write_wav
from tests.browser.conftest import PATIENCE_MS, STAGED, open_page
from tests.model.made import made_waveform
from tests.model.plan.made import phase

LONG_S = 12.0
TEXTGRID = """File type = "ooTextFile"
Object class = "TextGrid"

xmin = 0
xmax = {end}
tiers? <exists>
size = 1
item []:
    item [1]:
        class = "IntervalTier"
        name = "words"
        xmin = 0
        xmax = {end}
        intervals: size = {count}
{words}"""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Speech, its words, and a plan of it."""
    folder = tmp_path_factory.mktemp("files")
    write_wav(folder / "talk.wav", made_waveform(round(16_000 * LONG_S)))
    said = [(0.0, 4.0, ""), (4.0, 4.5, "you"), (4.5, 8.0, ""), (8.0, 8.5, "there"), (8.5, 12.0, "")]
    words = "".join(
        f"        intervals [{i}]:\n            xmin = {start}\n            xmax = {end}\n"
        f'            text = "{word}"\n'
        for i, (start, end, word) in enumerate(said, start=1)
    )
    (folder / "said.TextGrid").write_text(TEXTGRID.format(end=LONG_S, count=5, words=words))
    still = (phase(0.0, LONG_S, "rest"),)
    plan = GesturePlan(LONG_S, left=still, right=still)
    plan = added(added(plan, "offer", 2.0, "right").plan, "beat", 6.5, "right").plan
    (folder / "plan.json").write_text(plan.as_json())
    names = ("talk.wav", "said.TextGrid", "plan.json")
    return {Path(name).suffix: folder / name for name in names}


def run(page: Page, files: dict[str, Path]) -> None:
    """A run that moves by the plan, with its editor open."""
    page.set_input_files("#speech input[type=file]", str(files[".wav"]))
    page.locator("#speech").get_by_label("Play", exact=True).first.wait_for()
    page.get_by_role("button", name=text.ADVANCED_LABEL).first.click()
    for field, ending in (("#transcript", ".TextGrid"), ("#plan", ".json")):
        page.set_input_files(f"{field} input[type=file]", str(files[ending]))
        page.locator(field).get_by_text(files[ending].stem).first.wait_for()
    page.get_by_label(text.VIDEOS_LABEL).uncheck()  # drawing them takes longer than all the rest
    page.get_by_role("button", name=text.GENERATE).click()
    editor(page).get_by_role("button", name="Edit the gestures").click()
    said(page, text.EDITOR_READY)


def editor(page: Page) -> Locator:
    return page.locator("#player .editing")


def said(page: Page, sentence: str) -> None:
    expect(editor(page).locator(".said-of-edits")).to_contain_text(sentence, timeout=PATIENCE_MS)
    expect(editor(page)).to_have_attribute("aria-busy", "false", timeout=PATIENCE_MS)


def stroke(page: Page, kind: str) -> Locator:
    return page.locator("#player .timeline .event.stroke").filter(has_text=kind).first


def landing(page: Page, tmp_path: Path) -> dict[str, list[float]]:
    """Where the gestures of the plan that is edited land, by hand, as its file says it."""
    plan = saved(page, ".eaf", tmp_path)
    read = read_plan_file(plan).plan
    return {
        side: [round(one.lands_s, 2) for one in gestures(read, side)] for side in ("left", "right")
    }


def saved(page: Page, ending: str, folder: Path) -> Path:
    """A file of the body on the stage that is edited."""
    name = editor(page).get_by_label("Take that is edited").evaluate("it => it.value")
    tag = page.locator(f"#player .stage-tag[data-name='{name}']")
    tag.locator("summary").click()
    with page.expect_download() as told:
        tag.locator(f"a[download$='{ending}']").click()
    path = folder / told.value.suggested_filename
    told.value.save_as(path)
    return path


def test_three_edits_are_performed_beside_each_other_and_saved(
    browser: Browser, planned_address: str, files: dict[str, Path], tmp_path: Path
) -> None:
    page = open_page(browser, planned_address, motion="reduce")
    run(page, files)

    stroke(page, "offer").click()
    expect(editor(page).locator(".which")).to_contain_text("offer, right hand, 2.00 s")
    editor(page).get_by_role("button", name="Later").click()
    said(page, text.TAKE_DONE.format(number=1))
    page.wait_for_function(STAGED, arg=2)
    assert landing(page, tmp_path) == {"left": [], "right": [2.1, 6.5]}

    editor(page).get_by_label("Gesture to be added").select_option("you")
    editor(page).get_by_label("Where").select_option("0")
    editor(page).get_by_role("button", name="Add", exact=True).click()
    said(page, text.TAKE_DONE.format(number=2))
    assert landing(page, tmp_path) == {"left": [], "right": [2.1, 4.15, 6.5]}

    stroke(page, "beat").focus()
    page.keyboard.press("Delete")
    said(page, text.TAKE_DONE.format(number=3))
    page.wait_for_function(STAGED, arg=2)
    assert landing(page, tmp_path) == {"left": [], "right": [2.1, 4.15]}
    names = page.locator("#player .stage-tag header b").all_inner_texts()
    assert names == ["take 2", "take 3"]
    assert saved(page, ".bvh", tmp_path).read_text().startswith("HIERARCHY")
    grid = saved(page, ".TextGrid", tmp_path)
    assert [len(gestures(read_plan_file(grid).plan, side)) for side in ("left", "right")] == [0, 2]

    editor(page).get_by_role("button", name="Undo").click()
    assert landing(page, tmp_path)["right"] == [2.1, 4.15, 6.5]
    editor(page).get_by_role("button", name="Redo").click()
    assert landing(page, tmp_path)["right"] == [2.1, 4.15]

    eaf = saved(page, ".eaf", tmp_path)  # and it opens again
    editor(page).get_by_role("button", name="Undo").click()
    editor(page).get_by_label("Plan from a file").set_input_files(str(eaf))
    said(page, text.TAKE_DONE.format(number=4))
    assert landing(page, tmp_path) == {"left": [], "right": [2.1, 4.15]}
    page.context.close()


def test_a_stroke_is_dragged_to_another_time_and_moved_by_keys(
    browser: Browser, planned_address: str, files: dict[str, Path], tmp_path: Path
) -> None:
    page = open_page(browser, planned_address, motion="reduce")
    run(page, files)
    one = stroke(page, "offer")
    one.scroll_into_view_if_needed()
    box = one.bounding_box()
    plot = page.locator("#player .timeline .plot.tier").first.bounding_box()
    assert box is not None and plot is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + plot["width"] / LONG_S, y, steps=4)  # a second on
    page.mouse.up()
    said(page, text.TAKE_DONE.format(number=1))
    dragged, beat = landing(page, tmp_path)["right"]
    assert abs(dragged - 3.0) < 0.05 and beat == 6.5
    stroke(page, "offer").focus()
    page.keyboard.press("Shift+ArrowRight")
    said(page, text.TAKE_DONE.format(number=2))
    assert abs(landing(page, tmp_path)["right"][0] - dragged - 0.1) < 0.02
    page.context.close()


def hold_ends(page: Page, tmp_path: Path) -> float:
    """When the first gesture's hold ends, as the file of the plan says it."""
    right = read_plan_file(saved(page, ".eaf", tmp_path)).plan.right
    return round(next(one.end_s for one in right if one.phase == "hold"), 2)


def test_the_end_of_a_hold_is_dragged_and_moved_by_keys_and_undone(
    browser: Browser, planned_address: str, files: dict[str, Path], tmp_path: Path
) -> None:
    page = open_page(browser, planned_address, motion="reduce")
    run(page, files)
    hold = page.locator("#player .timeline .event.hold").first
    hold.scroll_into_view_if_needed()
    hold.click()
    handle = page.get_by_role("slider", name="End of the hold")
    expect(handle).to_have_attribute("aria-valuetext", "hold ends at 2.30 s")
    box = handle.bounding_box()
    plot = page.locator("#player .timeline .plot.tier").first.bounding_box()
    assert box is not None and plot is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 0.8 * plot["width"] / LONG_S, y, steps=4)  # .8 s on
    expect(editor(page).locator(".ends-at")).to_contain_text("hold ends at 3.")
    page.mouse.up()
    said(page, text.TAKE_DONE.format(number=1))
    expect(handle).to_be_focused()
    dragged = hold_ends(page, tmp_path)
    assert abs(dragged - 3.1) < 0.05

    handle.focus()
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    expect(handle).to_have_attribute("aria-valuetext", f"hold ends at {dragged + 0.3:.2f} s")
    said(page, text.TAKE_DONE.format(number=2))
    page.keyboard.press("Control+z")
    expect(handle).to_have_attribute("aria-valuetext", f"hold ends at {dragged:.2f} s")
    expect(handle).to_be_focused()
    page.keyboard.press("Control+Shift+z")
    expect(handle).to_have_attribute("aria-valuetext", f"hold ends at {dragged + 0.3:.2f} s")
    assert hold_ends(page, tmp_path) == pytest.approx(dragged + 0.3, abs=0.011)
    assert landing(page, tmp_path)["right"] == [2.0, 6.5]

    stroke(page, "offer").scroll_into_view_if_needed()
    edge = stroke(page, "offer").bounding_box()  # a mouse takes hold of the end of any phase
    assert edge is not None
    at = edge["x"] + edge["width"] - 2, edge["y"] + edge["height"] / 2
    page.mouse.move(*at)
    page.mouse.down()
    page.mouse.move(at[0] - 0.9 * edge["width"], at[1], steps=4)
    page.mouse.up()
    said(page, "lasts 0.2 s at least")
    assert landing(page, tmp_path)["right"] == [1.89, 6.5]
    page.context.close()


def test_what_cannot_be_is_refused_in_a_sentence_and_changes_nothing(
    browser: Browser, planned_address: str, files: dict[str, Path], tmp_path: Path
) -> None:
    page = open_page(browser, planned_address, motion="reduce")
    run(page, files)
    editor(page).get_by_label("Plan from a file").set_input_files(
        {"name": "x.json", "mimeType": "application/json", "buffer": b"[]"}
    )
    said(page, "is no plan of format 1")
    expect(editor(page).locator(".said-of-edits.refused")).to_be_visible()
    assert landing(page, tmp_path)["right"] == [2.0, 6.5]

    stroke(page, "offer").click()
    editor(page).get_by_role("button", name="Lock").click()
    editor(page).get_by_role("button", name="Delete").click()
    said(page, "is locked; unlock it to change it")

    plan = json.loads(files[".json"].read_text())
    plan["nods"] = [{"time_s": 1.0, "depth_deg": 8.0}]
    editor(page).get_by_label("Plan from a file").set_input_files(
        {"name": "x.json", "mimeType": "application/json", "buffer": json.dumps(plan).encode()}
    )
    said(page, text.TAKE_DONE.format(number=3))
    assert read_plan_file(saved(page, ".eaf", tmp_path)).plan.nods[0].time_s == 1.0
    page.context.close()


def test_on_a_phone_a_gesture_is_added_and_deleted(
    browser: Browser,
    planned_address: str,
    files: dict[str, Path],
) -> None:
    page = open_page(browser, planned_address, width=390, motion="reduce")
    run(page, files)
    editor(page).get_by_label("Where").select_option("1")
    editor(page).get_by_label("With", exact=True).select_option("left")
    editor(page).get_by_role("button", name="Add", exact=True).click()
    said(page, text.TAKE_DONE.format(number=1))
    added_one = page.locator("#player .timeline .event.stroke[data-list=left]")
    added_one.click()
    expect(editor(page).locator(".which")).to_contain_text("you, left hand, 8.15 s")
    editor(page).get_by_role("button", name="Delete").click()
    said(page, text.TAKE_DONE.format(number=2))
    expect(added_one).to_have_count(0)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.context.close()
