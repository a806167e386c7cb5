"""Open connections: so many of an address, and none whose client has stalled."""

import contextlib
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from gradio import Blocks

from app.config import AppConfig
from app.page.launch import launch
from app.page.routes import connections
from app.page.visitors.visitors import network_of
from tests.waiting import wait_for

HOST = b" HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
PAGE, BODY, STREAM = (
    b"GET /" + HOST,
    b"GET /live/body.glb" + HOST,
    b"GET /gradio_api/heartbeat/abc" + HOST,
)
POST = b"POST /visitor" + HOST.replace(b"\r\n\r\n", b"\r\nContent-Length: 9\r\n\r\n")
PROXY, VISITOR, OTHER = "127.0.0.1", "127.0.0.2", "127.0.0.3"
MOST = 5


@pytest.fixture(scope="module")
def page(weights: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Blocks]:
    """A page that ends what has stalled at once, and takes five connections of an address."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GRADIO_TEMP_DIR", "")  # launching sets it for the whole process
        patch.setattr(connections, "STALLED_S", 0.2)
        patch.setattr(connections, "MAX_CONNECTIONS_PER_ADDRESS", MOST)
        temp = tmp_path_factory.mktemp("page")
        page = launch(AppConfig(port=0, weights=weights, temp_folder=temp), preloads_models=False)
        yield page
        page.close()


def connect(page: Blocks, sent: bytes, address: str = VISITOR) -> socket.socket:
    connection = socket.create_connection(("127.0.0.1", page.server_port), 60, (address, 0))
    with contextlib.suppress(ConnectionError):
        connection.sendall(sent)
    return connection


def is_ended(connection: socket.socket) -> bool:
    """Check that the server ends a connection."""
    with contextlib.suppress(ConnectionError):
        while connection.recv(2**16):
            pass
    return True


def is_answered(connection: socket.socket) -> bool:
    """Check whether an answer begins, rather than the connection being ended."""
    with contextlib.suppress(ConnectionError):
        return connection.recv(15) == b"HTTP/1.1 200 OK"
    return False


@pytest.mark.parametrize("sent", [b"", PAGE[:9], PAGE[:-2], POST, POST + b"half"])
def test_a_client_that_sends_no_whole_request_is_ended(page, sent):
    with connect(page, sent) as stalled:
        assert is_ended(stalled)


def test_a_client_that_reads_no_answer_is_ended_and_one_that_waits_for_a_stream_is_not(page):
    open_now = page.server.server_state.connections
    with connect(page, STREAM, OTHER) as stream, connect(page, b"") as stalled:
        assert is_answered(stream)
        stalled.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        stalled.sendall(BODY * 100)
        wait_for(lambda: any(each.transport.get_write_buffer_size() for each in list(open_now)))
        wait_for(lambda: {each.client[0] for each in list(open_now)} == {OTHER})
        assert not stream.recv(2**16, socket.MSG_DONTWAIT).endswith(b"0\r\n\r\n")


def test_an_address_has_so_many_connections_and_others_have_theirs(page):
    with contextlib.ExitStack() as stack:

        def opened(address: str) -> bool:
            return is_answered(stack.enter_context(connect(page, STREAM, address)))

        assert all(opened(VISITOR) for _ in range(MOST))
        assert not opened(VISITOR) and not opened(VISITOR)
        assert opened(OTHER) and all(opened(PROXY) for _ in range(MOST + 1))
    wait_for(lambda: not page.server.server_state.connections)
    with connect(page, STREAM) as again:
        assert is_answered(again)


def test_connections_of_other_addresses_are_not_looked_through(page):
    with contextlib.ExitStack() as stack:
        for number in range(10, 40):
            stack.enter_context(connect(page, STREAM, f"127.0.0.{number}"))
        wait_for(lambda: len(page.server.server_state.connections) == 30)
        before = network_of.cache_info().hits
        assert is_answered(stack.enter_context(connect(page, STREAM, VISITOR)))
        assert network_of.cache_info().hits - before < 10
    wait_for(lambda: not page.server.server_state.connections)
    assert not page.server.config.http_protocol_class.transports
