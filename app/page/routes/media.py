"""Routes of a run's files for the player, and of exports for other programs, made on request.

Files are served with range requests, without which a browser cannot seek in a video. The URL begins
with 256 random bits of one folder, known only to the page that started the run; if that browser
keeps the page's cookie, the cookie is required as well. The URL expires with the folder.

Exports are made of a file with a URL, motion always with the open body: the mesh of a licensed one
is not given to visitors.
"""

from __future__ import annotations

import base64
import functools
import json
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, get_args
from urllib.parse import quote, unquote

import anyio
import anyio.to_thread
from fastapi import Request, Response
from fastapi.responses import FileResponse, PlainTextResponse, StreamingResponse
from fastapi.routing import APIRoute
from starlette.background import BackgroundTask
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import QueryParams
from starlette.routing import BaseRoute, Mount
from starlette.staticfiles import StaticFiles

from app.errors import RunError, visitor_message
from app.page.parts.catalogue import tracked_point_choices
from app.page.routes.bodies import CHARACTER_ROUTE
from app.page.visitors.characters import FILE, Characters
from app.page.visitors.quota import Quota
from app.page.visitors.visitors import TokenStore, cookie_of
from app.run import frame_packets
from app.run.requests.convert import parse_form_value, request_from
from app.run.requests.parts import FigureWidth, VideoOptions, check_choice
from app.run.requests.requests import MARKERS_SUFFIX, Figure6Request, RenderRequest
from app.run.tasks import DRAW_FIGURE, REDRAW_FIGURE, RENDER, WRITE_PLAN, WRITE_STAGE_BODY
from renderer.figures.style import CONTENTS_SUFFIX, FIGURE_FORMATS

MEDIA_ROUTE = "/media"
WEB_ROUTE = "/web"
MAX_CHARACTER_BYTES = 50_000_000
WEB_FOLDER = Path(__file__).parents[1] / "web"
GONE = "This file does not exist or has expired."
INLINE_TYPES: Mapping[str, str] = {
    ".mp4": "video/mp4",
    ".wav": "audio/wav",
    ".frames": "application/octet-stream",
    ".json": "application/json",
    ".png": "image/png",
}
"""MIME types of the files that a page shows; all others are only downloaded."""
PARTICIPANT_TYPES: Mapping[str, str] = {
    ".mp4": "video/mp4",
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".woff2": "font/woff2",
}
"""MIME types of the files of a participants' page, which opens as a page."""
MAX_EXPORTS = 8
TOO_MANY_EXPORTS = (
    f"You already have {MAX_EXPORTS} downloads in progress; the limit is {MAX_EXPORTS}. Wait "
    "until one is finished."
)
FileToUrl = Callable[[Path], str]
"""Function from a file to its URL, relative to the page."""


class _Shared(NamedTuple):
    folder: Path
    types: Mapping[str, str]


class SharedFolders(TokenStore[_Shared]):
    """Store of folders with files that a browser may fetch."""

    def share(
        self, folder: Path, cookie: str, types: Mapping[str, str] = INLINE_TYPES
    ) -> FileToUrl:
        """Return a function that gives the current and later files of a folder their URLs.

        A replaced file gets a new URL. A browser without a cookie needs only the URL.

        Args:
            types: MIME types of files that are shown rather than downloaded.
        """
        token = self.keep(_Shared(folder, types), folder, cookie or None)

        def to_url(path: Path) -> str:
            name = quote(path.relative_to(folder).as_posix())
            return f"{MEDIA_ROUTE.lstrip('/')}/{token}/{name}?{path.stat().st_ino}"

        return to_url

    def file_of_url(self, address: str, cookie: str) -> Path | None:
        """Return the file of a URL that this browser may fetch, or None."""
        path, _, _ = address.partition("?")
        route, _, rest = path.partition("/")
        token, _, name = rest.partition("/")
        shared = self.file(token, unquote(name), cookie) if f"/{route}" == MEDIA_ROUTE else None
        return shared and shared[0]

    def file(self, token: str, name: str, cookie: str) -> tuple[Path, str | None] | None:
        """Return the path of a file, with its MIME type if it is shown; None without access."""
        shared = self.find(token, cookie)
        if shared is None:
            return None
        try:
            path = (shared.folder / name).resolve()
            is_there = path.is_relative_to(shared.folder.resolve()) and path.is_file()
        except (OSError, ValueError):
            return None
        return (path, shared.types.get(path.suffix)) if is_there else None


