"""Pages without the server: a study's for its participants, a player and a board as one file."""

import json
import re
from collections.abc import Callable, Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from app.notebook import show
from app.run.batch.leaderboard import LeaderboardEntry, MetricValue, leaderboard_page_html
from app.study.design.key import StudyKey, read_key
from app.study.design.plan import load_wording
from app.study.leaks import find_leaks
from app.study.statistics.answers import CollectedAnswers, collect_answers
from model.speech.audio import Speech
from tests.app.study.made_study import make_study
from tests.browser.conftest import PATIENCE_MS, expect_fit, findings, saved, watched
from tests.helpers import smooth_motion_example
from tests.model.made import made_waveform

pytestmark = pytest.mark.browser

SYSTEMS, CLIPS = ["localnet", "globalnet"], ["kitchen", "garden"]
WORDS = load_wording()
BUTTONS = WORDS["buttons"]
RETURN_TO = "https://example.org/done?cc=C0DE"
CONTACT = "ask@lab.example"
PANEL = 'panel_ids = ["PROLIFIC_PID", "STUDY_ID"]'
HANG_MS = 20_000
"""Time without a new picture after which a video has failed."""
DOTS_MS, TONES_MS = 1500, 3900
"""How long a dot of the practice moves, and three tones sound: time that the page's clock can
skip, as it cannot for videos."""
FONTS_ARE_THERE = "() => [...document.fonts].every(({ status }) => status === 'loaded')"
SEEN = "index => document.querySelectorAll('.card')[index].className === 'card seen'"
QUIET = """() => {
    window.peaks = [];
    const start = AudioBufferSourceNode.prototype.start;
    AudioBufferSourceNode.prototype.start = function (...when) {
        window.peaks.push(Math.max(...this.buffer.getChannelData(0)));
        return start.apply(this, when);
    };
}"""
"""Notes each tone's loudness: the quiet one is what a listener would press."""


class _Host(SimpleHTTPRequestHandler):
    """A web host that keeps what is posted to it."""

    posted: list[bytes]

    def do_POST(self) -> None:
        self.posted.append(self.rfile.read(int(self.headers["Content-Length"])))
        self.send_response(200)
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:
        pass


class Host:
    """An address with one study for each protocol below it, and their folder."""

    def __init__(self, root: Path) -> None:
        self.root, self.posted = root, list[bytes]()
        handler = type("Handler", (_Host,), {"posted": self.posted})
        self.server = ThreadingHTTPServer(("127.0.0.1", 0), partial(handler, directory=str(root)))
        self.address = f"http://127.0.0.1:{self.server.server_port}"
        post = f'post_to = "{self.address}/answers"\nreturn_to = "{RETURN_TO}"'
        for protocol, settings in {
            "pairwise": f'contact = "{CONTACT}"\nethics = "Board 7"\n{PANEL}',
            "matched": "attention_checks = 0\n" + post,
            "ranking": "attention_checks = 0",
            "rating": "attention_checks = 0",
        }.items():
            systems = SYSTEMS[:1] if protocol == "matched" else SYSTEMS
            clips = CLIPS[: 1 if protocol in ("ranking", "rating") else 2]
            make_study(root / protocol, systems, clips, f'protocol = "{protocol}"\n{settings}')

    def bundle(self, protocol: str) -> Path:
        return self.root / protocol / "study" / "participant_bundle"

    def key(self, protocol: str) -> StudyKey:
        return read_key(self.root / protocol / "study" / "researcher_only" / "key.json")

    def collected(self, protocol: str, folder: Path) -> CollectedAnswers:
        return collect_answers([folder], self.key(protocol))


@pytest.fixture(scope="module")
def host(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Host]:
    host = Host(tmp_path_factory.mktemp("host"))
    Thread(target=host.server.serve_forever, daemon=True).start()
    yield host
    host.server.shutdown()
    host.server.server_close()


@pytest.fixture
def take_part(visitor: Callable[..., BrowserContext], host: Host) -> Callable[..., Page]:
    """Open a study as a new participant, who shares nothing with the others."""

    def open_page(protocol: str, query: str = "?p=0", width: int = 1280, is_file: bool = False):
        is_phone = width < 500
        context = visitor(width, 844 if is_phone else 720, has_touch=is_phone)
        page = watched(context.new_page())
        page.clock.install()
        root = host.root.as_uri() if is_file else host.address
        page.goto(f"{root}/{protocol}/study/participant_bundle/index.html{query}")
        return page

    return open_page


