"""The page for participants as its maker sees it before it is hosted anywhere.

It is served to the browser that made the study alone, below an address that nobody can guess, for
as long as the job's folder is kept.
"""

from __future__ import annotations

import secrets
import threading
from pathlib import Path

from fastapi import Request, Response
from fastapi.responses import FileResponse, PlainTextResponse
from fastapi.routing import APIRoute

from app.page.visitors.visitors import cookie_of, is_same

PREVIEW_ROUTE = "/study/preview"
START = "index.html?preview"
GONE = "There is no such preview, or it is kept no longer."
_TOKEN_BYTES = 32
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript",
    ".css": "text/css",
    ".mp4": "video/mp4",
}


class StudyPreviews:
    """Bundles that can be looked at. Safe to use from several threads."""

    def __init__(self) -> None:
        self._bundles: dict[str, tuple[Path, dict[str, Path], str]] = {}
        self._lock = threading.Lock()

    def address(self, bundle: Path, cookie: str) -> str:
        """The address of its first page, relative to the app's page, for one browser."""
        files = {
            path.relative_to(bundle).as_posix(): path
            for path in bundle.rglob("*")
            if path.suffix in _TYPES and path.is_file()
        }
        token = secrets.token_urlsafe(_TOKEN_BYTES)
        with self._lock:
            gone = [each for each, (folder, *_) in self._bundles.items() if not folder.is_dir()]
            for each in gone:
                del self._bundles[each]
            self._bundles[token] = (bundle, files, cookie)
        return f"{PREVIEW_ROUTE.lstrip('/')}/{token}/{START}"

    def find(self, token: str, name: str, cookie: str) -> Path | None:
        """A file of a bundle, or None where there is none for this browser."""
        with self._lock:
            _, files, owner = self._bundles.get(token, (None, {}, ""))
        path = files.get(name)
        return path if path is not None and is_same(owner, cookie) and path.is_file() else None


def preview_routes(previews: StudyPreviews) -> list[APIRoute]:
    """Serve them."""

    def preview(token: str, name: str, request: Request) -> Response:
        path = previews.find(token, name, cookie_of(request))
        if path is None:
            return PlainTextResponse(GONE, status_code=404)
        headers = {"Cache-Control": "no-store", "X-Content-Type-Options": "nosniff"}
        return FileResponse(path, media_type=_TYPES[path.suffix], headers=headers)

    route = PREVIEW_ROUTE + "/{token}/{name:path}"
    return [APIRoute(route, preview, methods=["GET", "HEAD"], include_in_schema=False)]
