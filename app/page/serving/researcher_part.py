"""The researcher's part of a study that was made on the page: fetched once, by its maker alone.

It never becomes an output of Gradio, whose files anyone with the address may read. It waits in a
folder of its own; the page shows a button that posts a random token, and the route also asks for
the cookie that the same browser got before the study was made. The file is deleted before its first
byte is sent.
"""

from __future__ import annotations

import secrets
import shutil
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO
from urllib.parse import parse_qs

from fastapi import Request, Response
from fastapi.responses import PlainTextResponse, StreamingResponse
from fastapi.routing import APIRoute

COOKIE = "study_visitor"
VISITOR_ROUTE = "/study/visitor"
RESEARCHER_ROUTE = "/study/researcher"
FILE_NAME = "researcher_only.zip"
REFUSED = (
    "There is nothing to fetch here: each study's researcher part can be fetched once, in the "
    "browser that made it."
)
_COOKIE_BYTES = 32
_ABANDONED_S = 86_400.0
_MAX_FORM_BYTES = 1000
_BLOCK_BYTES = 1 << 16


@dataclass(frozen=True)
class _Offer:
    visitor: str
    archive: Path
    until: float


class Handover:
    """Researcher parts that wait to be fetched."""

    def __init__(self, root: Path, keep_s: float = 3600.0) -> None:
        """
        Args:
            root: a folder of its own, which Gradio neither serves nor caches.
        """
        self.root = root
        self._keep_s = keep_s
        self._offers: dict[str, _Offer] = {}
        self._lock = threading.Lock()
        self._remove_abandoned()

    def private_folder(self) -> Path:
        """A new folder that only this process's user can enter."""
        folder = self.root / secrets.token_hex(16)
        folder.mkdir(parents=True, mode=0o700)
        self.root.chmod(0o700)
        return folder

    def offer(self, visitor: str, archive: Path) -> str:
        """Let a visitor fetch a file of a private folder; returns the token."""
        self._forget_old()
        token = secrets.token_urlsafe(32)
        with self._lock:
            self._offers[token] = _Offer(visitor, archive, time.monotonic() + self._keep_s)
        timer = threading.Timer(self._keep_s + 1.0, self._forget_old)
        timer.daemon = True
        timer.start()
        return token

    def take(self, visitor: str, token: str) -> IO[bytes] | None:
        """The file, already deleted, or None when this visitor may not have it.

        A token that another visitor tries stays good for the one who has it.
        """
        self._forget_old()
        with self._lock:
            offer = self._offers.get(token)
            if offer is None or not _is_same(offer.visitor, visitor):
                return None
            del self._offers[token]
        file = offer.archive.open("rb")
        shutil.rmtree(offer.archive.parent, ignore_errors=True)
        return file

    def _remove_abandoned(self) -> None:
        """Remove what an earlier process left; another one may be at work beside this."""
        for folder in self.root.iterdir() if self.root.is_dir() else ():
            if time.time() - folder.stat().st_mtime > _ABANDONED_S:
                shutil.rmtree(folder, ignore_errors=True)

    def _forget_old(self) -> None:
        now = time.monotonic()
        with self._lock:
            old = [token for token, offer in self._offers.items() if offer.until < now]
            folders = [self._offers.pop(token).archive.parent for token in old]
        for folder in folders:
            shutil.rmtree(folder, ignore_errors=True)


def study_routes(handover: Handover) -> list[APIRoute]:
    """Serve the cookie and the researcher's parts."""

    def visitor(request: Request) -> Response:
        response = Response(status_code=204, headers={"Cache-Control": "no-store"})
        if not request.cookies.get(COOKIE):
            response.set_cookie(
                COOKIE,
                secrets.token_urlsafe(_COOKIE_BYTES),
                httponly=True,
                samesite="strict",
                secure=request.url.scheme == "https",
            )
        return response

    async def researcher(request: Request) -> Response:
        form = parse_qs((await _body(request)).decode("ascii", "replace"))
        token = form.get("token", [""])[0]
        file = handover.take(request.cookies.get(COOKIE, ""), token)
        if file is None:
            return PlainTextResponse(REFUSED, status_code=404)
        return StreamingResponse(
            _blocks(file),
            media_type="application/zip",
            headers={
                "Content-Disposition": f'attachment; filename="{FILE_NAME}"',
                "Cache-Control": "no-store",
                "X-Content-Type-Options": "nosniff",
            },
        )

    return [
        APIRoute(VISITOR_ROUTE, visitor, methods=["POST"], include_in_schema=False),
        APIRoute(RESEARCHER_ROUTE, researcher, methods=["POST"], include_in_schema=False),
    ]


def _is_same(first: str, second: str) -> bool:
    """Whether two cookies are equal, in a time that does not tell how much of them is."""
    return bool(first) and secrets.compare_digest(first.encode(), second.encode())


async def _body(request: Request) -> bytes:
    """No more than a token needs; what is longer is no token."""
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > _MAX_FORM_BYTES:
            return b""
    return body


def _blocks(file: IO[bytes]) -> Iterator[bytes]:
    with file:
        while block := file.read(_BLOCK_BYTES):
            yield block