def agree(page: Page) -> None:
    start = page.get_by_role("button", name=BUTTONS["start"])
    expect(start).to_be_disabled()
    page.get_by_label(WORDS["consent"]["agree"]).check()
    start.click()


def skip_sound(page: Page) -> None:
    agree(page)
    page.get_by_role("button", name=WORDS["headphones"]["skip"]).click()


def by_click(page: Page, index: int) -> None:
    page.locator(".card .play").nth(index).click()


def by_key(page: Page, index: int) -> None:
    page.keyboard.press(str(index + 1))


Press = Callable[[Page, int], None]


def watch_all(page: Page, press: Press = by_click, skipped_ms: int = 0) -> None:
    """Play each video to its end."""
    for index in range(page.locator(".card").count()):
        press(page, index)
        if skipped_ms:
            page.clock.fast_forward(skipped_ms)
        page.wait_for_function(SEEN, arg=index, timeout=PATIENCE_MS)


def place(page: Page) -> str:
    return page.locator("#place").inner_text()


def go_on(page: Page) -> None:
    """Next, which is in sight on every page, and wait for the page that it leads to."""
    before = place(page)
    expect(page.locator("#next")).to_be_in_viewport(ratio=0.99)
    page.locator("#next").click()
    page.wait_for_function(
        "text => document.querySelector('#place').innerText !== text", arg=before
    )


def choose(page: Page, side: str = "left") -> None:
    page.locator(".choices").get_by_text(BUTTONS[side], exact=True).click()


def practise(page: Page, press: Press = by_click, skipped_ms: int = DOTS_MS) -> None:
    """The page with dots in place of people."""
    expect(page.locator("#place")).to_have_text(WORDS["practice"]["place"])
    expect(page.locator(".card .film")).to_have_count(2)
    expect(page.locator("#next")).to_be_disabled()
    watch_all(page, press, skipped_ms)
    for label in page.locator(".choices label").all()[:1]:
        label.click()
    for part in page.locator(".ranks").all():
        part.get_by_role("button", name="2").click()
    for slider in page.get_by_role("slider").all():
        slider.fill("10")
    go_on(page)
    expect(page.locator(".card .film")).to_have_count(0)


def obey(page: Page) -> None:
    """Checks of attention as they say, where the next pages are some."""
    while page.locator(".press").count():
        said = page.locator(".press").inner_text()
        name = next(BUTTONS[side] for side in ("left", "right") if BUTTONS[side] in said)
        page.get_by_text(name, exact=True).click()
        go_on(page)


def answer_pairs(page: Page, until: int = 100) -> None:
    """Answer pages, the left video each time and checks as they say, from wherever it stands."""
    for _ in range(until):
        if page.locator(".card .film").count():
            practise(page)
        obey(page)
        if not place(page):
            return
        expect(page.locator("#next")).to_be_disabled()
        watch_all(page)
        choose(page)
        go_on(page)


def saved_answers(page: Page, out: Path) -> Path:
    return saved(page, page.get_by_role("button", name=BUTTONS["download"]), out)


def kept_name(page: Page, of: str = "about") -> str:
    """The name under which the browser keeps something of the participant."""
    keys = page.evaluate("Object.keys(localStorage)")
    name = rf"study/[0-9a-f]{{16}}/[0-9a-f]{{16}}/{of}"
    return next(key for key in keys if re.fullmatch(name, key))


def kept(page: Page, name: str) -> str:
    return page.evaluate("name => localStorage.getItem(name)", name)


def is_whole(host: Host, protocol: str, participant: Any) -> bool:
    """Whether somebody has answered every page of their list, and come to the end."""
    asked = sorted(host.key(protocol).lists[participant.list_number])
    return participant.finished is not None and asked == sorted(
        answer.trial for answer in participant.answers
    )


