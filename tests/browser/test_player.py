"""The lock-step player in a real Chromium, over a pipeline that draws numbered pictures at once."""

import io
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page, expect

from app import text
from model.motion.motion import save_motion
from tests.app import fakes
from tests.browser.conftest import (
    FAKED_SYSTEMS as SYSTEMS,
)
from tests.browser.conftest import (
    FRAMES,
    PATIENCE_MS,
    STAGED,
    Stage,
    open_page,
    show_videos,
    start,
)

pytestmark = pytest.mark.browser

LABELS = [name.rsplit("/")[-1] for name in SYSTEMS]
"""What the page calls them."""
READ_FRAMES = """() => [...document.querySelectorAll('#player video')].map(video => {
    const canvas = document.createElement('canvas');
    canvas.width = canvas.height = 80;
    const context = canvas.getContext('2d', { willReadFrequently: true });
    context.drawImage(video, 0, 0, 80, 80);
    const row = context.getImageData(0, 40, 80, 1).data;
    let number = 0;
    for (let bit = 0; bit < BITS; bit++) {
        const x = Math.floor((bit + 0.5) * 80 / BITS);
        number = 2 * number + (row[4 * x] > 128 ? 1 : 0);
    }
    return number;
})""".replace("BITS", str(fakes.FRAME_BITS))
"""The number of the frame that each video shows, from its picture."""

IN_SYNC = f"""async () => {{
    const read = {READ_FRAMES};
    const audio = document.querySelector('#player audio');
    const lockstep = document.querySelector('.lockstep').lockstep;
    for (let good = 0; good < 12; good++) {{
        await new Promise(requestAnimationFrame);
        const now = audio.currentTime * 30;
        const shown = read();
        const isPlaying = !audio.paused && lockstep.isPlaying;
        // A frame is right from its own time to the next one's.
        const isNear = shown.every(frame => frame + 1 >= now - 1 && frame <= now + 1);
        if (!isPlaying || !isNear || shown.length !== 3) return false;
    }}
    return true;
}}"""
"""Whether three videos were within one frame of the sound in twelve pictures in a row."""


@pytest.fixture(scope="module")
def done(browser: Browser, fake_address: str, stage: Stage, speech: Path) -> Iterator[Page]:
    """A run of three systems and a reference that has ended; tests share it."""
    stage.hold(12)
    page = open_page(browser, fake_address)
    start(page, speech)
    page.locator("#bundle").wait_for()
    page.locator("#player .lane canvas").first.wait_for()
    expect(page.locator("#status")).to_contain_text(text.VIDEOS_DONE, timeout=PATIENCE_MS)
    show_videos(page)
    yield page
    page.context.close()


@pytest.fixture
def player(done: Page) -> Page:
    """The shared page, at rest on its first frame with nothing changed."""
    done.evaluate(
        """() => {
            const { lockstep } = document.querySelector('.lockstep');
            lockstep.pause(); lockstep.setLoop(null); lockstep.setRate(1); lockstep.seekFrame(0);
        }"""
    )
    done.locator("#player").get_by_role("button", name="All", exact=True).click()
    expect_frames(done, 0)
    return done


def expect_frames(page: Page, frame: int) -> None:
    """Every video comes to show this frame."""
    page.wait_for_function(f"frame => ({READ_FRAMES})().every(shown => shown === frame)", arg=frame)


def expect_sync(page: Page) -> None:
    """While it plays, all three come to be within one frame of the sound and stay there."""
    page.wait_for_function(IN_SYNC)


def test_three_videos_keep_within_a_frame_of_the_sound(player: Page) -> None:
    bar = player.locator("#player .controls")
    bar.get_by_role("button", name="Play", exact=True).click()
    expect_sync(player)
    player.evaluate("document.querySelectorAll('#player video')[1].currentTime += 0.5")
    expect_sync(player)  # one that was thrown off is brought back
    player.evaluate("document.querySelector('.lockstep').lockstep.seek(3.0)")
    assert player.evaluate("document.querySelector('#player audio').currentTime") >= 2.9
    expect_sync(player)
    player.evaluate("document.querySelector('.lockstep').lockstep.setLoop([1, 5])")
    for rate in ("0.5", "2"):
        bar.get_by_label("Speed").select_option(rate)
        assert player.evaluate("document.querySelector('#player audio').playbackRate") == float(
            rate
        )
        expect_sync(player)
    bar.get_by_role("button", name="Pause", exact=True).click()
    frame = player.evaluate("document.querySelector('.lockstep').lockstep.frame")
    expect_frames(player, frame)


