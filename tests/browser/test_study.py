"""The participants' page in a real Chromium: answers, gates, reloads, phone and keyboard."""

import json
import re
from collections.abc import Callable, Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from app.study.design.key import Key, read_key
from app.study.design.plan import wording
from app.study.leaks import check_study
from app.study.statistics.answers import collect
from tests.app.study.made_study import make_study
from tests.browser.conftest import PATIENCE_MS

pytestmark = pytest.mark.browser

SYSTEMS, CLIPS = ["localnet", "globalnet"], ["kitchen", "garden"]
WORDS = wording()
BUTTONS = WORDS["buttons"]
RETURN_TO = "https://example.org/done?cc=C0DE"
DOTS_MS, TONES_MS = 1500, 3900
"""How long a dot of the practice moves, and three tones sound: time that the page's clock can
skip, as it cannot for videos."""
SEEN = "index => document.querySelectorAll('.card')[index].className === 'card seen'"


class _Host(SimpleHTTPRequestHandler):
    """A web host that keeps what is posted to it, and whatever else is asked of it."""

    posted: list[bytes]
    asked: list[str]

    def do_POST(self) -> None:
        self.posted.append(self.rfile.read(int(self.headers["Content-Length"])))
        self.send_response(200)
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:
        self.asked.append(self.path)


@pytest.fixture(scope="module")
def host(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path, type[_Host]]]:
    """An address with one study for each protocol below it, and their folder."""
    root = tmp_path_factory.mktemp("host")
    handler = type("Host", (_Host,), {"posted": [], "asked": []})
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(handler, directory=str(root)))
    Thread(target=server.serve_forever, daemon=True).start()
    address = f"http://127.0.0.1:{server.server_port}"
    post = f'post_to = "{address}/answers"\nreturn_to = "{RETURN_TO}"'
    for protocol, settings in {
        "pairwise": "attention_checks = 1",
        "matched": "attention_checks = 0\n" + post,
        "ranking": "attention_checks = 0",
        "rating": "attention_checks = 0",
    }.items():
        systems = SYSTEMS[:1] if protocol == "matched" else SYSTEMS
        make_study(root / protocol, systems, CLIPS, f'protocol = "{protocol}"\n{settings}')
    yield address, root, handler
    server.shutdown()
    server.server_close()


@pytest.fixture
def take_part(
    browser: Browser, host: tuple[str, Path, type[_Host]]
) -> Iterator[Callable[..., Page]]:
    """Open a study as a new participant, who shares nothing with the others."""
    contexts: list[BrowserContext] = []

    def open_page(
        protocol: str, query: str = "?p=0", width: int = 1280, is_file: bool = False
    ) -> Page:
        is_phone = width < 500
        contexts.append(
            browser.new_context(viewport={"width": width, "height": 800}, has_touch=is_phone)
        )
        page = contexts[-1].new_page()
        page.clock.install()
        page.set_default_timeout(PATIENCE_MS)
        page.on("pageerror", lambda error: pytest.fail(str(error)))
        root = host[1].as_uri() if is_file else host[0]
        page.goto(f"{root}/{protocol}/study/participant_bundle/index.html{query}")
        return page

    yield open_page
    for context in contexts:
        context.close()


def agree(page: Page) -> None:
    start = page.get_by_role("button", name=BUTTONS["start"])
    expect(start).to_be_disabled()
    page.get_by_label(WORDS["consent"]["agree"]).check()
    start.click()


def watch_all(page: Page, press: Callable[[Page, int], None], skipped_ms: int = 0) -> None:
    """Play each video to its end."""
    for index in range(page.locator(".card").count()):
        press(page, index)
        if skipped_ms:
            page.clock.fast_forward(skipped_ms)
        page.wait_for_function(SEEN, arg=index, timeout=PATIENCE_MS)


def by_click(page: Page, index: int) -> None:
    page.locator(".card .play").nth(index).click()


def by_key(page: Page, index: int) -> None:
    page.keyboard.press(str(index + 1))


def place(page: Page) -> str:
    return page.locator("#place").inner_text()


def go_on(page: Page) -> None:
    """Next, and wait for the page that it leads to."""
    before = place(page)
    page.locator("#next").click()
    page.wait_for_function(
        "text => document.querySelector('#place').innerText !== text", arg=before
    )


