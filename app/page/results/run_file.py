"""A run as a file: its folder in a zip, which the page opens again, or a page of its own."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from pathlib import Path

from fastapi import Response
from fastapi.responses import FileResponse, PlainTextResponse
from fastapi.routing import APIRoute
from starlette.concurrency import run_in_threadpool

from app.page.results.kept_runs import RUN_ROUTE, KeptRun, KeptRuns

ENDING, PAGE_ENDING = ".zip", ".html"
GONE = "There is no such run, or it is kept no longer."
_MAX_STEM = 60


def file_name(title: str, ending: str = ENDING) -> str:
    """Of a run's file, from what the run is called."""
    stem = re.sub(r"[^\w .,+-]+", "-", title).strip(" .-")[:_MAX_STEM]
    return f"{stem or 'run'}{ending}"


def run_file_routes(kept: KeptRuns) -> list[APIRoute]:
    """Serve runs as files that the page opens again."""

    def bundle(run: KeptRun) -> Path:
        return run.bundle

    return [saving_route(kept, RUN_ROUTE + "/{token}", ENDING, "application/zip", bundle)]


def saving_route(
    kept: KeptRuns, path: str, ending: str, media_type: str, save: Callable[[KeptRun], Path]
) -> APIRoute:
    """Serve runs in one form, each as ``save`` leaves it; always as a file to be saved, so that
    nothing of it is opened as a page of this server."""
    lock = threading.Lock()

    def saved(token: str) -> tuple[Path, str] | None:
        run = kept.find(token)
        if run is None:
            return None
        with lock:
            return save(run), file_name(run.record.title, ending)

    async def answer(token: str) -> Response:
        found = await run_in_threadpool(saved, token)
        if found is None:
            return PlainTextResponse(GONE, status_code=404)
        headers = {"Cache-Control": "no-store", "X-Content-Type-Options": "nosniff"}
        return FileResponse(found[0], filename=found[1], media_type=media_type, headers=headers)

    return APIRoute(path, answer, methods=["GET"], include_in_schema=False)
