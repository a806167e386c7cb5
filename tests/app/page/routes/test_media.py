"""Files behind addresses that nobody can guess: each for one browser and for a while."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

from app.page.results.study_preview import StudyPreviews, preview_routes
from app.page.routes.media import (
    ENDINGS,
    WEB_FOLDER,
    MadeFiles,
    MediaAddresses,
    media_routes,
    motion_file_routes,
)
from app.page.visitors.token_files import TokenFiles
from app.page.visitors.visitors import COOKIE
from model.motion.motion import load_motion, save_motion
from tests.app.fakes import does, made_motion


@pytest.fixture
def addresses() -> MediaAddresses:
    return MediaAddresses()


@pytest.fixture
def previews() -> StudyPreviews:
    return StudyPreviews()


@pytest.fixture
def temp(tmp_path: Path) -> Path:
    folder = tmp_path / "temp"
    folder.mkdir()
    return folder


Browser = Callable[[str], TestClient]


@pytest.fixture
def browser(addresses: MediaAddresses, previews: StudyPreviews, temp: Path) -> Browser:
    """By its cookie; empty for one that keeps none."""
    app = FastAPI(routes=[*media_routes(addresses), *preview_routes(previews)])
    app.router.routes.extend(motion_file_routes(addresses, MadeFiles(temp, does)))
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


def test_a_file_is_for_the_browser_with_the_cookie(job):
    files, path = TokenFiles(), job / "a.mp4"
    token, other = files.add(path, "mine"), files.add(path, "mine")
    assert token != other and len(token) >= 43  # 256 bits
    for cookie in (*STRANGERS, "\u00e9"):
        assert files.find(token, cookie) is None and files.take(token, cookie) is None
    assert files.find(token, "mine") == path and files.find(token.swapcase(), "mine") is None
    assert files.find(files.add(path, None), "any") == path, "no cookie is asked of none"
    assert files.find(files.add(path, ""), "") is None, "an empty one lets nobody in"
    assert files.take(token, "mine") == path, "once"
    assert files.find(token, "mine") is None and files.take(token, "mine") is None
    assert files.find(other, "mine") == path


def test_what_is_over_or_deleted_is_had_by_nobody_and_forgotten_once(job):
    files, path, deleted = TokenFiles(), job / "a.mp4", job / "figure6.svg"
    tokens = [
        files.add(path, "mine", keep_s=-1.0),
        files.add(deleted, "mine"),
        files.add(path, "mine", keep_s=600.0),
    ]
    deleted.unlink()
    assert [files.find(token, "mine") for token in tokens] == [None, None, path]
    assert files.forget_ended() == [path, deleted] and files.forget_ended() == []
    assert files.find(tokens[2], "mine") == path


def test_another_browser_gets_nothing_of_a_run_and_nobody_once_its_folder_has_gone(
    addresses, previews, browser, job, temp
):
    motion = addresses.address(job / "globaldiff-local.npz", "mine")
    found = [
        addresses.address(job / "a.mp4", "mine"),
        f"{motion}/bvh",
        previews.address(job / "bundle", "mine"),
    ]
    for address in found:
        assert "a.mp4" not in address and "bundle" not in address
        for cookie in STRANGERS:
            assert browser(cookie).get(f"/{address}").status_code == 404, (address, cookie)
        assert browser("mine").get(f"/{address}").status_code == 200
    open_to_all = addresses.address(job / "a.mp4", "")
    assert browser("").get(f"/{open_to_all}").status_code == 200
    nobodys = previews.address(job / "bundle", "")
    assert all(browser(cookie).get(f"/{nobodys}").status_code == 404 for cookie in ("", "mine"))
    shutil.rmtree(job)
    for address in (*found, open_to_all, f"media/{'x' * 43}", "media/guess/glb"):
        assert browser("mine").get(f"/{address}").status_code == 404
    assert not list(temp.iterdir()), "nothing stays behind"


def test_a_part_of_a_file_can_be_asked_for(addresses, previews, browser, job):
    mine, part = browser("mine"), {"Range": "bytes=2-4"}
    answer = mine.get(f"/{addresses.address(job / 'a.mp4', 'mine')}", headers=part)
    assert (answer.status_code, answer.content) == (206, bytes([2, 3, 4]))
    assert answer.headers["content-type"] == "video/mp4"
    assert answer.headers["content-range"] == "bytes 2-4/200"
    page = previews.address(job / "bundle", "mine")
    base = page.partition("index.html")[0]
    answer = mine.get(f"/{base}media/0123.mp4", headers=part)
    assert (answer.status_code, answer.content) == (206, b"234")


def test_only_what_belongs_to_it_is_served(addresses, previews, browser, job, temp):
    mine = browser("mine")
    start = previews.address(job / "bundle", "mine")
    page = mine.get(f"/{start}")
    assert "A study" in page.text and page.headers["content-type"].startswith("text/html")
    base = start.partition("index.html")[0]
    for name in ("notes.txt", "../key.json", "%2e%2e/key.json", "media", "", "nothing.html"):
        assert mine.get(f"/{base}{name}").status_code == 404, name
    module = mine.get("/web/player/player.js")
    assert module.content == (WEB_FOLDER / "player" / "player.js").read_bytes()
    assert module.headers["content-type"].startswith("text/javascript")
    for name in ("..%2Fpage.py", "%2e%2e/page.py", "player/../../page.py", "absent.js", "player"):
        assert mine.get(f"/web/{name}").status_code == 404, name
    motion = addresses.address(job / "globaldiff-local.npz", "mine")
    video = addresses.address(job / "a.mp4", "mine")
    for address in (f"{motion}/exe", f"{motion}/json", f"{motion}/..%2fa.npz", f"{video}/glb"):
        assert mine.get(f"/{address}").status_code == 404, address
    picture = mine.get(f"/{addresses.address(job / 'figure6.svg', 'mine')}").headers
    assert picture["content-disposition"].startswith("attachment"), "a browser could run it"
    assert picture["x-content-type-options"] == "nosniff"
    assert not list(temp.iterdir())


def test_a_motion_comes_as_each_program_reads_it(addresses, browser, job, temp):
    address = addresses.address(job / "globaldiff-local.npz", "mine")
    came = {kind: browser("mine").get(f"/{address}/{kind}") for kind in ENDINGS}
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
    answer = browser("mine").get(f"/{addresses.address(damaged, 'mine')}/bvh")
    assert answer.status_code == 400 and "damaged.npz" in answer.text
    assert str(job) not in answer.text and not list(temp.iterdir())
