"""Attacks that cost who makes them next to nothing, against a page on this machine's loopback.

All of them are bounded in count and time, and come from one address. Each tells what it got.
"""

from __future__ import annotations

import contextlib
import io
import json
import secrets
import threading
import time
import zipfile
from collections.abc import Iterator
from urllib.parse import urlsplit

import httpx
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

NAMED, ENTRIES = 60, 120_000
TINY_BYTES = 8
ASK_LIVE = {"system": "globaldiff/global", "speaker": "ann", "seed": 1}


def only_here(address: str) -> str:
    """The address of a page, which must be on this machine.

    Raises:
        ValueError: if it is not; nobody else is ever attacked.
    """
    if urlsplit(address).hostname != "127.0.0.1":
        raise ValueError(f"Only a page on 127.0.0.1 is attacked; got {address}.")
    return address


def tiny_files(count: int) -> tuple[bytes, str]:
    """A multipart body of so many files of eight bytes, no two alike, and its boundary."""
    boundary = secrets.token_hex(8)
    head = f'--{boundary}\r\nContent-Disposition: form-data; name="files"; filename="%d"\r\n\r\n'
    parts = [(head % k).encode() + secrets.token_bytes(TINY_BYTES) + b"\r\n" for k in range(count)]
    return b"".join(parts) + f"--{boundary}--\r\n".encode(), boundary


def send_tiny_files(address: str, bodies: int, count: int, own: str) -> list[int]:
    """Send so many such bodies from the address ``own``; returns the status of each answer."""
    transport = httpx.HTTPTransport(local_address=own)
    statuses: list[int] = []
    with httpx.Client(base_url=only_here(address), transport=transport, timeout=60) as client:
        for _ in range(bodies):
            body, boundary = tiny_files(count)
            headers = {"Content-Type": f"multipart/form-data; boundary={boundary}"}
            try:
                answer = client.post("gradio_api/upload", content=body, headers=headers)
                statuses.append(answer.status_code)
            except httpx.TransportError:  # cut off in the middle
                statuses.append(0)
    return statuses


class TricklingSockets(contextlib.AbstractContextManager["TricklingSockets"]):
    """Live sessions of one address that send two bytes now and then and are heard no more of."""

    def __init__(self, address: str, count: int, own: str, every_s: float = 9.0) -> None:
        self._every_s = every_s
        self._over = threading.Event()
        self._sockets = contextlib.ExitStack()
        self._open: list[ClientConnection] = []
        self.endings: list[str] = []
        """What those were told who got no place, or lost it."""
        for _ in range(count):
            self._ask(address, own)
        self.num_let_in = len(self._open)
        self._thread = threading.Thread(target=self._trickle, daemon=True)
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._sockets.close()

    @property
    def num_open(self) -> int:
        return len(self._open)

    def _ask(self, address: str, own: str) -> None:
        socket = self._sockets.enter_context(live_socket(address, own))
        told = str(socket.recv())
        if "token" in told:
            self._open.append(socket)
        else:
            self.endings.append(told)

    def _trickle(self) -> None:
        sent_at = 0.0
        while not self._over.wait(0.2):
            is_time = time.monotonic() - sent_at > self._every_s
            for socket in list(self._open):
                try:
                    if is_time:
                        socket.send(b"\0\0")
                    told = socket.recv(timeout=0.0)
                    if isinstance(told, str):
                        self.endings.append(told)
                        self._open.remove(socket)
                except TimeoutError:
                    continue
                except ConnectionClosed:
                    self._open.remove(socket)
            if is_time:
                sent_at = time.monotonic()


@contextlib.contextmanager
def live_socket(address: str, own: str) -> Iterator[ClientConnection]:
    """A WebSocket that has asked for a live session, from the address ``own``."""
    page = only_here(address).rstrip("/")
    with connect(
        f"{page.replace('http', 'ws', 1)}/live/speak",
        additional_headers={"Origin": page},
        source_address=(own, 0),
    ) as socket:
        socket.send(json.dumps(ASK_LIVE))
        yield socket


def zip_of_nothing() -> bytes:
    """Of `ENTRIES` empty files, in a few megabytes."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for number in range(ENTRIES):
            archive.writestr(f"{number}.npz", b"")
    return file.getvalue()
