"""A visitor's own character on the stage: chosen, moved by the run, saved with the motion in it."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from app import text
from app.page.tabs import live as live_tab
from renderer.body.body import load_body
from renderer.body.gltf import Gltf
from tests.browser.conftest import (
    BUILDS_ARE_THERE,
    Fake,
    bar_of,
    opened,
    ready,
    saved,
    stage_digest,
    staged,
    start,
)
from tests.renderer.body.made_character import character

pytestmark = pytest.mark.browser

CHOICE = "Your own character (.glb or .vrm)"


def test_character_moves_on_all_stages_is_saved_with_the_motion_and_kept(
    browser: Browser, the_fake: Fake, fake_address: str, speech: Path, tmp_path: Path
) -> None:
    the_fake.usual()
    hero, broken = tmp_path / "hero.glb", tmp_path / "broken.vrm"
    hero.write_bytes(character(load_body(), "mixamo"))
    broken.write_bytes(hero.read_bytes()[:5000])
    context = browser.new_context(
        viewport={"width": 1280, "height": 900}, reduced_motion="reduce", accept_downloads=True
    )
    page = opened(context, fake_address)
    start(page, speech)
    staged(page, 3).locator("#player .tier-lane .event").first.wait_for()
    expect(page.locator("#status")).to_contain_text(text.VIDEOS_DONE)
    page.wait_for_function(BUILDS_ARE_THERE)  # nothing draws the stage anew after this
    stage = page.locator("#player .stage")
    bar_of(page).locator(".more").click()
    open_body = stage_digest(page)
    choice = page.locator("#player .body-choice")
    choice.get_by_label(CHOICE).set_input_files(broken)
    expect(choice.locator("output")).to_contain_text("not a complete glTF 2.0 file")
    choice.get_by_label(CHOICE).set_input_files(hero)
    expect(choice.locator("output")).to_have_text("hero.glb")
    expect(stage).to_have_attribute("data-character", "own")
    for label in ("Body shape", "Skin tone of the bodies"):  # they would do nothing
        expect(page.locator("#player").get_by_label(label)).to_be_hidden()
    assert stage_digest(page) != open_body
    page.locator("#player .files summary").first.click()
    file = saved(page, page.locator("#player .files a[download$='-character.glb']").first, tmp_path)
    gltf = Gltf(file.read_bytes(), file.name)
    paths = [each["target"]["path"] for each in gltf.document["animations"][0]["channels"]]
    assert paths.count("rotation") == 55
    assert paths.count("translation") == 1
    choice.get_by_role("button", name="Open body").click()
    expect(stage).to_have_attribute("data-character", "")
    assert stage_digest(page) == open_body
    page.get_by_role("tab", name=live_tab.TAB, exact=True).click()
    live = page.locator(".live")
    live.locator(".more").click()
    live.get_by_label(CHOICE).set_input_files(hero)
    for each in (live.locator(".stage"), stage):
        expect(each).to_have_attribute("data-character", "own")
    page.reload()
    staged(ready(page), 3).locator("#player .tier-lane .event").first.wait_for()  # the run again
    expect(stage).to_have_attribute("data-character", "own")
    page.wait_for_function(BUILDS_ARE_THERE)  # they are the open body's all the same
    bar_of(page).locator(".more").click()
    expect(choice.locator("output")).to_have_text("hero.glb")
    choice.get_by_role("button", name="Open body").click()
    expect(stage).to_have_attribute("data-character", "")
    assert stage_digest(page) == open_body
    context.close()
