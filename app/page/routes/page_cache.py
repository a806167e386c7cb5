"""Cache of the page, its configuration and its list of functions, built by Gradio for each request.

That takes 25 to 180 ms of a processor; requests that nobody reads would keep all others waiting.
"""

from __future__ import annotations

import asyncio
import json
import secrets
from dataclasses import dataclass, field
from typing import Any, NamedTuple
from urllib.parse import parse_qs

from gradio.route_utils import get_root_url
from starlette.requests import HTTPConnection, Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.page.visitors.visitors import user_of

INFO = "/gradio_api/info"
PATHS = ("/", "/config", INFO, "/gradio_api/openapi.json")
_CHUNK_BYTES = 2**16
"""Size of the pieces of an answer, so that one that nobody reads takes no more memory."""
_ESCAPES = {ord(character): f"\\u{ord(character):04x}" for character in "<>&'"}
"""Escapes of characters that Gradio replaces in JSON within HTML."""


class _Key(NamedTuple):
    path: str
    query: bytes
    user: str | None


@dataclass(frozen=True)
class _Answer:
    headers: list[tuple[bytes, bytes]]
    parts: list[bytes]
    """Body, split where it holds the page's root URL."""


@dataclass
class PageCache:
    """ASGI app that answers requests for the page from memory, and passes on all others.

    Gradio's answers depend on the user, the root URL, and parameters of pages and deep links, which
    this page has none of.
    """

    inner: ASGIApp
    app: Any
    _config: Any = None
    _answers: dict[_Key, _Answer] = field(default_factory=dict)
    _lock: asyncio.Lock = field(default_factory=asyncio.Lock)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        path = scope["path"].rstrip("/") or "/"
        if scope["type"] != "http" or scope["method"] not in ("GET", "HEAD") or path not in PATHS:
            await self.inner(scope, receive, send)
            return
        if self._config is not self.app.get_blocks().config:
            self._config = self.app.get_blocks().config
            self._answers.clear()
        key = _Key(path, _query(scope, path), user_of(self.app, HTTPConnection(scope)))
        answer = self._answers.get(key) or await self._render(key, scope, receive)
        if answer is None:
            await self.inner(scope, receive, send)
            return
        root = json.dumps(self._root_url(scope, path))[1:-1].translate(_ESCAPES)
        await _send(answer, root.encode(), scope["method"] == "HEAD", send)

    async def _render(self, key: _Key, scope: Scope, receive: Receive) -> _Answer | None:
        """Request an answer from Gradio with a placeholder as host; None if it is none to keep."""
        async with self._lock:
            if key in self._answers:
                return self._answers[key]
            headers = [(b"host", f"{secrets.token_hex(16)}.invalid".encode())]
            headers += [header for header in scope["headers"] if header[0] == b"cookie"]
            request_scope = {**scope, "method": "GET", "extensions": {}}
            request_scope |= {"query_string": key.query, "headers": headers}
            self.app.api_info = None  # Gradio would keep the list with the first visitor's host
            messages: list[Message] = []

            async def collect(message: Message) -> None:
                messages.append(message)

            await self.inner(request_scope, receive, collect)
            start, *rest = messages
            if start["status"] != 200:
                return None
            body = b"".join(message.get("body", b"") for message in rest)
            parts = body.split(self._root_url(request_scope, key.path).encode())
            headers_sent = [header for header in start["headers"] if header[0] != b"content-length"]
            self._answers[key] = _Answer(headers_sent, parts)
            return self._answers[key]

    def _root_url(self, scope: Scope, path: str) -> str:
        return get_root_url(Request(scope), path, self.app.root_path)


def _query(scope: Scope, path: str) -> bytes:
    """Return the part of a query on which Gradio's answer depends.

    That is whether it names the page, and whether it asks for the hidden functions as well.
    """
    if path == "/":
        return b""
    named = parse_qs(scope["query_string"].decode("latin-1"), keep_blank_values=True)
    parts = [b"page="] if path in ("/config", INFO) and named.get("page") == [""] else []
    parts += [b"all_endpoints=1"] if path == INFO and named.get("all_endpoints", [""])[-1] else []
    return b"&".join(parts)


async def _send(answer: _Answer, root: bytes, is_head: bool, send: Send) -> None:
    body = root.join(answer.parts)
    headers = [*answer.headers, (b"content-length", str(len(body)).encode())]
    headers.append((b"connection", b"close"))  # else one socket may ask a hundred times at once
    await send({"type": "http.response.start", "status": 200, "headers": headers})
    for start in range(0, 0 if is_head else len(body), _CHUNK_BYTES):
        chunk = body[start : start + _CHUNK_BYTES]
        await send({"type": "http.response.body", "body": chunk, "more_body": True})
    await send({"type": "http.response.body", "body": b""})
