"""The way of a live session between browser and server: a WebSocket beside Gradio's own routes.

The first message of the browser is what it asks for, as JSON; then it sends sound. The server sends
the session's token and pace, then frames, and at the end one sentence. A page of another origin is
not let in: browsers send a WebSocket's cookies whatever page opens it.
"""

from __future__ import annotations

import asyncio
import json
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.routing import BaseRoute, Mount, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from app.config import EXAMPLES
from app.errors import RunError, visitor_sentence
from app.live.sessions import LiveSessions
from app.page.routes.guard import is_from_page
from app.page.visitors.visitors import COOKIE, address_of

SPEAK_ROUTE = "/live/speak"
EXAMPLE_ROUTE = "/live/example"
MAX_ASK_BYTES = 1000
SILENT_S = 20.0
"""Without any message for so long, the browser has gone."""
GONE = "Nothing was heard from the browser for {seconds:.0f} s; start again."
FOREIGN = 4403
"""Closes a WebSocket that another site's page has opened."""
Message = bytes | str | dict[str, Any]
_MOST_UNSENT = 600
"""Messages to a browser that takes none; about a minute."""


def live_routes(sessions: LiveSessions) -> list[BaseRoute]:
    """Serve the sessions, and sound to try it with."""

    async def speak(socket: WebSocket) -> None:
        if not is_from_page(socket.headers.get("origin"), socket.headers.get("host")):
            await socket.close(FOREIGN)
            return
        await socket.accept()
        try:
            await _serve(socket, sessions)
        except WebSocketDisconnect:
            pass

    return [
        WebSocketRoute(SPEAK_ROUTE, speak),
        Mount(EXAMPLE_ROUTE, StaticFiles(directory=EXAMPLES)),
    ]


async def _serve(socket: WebSocket, sessions: LiveSessions) -> None:
    loop = asyncio.get_running_loop()
    unsent: asyncio.Queue[Message] = asyncio.Queue(_MOST_UNSENT)

    def put(message: Message) -> None:
        if unsent.full():  # the browser takes nothing; what is old helps it least
            unsent.get_nowait()
        unsent.put_nowait(message)

    def tell(message: Any) -> None:  # from the thread that listens to the process
        if not loop.is_closed():
            loop.call_soon_threadsafe(put, message)

    number: int | None = None
    try:
        told, cookie = await _ask(socket), socket.cookies.get(COOKIE, "")
        number = await run_in_threadpool(sessions.open, told, cookie, tell, address_of(socket))
        if not await _sent(socket, await unsent.get()):  # what a browser must know before it sends
            return
        async with asyncio.TaskGroup() as ways:
            hearing = ways.create_task(_hear(socket, sessions, number))
            await _send(socket, unsent)
            hearing.cancel()
    except Exception as error:
        why = error.exceptions[0] if isinstance(error, ExceptionGroup) else error
        if not isinstance(why, WebSocketDisconnect):
            await _end(socket, visitor_sentence(why))
    finally:
        if number is not None:
            sessions.close(number)


async def _ask(socket: WebSocket) -> object:
    try:
        return _object(await asyncio.wait_for(socket.receive_text(), SILENT_S))
    except (KeyError, TimeoutError):
        return None


async def _hear(socket: WebSocket, sessions: LiveSessions, number: int) -> None:
    """Sound, until the visitor goes or stops."""
    while True:
        try:
            message = await asyncio.wait_for(socket.receive(), SILENT_S)
        except TimeoutError:
            raise RunError(GONE.format(seconds=SILENT_S)) from None
        if message["type"] == "websocket.disconnect":
            raise WebSocketDisconnect(message.get("code", 1000))
        told = _object(message.get("text") or "")
        if isinstance(told, dict) and "manner" in told:
            sessions.lead(number, told)
        else:
            sessions.put(number, message.get("bytes") or b"")


def _object(told: str) -> object:
    """JSON from a browser; None of anything else."""
    try:
        return json.loads(told) if len(told) <= MAX_ASK_BYTES else None
    except (ValueError, RecursionError):
        return None


async def _send(socket: WebSocket, unsent: asyncio.Queue[Message]) -> None:
    """Frames and what is told of them, until a sentence ends it."""
    while await _sent(socket, await unsent.get()):
        pass


async def _sent(socket: WebSocket, message: Message) -> bool:
    """Send it; whether it was not the sentence that ends it."""
    if isinstance(message, str):
        await _end(socket, message)
    elif isinstance(message, bytes):
        await socket.send_bytes(message)
    else:
        await socket.send_text(json.dumps(message))
    return not isinstance(message, str)


async def _end(socket: WebSocket, sentence: str) -> None:
    await socket.send_text(json.dumps({"end": sentence}))
    await socket.close()
