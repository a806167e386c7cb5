"""Who is asking: one open page by Gradio's name for it, one browser by a cookie of ours."""

from __future__ import annotations

import ipaddress
import secrets

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