class OnDemandFiles:
    """Exports made on request, one at a time as each takes memory, and sent as downloads.

    An address may have a few that wait or are being sent, each of which takes disk space. One whose
    client has gone when its turn comes is not made.
    """

    def __init__(
        self,
        temp: Path,
        do: Callable[[Callable[..., object], Any], object],
        quota: Quota | None = None,
    ) -> None:
        """Configure the exports."""
        self.temp, self._do, self._quota = temp, do, quota or Quota()
        self._turns: anyio.CapacityLimiter | None = None  # made within its event loop
        self._num_open: Counter[str] = Counter()
        """Number of unfinished exports by owner (`Quota.owner_of`)."""

    async def answer(
        self,
        task: Callable[..., object],
        make_request: Callable[[Path], object],
        name: str,
        http_request: Request | None = None,
    ) -> Response:
        """Make a file and return it as a download, so that the browser never opens it as a page.

        Args:
            http_request: None if the caller limits the number of requests itself.
        """
        self._turns = self._turns or anyio.CapacityLimiter(1)
        owner = [] if http_request is None else [self._quota.owner_of(http_request)]
        if any(self._num_open[each] >= MAX_EXPORTS for each in owner):
            return PlainTextResponse(TOO_MANY_EXPORTS, status_code=429)
        folder = Path(tempfile.mkdtemp(dir=self.temp))
        out = folder / name
        self._num_open.update(owner)

        def end() -> None:
            shutil.rmtree(folder, ignore_errors=True)
            self._num_open -= Counter(owner)

        try:
            async with self._turns:
                if http_request is not None and await http_request.is_disconnected():
                    end()
                    return Response(status_code=408)
                await anyio.to_thread.run_sync(self._do, task, make_request(out))
        except Exception as error:
            end()
            return PlainTextResponse(visitor_message(error), status_code=400)
        except BaseException:
            end()  # the page has ended
            raise
        return FileResponse(
            out,
            media_type="application/octet-stream",
            filename=out.name,
            headers={"Cache-Control": "no-store"},
            background=BackgroundTask(end),
        )


ENDINGS = {"glb": ".glb", "vrma": ".vrma", "bvh": ".bvh", "blender": ".blender.npz"}
"""Suffixes of motion exports by value of the URL's parameter, as in app/page/web/stage/files.js."""
PLAN_ENDINGS = {"json": ".json", "textgrid": ".TextGrid", "elan": ".eaf", "markers": MARKERS_SUFFIX}
"""Suffixes of gesture plan exports by value of the URL's parameter."""
PLAN_SUFFIX = ".plan.json"
FIGURE_ENDINGS = {"svg": ".svg", "pdf": ".pdf"}
"""Suffixes of figure exports by value of the URL's parameter."""
REDRAW_PARAMETERS: Mapping[str, str] = {
    "panels": "figure_panels",
    "frames": "figure_frames",
    "width": "figure_width",
}
"""Fields of `Figure6Request` by URL parameter; with one of them, Figure 6 is drawn again."""


class _Modules(StaticFiles):
    """JavaScript modules of the page; a browser checks every time whether they have changed."""

    def file_response(self, *how: Any, **named: Any) -> Response:
        response = super().file_response(*how, **named)
        response.headers["Cache-Control"] = "no-cache"
        return response


def redraw_request(
    run: Path, query: QueryParams, form: str, out: Path, body: Path | None
) -> Figure6Request:
    """Return the request of a URL that draws a run's Figure 6 again; raises RunError."""
    values = {
        name: parse_form_value(Figure6Request, name, ",".join(query.getlist(key)))
        for key, name in REDRAW_PARAMETERS.items()
        if any(query.getlist(key))
    }
    check_choice(values.get("figure_width", "174mm"), get_args(FigureWidth), "width")
    own = {"run": run, "out": out.with_suffix(""), "body": body, "figure_formats": (form,)}
    return request_from(Figure6Request, values | own)


