"""What the page's stage asks for once: the numbers by which it draws as the videos do."""

from __future__ import annotations

import base64
import functools
import json

from fastapi import Response
from fastapi.routing import APIRoute
from starlette.concurrency import run_in_threadpool

from app.live.live_body import body_glb, builds, face_names, reaches_message
from app.page.parts.catalogue import point_choices

FACTS_ROUTE = "/stage/facts.json"
BUILDS_ROUTE = "/stage/builds.bin"


def stage_routes() -> list[APIRoute]:
    """Serve the facts and the builds; the body comes from where live speech has it."""

    async def facts() -> Response:
        content = await run_in_threadpool(stage_facts)
        headers = {"Cache-Control": "private, max-age=600", "X-Content-Type-Options": "nosniff"}
        return Response(content, media_type="application/json", headers=headers)

    async def other_builds() -> Response:
        content = await run_in_threadpool(builds)
        headers = {"Cache-Control": "private, max-age=3600", "X-Content-Type-Options": "nosniff"}
        return Response(content, media_type="application/octet-stream", headers=headers)

    return [
        APIRoute(FACTS_ROUTE, facts, methods=["GET"], include_in_schema=False),
        APIRoute(BUILDS_ROUTE, other_builds, methods=["GET"], include_in_schema=False),
    ]


def prepare() -> None:
    """Make what the first page would wait for."""
    body_glb()
    stage_facts()


@functools.cache
def stage_facts() -> bytes:
    """The numbers as JSON, as `Facts` of app/page/web/told.d.ts declares them."""
    from app.run.display import FULL_SPEED_M_S
    from app.run.followed_point import TIP
    from conventions.views import BUILDS, CUTOFF_HZ, MAX_TURN_RAD
    from renderer.body.look import COLORS
    from renderer.files.glb import STEP_M
    from renderer.video.facts import drawing_facts

    told = {
        **drawing_facts(),
        "faces": list(face_names()),
        "reaches": base64.b64encode(reaches_message()).decode("ascii"),
        "exaggeration": {"cutoff": CUTOFF_HZ, "max_turn": MAX_TURN_RAD},
        "scales": {"speed": FULL_SPEED_M_S},
        "points": {name: title for title, name in point_choices()},
        "usual_point": TIP,
        "tones": COLORS,
        "builds": {"names": BUILDS, "step": STEP_M},
    }
    return json.dumps(told, separators=(",", ":")).encode()
