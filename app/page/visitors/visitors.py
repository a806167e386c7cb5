"""Identity of visitors by session and cookie, and objects behind random tokens."""

from __future__ import annotations

import functools
import ipaddress
import secrets
import threading
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import fastapi
import gradio as gr
from fastapi.routing import APIRoute
from starlette.requests import HTTPConnection

if TYPE_CHECKING:
    from app.page.visitors.job_folders import Jobs

COOKIE = "visitor"
LEAVING_ROUTE = "/leave"
RUNS, CHECKS = "run", "check"
"""Gradio's `concurrency_id` of runs and of checks of uploads."""
CONNECTION: ContextVar[HTTPConnection] = ContextVar("connection")
"""The request that is being answered; Gradio passes only its headers to the parser of uploads."""
VISITOR_ROUTE = "/visitor"
_COOKIE_BYTES = 32


def page_session_of(request: gr.Request) -> str:
    """Return Gradio's session hash of an open page; a random name for a caller without one."""
    return request.session_hash or secrets.token_hex(8)


def client_network_of(request: gr.Request | HTTPConnection) -> str:
    """Return the client's address or IPv6 network (`network_of`); empty for internal callers."""
    client = getattr(request, "client", None)
    return network_of(client.host if client else "")


@functools.lru_cache(10_000)
def network_of(host: str) -> str:
    """Return an address, or the network of 64 bits of an IPv6 address.

    Whoever has one address of such a network has all of them.
    """
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return host
    if not isinstance(address, ipaddress.IPv6Address):
        return host
    if address.ipv4_mapped is not None:
        return str(address.ipv4_mapped)
    return str(ipaddress.ip_network((address.packed, 64), strict=False))


def cookie_of(request: gr.Request | HTTPConnection) -> str:
    """Return the cookie that identifies a browser; empty without one."""
    return request.cookies.get(COOKIE, "")


def user_of(app: Any, request: HTTPConnection) -> str | None:
    """Return the name with which a browser has logged in to a Gradio app."""
    names = (f"access-token-{app.cookie_id}", f"access-token-unsecure-{app.cookie_id}")
    users = (app.tokens.get(request.cookies.get(name)) for name in names)
    return next((user for user in users if user is not None), None)


def is_same_cookie(first: str, second: str) -> bool:
    """Check in constant time whether two cookies are equal; an empty one equals none."""
    return bool(first) and secrets.compare_digest(first.encode(), second.encode())


def visitor_route() -> APIRoute:
    """Make the route that gives a browser its cookie."""

    def visitor(request: fastapi.Request) -> fastapi.Response:
        response = fastapi.Response(status_code=204, headers={"Cache-Control": "no-store"})
        if not cookie_of(request):
            response.set_cookie(
                COOKIE,
                secrets.token_urlsafe(_COOKIE_BYTES),
                httponly=True,
                samesite="strict",
                secure=request.url.scheme == "https",
            )
        return response

    return APIRoute(VISITOR_ROUTE, visitor, methods=["POST"], include_in_schema=False)


def leaving_route(jobs: Jobs) -> APIRoute:
    """Make the route for the notification that a page was closed, which ends its runs."""

    async def leave(request: fastapi.Request) -> fastapi.Response:
        jobs.cancel_all_of_closed_page((await request.body()).decode("latin-1"), cookie_of(request))
        return fastapi.Response(status_code=204)

    return APIRoute(LEAVING_ROUTE, leave, methods=["POST"], include_in_schema=False)


Thing = TypeVar("Thing")
_TOKEN_BYTES = 32


class TokenStore(Generic[Thing]):
    """Thread-safe store of objects behind random tokens."""

    def __init__(self) -> None:
        self._entries: dict[str, tuple[Path, str | None, Thing]] = {}
        self._lock = threading.Lock()

    def keep(self, thing: Thing, lifetime_path: Path, owner_cookie: str | None) -> str:
        """Store an object while a path exists, and return its token of 256 random bits.

        The same object gets the same token. A cookie of None allows any browser, an empty one none.
        """
        entry = lifetime_path, owner_cookie, thing
        with self._lock:
            self._entries = {
                each: other for each, other in self._entries.items() if other[0].exists()
            }
            new = secrets.token_urlsafe(_TOKEN_BYTES)
            token = next((each for each, other in self._entries.items() if other == entry), new)
            self._entries[token] = entry
        return token

    def find(self, token: str, cookie: str = "") -> Thing | None:
        """Return the object of a token; None without access, or when its files are gone."""
        with self._lock:
            files, owner, thing = self._entries.get(token, (Path(), "", None))
        if not files.exists() or not (owner is None or is_same_cookie(owner, cookie)):
            return None
        return thing

    def take(self, token: str, cookie: str) -> Thing | None:
        """Remove and return the object of a token; with a wrong cookie, the token stays valid."""
        item = self.find(token, cookie)
        with self._lock:
            return item if self._entries.pop(token if item else "", None) else None

    def all(self) -> list[Thing]:
        """Return the stored objects of all browsers."""
        with self._lock:
            entries = list(self._entries.values())
        return [thing for files, _, thing in entries if files.exists()]
