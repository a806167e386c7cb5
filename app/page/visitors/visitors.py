"""Who is asking: one open page by Gradio's name for it, one browser by a cookie of ours."""

from __future__ import annotations

import ipaddress
import secrets
import threading
from pathlib import Path
from typing import Generic, TypeVar

import fastapi
import gradio as gr
from fastapi.routing import APIRoute
from starlette.requests import HTTPConnection

COOKIE = "visitor"
VISITOR_ROUTE = "/visitor"
_COOKIE_BYTES = 32


def visitor_of(request: gr.Request) -> str:
    """Gradio's name for one open page; a caller without one is a visitor of its own."""
    return request.session_hash or secrets.token_hex(8)


def address_of(request: gr.Request | HTTPConnection) -> str:
    """The machine that asks, as far as this server can see it. Of an IPv6 address it is the network
    of 64 bits: whoever has one address of that has all of them."""
    client = getattr(request, "client", None)  # of a caller within the program there is none
    host = client.host if client else ""
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return host
    if not isinstance(address, ipaddress.IPv6Address):
        return host
    if address.ipv4_mapped is not None:
        return str(address.ipv4_mapped)
    return str(ipaddress.ip_network((address.packed, 64), strict=False))


def cookie_of(request: gr.Request | fastapi.Request) -> str:
    """What tells one browser from all others; empty for one that keeps no cookie."""
    return request.cookies.get(COOKIE, "")


def is_same(first: str, second: str) -> bool:
    """Whether two cookies are equal, in a time that does not tell how much of them is; one that is
    empty is nobody's."""
    return bool(first) and secrets.compare_digest(first.encode(), second.encode())


def visitor_route() -> APIRoute:
    """Serve the cookie to a browser that has none yet."""

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


Thing = TypeVar("Thing")
_TOKEN_BYTES = 32


class Kept(Generic[Thing]):
    """Which thing lies behind which token. Safe to use from several threads."""

    def __init__(self) -> None:
        self._kept: dict[str, tuple[Path, str | None, Thing]] = {}
        self._lock = threading.Lock()

    def keep(self, thing: Thing, files: Path, cookie: str | None) -> str:
        """Let a browser have it for as long as its files are there; returns the token, of 256
        random bits, each time the same. No cookie asks for none, an empty one lets nobody have it.
        """
        entry = files, cookie, thing
        with self._lock:
            self._kept = {each: kept for each, kept in self._kept.items() if kept[0].exists()}
            new = secrets.token_urlsafe(_TOKEN_BYTES)
            token = next((each for each, kept in self._kept.items() if kept == entry), new)
            self._kept[token] = entry
        return token

    def find(self, token: str, cookie: str = "") -> Thing | None:
        """None when there is none for this browser, or no longer."""
        with self._lock:
            files, owner, thing = self._kept.get(token, (Path(), "", None))
        if not files.exists() or not (owner is None or is_same(owner, cookie)):
            return None
        return thing

    def take(self, token: str, cookie: str) -> Thing | None:
        """What nobody can have again; a token tried in vain stays good for its owner."""
        found = self.find(token, cookie)
        with self._lock:
            return found if self._kept.pop(token if found else "", None) else None

    def all(self) -> list[Thing]:
        """Whoever may have it."""
        with self._lock:
            kept = list(self._kept.values())
        return [thing for files, _, thing in kept if files.exists()]