def practise(
    page: Page, press: Callable[[Page, int], None] = by_click, skipped_ms: int = DOTS_MS
) -> None:
    """The page with dots in place of people."""
    expect(page.locator("#place")).to_have_text(WORDS["practice"]["place"])
    expect(page.locator(".card canvas")).to_have_count(2)
    expect(page.locator("#next")).to_be_disabled()
    watch_all(page, press, skipped_ms)
    for label in page.locator(".choices label").all()[:1]:
        label.click()
    for part in page.locator(".ranks").all():
        part.get_by_role("button", name="2").click()
    for slider in page.get_by_role("slider").all():
        slider.fill("10")
    go_on(page)
    expect(page.locator(".card canvas")).to_have_count(0)


def answer_pairs(page: Page, until: int = 100) -> None:
    """Answer pages, the left video each time and checks as they say, from wherever it stands."""
    for _ in range(until):
        if not place(page):
            return
        if page.locator(".card canvas").count():
            practise(page)
            continue
        if page.locator(".press").count():
            said = page.locator(".press").inner_text()
            name = next(BUTTONS[side] for side in ("left", "right") if BUTTONS[side] in said)
            page.get_by_text(name, exact=True).click()
        else:
            expect(page.locator("#next")).to_be_disabled()
            watch_all(page, by_click)
            page.locator(".choices").get_by_text(BUTTONS["left"], exact=True).click()
        go_on(page)


def saved_answers(page: Page, out: Path) -> Path:
    with page.expect_download() as download:
        page.get_by_role("button", name=BUTTONS["download"]).click()
    path = out / download.value.suggested_filename
    download.value.save_as(path)
    return path


def key_of(host: tuple[str, Path, type[_Host]], protocol: str) -> Key:
    return read_key(host[1] / protocol / "study" / "researcher_only" / "key.json")


def test_two_participants_complete_a_study_and_their_answers_are_read(
    take_part: Callable[..., Page], host: tuple[str, Path, type[_Host]], tmp_path: Path
) -> None:
    """One at a desk; one on a phone who reloads half-way, in the middle of a page."""
    desk = take_part("pairwise", "?p=0")
    agree(desk)
    answer_pairs(desk)
    saved_answers(desk, tmp_path)

    phone = take_part("pairwise", "?p=1", width=390)
    agree(phone)
    practise(phone)
    answer_pairs(phone, until=1)
    while phone.locator(".press").count():
        answer_pairs(phone, until=1)
    watch_all(phone, by_click)
    phone.locator(".choices").get_by_text(BUTTONS["right"], exact=True).click()
    phone.locator(".reasons").get_by_text("Motion smoothness").click()
    before = place(phone)
    phone.reload()
    assert place(phone) == before
    expect(phone.locator(".card.seen")).to_have_count(2)
    expect(phone.locator(".choices input").nth(2)).to_be_checked()
    expect(phone.get_by_label("Motion smoothness")).to_be_checked()
    assert phone.evaluate("document.documentElement.scrollWidth") <= 390
    go_on(phone)
    answer_pairs(phone)
    phone.reload()
    path = saved_answers(phone, tmp_path)

    key = key_of(host, "pairwise")
    collected = collect([tmp_path], key)
    assert collected.left_out == ()
    assert [p.list_number for p in sorted(collected.participants, key=lambda p: p.list_number)] == [
        0,
        1,
    ]
    for participant in collected.participants:
        assert participant.finished is not None
        assert sorted(answer.trial for answer in participant.answers) == sorted(
            key.lists[participant.list_number]
        )
    written = json.loads(path.read_text())
    assert written["device"] == {"width": 390, "height": 800, "touch": True}
    answers = {answer["trial"]: answer for answer in written["answers"]}
    for trial_id, answer in answers.items():
        trial = key.trials[trial_id]
        if trial.expected:
            assert answer["value"] == trial.expected.value
        else:
            assert answer["watched"] >= 1 and answer["ms"] >= 500
    chosen = [a for a in written["answers"] if a["reasons"]]
    assert [answer["value"] for answer in chosen] == [answer["shown"][1] for answer in chosen]
    assert [answer["reasons"] for answer in chosen] == [["smoothness"]]


