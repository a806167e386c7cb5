"""What stands before every route: who may ask, and from which page; faults become sentences.

Requests for another host name are refused, since a name that an attacker owns can be made to point
here; so are requests that another site's page makes, whatever they ask for.
"""

from __future__ import annotations

import contextlib
import ipaddress
import logging
import os
import traceback
from collections.abc import AsyncIterator, Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import gradio as gr
from fastapi import FastAPI, HTTPException
from gradio import route_utils
from pydantic import ValidationError
from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect, HTTPConnection
from starlette.responses import JSONResponse, PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

from app.errors import visitor_sentence, without_folders
from app.page.routes.bodies import BodyError, read_body
from conventions.names import printable
from model.storage.checked import why

log = logging.getLogger(__name__)
OWN_ROUTES = ("/media/", "/live/", "/study/", "/visitor", "/leave")
"""Gradio asks for a login before its own routes; these stand beside them."""
UNUSED_ROUTES = ("/gradio_api/component_server", "/gradio_api/process_recording")
"""Gradio has them for parts that this page has not; they take files that nobody counts."""
PROXY_ROUTE = "/gradio_api/proxy="
"""Of Gradio, for pages of others within this one, which has none."""
_SPACES = ("https://huggingface.co", "https://*.hf.space")
"""Where a hosted space is shown in a frame."""
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
_LOCAL = ("localhost", "127.0.0.1", "::1")
_ANYWHERE = ("0.0.0.0", "::")
FOREIGN = "This request comes from the page of another site, which may not use this one."
UNKNOWN_HOST = (
    "This page does not answer to the name {name}; who runs it can allow it: --host-name {name}."
)
LOG_IN = "Log in first."
UNUSED = "This page takes nothing there; upload files by the fields of its forms."
NO_PROXY = "This page fetches no pages of others; ask for them at their own address."


class HostNames:
    """The names under which the page answers."""

    def __init__(self, bound: str, more: Collection[str] = ()) -> None:
        """
        Args:
            bound: address that the server listens on.
            more: other names, as people type them.
        """
        self._names = {name.lower() for name in (*_LOCAL, bound, *more, _space())}
        self._any_address = bound in _ANYWHERE

    def __contains__(self, host: str) -> bool:
        """Whether a Host header names this page; a port is not looked at."""
        name = _name_of(host)
        if name in self._names:
            return True
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return self._any_address  # nobody can make an address point elsewhere


def _space() -> str:
    """The name of a hosted Gradio space."""
    return os.environ.get("SPACE_HOST") or "localhost"


def framing(embedders: Collection[str] = ()) -> list[tuple[bytes, bytes]]:
    """Headers of every answer: nothing is taken for another type than it says, and none but these
    sites may show the page in a frame, where clicks can be led astray."""
    hosts = _SPACES if os.environ.get("SPACE_HOST") else ()
    policy = " ".join(("frame-ancestors 'self'", *hosts, *embedders))
    headers = [(b"content-security-policy", policy.encode("ascii"))]
    headers.append((b"x-content-type-options", b"nosniff"))
    if not hosts and not embedders:  # it can name no others
        headers.append((b"x-frame-options", b"SAMEORIGIN"))
    return headers


def _name_of(host: str) -> str:
    try:
        return (urlsplit(f"//{host}").hostname or "").lower()
    except ValueError:
        return ""


def guarded(
    names: HostNames, embedders: Collection[str] = (), *, has_proxy: bool = False
) -> Callable[[FastAPI], contextlib.AbstractAsyncContextManager[None]]:
    """A lifespan that puts the guard before all of an app, its CORS headers among it. A proxy that
    was named is believed under which of the page's names it was asked."""
    is_believed = has_proxy or bool(os.environ.get("SPACE_HOST"))

    @contextlib.asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        inner = app.middleware_stack or app.build_middleware_stack()
        app.middleware_stack = Guard(inner, app, names, framing(embedders), is_believed)
        yield

    return lifespan


