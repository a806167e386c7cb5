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
from collections.abc import Iterator
from pathlib import Path
from typing import IO
from urllib.parse import parse_qs

from fastapi import Request, Response
from fastapi.responses import PlainTextResponse, StreamingResponse
from fastapi.routing import APIRoute

from app.page.visitors.token_files import TokenFiles
from app.page.visitors.visitors import cookie_of, visitor_route

RESEARCHER_ROUTE = "/study/researcher"
FILE_NAME = "researcher_only.zip"
REFUSED = (
    "There is nothing to fetch here: each study's researcher part can be fetched once, in the "
    "browser that made it."
)
_MAX_FORM_BYTES = 1000
_BLOCK_BYTES = 1 << 16


class Handover:
    """Researcher parts that wait to be fetched."""

    def __init__(self, root: Path, keep_s: float = 3600.0) -> None:
        """
        Args:
            root: a folder of its own, which Gradio neither serves nor caches.
        """
        self.root = root
        self._keep_s = keep_s
        self._token_files = TokenFiles()

    def private_folder(self) -> Path:
        """A new folder that only this process's user can enter."""
        folder = self.root / secrets.token_hex(16)
        folder.mkdir(parents=True, mode=0o700)
        self.root.chmod(0o700)
        return folder

    def offer(self, cookie: str, archive: Path) -> str:
        """Let a browser fetch a file of a private folder; returns the token."""
        self._remove_ended()
        token = self._token_files.add(archive, cookie, self._keep_s)
        timer = threading.Timer(self._keep_s + 1.0, self._remove_ended)
        timer.daemon = True
        timer.start()
        return token

    def take(self, cookie: str, token: str) -> IO[bytes] | None:
        """The file, already deleted, or None when this browser may not have it.

        A token that another browser tries stays good for the one who has it.
        """
        self._remove_ended()
        archive = self._token_files.take(token, cookie)
        if archive is None:
            return None
        file = archive.open("rb")
        shutil.rmtree(archive.parent, ignore_errors=True)
        return file

    def _remove_ended(self) -> None:
        for archive in self._token_files.forget_ended():
            shutil.rmtree(archive.parent, ignore_errors=True)


def study_routes(handover: Handover) -> list[APIRoute]:
    """Serve the cookie and the researcher's parts."""

    async def researcher(request: Request) -> Response:
        form = parse_qs((await _body(request)).decode("ascii", "replace"))
        token = form.get("token", [""])[0]
        file = handover.take(cookie_of(request), token)
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
        visitor_route(),
        APIRoute(RESEARCHER_ROUTE, researcher, methods=["POST"], include_in_schema=False),
    ]


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
