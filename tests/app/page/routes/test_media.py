"""Files behind addresses that nobody can guess: each for one browser and for a while."""

import shutil
import threading
import urllib.parse
from collections.abc import Callable
from http.cookies import SimpleCookie
from pathlib import Path
from typing import Any

import anyio
import numpy as np
import pytest
from fastapi import FastAPI
from starlette.datastructures import QueryParams
from starlette.testclient import TestClient

from app.errors import RunError
from app.page.routes.media import (
    ENDINGS,
    MAX_EXPORTS,
    PARTICIPANT_TYPES,
    RESEARCHER_FILE,
    WEB_FOLDER,
    OnDemandFiles,
    SharedFolders,
    media_routes,
    redraw_request,
    researcher_route,
)
from app.page.visitors.characters import Characters
from app.page.visitors.quota import Quota
from app.page.visitors.visitors import COOKIE, TokenStore, visitor_route
from app.run.requests.parts import FigureOptions
from app.run.requests.requests import RenderRequest
from model.motion.motion import load_motion, save_motion
from renderer.body.body import load_body
from renderer.figures.saved_figures import save_figure_contents
from tests.app.fakes import does, made_motion
from tests.renderer.body.made_character import character
from tests.renderer.figures.test_curves import MARKS


@pytest.fixture
def media() -> SharedFolders:
    return SharedFolders()


@pytest.fixture
def private() -> TokenStore[Path]:
    return TokenStore()


@pytest.fixture
def temp(tmp_path: Path) -> Path:
    folder = tmp_path / "temp"
    folder.mkdir()
    return folder


Browser = Callable[[str], TestClient]


@pytest.fixture
def characters(tmp_path: Path) -> Characters:
    return Characters(tmp_path / "characters")


@pytest.fixture
def quota() -> Quota:
    return Quota(10**9)


@pytest.fixture
def browser(
    media: SharedFolders,
    private: TokenStore[Path],
    characters: Characters,
    temp: Path,
    quota: Quota,
) -> Browser:
    """By its cookie; empty for one that keeps none."""
    routes = media_routes(media, OnDemandFiles(temp, does), characters, quota)
    routes = [*routes, researcher_route(private)]
    app = FastAPI(routes=[*routes, visitor_route()])
    return lambda cookie: TestClient(app, cookies={COOKIE: cookie} if cookie else None)


@pytest.fixture
def job(tmp_path: Path) -> Path:
    folder = tmp_path / "job"
    folder.mkdir()
    (folder / "a.mp4").write_bytes(bytes(range(200)))
    (folder / "figure6.svg").write_text("<svg/>")
    save_motion(made_motion(8), folder / "globaldiff-local.npz")
    (folder / "bundle" / "media").mkdir(parents=True)
    (folder / "bundle" / "index.html").write_text("<title>A study</title>")
    (folder / "bundle" / "media" / "0123.mp4").write_bytes(b"0123456789")
    (folder / "bundle" / "notes.txt").write_text("not part of a page")
    (folder / "key.json").write_text("secret")
    return folder


STRANGERS = ("", "min", "mine2", "yours")


def test_a_thing_is_for_the_browser_with_the_cookie_as_long_as_its_files_are_there(job):
    kept, path = TokenStore[str](), job / "a.mp4"
    token, other = (kept.keep(each, path, "mine") for each in ("one", "other"))
    assert token != other and len(token) >= 43  # 256 bits
    assert kept.keep("one", path, "mine") == token, "who opens it often takes no room"
    for cookie in (*STRANGERS, "\u00e9"):
        assert kept.find(token, cookie) is None and kept.take(token, cookie) is None
    assert kept.find(token, "mine") == "one" and kept.find(token.swapcase(), "mine") is None
    assert kept.find(kept.keep("all's", path, None), "any") == "all's", "no cookie is asked of none"
    assert kept.find(kept.keep("nobody's", path, ""), "") is None
    assert kept.take(token, "mine") == "one", "once"
    assert kept.find(token, "mine") is None and kept.take(token, "mine") is None
    assert kept.find(other, "mine") == "other" and len(kept.all()) == 3
    path.unlink()
    assert kept.find(other, "mine") is None and kept.all() == []
    kept.keep("new", job, "mine")
    assert len(kept._entries) == 1, "and the others are forgotten"