def test_a_click_on_a_plot_shows_that_moment(player: Page) -> None:
    for lane, share in (("globaldiff/global", 0.5), ("globaldiff/local", 0.81)):
        plot = player.locator(f'.lane[data-name="{lane}"] .plot')
        box = plot.bounding_box()
        assert box is not None
        plot.click(position={"x": box["width"] * share, "y": 10})
        frame = player.evaluate("document.querySelector('.lockstep').lockstep.frame")
        assert abs(frame - share * FRAMES) <= 1
        expect_frames(player, frame)
        at = player.evaluate(
            "getComputedStyle(document.querySelector('.lanes')).getPropertyValue('--at')"
        )
        assert float(at) == pytest.approx(share, abs=1 / FRAMES)


def test_keys_play_step_hop_loop_and_enlarge(player: Page) -> None:
    for key, frame in ((".", 1), (".", 2), (",", 1), ("ArrowRight", 31), ("ArrowLeft", 1)):
        player.keyboard.press(key)
        expect_frames(player, frame)
    player.keyboard.press("End")
    expect_frames(player, FRAMES - 1)
    player.keyboard.press("l")
    assert player.evaluate("document.querySelector('.lockstep').lockstep.loop") == [4, 6]
    player.keyboard.press("Space")
    player.wait_for_function(
        "() => { const l = document.querySelector('.lockstep').lockstep;"
        " return l.isPlaying && l.time >= 4 && l.time < 5.5; }"
    )
    player.keyboard.press("Space")
    assert not player.evaluate("document.querySelector('.lockstep').lockstep.isPlaying")
    player.keyboard.press("2")
    large = player.locator("#player .tile.large")
    expect(large).to_have_attribute("data-name", "globaldiff/global")
    player.keyboard.press("2")
    expect(large).to_have_count(0)


SHOWN = """() => {
    const lanes = document.querySelector('#player .lanes');
    const share = Number(getComputedStyle(lanes).getPropertyValue('--at'));
    return document.querySelector('#player .cursor').hidden ? null : share;
}"""
"""Where the present moment stands on the time line."""


def test_the_time_line_zooms_by_buttons_keys_and_wheel(player: Page) -> None:
    zoom = player.get_by_role("group", name="Zoom of the time line")
    whole = zoom.get_by_role("button", name="Show all of it")
    seek = "seconds => document.querySelector('.lockstep').lockstep.seek(seconds)"
    player.evaluate(seek, 3.0)  # of 6
    assert player.evaluate(SHOWN) == pytest.approx(0.5, abs=0.01)
    expect(whole).to_be_disabled()
    zoom.get_by_role("button", name="Show less time, larger").click()
    assert player.evaluate(SHOWN) == pytest.approx(0.5, abs=0.01)  # it stays where it was
    player.evaluate(seek, 3.75)  # a quarter of the clip on, of 6 / 1.6 s that are shown
    assert player.evaluate(SHOWN) == pytest.approx(0.5 + 0.75 / 3.75, abs=0.01)
    player.evaluate(seek, 0.0)  # the page turns
    assert player.evaluate(SHOWN) == pytest.approx(0.0, abs=0.01)
    player.keyboard.press("0")
    expect(whole).to_be_disabled()

    plot = player.locator("#player .lane .plot").first
    box = plot.bounding_box()
    assert box is not None
    player.mouse.move(box["x"] + box["width"] - 1, box["y"] + 5)
    player.keyboard.down("Control")
    player.mouse.wheel(0, -300)
    player.keyboard.up("Control")
    expect(whole).to_be_enabled()
    player.wait_for_function(f"() => ({SHOWN})() === null")  # 0 s is not among the last ones
    player.mouse.click(box["x"] + 1, box["y"] + 5)
    assert player.evaluate("document.querySelector('.lockstep').lockstep.time") > 3.0
    player.keyboard.press("0")
    assert player.evaluate(SHOWN) > 0.5


