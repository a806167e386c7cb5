"""The researcher's part is had once, by the browser that made it, and by nobody else."""

import urllib.parse
from http.cookies import SimpleCookie
from pathlib import Path

import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

from app.page.visitors.researcher_part import FILE_NAME, Handover, study_routes
from app.page.visitors.visitors import COOKIE

SECRET = b"which video is whose"


@pytest.fixture
def handover(tmp_path: Path) -> Handover:
    return Handover(tmp_path / "private")


@pytest.fixture
def page(handover: Handover) -> FastAPI:
    return FastAPI(routes=study_routes(handover))


def visitor(page: FastAPI) -> TestClient:
    """A browser that has opened the page."""
    client = TestClient(page)
    assert client.post("/visitor").status_code == 204
    return client


def offered(handover: Handover, client: TestClient) -> tuple[str, Path]:
    """A researcher's part made for a visitor: token and archive."""
    archive = handover.private_folder() / FILE_NAME
    archive.write_bytes(SECRET)
    return handover.offer(client.cookies[COOKIE], archive), archive


def test_the_maker_gets_it_once_and_nobody_else_gets_it_or_takes_it_away(page, handover):
    maker, other = visitor(page), visitor(page)
    assert maker.cookies[COOKIE] != other.cookies[COOKIE]
    token, archive = offered(handover, maker)
    assert archive.parent.stat().st_mode & 0o777 == handover.root.stat().st_mode & 0o777 == 0o700
    forged = TestClient(page, headers={b"cookie": f"{COOKIE}=\u00e9".encode("latin-1")})
    for client in (other, TestClient(page), forged):
        reply = client.post("/study/researcher", data={"token": token})
        assert reply.status_code == 404 and SECRET not in reply.content
    for guess in ("", "0", "../key.json", "%00", "a" * 43, "a" * 5000, "None", "\u00e9"):
        for tried in (guess, token[:-1] + guess[:1] + "x", token.swapcase()):
            assert maker.post("/study/researcher", data={"token": tried}).status_code == 404
    for reply in (
        maker.get(f"/study/researcher?token={token}"),
        maker.get(f"/study/researcher/{token}"),
        maker.post(f"/study/researcher?token={token}"),
        maker.post("/study/researcher", json={"token": token}),
    ):
        assert reply.status_code in (404, 405, 422) and SECRET not in reply.content
    reply = maker.post("/study/researcher", data={"token": token})
    assert (reply.status_code, reply.content) == (200, SECRET)
    assert FILE_NAME in reply.headers["content-disposition"]
    assert reply.headers["cache-control"] == "no-store"
    assert not archive.parent.exists()
    assert maker.post("/study/researcher", data={"token": token}).status_code == 404


def test_the_page_serves_no_file_of_the_private_folder(served):
    archive = served.temp / "private" / "abc" / FILE_NAME
    archive.parent.mkdir(parents=True)
    archive.write_bytes(SECRET)
    client = served.visitor()
    for path in (str(archive), f"../private/abc/{FILE_NAME}"):
        quoted = urllib.parse.quote(path)
        for route in ("gradio_api/file=", "file=", "gradio_api/file/"):
            reply = client.get(f"/{route}{quoted}")
            assert reply.status_code in (403, 404) and SECRET not in reply.content


def test_the_cookie_is_kept_from_scripts_and_other_sites(page):
    reply = TestClient(page).post("/visitor")
    cookie = SimpleCookie(reply.headers["set-cookie"])[COOKIE]
    assert cookie["httponly"] and cookie["samesite"].lower() == "strict" and not cookie["secure"]
    assert len(cookie.value) >= 43
    kept = TestClient(page, cookies={COOKIE: cookie.value}).post("/visitor")
    assert "set-cookie" not in kept.headers
    reply = TestClient(page, base_url="https://lab.example").post("/visitor")
    assert SimpleCookie(reply.headers["set-cookie"])[COOKIE]["secure"]


def test_what_nobody_fetches_is_deleted(tmp_path):
    handover = Handover(tmp_path / "private", keep_s=0.0)
    archive = handover.private_folder() / FILE_NAME
    archive.write_bytes(SECRET)
    token = handover.offer("visitor", archive)
    assert handover.take("visitor", token) is None
    assert not archive.parent.exists()