def test_two_participants_complete_a_study_and_their_answers_are_read(
    take_part: Callable[..., Page], host: Host, tmp_path: Path
) -> None:
    """One at a desk, by keyboard alone; one on a phone who reloads half-way, in the middle of a
    page."""
    desk = take_part("pairwise", "?p=0")
    assert findings(desk) == []
    said = desk.locator("#main").inner_text()
    assert f"please contact {CONTACT}" in said and "Ethics approval: Board 7" in said
    assert re.search(r"takes about \d+ minutes: a short practice page, then \d+ pages", said)
    for key in ("Tab", "Space", "Tab", "Enter"):
        desk.keyboard.press(key)
    practise(desk, by_key)
    while place(desk):
        before = place(desk)
        if desk.locator(".press").count():
            is_left = BUTTONS["left"] in desk.locator(".press").inner_text()
            desk.keyboard.press("ArrowLeft" if is_left else "ArrowRight")
        else:
            desk.keyboard.press("ArrowRight")  # nothing may be chosen before both were watched
            expect(desk.locator(".choices input:checked")).to_have_count(0)
            watch_all(desk, by_key)
            desk.keyboard.press("ArrowDown")
            expect(desk.locator(".choices input").nth(1)).to_be_checked()
            desk.keyboard.press("ArrowLeft")
            expect(desk.locator(".choices input").nth(0)).to_be_checked()
        desk.keyboard.press("Enter")
        expect(desk.locator("#place")).not_to_have_text(before)
    expect(desk.locator("#main")).to_contain_text(f"as a file and send it to {CONTACT}")
    name = saved_answers(desk, tmp_path).name
    told = f"Saved as {name}. Please send this file to {CONTACT}."
    expect(desk.get_by_role("status").filter(has_text="Saved")).to_have_text(told)

    phone = take_part("pairwise", "?p=1", width=390)
    agree(phone)
    practise(phone)
    obey(phone)
    assert findings(phone) == []
    large = phone.get_by_role("button", name="Full screen").first
    for is_large in ("true", "false"):
        large.click()
        phone.wait_for_function(f"() => Boolean(document.fullscreenElement) === {is_large}")
    watch_all(phone)
    choose(phone, "right")
    phone.locator(".reasons").get_by_text("Smoothness of the movements").click()
    expect(phone.locator("#next")).to_be_in_viewport(ratio=0.99)  # with the reasons below
    before = place(phone)
    phone.reload()
    assert place(phone) == before
    expect(phone.locator(".card.seen")).to_have_count(2)
    expect(phone.locator(".choices input").nth(2)).to_be_checked()
    expect(phone.get_by_label("Smoothness of the movements")).to_be_checked()
    expect_fit(phone)
    go_on(phone)
    answer_pairs(phone)
    phone.reload()
    path = saved_answers(phone, tmp_path)

    key, found = host.key("pairwise"), host.collected("pairwise", tmp_path)
    assert found.left_out_sentences == ()
    assert sorted(each.list_number for each in found.participants) == [0, 1]
    assert all(is_whole(host, "pairwise", each) for each in found.participants)
    written = json.loads(path.read_text())
    assert written["device"] == {"width": 390, "height": 844, "touch": True}
    for answer in written["answers"]:
        expected = key.trials[answer["trial"]].expected
        if expected:
            assert answer["value"] == expected.value
        else:
            assert answer["watched"] >= 1 and answer["ms"] >= 500
    chosen = [answer for answer in written["answers"] if answer["reasons"]]
    assert [answer["value"] for answer in chosen] == [answer["shown"][1] for answer in chosen]
    assert [answer["reasons"] for answer in chosen] == [["smoothness"]]


