"""A bundle is looked at by the browser that made it, and by nobody else."""

from pathlib import Path

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

from app.page.results.study_preview import GONE, StudyPreviews, preview_routes
from app.page.visitors.visitors import COOKIE


@pytest.fixture
def bundle(tmp_path: Path) -> Path:
    folder = tmp_path / "bundle"
    (folder / "media").mkdir(parents=True)
    (folder / "index.html").write_text("<title>A study</title>")
    (folder / "media" / "0123456789abcdef.mp4").write_bytes(b"0123456789")
    (folder / "notes.txt").write_text("not part of a page")
    (tmp_path / "key.json").write_text("secret")
    return folder


def test_only_the_maker_sees_the_bundle_and_only_its_files(bundle: Path, tmp_path: Path) -> None:
    previews = StudyPreviews()
    address = previews.address(bundle, "mine")
    client = TestClient(FastAPI(routes=preview_routes(previews)))
    base = "/" + address.partition("index.html")[0]
    client.cookies.set(COOKIE, "mine")
    page = client.get(f"/{address}")
    assert page.status_code == 200 and "A study" in page.text
    assert page.headers["content-type"].startswith("text/html")
    video = client.get(f"{base}media/0123456789abcdef.mp4", headers={"Range": "bytes=2-4"})
    assert (video.status_code, video.content) == (206, b"234")
    for name in ("notes.txt", "../key.json", "%2e%2e/key.json", "media", "", "nothing.html"):
        assert client.get(base + name).status_code == 404, name
    client.cookies.set(COOKIE, "yours")
    refused = client.get(f"/{address}")
    assert (refused.status_code, refused.text) == (404, GONE)
    client.cookies.clear()
    assert client.get(f"/{address}").status_code == 404


def test_a_bundle_without_an_owner_is_nobodys(bundle: Path) -> None:
    previews = StudyPreviews()
    token = previews.address(bundle, "").split("/")[2]
    assert previews.find(token, "index.html", "") is None
