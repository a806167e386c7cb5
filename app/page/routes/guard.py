"""Access control in front of every route, and conversion of faults to sentences.

Requests for another host name are refused, since an attacker's domain name can be made to resolve
to this server; so are requests from pages of other sites.
"""

from __future__ import annotations

import contextlib
import ipaddress
import logging
import os
import re
from collections.abc import AsyncIterator, Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any, cast
from urllib.parse import urlsplit

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect, HTTPConnection
from starlette.responses import JSONResponse, PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

from app.page.routes.bodies import RequestBodyError, read_limited_body
from app.page.routes.page_cache import PageCache
from app.page.visitors.visitors import CONNECTION, user_of
from conventions.names import printable

log = logging.getLogger(__name__)
OWN_ROUTES = ("/media/", "/live/", "/stage/", "/study/", "/visitor", "/leave")
"""Routes in addition to Gradio's own, for which Gradio checks no login."""
UNUSED_ROUTES = ("/gradio_api/component_server", "/gradio_api/process_recording")
"""Routes of Gradio components that this page does not have; they accept files without limits."""
PROXY_ROUTE = "/gradio_api/proxy="
"""Route of Gradio for pages of other servers, which this page does not embed."""
_SPACES = ("https://huggingface.co", "https://*.hf.space")
"""Sites that show a hosted space in a frame."""
MAX_NAME_BYTES = 255
"""Length of the longest file name; looking for a longer one is a fault in Gradio's file routes."""
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
_HOST = re.compile(r"(?P<name>\[[^][@/?#\\]+\]|[^][:@/?#\\]*)(:[0-9]{0,5})?")
_LOCAL = ("localhost", "127.0.0.1", "::1")
_ANYWHERE = ("0.0.0.0", "::")
FOREIGN = "Request refused: it comes from another site."
UNKNOWN_HOST = (
    "This page cannot be opened under the name {name}. Its operator can allow the name with "
    "--host-name {name}."
)
LOG_IN = "Log in first."
UNUSED = "Files can be uploaded only with the forms of the page."
LONG_NAME = "The file name is too long; at most {limit} bytes are allowed."
WRONG_BODY = "Invalid request ({where}): {why}."
NO_PROXY = "This server does not load pages from other sites."


class HostNames:
    """Host names of the page."""

    def __init__(self, bound: str, more: Collection[str] = ()) -> None:
        """Collect the host names: the listening address ``bound``, local ones, and ``more``."""
        space = os.environ.get("SPACE_HOST") or "localhost"  # of a hosted Gradio space
        self._names = {name.lower() for name in (*_LOCAL, bound, *more, space)}
        self._any_address = bound in _ANYWHERE

    def __contains__(self, host: str) -> bool:
        """Check whether a Host header names this page, with any port."""
        name = _name_of(host)
        if name in self._names:
            return True
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return self._any_address  # an IP address cannot be redirected by DNS


def security_headers(frame_ancestors: Collection[str] = ()) -> list[tuple[bytes, bytes]]:
    """Return security headers for every answer.

    They forbid content sniffing, and frames on any sites but these, where clicks can be hijacked.
    """
    hosts = _SPACES if os.environ.get("SPACE_HOST") else ()
    policy = " ".join(("frame-ancestors 'self'", *hosts, *frame_ancestors))
    headers = [(b"content-security-policy", policy.encode("ascii"))]
    headers.append((b"x-content-type-options", b"nosniff"))
    if not hosts and not frame_ancestors:  # the header cannot list sites
        headers.append((b"x-frame-options", b"SAMEORIGIN"))
    return headers


def _name_of(host: str) -> str:
    """Return the name in a Host header; empty if it holds more than a name and a port."""
    match = _HOST.fullmatch(host)
    return match["name"].strip("[]").lower() if match else ""


def guard_lifespan(
    names: HostNames, frame_ancestors: Collection[str] = (), *, has_proxy: bool = False
) -> Callable[[FastAPI], contextlib.AbstractAsyncContextManager[None]]:
    """Return a lifespan that puts the guard in front of an app, including its CORS headers.

    X-Forwarded-Host is trusted with a proxy if it is one of the page's names.
    """
    trusts_forwarded_headers = has_proxy or bool(os.environ.get("SPACE_HOST"))

    @contextlib.asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        inner = app.middleware_stack or app.build_middleware_stack()
        app.middleware_stack = Guard(
            PageCache(inner, app),
            app,
            names,
            security_headers(frame_ancestors),
            trusts_forwarded_headers,
        )
        yield

    return lifespan


