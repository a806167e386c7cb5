"""Files of a run that the player fetches, and a motion as other programs read it, made when asked
for.

A browser must be able to ask for a part of a file, or it cannot seek in a video. The address holds
256 random bits and no path. It is told to the page that started the run alone; where that browser
keeps the page's cookie, the cookie is asked for as well. It dies with the run's folder.

Files for other programs are made of one that the page has given an address, motion always with the
open body: the mesh of a licensed one is not handed to visitors.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import anyio
import anyio.to_thread
from fastapi import Request, Response
from fastapi.responses import FileResponse, PlainTextResponse
from fastapi.routing import APIRoute
from starlette.background import BackgroundTask

from app.errors import visitor_sentence
from app.page.visitors.token_files import TokenFiles
from app.page.visitors.visitors import cookie_of
from app.run.videos.export import MARKERS_ENDING, RenderRequest

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


def motion_file_routes(
    addresses: MediaAddresses, temp: Path, write_motion: Callable[[RenderRequest], object]
) -> list[APIRoute]:
    """Serve them, one at a time, as each takes memory.

    Args:
        temp: folder where a file lies until it is sent.
        write_motion: as `app.run.videos.export.render_motion`, in a process of its own.
    """
    turns: list[anyio.CapacityLimiter] = []  # made within the loop that it is of

    async def motion_file(token: str, kind: str, request: Request) -> Response:
        file = addresses.find(token, cookie_of(request))
        is_plan = file is not None and file.name.endswith(PLAN_SUFFIX)
        endings = PLAN_ENDINGS if is_plan else ENDINGS
        if file is None or not (is_plan or file.suffix == ".npz") or kind not in endings:
            return PlainTextResponse(GONE, status_code=404)
        if not turns:
            turns.append(anyio.CapacityLimiter(1))
        folder = Path(tempfile.mkdtemp(dir=temp))
        try:
            stem = file.name.removesuffix(PLAN_SUFFIX) if is_plan else file.stem
            out = folder / f"{stem}{endings[kind]}"
            if is_plan:
                write = partial(_write_plan, file, out)
            else:
                write = partial(write_motion, RenderRequest(file, out))
            await anyio.to_thread.run_sync(write, limiter=turns[0])
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
            headers={"Cache-Control": "private", "X-Content-Type-Options": "nosniff"},
            background=BackgroundTask(shutil.rmtree, folder, ignore_errors=True),
        )

    route = MEDIA_ROUTE + "/{token}/{kind}"
    return [APIRoute(route, motion_file, methods=["GET"], include_in_schema=False)]


def _write_plan(shown: Path, out: Path) -> None:
    """A plan as the page shows it, without what only the page has of it."""
    from model.plan.files import markers_csv, write_plan_file
    from model.plan.plan import read_plan

    told = json.loads(shown.read_text(encoding="utf-8"))
    told.pop("origin", None)
    bare = out.with_name(f".{out.name}.bare")
    bare.write_text(json.dumps(told), encoding="utf-8")
    plan = read_plan(bare)
    if out.name.endswith(MARKERS_ENDING):
        out.write_text(markers_csv(plan), encoding="utf-8")
    else:
        write_plan_file(plan, out)