def test_another_browser_gets_nothing_of_a_run_and_nobody_once_its_folder_has_gone(
    media, browser, job, temp
):
    mine, all_of = (media.share(job, cookie) for cookie in ("mine", ""))
    found = [
        mine(job / "a.mp4"),
        f"{mine(job / 'globaldiff-local.npz')}&as=bvh",
        media.share(job / "bundle", "mine", PARTICIPANT_TYPES)(job / "bundle" / "index.html"),
    ]
    for address in found:
        for cookie in STRANGERS:
            assert browser(cookie).get(f"/{address}").status_code == 404, (address, cookie)
        assert browser("mine").get(f"/{address}").status_code == 200
    open_to_all = all_of(job / "a.mp4")
    assert browser("").get(f"/{open_to_all}").status_code == 200
    assert mine(job / "a.mp4") == found[0], "the same each time"
    (job / "a.mp4").rename(job / "b.mp4")
    (job / "a.mp4").write_bytes(b"another")
    assert mine(job / "a.mp4") != found[0]
    shutil.rmtree(job)
    for address in (*found, open_to_all, f"media/{'x' * 43}", "media/guess/a.npz?as=glb"):
        assert browser("mine").get(f"/{address}").status_code == 404
    assert not list(temp.iterdir()), "nothing stays behind"


def test_a_part_of_a_file_can_be_asked_for(media, browser, job):
    mine, part = browser("mine"), {"Range": "bytes=2-4"}
    answer = mine.get(f"/{media.share(job, 'mine')(job / 'a.mp4')}", headers=part)
    assert (answer.status_code, answer.content) == (206, bytes([2, 3, 4]))
    assert answer.headers["content-type"] == "video/mp4"
    assert answer.headers["content-range"] == "bytes 2-4/200"


def test_character_is_kept_for_its_visitor_alone_and_moves(
    media, browser, characters, job, temp, quota, monkeypatch
):
    mine, yours, hero = browser("mine"), browser("yours"), character(load_body(), "vrm")
    body = mine.post("/stage/character", content=hero)
    assert b"TEXCOORD_0" in body.content and b"image/webp" in body.content
    assert mine.get("/stage/character").content == body.content
    address = media.share(job, None)(job / "globaldiff-local.npz")
    moving = mine.get(f"/{address}&as=character")
    assert moving.content[:4] == b"glTF" and b"VRMC_vrm" in moving.content
    assert "local-character.glb" in moving.headers["content-disposition"]
    for stranger in (yours, browser("")):
        assert stranger.get("/stage/character").status_code in (400, 404)
        assert stranger.get(f"/{address}&as=character").status_code == 404
        stranger.delete("/stage/character")
    assert browser("").post("/stage/character", content=hero).status_code == 400
    assert mine.post("/stage/character", content=hero[:5000]).status_code == 400
    monkeypatch.setattr("app.page.routes.media.MAX_CHARACTER_BYTES", 1000)
    assert mine.post("/stage/character", content=hero).status_code == 413
    assert characters.find("mine").read_bytes() == hero, "what is refused replaces nothing"
    run = temp / "run"
    run.mkdir()
    assert characters.link("yours", run) is None
    linked = characters.link("mine", run)
    with pytest.raises(RunError, match="the limit is"):
        quota.require_space("testclient", int(quota.max_bytes))
    assert mine.delete("/stage/character").status_code == 204
    quota.require_space("testclient", int(quota.max_bytes))
    assert mine.get("/stage/character").status_code == 404
    assert linked.read_bytes() == hero, "a run keeps what it began with"
    shutil.rmtree(run)
    assert not list(temp.iterdir()) and not characters.folder("mine").exists()


def test_characters_that_never_arrive_keep_no_other_visitor_out(browser):
    app = browser("mine").app

    async def post(host: str, receive: Callable[[], Any]) -> int:
        sent: list[dict[str, Any]] = []

        async def send(message: dict[str, Any]) -> None:
            sent.append(message)

        scope = {"type": "http", "method": "POST", "path": "/stage/character", "query_string": b""}
        scope |= {"headers": [(b"cookie", f"{COOKIE}=mine".encode())], "client": (host, 1)}
        await app(scope, receive, send)
        return sent[0]["status"]

    async def damaged() -> dict[str, Any]:
        return {"type": "http.request", "body": b"glTF"}

    async def attack() -> None:
        async with anyio.create_task_group() as group:
            for _ in range(4):
                group.start_soon(post, "10.0.0.1", anyio.sleep_forever)
            await anyio.wait_all_tasks_blocked()
            assert await post("10.0.0.1", damaged) == 429
            assert await post("10.0.0.2", damaged) == 400
            group.cancel_scope.cancel()

    anyio.run(attack)