def test_the_worst_second_is_played_slowly_again_and_again(player: Page) -> None:
    bar = player.locator("#player .controls")
    worst = bar.get_by_role("button", name="Worst second", exact=True)
    state = """(() => {
        const { rate, loop, isPlaying } = document.querySelector('.lockstep').lockstep;
        return { rate, loop, isPlaying };
    })()"""
    worst.click()
    expect(worst).to_have_attribute("aria-pressed", "true")
    line = player.locator("#player .worst-line")
    first = player.evaluate(state)
    assert first["rate"] == 0.25 and first["loop"][1] - first["loop"][0] == pytest.approx(1.0)
    expect(line).to_contain_text(re.compile(r"1 of \d: (local|global|full),"))
    player.wait_for_function(
        "() => { const l = document.querySelector('.lockstep').lockstep;"
        " return l.isPlaying && l.time > l.loop[0] && l.time < l.loop[1]; }"
    )
    bar.get_by_role("button", name="Next second, less bad").click()
    expect(line).to_contain_text(re.compile(r"2 of \d"))
    second = player.evaluate(state)
    assert abs(second["loop"][0] - first["loop"][0]) >= 1.0
    bar.get_by_role("button", name="Next worse second").click()
    assert player.evaluate(state)["loop"] == first["loop"]
    player.keyboard.press("l")  # another loop is another matter
    expect(worst).to_have_attribute("aria-pressed", "false")
    player.keyboard.press("w")
    player.keyboard.press("w")
    assert player.evaluate(state)["loop"] is None and player.evaluate(state)["rate"] == 1


def test_a_close_up_is_one_click_away(player: Page) -> None:
    """Each picture holds body, face and hands; the tile shows what is asked for."""
    choice = player.get_by_label("Close-up", exact=True)
    shown = """() => {
        const picture = document.querySelector('#player .picture').getBoundingClientRect();
        const video = document.querySelector('#player video').getBoundingClientRect();
        const share = y => (y - video.top) / video.height;
        return [share(picture.top), share(picture.bottom)];
    }"""
    expect(choice).to_have_value("hands")
    for name, edges in (
        # A face of 240 rows, a body of 640, hands of 240.
        ("hands", (240 / 1120, 1.0)),
        ("face", (0.0, 880 / 1120)),
        ("both", (0.0, 1.0)),
        ("off", (240 / 1120, 880 / 1120)),
    ):
        choice.select_option(name)
        assert player.evaluate(shown) == pytest.approx(edges, abs=0.01)
    player.keyboard.press("c")
    expect(choice).to_have_value("hands")


@pytest.mark.parametrize("mode", ["grid", "wipe"])
def test_a_large_picture_fits_the_window(player: Page, mode: str) -> None:
    if mode == "wipe":
        player.locator("#player").get_by_role("button", name="Wipe").click()
    else:
        player.keyboard.press("1")
    tall = player.evaluate(
        "Math.max(...[...document.querySelectorAll('#player .picture')]"
        ".map(each => each.getBoundingClientRect().height))"
    )
    assert 500 < tall < 900, "of a window of 900"
    if mode == "grid":
        player.keyboard.press("1")


def test_two_videos_are_wiped_and_flickered(player: Page) -> None:
    bar = player.locator("#player .controls")
    bar.get_by_role("button", name="Wipe").click()
    bar.get_by_label("Second of two").select_option("globaldiff/full")
    shown = player.locator("#player .tile:visible")
    expect(shown).to_have_count(2)
    boxes = [tile.locator(".picture").bounding_box() for tile in shown.all()]
    assert boxes[0] == boxes[1]
    handle = player.locator("#player .wipe")
    handle.focus()
    handle.press("ArrowRight")
    expect(handle).to_have_attribute("aria-valuenow", "52")
    bar.get_by_role("button", name="Flicker").click()
    for index in (0, 1):
        player.wait_for_function(
            "i => getComputedStyle(document.querySelector(i ? '.second-of-two' : '.first-of-two'))"
            ".visibility === 'hidden'",
            arg=index,
        )


def test_a_ghost_is_grey_where_two_agree_and_coloured_where_they_do_not(player: Page) -> None:
    player.keyboard.press("g")
    player.locator("#player .controls").get_by_label("Second of two").select_option(SYSTEMS[1])
    expect(player.locator("#player .tiles .ghost-legend")).to_contain_text("Grey where both agree.")
    shown = player.locator("#player .tile:visible")
    expect(shown).to_have_count(2)
    picture = shown.first.locator(".picture")

    def colourfulness() -> float:
        drawn = np.asarray(Image.open(io.BytesIO(picture.screenshot())).convert("RGB"), float)
        return float((drawn.max(axis=-1) - drawn.min(axis=-1)).mean())

    expect_frames(player, 0)
    player.wait_for_timeout(200)
    assert colourfulness() < 2.0
    # Another moment of one of them: bars where the other has none.
    player.evaluate("document.querySelector('.second-of-two video').currentTime = 3.3")
    player.wait_for_function("() => !document.querySelector('.second-of-two video').seeking")
    player.wait_for_timeout(200)
    assert colourfulness() > 20.0
    player.keyboard.press("g")
    expect(player.locator("#player .tiles .ghost-legend")).not_to_be_visible()


