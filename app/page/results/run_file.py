"""A run as a file: its folder in a zip, which the page opens again, or a page of its own."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from fastapi import Response
from fastapi.responses import PlainTextResponse
from fastapi.routing import APIRoute
from starlette.concurrency import run_in_threadpool

from app.page.results.kept_runs import RUN_ROUTE, KeptRuns
from app.page.routes.media import MadeFiles

GONE = "There is no such run, or it is kept no longer."
_MAX_STEM = 60


def file_name(title: str, ending: str = ".zip") -> str:
    """Of a run's file, from what the run is called."""
    stem = re.sub(r"[^\w .,+-]+", "-", title).strip(" .-")[:_MAX_STEM]
    return f"{stem or 'run'}{ending}"


def saving_route(
    kept: KeptRuns, made: MadeFiles, ending: str, task: Callable[..., object], below: str = ""
) -> APIRoute:
    """Serve runs in one form, of all that there is of them when they are asked for.

    Args:
        task: writes it, asked by the run's folder and the file.
    """

    def found(token: str) -> tuple[Path, str] | None:
        run = kept.find(token)
        return run and (run.showing.folder, file_name(run.record.title, ending))

    async def answer(token: str) -> Response:
        run = await run_in_threadpool(found, token)
        if run is None:
            return PlainTextResponse(GONE, status_code=404)
        folder, name = run
        return await made.answer(task, lambda out: (folder, out), name)

    return APIRoute(
        f"{RUN_ROUTE}/{{token}}{below}", answer, methods=["GET"], include_in_schema=False
    )
