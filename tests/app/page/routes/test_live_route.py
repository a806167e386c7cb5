"""The WebSocket of a live session, without a browser."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from app.config import EXAMPLES
from app.errors import RunError
from app.page.routes import live_route
from app.page.routes.live_route import FOREIGN, SPEAK_ROUTE, live_routes
from app.page.visitors.visitors import COOKIE
from app.run.frame_packets import HEADER
from tests.app.live.test_live import ByHand, sound
from tests.waiting import wait_for

ASK = {"system": "globaldiff/global", "speaker": "ann", "seed": 1}
OWN = {"origin": "http://testserver", "host": "testserver"}


@pytest.fixture
def sessions(weights: Path) -> ByHand:
    return ByHand(weights)


@pytest.fixture
def client(sessions: ByHand, monkeypatch: pytest.MonkeyPatch) -> Iterator[TestClient]:
    monkeypatch.setattr(live_route, "SILENT_S", 600.0)  # a busy machine is not a browser that left
    with TestClient(FastAPI(routes=live_routes(sessions))) as client:
        yield client


def told(socket) -> dict:
    return json.loads(socket.receive_text())


def test_sound_goes_in_and_frames_come_out(client, sessions, tmp_path):
    client.cookies.update({COOKIE: "mine"})
    with client.websocket_connect(SPEAK_ROUTE, headers=OWN) as socket:
        socket.send_text(json.dumps(ASK))
        ready = told(socket)
        assert (ready["hop"], ready["ahead"]) == (9, 9)
        assert len(ready["token"]) >= 43 and not ready["plans"]
        for block in sound(2.5):
            socket.send_bytes(block)
        session = next(iter(sessions.performers.open.values()))
        wait_for(lambda: session._samples == 40_000)
        wait_for(lambda: sessions.performers.generate_next_window() and session.windows)
        first, count, *_ = HEADER.unpack_from(socket.receive_bytes())
        assert first == 0 and count >= 9
    with pytest.raises(RunError, match="no live recording"):
        sessions.save_last_minute(ready["token"], "yours", tmp_path)
    # The connection ends, and the minute outlives it.
    wait_for(lambda: not sessions.performers.open and len(sessions.performers.ended) == 1)


def test_a_page_of_another_origin_is_not_let_in(client):
    for headers in ({"host": "testserver"}, {**OWN, "origin": "http://testserver.evil.example"}):
        with pytest.raises(WebSocketDisconnect) as refused:
            with client.websocket_connect(SPEAK_ROUTE, headers=headers):
                pass
        assert refused.value.code == FOREIGN


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ("no json", "invalid request for a live session"),
        ("[" * 990, "invalid request for a live session"),
        (json.dumps({**ASK, "more": "x" * 1000}), "invalid request for a live session"),
        (json.dumps({**ASK, "system": "../../etc/passwd"}), "There is no system"),
        (json.dumps({**ASK, "system": "expression"}), "There is no system"),
        (json.dumps({**ASK, "speaker": "eve"}), "There is no speaker"),
        (json.dumps({**ASK, "seed": -1}), "The seed must be"),
    ],
)
def test_what_cannot_be_is_told_in_a_sentence(client, asked, words):
    with client.websocket_connect(SPEAK_ROUTE, headers=OWN) as socket:
        socket.send_text(asked)
        assert words in told(socket)["end"]
        with pytest.raises(WebSocketDisconnect):
            socket.receive_text()


def test_what_is_no_sound_ends_the_session(client, sessions):
    for sent, words in (
        (b"abc", "damaged"),
        (bytes(2_000_000), "the limit is 32000"),
        ("a", "damaged"),
    ):
        with client.websocket_connect(SPEAK_ROUTE, headers=OWN) as socket:
            socket.send_text(json.dumps(ASK))
            assert "token" in told(socket)
            socket.send_bytes(sent) if isinstance(sent, bytes) else socket.send_text(sent)
            assert words in told(socket)["end"]
        wait_for(lambda: not sessions.performers.open)


def test_one_too_many_is_told(client, monkeypatch):
    monkeypatch.setattr("app.live.session_process.MAX_SESSIONS", 2)
    monkeypatch.setattr("app.live.session_process.MAX_SESSIONS_PER_ADDRESS", 1)
    answers = []
    visitors = [TestClient(client.app, client=(f"10.0.0.{k}", 1)) for k in (1, 1, 2, 3)]
    with (
        visitors[0].websocket_connect(SPEAK_ROUTE, headers=OWN) as one,
        visitors[1].websocket_connect(SPEAK_ROUTE, headers=OWN) as same,
        visitors[2].websocket_connect(SPEAK_ROUTE, headers=OWN) as two,
        visitors[3].websocket_connect(SPEAK_ROUTE, headers=OWN) as three,
    ):
        for socket in (one, same, two, three):
            socket.send_text(json.dumps(ASK))
            answers.append(told(socket))
    assert "token" in answers[0] and "token" in answers[2]
    assert "Your network address already has 1 live sessions" in answers[1]["end"]
    assert "2 live sessions are already running on this server" in answers[3]["end"]


def test_examples_are_there_and_nothing_else(client):
    example = EXAMPLES / "three_reasons.wav"
    assert client.get(f"/live/example/{example.name}").content == example.read_bytes()
    for other in ("", "1", "..%2fapp.py", "..%2f..%2fapp.py", "%2fetc%2fpasswd", "x"):
        assert client.get(f"/live/example/{other}").status_code == 404