def test_one_switch_filters_plots_and_measures(player: Page) -> None:
    jerk = player.locator('#numbers tr[data-measure="Jerk"]')
    expect(jerk.locator("td .raw").first).to_have_text("110")
    player.locator("#player .timeline").get_by_role("button", name=text.FILTERED).click()
    expect(jerk.locator("td .savgol").first).to_be_visible()
    expect(jerk.locator("td .raw").first).not_to_be_visible()
    player.locator("#numbers").get_by_role("button", name=text.AS_GENERATED).click()
    expect(jerk.locator("td .raw").first).to_be_visible()
    button = player.locator("#player .timeline").get_by_role("button", name=text.AS_GENERATED)
    expect(button).to_have_attribute("aria-pressed", "true")


def test_measures_order_the_systems_and_are_saved(player: Page, tmp_path: Path) -> None:
    heads = player.locator("#numbers thead th[data-name]")
    jerk = player.locator('#numbers tr[data-measure="Jerk"] button')
    jerk.click()
    jerk.click()
    expect(heads).to_have_text([*reversed(LABELS)])
    expect(player.locator('#numbers tr[data-measure="Jerk"] td').first).to_contain_text("130")
    with player.expect_download() as download:
        player.get_by_role("button", name=text.CSV_LABEL).click()
    download.value.save_as(tmp_path / "measures.csv")
    lines = (tmp_path / "measures.csv").read_text().splitlines()
    assert '"Jerk","m/s³","globaldiff/full","raw","130"' in [
        line.replace("130.0", "130") for line in lines
    ]
    jerk.click()
    expect(heads).to_have_text([*LABELS])


def test_a_saved_cell_begins_no_formula(player: Page, tmp_path: Path) -> None:
    head = player.locator("#numbers thead th[data-name]").first
    name = head.get_attribute("data-name")
    head.evaluate("head => { head.dataset.name = '=1;@SUM(1)\\u001b\\u202e'; }")
    with player.expect_download() as download:
        player.get_by_role("button", name=text.CSV_LABEL).click()
    head.evaluate("(head, name) => { head.dataset.name = name; }", name)
    download.value.save_as(tmp_path / "measures.csv")
    saved = (tmp_path / "measures.csv").read_text("utf-8")
    assert '"Jerk","m/s³","\'=1;\'@SUM(1)??","raw","' in saved


def test_a_figure_fills_the_window_on_click(player: Page) -> None:
    player.locator("#figures button.zoom").first.click()
    large = player.locator("dialog.lightbox img")
    expect(large).to_be_visible()
    assert large.evaluate("image => image.naturalWidth") == 160
    player.keyboard.press("Escape")
    expect(large).not_to_be_visible()


def test_another_browser_cannot_fetch_the_videos(player: Page, browser: Browser) -> None:
    url = player.locator("#player video").first.get_attribute("src")
    where = player.evaluate("url => new URL(url, document.baseURI).href", url)
    assert player.request.get(where).status == 200
    stranger = browser.new_context()
    assert stranger.request.get(where).status == 404
    stranger.close()


def test_a_link_opens_the_run_again_in_another_browser(player: Page, browser: Browser) -> None:
    link = player.locator("#runs .link a")
    href = link.evaluate("link => link.href")
    assert re.search(r"[?]run=[\w-]{43}$", href)
    player.locator("#runs summary").click()
    mine = player.locator("#runs li a")
    expect(mine).to_have_text([f"speech: {', '.join(LABELS)}; seed 0"])
    expect(player.locator("#runs time")).to_have_text(re.compile(r"\d\d?:\d\d"))

    other = browser.new_context().new_page()
    other.set_default_timeout(PATIENCE_MS)
    other.goto(href)
    other.locator("#player .lane canvas").first.wait_for()
    show_videos(other)
    expect(other.locator("#player video")).to_have_count(3)
    other.wait_for_function("() => document.querySelector('#player video').duration > 5")
    expect(other.locator('#numbers tr[data-measure="Jerk"] td .raw').first).to_have_text("110")
    expect(other.locator("#status")).to_contain_text(f"{FRAMES} frames each")
    expect(other.locator("#runs .link")).to_contain_text("minutes more")
    expect(other.locator("#runs li")).to_have_count(0)  # it is another's
    with other.expect_download() as download:
        other.locator("#bundle").click()
    assert download.value.suggested_filename.endswith(".zip")
    # What the first browser got is still its own.
    src = player.locator("#player video").first.get_attribute("src")
    assert other.locator("#player video").first.get_attribute("src") != src
    other.goto(re.sub(r"=.*", "=" + "x" * 43, href))
    expect(other.locator("#message")).to_contain_text("kept no longer")
    expect(other.locator("#player video")).to_have_count(0)
    other.context.close()