def media_routes(
    media: SharedFolders,
    exports: OnDemandFiles,
    characters: Characters,
    quota: Quota,
    body: Path | None = None,
) -> list[BaseRoute]:
    """Return the routes of the player's files, exports, modules, and the body (None: open)."""

    async def file(token: str, name: str, request: Request) -> Response:
        shared_path = await run_in_threadpool(media.file, token, name, cookie_of(request))
        if shared_path is None:
            return PlainTextResponse(GONE, status_code=404)
        path, media_type = shared_path
        kind = request.query_params.get("as")
        if kind == "character":
            return await moving_character(path, request)
        if kind is not None:
            return await export(path, kind, request)
        return FileResponse(
            path,
            media_type=media_type or "application/octet-stream",
            filename=None if media_type else path.name,
            headers={"Cache-Control": "private"},
        )

    async def moving_character(path: Path, client: Request) -> Response:
        body = characters.find(cookie_of(client))
        if body is None or path.suffix != ".npz":
            return PlainTextResponse(CHARACTER_GONE, status_code=404)
        video, name = VideoOptions(body=body), f"{path.stem}-character.glb"
        return await exports.answer(
            RENDER, lambda out: RenderRequest(motion=path, out=out, video=video), name, client
        )

    async def export(path: Path, kind: str, client: Request) -> Response:
        query = client.query_params

        def render_request(out: Path) -> RenderRequest:
            return RenderRequest(motion=path, out=out)

        is_redrawn = kind in FIGURE_FORMATS and REDRAW_PARAMETERS.keys() & query.keys()
        if is_redrawn and path.name == f"figure6{CONTENTS_SUFFIX}":
            run = path.parents[1]
            redrawn = partial(redraw_request, run, query, kind, body=body)
            return await exports.answer(REDRAW_FIGURE, redrawn, f"figure6.{kind}", client)

        for suffix, endings, task, request in (
            (PLAN_SUFFIX, PLAN_ENDINGS, WRITE_PLAN, render_request),
            (CONTENTS_SUFFIX, FIGURE_ENDINGS, DRAW_FIGURE, lambda out: (path, out)),
            (".npz", ENDINGS, RENDER, render_request),
        ):
            if path.name.endswith(suffix):
                if kind not in endings:
                    break
                name = f"{path.name.removesuffix(suffix)}{endings[kind]}"
                return await exports.answer(task, request, name, client)
        return PlainTextResponse(GONE, status_code=404)

    return [
        APIRoute(MEDIA_ROUTE + "/{token}/{name:path}", file, methods=["GET", "HEAD"]),
        Mount(WEB_ROUTE, _Modules(directory=WEB_FOLDER)),
        character_route(characters, exports, quota),
        *(_route(f"/{name}", make, kind) for name, (make, kind) in VIEWER_ASSETS.items()),
    ]


CHARACTER_TOO_LARGE = (
    "This file is larger than the limit of {limit:.0f} MB for a character; export it with smaller "
    "textures."
)
TOO_MANY_CHARACTERS = "The server is busy reading other character files; try again in a moment."
CHARACTER_GONE = (
    "Your character was deleted because it was not used for a while; choose its file again."
)
NO_COOKIE = (
    "Allow cookies for this page; they are needed to keep your character private to your browser."
)
_MAX_CHARACTERS_AT_ONCE, _MAX_OF_OWNER = 16, 4


def character_route(characters: Characters, exports: OnDemandFiles, quota: Quota) -> APIRoute:
    """Make the route that takes a visitor's character and answers with the viewer's mesh of it.

    The file is a request's body; its name is not sent. It is kept for this browser alone, which
    can ask for the mesh again (GET), or have the file deleted (DELETE).
    """
    reading: dict[Path, str] = {}
    """Owners (`Quota.owner_of`) by the folder of what is read for them."""

    async def character(request: Request) -> Response:
        cookie = cookie_of(request)
        if request.method == "DELETE":
            characters.drop(cookie)
            quota.drop_upload(quota.owner_of(request), characters.folder(cookie), FILE)
            return Response(status_code=204)
        if not cookie:
            return PlainTextResponse(NO_COOKIE, status_code=400)
        owner = quota.owner_of(request)
        of_owner = [*reading.values()].count(owner)
        if len(reading) >= _MAX_CHARACTERS_AT_ONCE or of_owner >= _MAX_OF_OWNER:
            return PlainTextResponse(TOO_MANY_CHARACTERS, status_code=429)
        folder = Path(tempfile.mkdtemp(dir=exports.temp))
        reading[folder] = owner
        try:
            source = folder / FILE
            if request.method == "GET":
                if characters.link(cookie, folder) is None:
                    return PlainTextResponse(CHARACTER_GONE, status_code=404)
                return await exports.answer(WRITE_STAGE_BODY, lambda out: (source, out), "body.glb")
            size = 0
            with source.open("wb") as file:
                async for piece in request.stream():
                    size += len(piece)
                    if size > MAX_CHARACTER_BYTES:
                        message = CHARACTER_TOO_LARGE.format(limit=MAX_CHARACTER_BYTES / 1e6)
                        return PlainTextResponse(message, status_code=413)
                    file.write(piece)
            quota.require_space(owner, size)
            answer = await exports.answer(WRITE_STAGE_BODY, lambda out: (source, out), "body.glb")
            if answer.status_code == 200:
                characters.keep(cookie, source)
                quota.set_upload(owner, characters.folder(cookie), FILE, size)
            return answer
        except (RunError, OSError) as error:  # the quota, or the disk
            return PlainTextResponse(visitor_message(error), status_code=413)
        finally:
            reading.pop(folder, None)
            shutil.rmtree(folder, ignore_errors=True)

    return APIRoute(CHARACTER_ROUTE, character, methods=["GET", "POST", "DELETE"])