@dataclass(frozen=True)
class Guard:
    """ASGI middleware that refuses requests which must not reach the app."""

    inner: ASGIApp
    app: Any
    names: HostNames
    security_headers: Sequence[tuple[bytes, bytes]]
    trusts_forwarded_headers: bool

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.inner(scope, receive, send)
            return
        _take_off_root_path(scope)

        async def framed(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *self.security_headers]
            await send(message)

        refusal = self._refusal(scope)
        if refusal is not None:
            await _refuse(*refusal, scope, receive, framed)
            return
        self._forget_forwarded(scope)
        if scope["type"] == "http" and scope["method"] not in SAFE_METHODS:
            try:
                receive = await read_limited_body(scope, receive)
            except RequestBodyError as error:
                await _refuse_call(error, scope, receive, framed)
                return
        CONNECTION.set(HTTPConnection(scope))
        with contextlib.suppress(ClientDisconnect):  # an interrupted upload
            await self.inner(scope, receive, framed)

    def _refusal(self, scope: Scope) -> tuple[str, int] | None:
        """Return a sentence and a status for a wrong host, origin or route, or a missing login."""
        headers, path = Headers(scope=scope), scope["path"]
        host = headers.get("host", "")
        if host not in self.names:
            name = printable(_name_of(host) or host)[:100] or "(empty)"
            return UNKNOWN_HOST.format(name=name), 421
        origin = headers.get("origin")
        is_foreign = origin is not None and not is_same_origin(origin, host)
        changes = scope.get("method", "GET") not in SAFE_METHODS
        if is_foreign or (changes and headers.get("sec-fetch-site") == "cross-site"):
            return FOREIGN, 403
        if path.rstrip("/").endswith(UNUSED_ROUTES):
            return UNUSED, 404
        if PROXY_ROUTE in path:
            return NO_PROXY, 404
        if any(len(part.encode()) > MAX_NAME_BYTES for part in path.split("/")):
            return LONG_NAME.format(limit=MAX_NAME_BYTES), 404
        if self.app.auth is not None and path.startswith(OWN_ROUTES):
            if user_of(self.app, HTTPConnection(scope)) is None:
                return LOG_IN, 401
        return None

    def _forget_forwarded(self, scope: Scope) -> None:
        """Remove untrusted forwarding headers, from which Gradio makes links."""
        is_https = scope["scheme"] in ("https", "wss")  # as reported by a trusted proxy

        def is_good(name: bytes, value: bytes) -> bool:
            if name == b"x-forwarded-host":
                host = value.decode("latin-1").split(",")[0].strip()
                return self.trusts_forwarded_headers and host in self.names
            if name == b"x-forwarded-proto":
                return self.trusts_forwarded_headers or is_https
            return name != b"x-gradio-server"

        scope["headers"] = [(key, value) for key, value in scope["headers"] if is_good(key, value)]


def _take_off_root_path(scope: Scope) -> None:
    """Remove --root-path if a proxy has not; a mounted folder is not matched with it."""
    root, path = urlsplit(scope.get("root_path", "")).path, scope["path"]
    if root and f"{path}/".startswith(f"{root}/"):
        scope["path"] = path[len(root) :] or "/"
    scope["root_path"] = ""


def is_same_origin(origin: str | None, host: str | None) -> bool:
    """Check whether an Origin header names this server."""
    scheme, _, netloc = (origin or "").lower().partition("://")
    return scheme in ("http", "https") and bool(host) and netloc == (host or "").lower()


async def _refuse(sentence: str, status: int, scope: Scope, receive: Receive, send: Send) -> None:
    if scope["type"] == "websocket":
        await WebSocketClose(code=4000 + status)(scope, receive, send)
        return
    answer = PlainTextResponse(sentence, status_code=status, headers={"Connection": "close"})
    await answer(scope, receive, send)


async def _refuse_call(error: RequestBodyError, scope: Scope, receive: Receive, send: Send) -> None:
    """Answer in the format of Gradio's routes; its page and client then show the sentence."""
    body = {"detail": error.sentence, "error": error.sentence}
    answer = JSONResponse(body, status_code=error.status, headers={"Connection": "close"})
    await answer(scope, receive, send)


async def refuse_wrong_body(request: Request, error: Exception) -> JSONResponse:
    """Answer to a body of the wrong form with a sentence.

    FastAPI would send the body back, and fail if that holds NaN or half a character.
    """
    first = cast(RequestValidationError, error).errors()[0]
    where = ".".join(map(str, first["loc"]))[:80]
    message = printable(WRONG_BODY.format(where=where, why=first["msg"]))[:300]
    return JSONResponse({"detail": message, "error": message}, status_code=422)


_NO_TEXT = "Invalid UTF-8 sequence received from client."


def silence_invalid_websocket_text() -> None:
    """Prevent a traceback in the log for a WebSocket that sends invalid text."""
    logger = logging.getLogger("uvicorn.error")
    if _is_no_fault not in logger.filters:
        logger.addFilter(_is_no_fault)


def _is_no_fault(record: logging.LogRecord) -> bool:
    return record.msg != _NO_TEXT