def test_videos_appear_one_by_one_beside_a_reference_until_another_run_begins(
    browser: Browser, fake_address: str, stage: Stage, speech: Path, tmp_path: Path
) -> None:
    stage.hold(0)
    page = open_page(browser, fake_address, width=390)
    page.get_by_role("button", name=text.ADVANCED_LABEL).click()
    reference = tmp_path / "reference.npz"
    save_motion(fakes.made_motion(FRAMES), reference)
    page.set_input_files("#reference input[type=file]", str(reference))
    expect(page.locator("#reference")).to_contain_text("reference")
    transcript = tmp_path / "words.TextGrid"
    transcript.write_text(
        'File type = "ooTextFile"\nObject class = "TextGrid"\n'
        'item [1]:\n class = "IntervalTier"\n name = "words"\n'
        ' intervals [1]:\n xmin = 1\n xmax = 2\n text = "<b>hello</b>"\n'
    )
    page.set_input_files("#transcript input[type=file]", str(transcript))
    expect(page.locator("#transcript")).to_contain_text("words")
    start(page, speech)
    page.wait_for_function(STAGED, arg=4)
    show_videos(page)
    drawing, videos = page.locator("#player .drawing:visible"), page.locator("#player video")
    expect(drawing).to_have_count(4, timeout=PATIENCE_MS)
    for drawn in (1, 2):
        stage.hold(drawn)
        expect(videos).to_have_count(drawn, timeout=PATIENCE_MS)
        expect(drawing).to_have_count(4 - drawn)
    expect(page.locator("#player .lane[data-name]")).to_have_count(4, timeout=PATIENCE_MS)
    expect(page.locator("#player .words span")).to_have_text("<b>hello</b>")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.get_by_label(text.VIDEOS_LABEL).uncheck()
    page.get_by_role("button", name=text.GENERATE).click()
    expect(videos).to_have_count(0, timeout=PATIENCE_MS)
    stage.hold(12)
    page.wait_for_function(STAGED, arg=4)
    expect(page.locator("#status")).to_contain_text("Done in", timeout=PATIENCE_MS)
    show_videos(page)
    expect(drawing).to_have_text(4 * ["no video was asked for"], timeout=PATIENCE_MS)
    page.context.close()


def test_recognised_words_come_into_the_time_line_when_the_run_ends_and_say_what_they_are(
    browser: Browser, fake_address: str, stage: Stage, speech: Path
) -> None:
    stage.hold(12)
    page = open_page(browser, fake_address)
    page.get_by_role("button", name=text.ADVANCED_LABEL).click()
    page.get_by_label(text.WORDS_LABEL).check()
    start(page, speech)
    expect(page.locator("#player .words span")).to_have_text("hello", timeout=PATIENCE_MS)
    names = page.locator("#player .lane:has(.words) .name")
    expect(names).to_have_text("Words (recognised)")
    page.context.close()


@pytest.mark.parametrize("width", [390])
def test_results_are_no_wider_than_the_window(player: Page, width: int) -> None:
    player.set_viewport_size({"width": width, "height": 800})
    assert player.evaluate("document.documentElement.scrollWidth") <= width
    table = player.locator("#numbers .scroll")
    assert table.evaluate("box => box.scrollWidth > box.clientWidth")
    for mode in ("Wipe", "All"):
        player.locator("#player").get_by_role("button", name=mode, exact=True).click()
        assert player.evaluate("document.documentElement.scrollWidth") <= width
    player.set_viewport_size({"width": 1280, "height": 900})


def test_the_ladder_is_explained_on_a_phone_too(browser: Browser, fake_address: str) -> None:
    page = open_page(browser, fake_address, width=390)
    page.get_by_role("tab", name=text.LADDER_TAB).click()
    expect(page.locator(".ladder li")).to_have_count(5)
    expect(page.locator(".ladder .absent")).to_have_count(2)
    expect(page.locator(".ladder .equation .katex-html")).to_have_count(5)
    expect(page.locator(".ladder .katex-error")).to_have_count(0)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.context.close()