def test_exports_of_one_address_are_few_and_none_is_made_for_a_client_that_has_gone(
    media, characters, job, temp, quota
):
    made: list[Path] = []
    is_free = threading.Event()

    def make(_task: object, request: RenderRequest) -> None:
        made.append(request.out)
        assert is_free.wait(60)
        request.out.write_bytes(b"glTF")

    app = FastAPI(routes=media_routes(media, OnDemandFiles(temp, make, quota), characters, quota))
    path = media.share(job, None)(job / "globaldiff-local.npz").partition("?")[0]
    answers: dict[str, list[int]] = {"10.0.0.1": [], "10.0.0.2": []}
    gone: set[str] = set()

    async def get(host: str) -> None:
        async def receive() -> dict[str, Any]:
            if host not in gone:
                await anyio.sleep_forever()
            return {"type": "http.disconnect"}

        async def send(message: dict[str, Any]) -> None:
            if message["type"] == "http.response.start":
                answers[host].append(message["status"])

        scope = {"type": "http", "method": "GET", "path": f"/{path}", "query_string": b"as=glb"}
        await app(scope | {"headers": [], "client": (host, 1)}, receive, send)

    async def visit() -> None:
        async with anyio.create_task_group() as group:
            for _ in range(MAX_EXPORTS + 2):
                group.start_soon(get, "10.0.0.1")
            group.start_soon(get, "10.0.0.2")
            while len(made) < 1 or len(list(temp.iterdir())) < MAX_EXPORTS + 1:
                await anyio.sleep(0.01)
            assert answers == {"10.0.0.1": [429, 429], "10.0.0.2": []}
            gone.add("10.0.0.1")
            is_free.set()
        await get("10.0.0.1")

    anyio.run(visit)
    assert len(made) == 2, "the first, and that of the other address"
    assert answers["10.0.0.2"] == [200] and not list(temp.iterdir())
    assert answers["10.0.0.1"].count(429) == 2, "those that have ended do not count"


def test_only_what_belongs_to_it_is_served(media, browser, job, temp):
    mine = browser("mine")
    start = media.share(job / "bundle", "mine", PARTICIPANT_TYPES)(job / "bundle" / "index.html")
    page = mine.get(f"/{start}")
    assert "A study" in page.text and page.headers["content-type"].startswith("text/html")
    base = start.partition("index.html")[0]
    assert mine.get(f"/{base}media/0123.mp4").content == b"0123456789"
    (job / "bundle" / "link.txt").symlink_to(job / "key.json")
    secret = str(job / "key.json")
    for name in ("../key.json", "%2e%2e/key.json", "..%2fkey.json", "media", "", "nothing.html",
                 "link.txt", "%00", "a" * 5000, secret, urllib.parse.quote(secret, safe=""),
                 f"/{secret}", "media/../../key.json"):  # fmt: skip
        assert mine.get(f"/{base}{name}").status_code == 404, name
        assert media.file_of_url(f"{base}{name}", "mine") is None
    assert mine.get("/live/body.glb").content[:4] == b"glTF"
    module = mine.get("/web/player/player.js")
    assert module.headers["cache-control"] == "no-cache"
    assert module.content == (WEB_FOLDER / "player" / "player.js").read_bytes()
    assert module.headers["content-type"].split(";")[0].endswith("/javascript")
    for name in ("..%2Fpage.py", "%2e%2e/page.py", "player/../../page.py", "absent.js", "player"):
        assert mine.get(f"/web/{name}").status_code == 404, name
    address = media.share(job, "mine")
    motion, video = address(job / "globaldiff-local.npz"), address(job / "a.mp4")
    for asked in (f"{motion}&as=exe", f"{motion}&as=json", f"{motion}&as=..", f"{video}&as=glb"):
        assert mine.get(f"/{asked}").status_code == 404, asked
    picture = mine.get(f"/{address(job / 'figure6.svg')}").headers
    page = mine.get(f"/{address(job / 'bundle' / 'index.html')}").headers
    assert page["content-disposition"].startswith("attachment"), "of a run it is not a page"
    assert picture["content-disposition"].startswith("attachment"), "a browser could run it"
    assert not list(temp.iterdir())


def test_a_motion_comes_as_each_program_reads_it(media, browser, job, temp):
    address = media.share(job, "mine")
    motion = address(job / "globaldiff-local.npz")
    came = {kind: browser("mine").get(f"/{motion}&as={kind}") for kind in ENDINGS}
    for kind, answer in came.items():
        assert answer.status_code == 200, answer.text
        name = f"globaldiff-local{ENDINGS[kind]}"
        assert f'filename="{name}"' in answer.headers["content-disposition"]
    assert came["glb"].content[:4] == b"glTF"
    assert came["bvh"].text.startswith("HIERARCHY") and "Frames: 8" in came["bvh"].text
    kept = job / "blender.npz"
    kept.write_bytes(came["blender"].content)
    with np.load(kept, allow_pickle=False) as content:
        assert content["poses"].shape == (8, 165)
    assert load_motion(job / "globaldiff-local.npz").num_frames == 8
    damaged = job / "damaged.npz"
    damaged.write_bytes(b"PK nothing of the kind")
    answer = browser("mine").get(f"/{address(damaged)}&as=bvh")
    assert answer.status_code == 400 and "damaged.npz" in answer.text
    assert str(job) not in answer.text and not list(temp.iterdir())


