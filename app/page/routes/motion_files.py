"""A motion as other programs read it, made when somebody asks for it: GLB, BVH, Blender; and a
plan as annotators read it: TextGrid, ELAN.

They are made of a file that the page has given an address, motion always with the open body: the
mesh of a licensed one is not handed to visitors.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from pathlib import Path

import anyio
import anyio.to_thread
from fastapi import Request, Response
from fastapi.responses import FileResponse, PlainTextResponse
from fastapi.routing import APIRoute
from starlette.background import BackgroundTask

from app.errors import visitor_sentence
from app.page.routes.media import GONE, MEDIA_ROUTE, MediaAddresses
from app.page.visitors.visitors import cookie_of
from app.run.videos.export import MARKERS_ENDING, RenderRequest, render_motion

ENDINGS = {"glb": ".glb", "bvh": ".bvh", "blender": ".blender.npz"}
"""By what stands behind the address of a motion; app/page/web/stage/files.js has them too."""

PLAN_ENDINGS = {
    "json": ".json", "textgrid": ".TextGrid", "elan": ".eaf", "markers": MARKERS_ENDING,
}  # fmt: skip
"""The same of a plan."""
PLAN_SUFFIX = ".tiers.json"
"""Of plans as the page shows them."""


def motion_file_routes(addresses: MediaAddresses, temp: Path) -> list[APIRoute]:
    """Serve them, one at a time, as each takes memory.

    Args:
        temp: folder where a file lies until it is sent.
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
            await anyio.to_thread.run_sync(
                _write_plan if is_plan else _write_motion, file, out, limiter=turns[0]
            )
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


def _write_motion(motion: Path, out: Path) -> None:
    render_motion(RenderRequest(motion, out))


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