def test_a_video_that_fails_is_tried_again_then_skipped_and_named_ids_alone_are_kept(
    take_part: Callable[..., Page], host: Host, tmp_path: Path
) -> None:
    address = "?p=0&PROLIFIC_PID=5f1a2b&STUDY_ID=%7B%7B%25STUDY_ID%25%7D%7D&email=a@b.example"
    page = take_part("pairwise", address)
    page.route("**/media/*.mp4", lambda route: route.abort())
    told = WORDS["consent"]["panel"].format(names="PROLIFIC_PID")
    expect(page.locator("#main")).to_contain_text(told)
    agree(page)
    practise(page)
    first = page.locator(".card").nth(0)
    expect(first.get_by_role("alert")).to_have_text(WORDS["problems"]["video"])
    skip = first.get_by_role("button", name=BUTTONS["skip"])
    expect(skip).to_have_count(0)
    first.get_by_role("button", name=BUTTONS["retry"]).click()
    expect(skip).to_be_visible()
    expect(page.locator("#next")).to_be_disabled()
    page.unroute("**/media/*.mp4")
    # Tried again it plays, and what is left of the failure is gone.
    second = page.locator(".card").nth(1)
    second.get_by_role("button", name=BUTTONS["retry"]).click()
    expect(second.get_by_role("alert")).to_have_count(0)
    before = place(page)
    skip.click()
    expect(page.locator("#place")).not_to_have_text(before)
    answer_pairs(page)
    written = json.loads(saved_answers(page, tmp_path).read_text())
    assert written["panel"] == {"PROLIFIC_PID": "5f1a2b"}
    assert written["answers"][0]["value"] is None
    assert written["answers"][0]["skipped"] in written["answers"][0]["shown"]
    found = host.collected("pairwise", tmp_path)
    assert found.left_out_sentences == () and is_whole(host, "pairwise", found.participants[0])