def test_a_figure_comes_in_the_forms_that_were_not_written(media, browser, job, temp):
    save_figure_contents(job / "steps.figure.npz", "steps", MARKS, "What it shows.")
    address = media.share(job, "mine")(job / "steps.figure.npz")
    for form, begins in (("svg", b"<?xml"), ("pdf", b"%PDF-")):
        answer = browser("mine").get(f"/{address}&as={form}")
        assert answer.status_code == 200 and answer.content.startswith(begins)
        assert f'filename="steps.{form}"' in answer.headers["content-disposition"]
    assert browser("mine").get(f"/{address}&as=bvh").status_code == 404
    assert not list(temp.iterdir())


SECRET = b"which video is whose"


def test_the_maker_gets_the_researchers_part_once_and_nobody_else_gets_it_or_takes_it_away(
    browser, private, tmp_path
):
    maker, other, nobody = browser(""), browser("yours"), browser("")
    assert maker.post("/visitor").status_code == 204
    folder = tmp_path / "private"
    folder.mkdir()
    (folder / RESEARCHER_FILE).write_bytes(SECRET)
    token = private.keep(folder, folder, maker.cookies[COOKIE])
    address = f"/study/researcher/{token}"
    forged = TestClient(maker.app, headers={b"cookie": f"{COOKIE}=\u00e9".encode("latin-1")})
    for client in (other, nobody, forged):
        reply = client.post(address)
        assert reply.status_code == 404 and SECRET not in reply.content
    for guess in ("0", "../key.json", "%00", "a" * 43, "a" * 5000, token[:-1], token.swapcase()):
        assert maker.post(f"/study/researcher/{guess}").status_code == 404
    assert maker.get(address).status_code == 405, "no link to another site's picture fetches it"
    reply = maker.post(address)
    assert (reply.status_code, reply.content) == (200, SECRET)
    assert RESEARCHER_FILE in reply.headers["content-disposition"]
    assert reply.headers["cache-control"] == "no-store"
    assert not folder.exists() and maker.post(address).status_code == 404


def test_the_page_serves_no_file_of_the_private_folder(served):
    archive = served.temp / "private" / "abc" / RESEARCHER_FILE
    archive.parent.mkdir(parents=True)
    archive.write_bytes(SECRET)
    client = served.visitor()
    for path in (str(archive), f"../private/abc/{RESEARCHER_FILE}"):
        quoted = urllib.parse.quote(path)
        for route in ("gradio_api/file=", "file=", "gradio_api/file/"):
            reply = client.get(f"/{route}{quoted}")
            assert reply.status_code in (403, 404) and SECRET not in reply.content


def test_the_cookie_is_kept_from_scripts_and_other_sites(browser):
    reply = browser("").post("/visitor")
    cookie = SimpleCookie(reply.headers["set-cookie"])[COOKIE]
    assert cookie["httponly"] and cookie["samesite"].lower() == "strict" and not cookie["secure"]
    assert len(cookie.value) >= 43
    assert "set-cookie" not in browser(cookie.value).post("/visitor").headers
    reply = TestClient(browser("").app, base_url="https://lab.example").post("/visitor")
    assert SimpleCookie(reply.headers["set-cookie"])[COOKIE]["secure"]


def test_figure_6_is_drawn_again_as_a_url_says_within_the_limits_of_the_form(media, browser, job):
    (job / "viewer").mkdir()
    (job / "viewer" / "figure6.figure.npz").touch()
    address = media.share(job, "mine")(job / "viewer" / "figure6.figure.npz")
    base = f"/{address.partition('?')[0]}?as=pdf"
    refused = {
        "&width=9000mm": "no width '9000mm'",
        "&panels=e": "no panel 'e'",
        "&frames=1,2,3,4,5,6,7,8": "1 to 7 frames",
        "&panels=a&panels=d": "run.json is missing",  # all else is right
    }
    for query, sentence in refused.items():
        answer = browser("mine").get(base + query)
        assert answer.status_code == 400 and sentence in answer.text, query
    assert browser("mine").get(base.replace("pdf", "exe") + "&panels=a").status_code == 404
    query = QueryParams("panels=a&panels=d&frames=&width=85mm")
    request = redraw_request(job, query, "svg", job / "figure6.svg", None)
    assert request.figures == FigureOptions(
        figure_panels=("a", "d"), figure_width="85mm", figure_formats=("svg",)
    )
    assert request.out == job / "figure6" and request.run == job
