"""Files of a run that the page's player fetches, each under an address that nobody can guess.

A browser must be able to ask for a part of a file, or it cannot seek in a video. The address holds
256 random bits and no path. It is told to the page that started the run alone; where that browser
keeps the page's cookie, the cookie is asked for as well. It dies with the run's folder.
"""

from __future__ import annotations

from pathlib import Path

from fastapi import Request, Response
from fastapi.responses import FileResponse, PlainTextResponse
from fastapi.routing import APIRoute

from app.page.visitors.token_files import TokenFiles
from app.page.visitors.visitors import cookie_of

MEDIA_ROUTE = "/media"
WEB_ROUTE = "/web"
WEB_FOLDER = Path(__file__).parents[1] / "web"
GONE = "There is no such file, or it is kept no longer."
_SHOWN_TYPES = {
    ".mp4": "video/mp4",
    ".wav": "audio/wav",
    ".frames": "application/octet-stream",
    ".json": "application/json",
    ".png": "image/png",
}
"""What a page shows; everything else is only ever downloaded."""
_WEB_TYPES = {".js": "text/javascript", ".css": "text/css"}


class MediaAddresses:
    """Gives a run's files their addresses."""

    def __init__(self) -> None:
        self._token_files = TokenFiles()

    def address(self, path: Path, cookie: str) -> str:
        """The address, relative to the page, of a file for one browser.

        Args:
            cookie: empty for a browser that keeps none; the address alone is asked of it.
        """
        self._token_files.forget_ended()
        return f"{MEDIA_ROUTE.lstrip('/')}/{self._token_files.add(path, cookie or None)}"

    def find(self, token: str, cookie: str) -> Path | None:
        """The file, or None when there is none for this browser."""
        return self._token_files.find(token, cookie)


def media_routes(addresses: MediaAddresses) -> list[APIRoute]:
    """Serve the player's files and the page's own modules."""
    modules = {
        path.relative_to(WEB_FOLDER).as_posix(): path
        for path in WEB_FOLDER.rglob("*")
        if path.suffix in _WEB_TYPES
    }

    def media(token: str, request: Request) -> Response:
        path = addresses.find(token, cookie_of(request))
        if path is None:
            return PlainTextResponse(GONE, status_code=404)
        media_type = _SHOWN_TYPES.get(path.suffix)
        return FileResponse(
            path,
            media_type=media_type or "application/octet-stream",
            filename=None if media_type else path.name,
            headers={"Cache-Control": "private", "X-Content-Type-Options": "nosniff"},
        )

    def web(name: str) -> Response:
        if name not in modules:
            return PlainTextResponse(GONE, status_code=404)
        path = modules[name]
        headers = {"Cache-Control": "no-cache", "X-Content-Type-Options": "nosniff"}
        return FileResponse(path, media_type=_WEB_TYPES[path.suffix], headers=headers)

    methods = ["GET", "HEAD"]
    return [
        APIRoute(MEDIA_ROUTE + "/{token}", media, methods=methods, include_in_schema=False),
        APIRoute(WEB_ROUTE + "/{name:path}", web, methods=methods, include_in_schema=False),
    ]
