import shutil
from pathlib import Path

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

from app.page.routes.media import WEB_FOLDER, MediaAddresses, media_routes
from app.page.visitors.visitors import COOKIE


@pytest.fixture
def addresses() -> MediaAddresses:
    return MediaAddresses()


@pytest.fixture
def client(addresses: MediaAddresses) -> TestClient:
    return TestClient(FastAPI(routes=media_routes(addresses)))


@pytest.fixture
def video(tmp_path: Path) -> Path:
    path = tmp_path / "job" / "a.mp4"
    path.parent.mkdir()
    path.write_bytes(bytes(range(200)))
    return path


def test_a_part_of_a_file_can_be_asked_for(
    addresses: MediaAddresses, client: TestClient, video: Path
) -> None:
    answer = client.get(addresses.address(video, ""), headers={"Range": "bytes=50-59"})
    assert answer.status_code == 206
    assert answer.content == bytes(range(50, 60))
    assert answer.headers["content-type"] == "video/mp4"
    assert answer.headers["content-range"] == "bytes 50-59/200"


def test_another_browser_gets_nothing(
    addresses: MediaAddresses, client: TestClient, video: Path
) -> None:
    url = addresses.address(video, "mine")
    for cookies in ({}, {COOKIE: "yours"}):
        client.cookies.clear()
        client.cookies.update(cookies)
        assert client.get(url).status_code == 404
    client.cookies.update({COOKIE: "mine"})
    assert client.get(url).status_code == 200


def test_an_address_tells_no_path_and_dies_with_the_folder(
    addresses: MediaAddresses, client: TestClient, video: Path
) -> None:
    url = addresses.address(video, "")
    assert "a.mp4" not in url and len(url.removeprefix("media/")) >= 43
    assert client.get(url).status_code == 200
    shutil.rmtree(video.parent)
    assert client.get(url).status_code == 404
    assert client.get(f"media/{'x' * 43}").status_code == 404


def test_what_a_browser_could_run_is_only_downloaded(
    addresses: MediaAddresses, client: TestClient, tmp_path: Path
) -> None:
    path = tmp_path / "figure6.svg"
    path.write_text("<svg/>")
    headers = client.get(addresses.address(path, "")).headers
    assert headers["content-disposition"].startswith("attachment")
    assert headers["x-content-type-options"] == "nosniff"


def test_modules_of_the_page_are_served_and_nothing_else(client: TestClient) -> None:
    answer = client.get("web/player/player.js")
    assert answer.content == (WEB_FOLDER / "player" / "player.js").read_bytes()
    assert answer.headers["content-type"].startswith("text/javascript")
    for name in ("..%2Fpage.py", "%2e%2e/page.py", "player/../../page.py", "absent.js", "player"):
        assert client.get(f"web/{name}").status_code == 404
