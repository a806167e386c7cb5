"""Over HTTP: the researcher's part is had once, by the browser that made it, and by nobody else."""

import os
import urllib.parse
from collections.abc import Iterator
from http.cookies import SimpleCookie
from pathlib import Path

import gradio as gr
import httpx
import pytest

from app.page.visitors.researcher_part import FILE_NAME, Handover, study_routes
from app.page.visitors.visitors import COOKIE

SECRET = b"which video is whose"


@pytest.fixture(scope="module")
def served(
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[tuple[str, Handover]]:
    """A Gradio page with the routes, as the app launches it."""
    temp = tmp_path_factory.mktemp("served")
    before = os.environ.get("GRADIO_TEMP_DIR")
    os.environ["GRADIO_TEMP_DIR"] = str(temp / "gradio")
    handover = Handover(temp / "private")
    with gr.Blocks(analytics_enabled=False) as page:
        gr.Markdown("A page.")
    page.launch(
        prevent_thread_lock=True,
        quiet=True,
        share=False,
        ssr_mode=False,
        app_kwargs={"routes": study_routes(handover)},
    )
    yield page.local_url, handover
    page.close()
    if before is None:
        del os.environ["GRADIO_TEMP_DIR"]
    else:
        os.environ["GRADIO_TEMP_DIR"] = before


def visitor(address: str) -> httpx.Client:
    """A browser that has opened the page."""
    client = httpx.Client(base_url=address, timeout=10)
    reply = client.post("study/visitor")
    assert reply.status_code == 204
    return client


def offered(handover: Handover, client: httpx.Client) -> tuple[str, Path]:
    """A researcher's part made for a visitor: token and archive."""
    archive = handover.private_folder() / FILE_NAME
    archive.write_bytes(SECRET)
    return handover.offer(client.cookies[COOKIE], archive), archive


def fetch(client: httpx.Client, token: str) -> httpx.Response:
    return client.post("study/researcher", data={"token": token})


def test_the_maker_gets_it_once_and_then_it_is_gone(served: tuple[str, Handover]) -> None:
    address, handover = served
    maker = visitor(address)
    token, archive = offered(handover, maker)
    reply = fetch(maker, token)
    assert (reply.status_code, reply.content) == (200, SECRET)
    assert FILE_NAME in reply.headers["content-disposition"]
    assert reply.headers["cache-control"] == "no-store"
    assert not archive.parent.exists()
    assert fetch(maker, token).status_code == 404


def test_another_visitor_gets_nothing_and_takes_nothing_away(
    served: tuple[str, Handover],
) -> None:
    address, handover = served
    maker, other = visitor(address), visitor(address)
    assert maker.cookies[COOKIE] != other.cookies[COOKIE]
    token, _ = offered(handover, maker)
    stranger = httpx.Client(base_url=address, timeout=10)
    forged = [(b"cookie", f"{COOKIE}=\u00e9".encode("latin-1"))]
    forger = httpx.Client(base_url=address, timeout=10, headers=forged)
    for client in (other, stranger, forger):
        reply = fetch(client, token)
        assert reply.status_code == 404 and SECRET not in reply.content
    assert fetch(maker, token).content == SECRET


@pytest.mark.parametrize(
    "guess", ["", "0", "../key.json", "%00", "a" * 43, "a" * 5000, "None", "\u00e9"]
)
def test_a_guess_gets_nothing(served: tuple[str, Handover], guess: str) -> None:
    address, handover = served
    maker = visitor(address)
    token, _ = offered(handover, maker)
    for tried in (guess, token[:-1] + guess[:1] + "x", token.swapcase()):
        assert fetch(maker, tried).status_code == 404
    assert fetch(maker, token).status_code == 200


def test_other_ways_to_ask_are_refused(served: tuple[str, Handover]) -> None:
    address, handover = served
    maker = visitor(address)
    token, archive = offered(handover, maker)
    for reply in (
        maker.get(f"study/researcher?token={token}"),
        maker.get(f"study/researcher/{token}"),
        maker.post(f"study/researcher?token={token}"),
        maker.post("study/researcher", json={"token": token}),
    ):
        assert reply.status_code in (404, 405, 422) and SECRET not in reply.content
    for path in (str(archive), f"../private/{archive.parent.name}/{FILE_NAME}"):
        quoted = urllib.parse.quote(path)
        for route in (f"gradio_api/file={quoted}", f"file={quoted}", f"gradio_api/file/{quoted}"):
            reply = maker.get(route)
            assert reply.status_code in (403, 404) and SECRET not in reply.content
    assert fetch(maker, token).status_code == 200


def test_the_cookie_is_kept_from_scripts_and_other_sites(served: tuple[str, Handover]) -> None:
    reply = httpx.post(f"{served[0]}study/visitor", timeout=10)
    cookie = SimpleCookie(reply.headers["set-cookie"])[COOKIE]
    assert cookie["httponly"] and cookie["samesite"].lower() == "strict"
    assert len(cookie.value) >= 43


def test_what_nobody_fetches_is_deleted(tmp_path: Path) -> None:
    handover = Handover(tmp_path / "private", keep_s=0.0)
    archive = handover.private_folder() / FILE_NAME
    archive.write_bytes(SECRET)
    token = handover.offer("visitor", archive)
    assert handover.take("visitor", token) is None
    assert not archive.parent.exists()
