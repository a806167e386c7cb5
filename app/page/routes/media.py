"""Files of a run that the player fetches, and a motion as other programs read it, made when asked
for.

A browser must be able to ask for a part of a file, or it cannot seek in a video. The address holds
256 random bits and no path. It is told to the page that started the run alone; where that browser
keeps the page's cookie, the cookie is asked for as well. It dies with the run's folder.

Files for other programs are made of one that the page has given an address, motion always with the
open body: the mesh of a licensed one is not handed to visitors.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import anyio
import anyio.to_thread
from fastapi import Request, Response
from fastapi.responses import FileResponse, PlainTextResponse
from fastapi.routing import APIRoute
from starlette.background import BackgroundTask

from app.errors import visitor_sentence
from app.page.visitors.token_files import TokenFiles
from app.page.visitors.visitors import cookie_of
from app.run.videos.export import MARKERS_ENDING, RenderAsk, render_motion, write_plan

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


ENDINGS = {"glb": ".glb", "bvh": ".bvh", "blender": ".blender.npz"}
"""By what stands behind the address of a motion; app/page/web/stage/files.js has them too."""

PLAN_ENDINGS = {
    "json": ".json",
    "textgrid": ".TextGrid",
    "elan": ".eaf",
    "markers": MARKERS_ENDING,
}
"""The same of a plan."""
PLAN_SUFFIX = ".tiers.json"
"""Of plans as the page shows them."""


class MadeFiles:
    """Makes files when they are asked for, one at a time, as each takes memory, and sends them."""

    def __init__(self, temp: Path, do: Callable[[Callable[..., object], Any], object]) -> None:
        """
        Args:
            temp: folder where a file lies until it is sent.
            do: does a task, in a process of its own, that writes where its request says.
        """
        self._temp, self._do = temp, do
        self._turns: anyio.CapacityLimiter | None = None  # made within the loop that it is of

    async def answer(
        self, task: Callable[..., object], request: Callable[[Path], object], name: str
    ) -> Response:
        """
        Args:
            request: of the task, for a file there.
            name: under which the file is saved, always, so that nothing of it is opened as a page
                of this server.
        """
        self._turns = self._turns or anyio.CapacityLimiter(1)
        folder = Path(tempfile.mkdtemp(dir=self._temp))
        out = folder / name
        try:
            await anyio.to_thread.run_sync(self._do, task, request(out), limiter=self._turns)
        except Exception as error:
            shutil.rmtree(folder, ignore_errors=True)
            return PlainTextResponse(visitor_sentence(error), status_code=400)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)  # the visitor has gone
            raise
        return FileResponse(
            out,
            media_type="application/octet-stream",
            filename=out.name,
            headers={"Cache-Control": "no-store", "X-Content-Type-Options": "nosniff"},
            background=BackgroundTask(shutil.rmtree, folder, ignore_errors=True),
        )


def _as_file(file: Path, out: Path) -> RenderAsk:
    return RenderAsk(motions=(file,), out=out)


def motion_file_routes(addresses: MediaAddresses, made: MadeFiles) -> list[APIRoute]:
    """Serve motions and plans as other programs read them."""

    async def motion_file(token: str, kind: str, request: Request) -> Response:
        file = addresses.find(token, cookie_of(request))
        is_plan = file is not None and file.name.endswith(PLAN_SUFFIX)
        endings = PLAN_ENDINGS if is_plan else ENDINGS
        if file is None or not (is_plan or file.suffix == ".npz") or kind not in endings:
            return PlainTextResponse(GONE, status_code=404)
        stem = file.name.removesuffix(PLAN_SUFFIX if is_plan else ".npz")
        task = write_plan if is_plan else render_motion
        return await made.answer(task, partial(_as_file, file), f"{stem}{endings[kind]}")

    route = MEDIA_ROUTE + "/{token}/{kind}"
    return [APIRoute(route, motion_file, methods=["GET"], include_in_schema=False)]