@pytest.mark.parametrize(("width", "height"), [(390, 844), (1280, 720)])
def test_next_is_in_sight_on_every_page(
    take_part: Callable[..., Page], width: int, height: int
) -> None:
    page = take_part("pairwise", "?p=0", width=width)
    page.set_viewport_size({"width": width, "height": height})

    def in_sight(name: str) -> None:
        box = page.get_by_role("button", name=name, exact=True).bounding_box()
        assert box is not None and box["y"] >= 0 and box["y"] + box["height"] <= height

    in_sight(BUTTONS["start"])
    said = page.locator("#main").inner_text()
    assert re.search(r"takes about \d+ minutes: a short practice, then \d+ pages", said)
    agree(page)
    in_sight(BUTTONS["next"])
    practise(page)
    while page.locator(".press").count():
        in_sight(BUTTONS["next"])
        answer_pairs(page, until=1)
    in_sight(BUTTONS["next"])
    watch_all(page, by_click)
    page.locator(".choices").get_by_text(BUTTONS["left"], exact=True).click()
    in_sight(BUTTONS["next"])  # with the reasons below the choice


def test_a_preview_keeps_and_sends_nothing(
    take_part: Callable[..., Page], host: tuple[str, Path, type[_Host]], tmp_path: Path
) -> None:
    before = len(host[2].posted)
    page = take_part("matched", "?preview&p=0")
    expect(page.locator(".preview")).to_contain_text("Nothing is sent")
    agree(page)
    page.get_by_role("button", name=WORDS["headphones"]["skip"]).click()
    practise(page)
    answer_pairs(page)
    expect(page.get_by_text(WORDS["finish"]["then"])).to_be_visible()
    assert saved_answers(page, tmp_path).name.startswith("preview-")
    expect(page.get_by_text(RETURN_TO)).to_be_visible()  # said, but it leads nowhere
    expect(page.get_by_role("link", name=WORDS["finish"]["back"])).to_have_count(0)
    assert len(host[2].posted) == before
    assert page.evaluate("localStorage.length") == 0
    page.reload()
    expect(page.get_by_label(WORDS["consent"]["agree"])).not_to_be_checked()


def test_a_whole_page_can_be_answered_by_keyboard(take_part: Callable[..., Page]) -> None:
    page = take_part("pairwise", "?p=2")
    page.keyboard.press("Tab")
    page.keyboard.press("Space")
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    practise(page, by_key)
    first = place(page)
    while page.locator(".press").count():
        page.keyboard.press("ArrowRight")
        page.keyboard.press("Enter")
        first = place(page)
    page.keyboard.press("ArrowRight")  # nothing may be chosen before both were watched
    expect(page.locator(".choices input:checked")).to_have_count(0)
    watch_all(page, by_key)
    page.keyboard.press("ArrowDown")
    expect(page.locator(".choices input").nth(1)).to_be_checked()
    page.keyboard.press("ArrowLeft")
    expect(page.locator(".choices input").nth(0)).to_be_checked()
    page.keyboard.press("Enter")
    expect(page.locator("#place")).not_to_have_text(first)


def test_a_video_that_is_stopped_or_skipped_does_not_count(take_part: Callable[..., Page]) -> None:
    page = take_part("ranking", is_file=True)  # this host cannot skip inside a video
    agree(page)
    page.get_by_role("button", name=WORDS["headphones"]["skip"]).click()
    practise(page)
    by_click(page, 0)
    by_click(page, 1)  # stops the first one
    expect(page.locator(".card").nth(1)).to_have_class("card seen")
    expect(page.locator(".card").nth(0)).to_have_class("card")
    page.evaluate("document.querySelector('video').currentTime = 0.45")
    page.evaluate("document.querySelector('video').play()")
    page.wait_for_function("() => document.querySelector('video').ended")
    expect(page.locator(".card").nth(0)).to_have_class("card")
    expect(page.locator("#next")).to_be_disabled()
    by_click(page, 0)
    expect(page.locator(".card").nth(0)).to_have_class("card seen")


def test_speech_is_asked_about_and_answers_are_posted(
    take_part: Callable[..., Page], host: tuple[str, Path, type[_Host]], tmp_path: Path
) -> None:
    page = take_part("matched")
    agree(page)
    page.get_by_role("button", name=WORDS["headphones"]["skip"]).click()
    practise(page)
    assert page.evaluate("document.querySelector('video').muted") is False
    answer_pairs(page)
    expect(page.get_by_text(WORDS["finish"]["sent"])).to_be_visible()
    back = page.get_by_role("link", name=WORDS["finish"]["back"])
    expect(back).to_have_attribute("href", RETURN_TO)
    expect(page.get_by_text(WORDS["finish"]["then"])).to_have_count(0)
    for number, posted in enumerate(host[2].posted):
        (tmp_path / f"{number}.json").write_bytes(posted)
    collected = collect([tmp_path], key_of(host, "matched"))
    assert collected.left_out == ("1 file of answers under way, all of them also in later ones.",)
    (participant,) = collected.participants
    assert participant.headphones == "skipped"
    assert len(participant.answers) == 2