RESEARCHER_ROUTE = "/study/researcher"
RESEARCHER_FILE = "researcher_only.zip"
_BLOCK_BYTES = 1 << 16
FETCHED = (
    "There is nothing to download. The researcher's files of a study can be downloaded only once, "
    "and only in the browser that created the study."
)


def researcher_route(private: TokenStore[Path]) -> APIRoute:
    """Make the route that serves the researcher's part once, to the browser that made the study.

    It is never an output of Gradio, which serves files to all clients with the URL, and it is
    deleted before its first byte is sent.
    """

    def researcher(token: str, request: Request) -> Response:
        folder = private.take(token, cookie_of(request))
        if folder is None:
            return PlainTextResponse(FETCHED, status_code=404)
        file = (folder / RESEARCHER_FILE).open("rb")
        shutil.rmtree(folder, ignore_errors=True)
        return StreamingResponse(
            iter(lambda: file.read(_BLOCK_BYTES), b""),
            media_type="application/zip",
            headers={
                "Content-Disposition": f'attachment; filename="{RESEARCHER_FILE}"',
                "Cache-Control": "no-store",
            },
            background=BackgroundTask(file.close),
        )

    return APIRoute(RESEARCHER_ROUTE + "/{token}", researcher, methods=["POST"])


def _route(path: str, make: Callable[[], bytes], media_type: str) -> APIRoute:
    """Make the route of data that the viewer fetches once."""

    def answer() -> Response:
        headers = {"Cache-Control": "private, max-age=600"}
        return Response(make(), media_type=media_type, headers=headers)

    return APIRoute(path, answer, methods=["GET"], include_in_schema=False)


def warm_caches() -> None:
    """Make the data that the first page would wait for."""
    frame_packets.make_open_body_glb()
    viewer_constants()


@functools.cache
def viewer_constants() -> bytes:
    """Return the viewer's constants as JSON."""
    from app.run.display import FULL_SPEED_M_S
    from app.run.requests.parts import DEFAULT_TRACKED_POINT
    from conventions.views import BODY_BUILDS, CUTOFF_HZ, MAX_EXAGGERATED_RAD
    from renderer.body.look import SKIN_TONE_COLORS
    from renderer.files.glb import BUILD_OFFSET_STEP_M
    from renderer.video.render_constants import browser_render_constants

    constants = {
        **browser_render_constants(),
        "faces": list(frame_packets.face_blendshape_names()),
        "reaches": base64.b64encode(frame_packets.encode_camera_framing_poses()).decode("ascii"),
        "exaggeration": {"cutoff": CUTOFF_HZ, "max_turn": MAX_EXAGGERATED_RAD},
        "scales": {"speed": FULL_SPEED_M_S},
        "points": {name: title for title, name in tracked_point_choices()},
        "usual_point": DEFAULT_TRACKED_POINT,
        "tones": SKIN_TONE_COLORS,
        "builds": {"names": BODY_BUILDS, "step": BUILD_OFFSET_STEP_M},
    }
    return json.dumps(constants, separators=(",", ":")).encode()


VIEWER_ASSETS: Mapping[str, tuple[Callable[[], bytes], str]] = {
    "live/body.glb": (frame_packets.make_open_body_glb, "model/gltf-binary"),
    "stage/facts.json": (viewer_constants, "application/json"),
    "stage/builds.bin": (frame_packets.encode_open_body_builds, "application/octet-stream"),
}
"""Functions that make the data which every viewer fetches once, and MIME types, by route."""