def test_a_video_without_a_new_picture_for_20_s_has_failed(take_part: Callable[..., Page]) -> None:
    page = take_part("pairwise")
    page.route("**/media/*.mp4", lambda route: None)  # never answered
    agree(page)
    practise(page)
    hanging, stalling = page.locator(".card").all()
    skip = hanging.get_by_role("button", name=BUTTONS["skip"])
    for has_skip in (False, True):
        hanging.locator(".play").click()
        expect(hanging).to_have_class(re.compile("playing"))
        page.clock.run_for(HANG_MS // 4)
        expect(hanging.get_by_role("alert")).to_have_count(0)
        page.clock.run_for(HANG_MS)
        expect(hanging.get_by_role("alert")).to_have_text(WORDS["problems"]["video"])
        expect(hanging).not_to_have_class(re.compile("playing"))
        expect(skip).to_have_count(int(has_skip))
        hanging.get_by_role("button", name=BUTTONS["retry"]).click()
    # One that shows pictures for a while, and then no more.
    stalling.locator("video").evaluate(
        """video => {
          const own = (value) => ({ value, writable: true });
          const play = own(async () => (video.paused = false));
          const pause = own(() => (video.paused = true));
          Object.defineProperties(video, { currentTime: own(0), paused: own(true), play, pause });
        }"""
    )
    stalling.locator(".play").click()
    stalling.locator("video").evaluate("video => (video.currentTime = 1.5)")
    page.clock.run_for(HANG_MS)
    expect(stalling.get_by_role("alert")).to_have_count(0)
    page.clock.run_for(HANG_MS)
    expect(stalling.get_by_role("alert")).to_have_text(WORDS["problems"]["video"])


def test_speech_is_asked_about_and_answers_are_posted_again_when_the_network_returns(
    take_part: Callable[..., Page], host: Host, tmp_path: Path
) -> None:
    page = take_part("matched")
    skip_sound(page)
    practise(page)
    assert page.evaluate("document.querySelector('video').muted") is False
    watch_all(page)
    choose(page)
    with page.expect_response("**/answers"):
        go_on(page)  # at once, not only at the end
    assert len(host.posted) == 1
    watch_all(page)
    choose(page)
    page.context.set_offline(True)
    go_on(page)
    expect(page.get_by_text(WORDS["finish"]["post"])).to_be_visible()
    assert len(host.posted) == 1
    page.context.set_offline(False)
    expect(page.get_by_text(WORDS["finish"]["sent"])).to_be_visible()
    back = page.get_by_role("link", name=WORDS["finish"]["back"])
    expect(back).to_have_attribute("href", RETURN_TO)
    expect(page.get_by_text(WORDS["finish"]["then"])).to_have_count(0)
    for number, posted in enumerate(host.posted):
        (tmp_path / f"{number}.json").write_bytes(posted)
    found = host.collected("matched", tmp_path)
    assert found.left_out_sentences == (
        "1 unfinished file is left out: later files of the same participant include the answers.",
    )
    (participant,) = found.participants
    assert participant.headphones == "skipped" and is_whole(host, "matched", participant)

    # A preview keeps and sends nothing.
    preview = take_part("matched", "?preview&p=0")
    expect(preview.locator(".preview")).to_contain_text("Nothing is sent")
    skip_sound(preview)
    answer_pairs(preview)
    expect(preview.get_by_text(WORDS["finish"]["then"])).to_be_visible()
    assert saved_answers(preview, tmp_path).name.startswith("preview-")
    expect(preview.get_by_text(RETURN_TO)).to_be_visible()  # said, but it leads nowhere
    expect(preview.get_by_role("link", name=WORDS["finish"]["back"])).to_have_count(0)
    assert len(host.posted) == 2
    assert preview.evaluate("localStorage.length") == 0
    preview.reload()
    expect(preview.get_by_label(WORDS["consent"]["agree"])).not_to_be_checked()


def test_rankings_and_ratings_are_read_and_the_sound_check_tells_who_hears_the_quiet_tone(
    take_part: Callable[..., Page], host: Host, tmp_path: Path
) -> None:
    """Rankings from a file, without any host; a video that is stopped or skipped does not count."""
    ranking, asked = take_part("ranking", is_file=True), list[str]()
    bundle = host.bundle("ranking")
    assert find_leaks(bundle.parent) == []
    ranking.on("request", lambda request: asked.append(request.url))
    ranking.reload()
    ranking.wait_for_function(FONTS_ARE_THERE)
    skip_sound(ranking)
    practise(ranking)
    by_click(ranking, 0)
    by_click(ranking, 1)  # stops the first one
    ranking.wait_for_function(SEEN, arg=1)
    first = ranking.locator(".card").nth(0)
    expect(first).to_have_class("card")
    ranking.evaluate("document.querySelector('video').currentTime = 0.45")
    ranking.evaluate("document.querySelector('video').play()")
    ranking.wait_for_function("() => document.querySelector('video').ended")
    expect(first).to_have_class("card")
    expect(ranking.locator("#next")).to_be_disabled()
    while place(ranking):
        watch_all(ranking)
        for part in ranking.locator(".ranks").all():
            part.get_by_role("button", name="2").click()  # the last one follows by itself
        go_on(ranking)
    (tmp_path / "ranking").mkdir()
    saved_answers(ranking, tmp_path / "ranking")
    found = host.collected("ranking", tmp_path / "ranking")
    assert found.left_out_sentences == () and len(found.participants[0].answers) == 3
    for answer in found.participants[0].answers:
        assert answer.value == list(answer.videos[::-1])
    assert asked and all(url.startswith(f"{bundle.as_uri()}/") for url in asked)

    rating, words = take_part("rating", "?p=3"), WORDS["headphones"]
    rating.evaluate(QUIET)
    for wrong, passed in ((0, "passed"), (1, "failed")):
        agree(rating)
        for _ in range(3 if not wrong else 2):
            rating.evaluate("window.peaks = []")
            rating.get_by_role("button", name=words["play"]).click()
            rating.clock.fast_forward(TONES_MS)
            choices = [rating.get_by_role("button", name=name) for name in words["choices"]]
            expect(choices[0]).to_be_enabled()
            quiet = rating.evaluate("window.peaks.indexOf(Math.min(...window.peaks))")
            choices[(quiet + wrong) % 3].click()
        if wrong:
            expect(rating.get_by_text(words["failed"])).to_be_visible()
            rating.get_by_role("button", name=words["continue"]).click()
        expect(rating.locator("#place")).to_have_text(WORDS["practice"]["place"])
        assert json.loads(kept(rating, kept_name(rating)))["headphones"] == passed
        if not wrong:
            rating.evaluate("localStorage.clear()")
            rating.reload()
            rating.evaluate(QUIET)
    practise(rating)
    while place(rating):
        watch_all(rating)
        for i, slider in enumerate(rating.get_by_role("slider").all()):
            slider.fill(str(30 + 40 * i))
        go_on(rating)
    (tmp_path / "rating").mkdir()
    saved_answers(rating, tmp_path / "rating")
    (participant,) = host.collected("rating", tmp_path / "rating").participants
    assert participant.headphones == "failed" and len(participant.answers) == 1
    for answer in participant.answers:
        assert answer.value == {answer.videos[0]: 30, answer.videos[1]: 70}
    rating.goto(rating.url.replace("?p=3", "?p=99"))
    expect(rating.get_by_role("alert")).to_contain_text("This link is not valid")


def test_damaged_storage_strands_nobody_and_two_tabs_go_ahead_together(
    take_part: Callable[..., Page], host: Host, tmp_path: Path
) -> None:
    token = "5-" + "0" * 32
    first = take_part("pairwise", f"?p=0&t={token}")
    agree(first)
    answer_pairs(first, until=1)
    here, participant = place(first), kept_name(first).split("/")[2]
    for of, broken in {
        "about": '{"screen": "tri',
        "draft": "[",
        "page/[0-9a-f]{8}": '[{"trial": 7}, null',
    }.items():
        name = kept_name(first, of)
        first.evaluate("([name, value]) => localStorage.setItem(name, value)", [name, broken])
        first.reload()
        expect(first.locator("#next")).to_be_visible()
        assert (place(first) == here) == (of in ("about", "draft"))  # what is lost is asked again
    answer_pairs(first, until=1)
    second = watched(first.context.new_page())
    second.goto(first.url)
    assert place(second) == place(first)
    answer_pairs(second, until=1)
    expect(first.locator("#place")).to_have_text(place(second))
    first.bring_to_front()  # pages behind others are drawn once a second
    answer_pairs(first)
    expect(second.get_by_role("heading", name=WORDS["finish"]["heading"])).to_be_visible()
    saved_answers(first, tmp_path)
    (found,) = host.collected("pairwise", tmp_path).participants
    assert is_whole(host, "pairwise", found) and (found.link_token, found.id) == (
        token,
        participant,
    )


# ---------------------------------------------------------------- other pages that are files


def test_a_player_as_one_file_plays_without_any_server_also_in_a_cell(
    visitor: Callable[..., BrowserContext], tmp_path: Path
) -> None:
    motions = {"one": smooth_motion_example(30), "two": smooth_motion_example(30, seed=1)}
    player = show(motions, Speech(made_waveform(16_000), ""))
    cell = tmp_path / "cell.html"
    cell.write_text(f"<!doctype html><meta charset=utf-8>{player._repr_html_()}")
    page, asked = watched(visitor(640, 600).new_page()), list[str]()
    page.on("request", lambda request: asked.append(request.url[:40]))
    kept = player.save(tmp_path / "run.html")
    for path, where in ((cell, "iframe"), (kept, "body")):
        page.goto(path.as_uri())
        seen = page.frame_locator("iframe") if where == "iframe" else page
        root = seen.locator(".lockstep")
        seen.locator(".stage[data-bodies='2']").wait_for()
        before = root.evaluate("root => root.stage.pictures")
        seen.get_by_role("button", name="Play", exact=True).click()
        expect(seen.locator("output.time")).to_have_text(
            "0:00.98 / 0:01.00"
        )  # it has come to its end
        assert root.evaluate("root => root.stage.pictures") > before + 2
        seen.get_by_role("button", name="Ghost", exact=True).click()
    assert not [url for url in asked if url.startswith("http")]


def test_a_leaderboard_sorts_by_the_distance_to_recorded(
    visitor: Callable[..., BrowserContext], tmp_path: Path
) -> None:
    def entry(system: str, jerk: float) -> LeaderboardEntry:
        value = MetricValue(jerk, jerk - 1, jerk + 1, "m/s³", 9)
        return LeaderboardEntry(system, "t", system, 9, "2026", "p", {"joint_jerk_m_s3": value}, {})

    path = tmp_path / "board.html"
    numbers = {"a": 30.0, "b": 11.0, "c": 1.0, "reference": 10.0}
    path.write_text(leaderboard_page_html([entry(name, jerk) for name, jerk in numbers.items()]))
    page = watched(visitor().new_page())
    page.goto(path.as_uri())
    names = page.locator("tbody th")
    head = page.get_by_role("button", name="All joints: Mean jerk")
    head.click()
    assert names.all_inner_texts() == ["recorded", "b", "c", "a"]
    head.click()
    assert names.all_inner_texts() == ["a", "b", "recorded", "c"]
    assert page.locator("td.best").inner_text().startswith("11")
    page.get_by_placeholder("part of the name").fill("c")
    assert page.locator("tbody tr:visible").count() == 2  # the recorded one stays
