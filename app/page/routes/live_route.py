"""WebSocket route of live sessions, in addition to Gradio's own routes.

The first message of the browser is its request as JSON; then it sends sound. The server sends the
session's token and window timing, then frames, and at the end one sentence. A page of another
origin is refused, as browsers send cookies with a WebSocket whatever page opens it.
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
from app.errors import RunError, visitor_message
from app.live.sessions import LiveSessions
from app.page.routes.guard import is_same_origin
from app.page.visitors.visitors import COOKIE, client_network_of

SPEAK_ROUTE = "/live/speak"
EXAMPLE_ROUTE = "/live/example"
MAX_ASK_BYTES = 1000
SILENT_S = 20.0
"""Time (s) without any message after which the browser counts as disconnected."""
GONE = "The server received no audio for {seconds:.0f} s and ended the session. Start again."
FOREIGN = 4403
"""Close code for a WebSocket that another site's page has opened."""
Message = bytes | str | dict[str, Any]
_MOST_UNSENT = 600
"""Maximum number of messages that wait for a browser, about a minute."""


def live_routes(sessions: LiveSessions) -> list[BaseRoute]:
    """Return the routes of live sessions and of example speech."""

    async def speak(socket: WebSocket) -> None:
        if not is_same_origin(socket.headers.get("origin"), socket.headers.get("host")):
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
        if unsent.full():  # the browser is too slow: drop the oldest message
            unsent.get_nowait()
        unsent.put_nowait(message)

    def tell(message: Any) -> None:  # called by the thread that reads from the process
        if not loop.is_closed():
            loop.call_soon_threadsafe(put, message)

    number: int | None = None
    try:
        first_message, cookie = await _ask(socket), socket.cookies.get(COOKIE, "")
        number = await run_in_threadpool(
            sessions.open, first_message, cookie, tell, client_network_of(socket)
        )
        if not await _sent(socket, await unsent.get()):  # token and timing come first
            return
        async with asyncio.TaskGroup() as ways:
            hearing = ways.create_task(_hear(socket, sessions, number))
            while await _sent(socket, await unsent.get()):
                pass
            hearing.cancel()
    except Exception as error:
        why = error.exceptions[0] if isinstance(error, ExceptionGroup) else error
        if not isinstance(why, WebSocketDisconnect):
            await _end(socket, visitor_message(why))
    finally:
        if number is not None:
            sessions.close(number)


async def _ask(socket: WebSocket) -> object:
    try:
        return _object(await asyncio.wait_for(socket.receive_text(), SILENT_S))
    except (KeyError, TimeoutError):
        return None


async def _hear(socket: WebSocket, sessions: LiveSessions, number: int) -> None:
    """Pass sound and style changes to the session until the visitor stops."""
    while True:
        try:
            message = await asyncio.wait_for(socket.receive(), SILENT_S)
        except TimeoutError:
            raise RunError(GONE.format(seconds=SILENT_S)) from None
        if message["type"] == "websocket.disconnect":
            raise WebSocketDisconnect(message.get("code", 1000))
        style = _object(message.get("text") or "")
        if isinstance(style, dict) and "manner" in style:
            sessions.set_style(number, style)
        else:
            sessions.add_audio(number, message.get("bytes") or b"")


def _object(json_text: str) -> object:
    """Parse JSON from a browser; None for anything else."""
    try:
        return json.loads(json_text) if len(json_text) <= MAX_ASK_BYTES else None
    except (ValueError, RecursionError):
        return None


async def _sent(socket: WebSocket, message: Message) -> bool:
    """Send a message; return False if it was the closing message, after which nothing is sent."""
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
