"""What a request may hold, held on every route that takes one and on every function of the page."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from starlette.routing import BaseRoute, Mount
from starlette.testclient import TestClient

from app.page.routes.bodies import MAX_BODY_BYTES, MAX_ITEMS, RequestBodyError, check_json_body
from tests.app.page.conftest import UPLOAD, Served

FILE = {"path": "/up/a.wav", "meta": {"_type": "gradio.FileData"}}
UPLOAD_ROUTES = ("/gradio_api/upload", "/stage/character")


def posted(routes: list[BaseRoute], prefix: str = "") -> Iterator[str]:
    """The paths of all routes that take a body."""
    for route in routes:
        path = prefix + getattr(route, "path", "")
        if isinstance(route, Mount):
            yield from posted(list(route.routes or ()), path)
        elif hasattr(route, "original_router"):  # FastAPI's, of routes under a prefix
            yield from posted(route.original_router.routes, prefix)
        elif {"POST", "PUT", "PATCH", "DELETE"} & set(getattr(route, "methods", None) or ()):
            yield path.replace("{", "").replace("}", "").replace(":path", "")


@pytest.fixture
def client(served: Served) -> TestClient:
    return served.visitor()


TOO_MUCH: dict[str, tuple[Any, str]] = {
    "bytes": ({"data": ["x" * MAX_BODY_BYTES]}, "larger than the limit of 1,000,000 bytes"),
    "items": ({"data": [[1] * (MAX_ITEMS + 1)]}, f"items; the limit is {MAX_ITEMS}."),
    "files": ({"data": [[FILE] * 200, [FILE] * 51]}, f"more than {MAX_ITEMS} files"),
    "values": ({"data": [[[0] * 200] * 100]}, "the limit of 10,000 values"),
    "depth": ({"data": json.loads("[" * 60 + "]" * 60)}, "the limit is 32 levels"),
    "url": (
        {"data": [[{**FILE, "path": "https://evil.example/a.wav"}]]},
        "upload the file instead",
    ),
    "stream": ({"data": [{**FILE, "is_stream": True}]}, "upload the file instead"),
}


@pytest.mark.parametrize("name", TOO_MUCH)
def test_no_route_is_given_a_request_that_holds_too_much_or_no_upload(served, client, name):
    body, words = TOO_MUCH[name]
    paths = sorted(set(posted(served.app.routes)))
    assert {"/gradio_api/queue/join", "/login", "/visitor"} <= set(paths) and len(paths) > 15
    for path in paths:
        if path.rstrip("/").endswith(("component_server", "process_recording")):
            continue  # which take nothing at all
        answer = client.post(path, json=body)
        if path in UPLOAD_ROUTES:
            assert answer.status_code == 400
            continue
        assert answer.status_code in (400, 413), path
        assert words in answer.json()["detail"] == answer.json()["error"], path


def test_a_wrong_body_is_answered_with_a_sentence_that_does_not_repeat_it(served, client):
    bodies = (
        b'{"data": [NaN, 1e999]}',
        b'{"data": ["\\ud800"]}',
        json.dumps("x" * 900_000).encode(),
    )
    named = "/gradio_api/call/v2/generate"
    for path in sorted({named, *posted(served.app.routes)}):
        for body in bodies:
            answer = client.post(path, content=body, headers={"Content-Type": "application/json"})
            assert answer.text != "Internal Server Error" and len(answer.content) < 2000, path
            if answer.status_code == 422:
                assert answer.json()["detail"].startswith("Invalid request (body"), path


def test_every_function_is_given_few_values_and_tells_one_error_in_short(served, client, caplog):
    """Each as the page asks it, with lists of the longest kind in all of its fields."""
    functions = client.get("/config").json()["dependencies"]
    longest = list(range(MAX_ITEMS))
    assert len(functions) > 30
    for function in functions:
        count = len(function["inputs"])
        asked = {"fn_index": function["id"], "session_hash": "a", "data": [longest] * count}
        for data, words in (
            ([longest] * count, ""),
            ([[FILE] * (MAX_ITEMS + 1)], f"items; the limit is {MAX_ITEMS}."),
            ([{"a": [FILE] * MAX_ITEMS}, FILE], f"more than {MAX_ITEMS} files"),
        ):
            if not words and not count:
                continue
            answer = client.post("/gradio_api/run/x", json={**asked, "data": data})
            assert words in answer.text
            assert (answer.status_code == 413) == bool(words), answer.text[:500]
            assert answer.status_code == 200 or len(answer.text) < 1000, function
    assert "fault" not in caplog.text, "none of ours fails in a way that it has no words for"
    assert all(len(message) < 500 for message in caplog.messages)


def test_what_a_page_asks_is_let_through(client):
    for body in (b"", b"{", b"\xff\xfe", b"[" + b"0," * 249 + b"0]", b'"' + b"a" * 10**5 + b'"'):
        check_json_body(body)
    with pytest.raises(RequestBodyError):
        check_json_body(b"[" * 100_000)
    assert client.post("/gradio_api/upload", files=UPLOAD).status_code == 200


def test_a_body_that_does_not_say_how_long_it_is_is_refused_as_well(client):
    pieces = (b"x" * 10**5 for _ in range(11))
    answer = client.post("/gradio_api/queue/join", content=pieces)
    assert answer.status_code == 413 and "bytes" in answer.json()["detail"]


def test_files_that_a_call_names_leave_nothing_beside_them(served, client):
    path = Path(client.post("/gradio_api/upload", files=UPLOAD).json()[0])
    named = {"path": str(path), "meta": {"_type": "gradio.FileData"}}
    functions = client.get("/config").json()["dependencies"]
    (choices,) = (each for each in functions if each["api_name"] == "_choices")
    before = served.uploads()
    asked = {"fn_index": choices["id"], "data": [[named] * MAX_ITEMS]}
    assert client.post("/gradio_api/run/_choices", json=asked).status_code == 200
    assert served.uploads() == before