@pytest.mark.parametrize("is_right", [True, False])
def test_the_sound_check_tells_who_hears_the_quiet_tone(
    take_part: Callable[..., Page], tmp_path: Path, is_right: bool
) -> None:
    page = take_part("rating", "?p=3")
    # Each tone's loudness is noted as it is made: the quiet one is what a listener would press.
    page.evaluate(
        """() => {
            window.peaks = [];
            const start = AudioBufferSourceNode.prototype.start;
            AudioBufferSourceNode.prototype.start = function (...when) {
                window.peaks.push(Math.max(...this.buffer.getChannelData(0)));
                return start.apply(this, when);
            };
        }"""
    )
    agree(page)
    text = WORDS["headphones"]
    for _ in range(3 if is_right else 2):
        page.evaluate("window.peaks = []")
        page.get_by_role("button", name=text["play"]).click()
        page.clock.fast_forward(TONES_MS)
        choices = [page.get_by_role("button", name=name) for name in text["choices"]]
        expect(choices[0]).to_be_enabled()
        quiet = page.evaluate("window.peaks.indexOf(Math.min(...window.peaks))")
        choices[quiet if is_right else (quiet + 1) % 3].click()
    if not is_right:
        expect(page.get_by_text(text["failed"])).to_be_visible()
        page.get_by_role("button", name=text["continue"]).click()
    watch_all(page, by_click, DOTS_MS)
    kept = page.evaluate("name => localStorage.getItem(name)", kept_state(page))
    assert json.loads(kept)["headphones"] == ("passed" if is_right else "failed")


def test_rankings_and_ratings_are_read(
    take_part: Callable[..., Page], host: tuple[str, Path, type[_Host]], tmp_path: Path
) -> None:
    for protocol in ("ranking", "rating"):
        page = take_part(protocol)
        agree(page)
        page.get_by_role("button", name=WORDS["headphones"]["skip"]).click()
        practise(page)
        while place(page):
            watch_all(page, by_click)
            for part in page.locator(".ranks").all():
                part.get_by_role("button", name="2").click()  # the last one follows by itself
            for i, slider in enumerate(page.get_by_role("slider").all()):
                slider.fill(str(30 + 40 * i))
            go_on(page)
        folder = tmp_path / protocol
        folder.mkdir()
        saved_answers(page, folder)
        collected = collect([folder], key_of(host, protocol))
        assert collected.left_out == ()
        (participant,) = collected.participants
        assert len(participant.answers) == (6 if protocol == "ranking" else 2)
        for answer in participant.answers:
            if protocol == "ranking":
                assert answer.value == list(answer.shown[::-1])
            else:
                assert answer.value == {answer.shown[0]: 30, answer.shown[1]: 70}


def test_a_link_to_a_list_that_is_none_says_so(take_part: Callable[..., Page]) -> None:
    page = take_part("rating", "?p=99")
    expect(page.get_by_role("alert")).to_contain_text("list 99")


def test_the_page_works_from_a_file_and_asks_nobody_else(
    browser: Browser, host: tuple[str, Path, type[_Host]]
) -> None:
    bundle = host[1] / "pairwise" / "study" / "participant_bundle"
    assert check_study(bundle.parent) == []
    context = browser.new_context()
    page = context.new_page()
    page.clock.install()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(f"{bundle.as_uri()}/index.html?p=0")
    page.get_by_label(WORDS["consent"]["agree"]).check()
    page.get_by_role("button", name=BUTTONS["start"]).click()
    answer_pairs(page, until=2)
    context.close()
    assert asked and all(url.startswith(f"{bundle.as_uri()}/") for url in asked)


def kept_state(page: Page) -> str:
    """The name under which the browser keeps the answers."""
    keys = page.evaluate("Object.keys(localStorage)")
    return next(key for key in keys if re.fullmatch(r"study/[0-9a-f]{16}/[0-9a-f]{16}", key))