@dataclass(frozen=True)
class Guard:
    """Refuses what must not come in; everything else goes on to the app."""

    inner: ASGIApp
    app: Any
    names: HostNames
    framing: Sequence[tuple[bytes, bytes]]
    is_believed: bool

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.inner(scope, receive, send)
            return
        _take_off_root_path(scope)

        async def framed(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *self.framing]
            await send(message)

        refusal = self._refusal(scope)
        if refusal is not None:
            await _refuse(*refusal, scope, receive, framed)
            return
        self._forget_forwarded(scope)
        if scope["type"] == "http" and scope["method"] not in SAFE_METHODS:
            try:
                receive = await read_body(scope, receive)
            except BodyError as error:
                await _refuse_call(error, scope, receive, framed)
                return
        with contextlib.suppress(ClientDisconnect):  # an upload that is broken off
            await self.inner(scope, receive, framed)

    def _refusal(self, scope: Scope) -> tuple[str, int] | None:
        """A sentence and its status, of a foreign host or page, or of a visitor who must log in."""
        headers, path = Headers(scope=scope), scope["path"]
        host = headers.get("host", "")
        if host not in self.names:
            name = printable(_name_of(host))[:100] or "without a name"
            return UNKNOWN_HOST.format(name=name), 421
        origin = headers.get("origin")
        is_foreign = origin is not None and not is_from_page(origin, host)
        changes = scope.get("method", "GET") not in SAFE_METHODS
        if is_foreign or (changes and headers.get("sec-fetch-site") == "cross-site"):
            return FOREIGN, 403
        if path.rstrip("/").endswith(UNUSED_ROUTES):
            return UNUSED, 404
        if PROXY_ROUTE in path:
            return NO_PROXY, 404
        if self.app.auth is not None and path.startswith(OWN_ROUTES):
            if not self._is_logged_in(HTTPConnection(scope)):
                return LOG_IN, 401
        return None

    def _forget_forwarded(self, scope: Scope) -> None:
        """Take out what anyone may claim of the page's address: Gradio makes links of it."""
        is_https = scope["scheme"] in ("https", "wss")  # as a proxy has said that is trusted

        def is_good(name: bytes, value: bytes) -> bool:
            if name == b"x-forwarded-host":
                host = value.decode("latin-1").split(",")[0].strip()
                return self.is_believed and host in self.names
            if name == b"x-forwarded-proto":
                return self.is_believed or is_https
            return name != b"x-gradio-server"

        scope["headers"] = [
            (name, value) for name, value in scope["headers"] if is_good(name, value)
        ]

    def _is_logged_in(self, asked: HTTPConnection) -> bool:
        names = (f"access-token-{self.app.cookie_id}",)
        names += (f"access-token-unsecure-{self.app.cookie_id}",)
        return any(self.app.tokens.get(asked.cookies.get(name)) is not None for name in names)


def _take_off_root_path(scope: Scope) -> None:
    """Let routes find a path below --root-path whether a proxy has removed it or not. A mounted
    folder is found only where neither path nor ``root_path`` has it."""
    root, path = urlsplit(scope.get("root_path", "")).path, scope["path"]
    if root and f"{path}/".startswith(f"{root}/"):
        scope["path"] = path[len(root) :] or "/"
    scope["root_path"] = ""


def is_from_page(origin: str | None, host: str | None) -> bool:
    """Whether a browser says that a page of this very server asks."""
    try:
        netloc = urlsplit(origin or "").netloc
    except ValueError:
        return False
    return bool(origin and host) and netloc.lower() == (host or "").lower()


async def _refuse(sentence: str, status: int, scope: Scope, receive: Receive, send: Send) -> None:
    if scope["type"] == "websocket":
        await WebSocketClose(code=4000 + status)(scope, receive, send)
        return
    answer = PlainTextResponse(sentence, status_code=status, headers={"Connection": "close"})
    await answer(scope, receive, send)


async def _refuse_call(error: BodyError, scope: Scope, receive: Receive, send: Send) -> None:
    """Answer as Gradio's own routes do, so that its page and its client show the sentence."""
    told = {"detail": error.sentence, "error": error.sentence}
    answer = JSONResponse(told, status_code=error.status, headers={"Connection": "close"})
    await answer(scope, receive, send)


UNKNOWN_FUNCTION = "This page has no such function; load it again, or ask /gradio_api/info for all."
WRONG_CALL = "This function cannot be called so: {why}"
_MAX_WHY, _MAX_READ = 300, 3000
"""Characters of a reason that are told, and that are looked at."""
_NO_TEXT = "Invalid UTF-8 sequence received from client."
_find, _call = route_utils.get_fn, route_utils.call_process_api
_OWN_FUNCTIONS = str(Path(__file__).parents[1])


def tell_wrong_calls() -> None:
    """Let Gradio answer to a number or name of no function with status 404, and to a call that a
    function cannot have with a sentence, and a line in the log."""

    def get_fn(*arguments: Any, **named: Any) -> Any:
        try:
            return _find(*arguments, **named)
        except (KeyError, route_utils.FnIndexInferError):
            raise HTTPException(404, UNKNOWN_FUNCTION) from None

    async def call_process_api(*arguments: Any, **named: Any) -> Any:
        try:
            return await _call(*arguments, **named)
        except HTTPException:
            raise
        except gr.Error as error:
            if not error.print_exception:  # a function has told it already
                raise
            raise _wrong_call(str(error.message)) from None
        except Exception as error:
            _, *frames = traceback.extract_tb(error.__traceback__)
            if any(frame.filename.startswith(_OWN_FUNCTIONS) for frame in frames):
                raise gr.Error(visitor_sentence(error), print_exception=False) from None
            told = why(error) if isinstance(error, ValidationError) else str(error)[:_MAX_READ]
            raise _wrong_call(f"{type(error).__name__}: {told}") from None

    route_utils.get_fn, route_utils.call_process_api = get_fn, call_process_api


def _wrong_call(reason: str) -> gr.Error:
    told = printable(without_folders(reason[:_MAX_READ]))[:_MAX_WHY]
    log.warning("a wrong call: %s", told)
    return gr.Error(WRONG_CALL.format(why=told), print_exception=False)


def quieten_sockets() -> None:
    """Let the server close a socket that sends no text where text is due without a traceback."""
    logger = logging.getLogger("uvicorn.error")
    if _is_no_fault not in logger.filters:
        logger.addFilter(_is_no_fault)


def _is_no_fault(record: logging.LogRecord) -> bool:
    return record.msg != _NO_TEXT