@pytest.mark.parametrize("has_locks", [True, False])
def test_two_tabs_lose_no_answer(
    take_part: Callable[..., Page],
    host: tuple[str, Path, type[_Host]],
    tmp_path: Path,
    has_locks: bool,
) -> None:
    token = "5-" + "0" * 32
    first = take_part("pairwise", f"?p=0&t={token}")
    if not has_locks:  # as over plain HTTP
        hidden = "Object.defineProperty(navigator, 'locks', { value: undefined })"
        first.context.add_init_script(hidden)
        first.reload()
    agree(first)
    answer_pairs(first, until=2)
    second = first.context.new_page()
    second.goto(first.url)
    assert place(second) == place(first)
    expect(first.get_by_text(WORDS["problems"]["elsewhere"])).to_be_visible()
    answer_pairs(second, until=1)
    here = place(second)
    first.bring_to_front()  # pages behind others are drawn once a second
    first.get_by_role("button", name=BUTTONS["here"]).click()
    assert place(first) == here
    expect(second.get_by_text(WORDS["problems"]["elsewhere"])).to_be_visible()
    answer_pairs(first)
    saved_answers(first, tmp_path)
    (participant,) = collect([tmp_path], key_of(host, "pairwise")).participants
    assert participant.finished is not None and participant.link == token
    assert len(participant.answers) == len(key_of(host, "pairwise").lists[0])


def test_the_browsers_own_lock_lets_one_tab_write(take_part: Callable[..., Page]) -> None:
    page = take_part("pairwise")
    agree(page)
    name = f"{kept_state(page)}/writer"
    held = "navigator.locks.query().then((all) => all.held.map((lock) => lock.name))"
    assert page.evaluate(held) == [name]
    before = page.evaluate(f"localStorage['{kept_state(page)}']")
    # Another tab that has the lock, and whose mark in the storage was lost.
    other = page.context.new_page()
    other.goto(page.url.replace("index.html", "study.css"))
    other.evaluate(
        "(name) => new Promise((got) => navigator.locks.request(name, { steal: true }, () => "
        "{ got(); return new Promise(() => {}); }))",
        name,
    )
    expect(page.get_by_text(WORDS["problems"]["elsewhere"])).to_be_visible()
    assert page.evaluate(f"localStorage['{kept_state(page)}']") == before
    page.get_by_role("button", name=BUTTONS["here"]).click()
    expect(page.get_by_text(WORDS["problems"]["elsewhere"])).to_have_count(0)
    assert page.evaluate(held) == [name]


@pytest.mark.parametrize("damage", ["cut", "answers", "page"])
def test_damaged_storage_strands_nobody(
    take_part: Callable[..., Page], host: tuple[str, Path, type[_Host]], tmp_path: Path, damage: str
) -> None:
    page = take_part("pairwise", "?p=0")
    agree(page)
    answer_pairs(page, until=2)
    third, name = place(page), kept_state(page)
    kept = page.evaluate("name => localStorage.getItem(name)", name)
    state = json.loads(kept)
    broken = {
        "cut": kept[: len(kept) // 2],
        "answers": json.dumps(state | {"answers": [*state["answers"], None, {"trial": 7}]}),
        "page": json.dumps(state | {"page": "x", "screen": "nowhere", "draft": [1]}),
    }[damage]
    page.evaluate("([name, value]) => localStorage.setItem(name, value)", [name, broken])
    page.reload()
    expect(page.get_by_text(WORDS["problems"]["repaired"])).to_be_visible()
    assert page.evaluate("name => localStorage.getItem(name)", f"{name}/damaged") == broken
    if damage == "cut":
        agree(page)
    else:
        assert place(page) == third
    answer_pairs(page)
    saved_answers(page, tmp_path)
    (participant,) = collect([tmp_path], key_of(host, "pairwise")).participants
    assert participant.id == state["participant"] and participant.finished is not None
    assert len(participant.answers) == len(key_of(host, "pairwise").lists[0])


def test_answers_are_sent_again_when_the_network_returns(
    take_part: Callable[..., Page], host: tuple[str, Path, type[_Host]]
) -> None:
    page = take_part("matched", "?p=1")
    agree(page)
    page.get_by_role("button", name=WORDS["headphones"]["skip"]).click()
    practise(page)
    before = len(host[2].posted)
    answer_pairs(page, until=1)
    page.wait_for_timeout(500)
    assert len(host[2].posted) == before + 1  # at once, not only at the end
    watch_all(page, by_click)
    page.locator(".choices").get_by_text(BUTTONS["left"], exact=True).click()
    page.context.set_offline(True)
    go_on(page)
    expect(page.get_by_text(WORDS["finish"]["post"])).to_be_visible()
    assert len(host[2].posted) == before + 1
    page.context.set_offline(False)
    expect(page.get_by_text(WORDS["finish"]["sent"])).to_be_visible()
    assert json.loads(host[2].posted[-1])["finished"] is not None
