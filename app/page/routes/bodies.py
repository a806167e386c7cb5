"""Limits on request bodies, for every route but that of uploads, which has its own.

They are checked before any route parses a body: Gradio writes one error for each wrong item of a
list, makes a file for each file that a call names, and downloads a URL in place of a file, of any
size and past all limits of uploads.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

from starlette.datastructures import Headers
from starlette.types import Message, Receive, Scope

UPLOAD_ROUTE = "/gradio_api/upload"
CHARACTER_ROUTE = "/stage/character"
"""Route that takes a visitor's character and checks its size itself."""
MAX_BODY_BYTES = 10**6
MAX_ITEMS = 250
"""Maximum number of items in any list, and of files in a call."""
MAX_VALUES = 10_000
"""Maximum number of values in a call, nested ones included."""
_MAX_DEPTH = 32
_MAX_UNREAD_BYTES = 10**8
"""Bytes read of a body that is too large; a client that still sends would miss the answer."""
TOO_LARGE = "This request is larger than the limit of {limit:,} bytes. Upload files separately."
TOO_MANY_ITEMS = "A list in this request has {count} items; the limit is {limit}."
TOO_MANY_FILES = "This request refers to more than {limit} files; the limit is {limit}."
TOO_MANY_VALUES = "This request exceeds the limit of {limit:,} values."
TOO_DEEP = f"Lists in this request are nested too deeply; the limit is {_MAX_DEPTH} levels."
NOT_UPLOADED = "This request gives a file as a URL or a stream; upload the file instead."


@dataclass
class RequestBodyError(Exception):
    """Refusal of a request body, with the sentence and status of the answer."""

    sentence: str
    status: int = 413


async def read_limited_body(scope: Scope, receive: Receive) -> Receive:
    """Read a body within the limits; return a ``receive`` of it; raises RequestBodyError."""
    if scope["path"].rstrip("/").endswith((UPLOAD_ROUTE, CHARACTER_ROUTE)):
        return receive
    body, num_bytes, has_ended = bytearray(), 0, False
    stated = Headers(scope=scope).get("content-length", "0")
    if stated.isdecimal() and int(stated) > _MAX_UNREAD_BYTES:
        raise RequestBodyError(TOO_LARGE.format(limit=MAX_BODY_BYTES))
    while not has_ended:
        message = await receive()
        if message["type"] == "http.disconnect":
            return _replay(message, receive)
        part = message.get("body", b"")
        num_bytes += len(part)
        if num_bytes <= MAX_BODY_BYTES:
            body += part
        has_ended = not message.get("more_body", False) or num_bytes > _MAX_UNREAD_BYTES
    if num_bytes > MAX_BODY_BYTES:
        raise RequestBodyError(TOO_LARGE.format(limit=MAX_BODY_BYTES))
    check_json_body(bytes(body))
    return _replay({"type": "http.request", "body": bytes(body), "more_body": False}, receive)


def _replay(first: Message, receive: Receive) -> Receive:
    """Return a ``receive`` that yields one message before all later ones."""
    waiting = [first]

    async def replay() -> Message:
        return waiting.pop() if waiting else await receive()

    return replay


def check_json_body(body: bytes) -> None:
    """Check values, lists and files in a JSON body; raises RequestBodyError."""
    try:
        unchecked = [(json.loads(body), 0)] if body else []
    except RecursionError:
        raise RequestBodyError(TOO_DEEP, 400) from None
    except ValueError:
        return
    num_values = num_files = 0
    while unchecked:
        value, depth = unchecked.pop()
        if depth > _MAX_DEPTH:
            raise RequestBodyError(TOO_DEEP, 400)
        if isinstance(value, list) and len(value) > MAX_ITEMS:
            raise RequestBodyError(TOO_MANY_ITEMS.format(limit=MAX_ITEMS, count=len(value)))
        if isinstance(value, dict) and "path" in value:  # Gradio treats it as an uploaded file
            num_files += 1
            if value.get("is_stream") or "://" in str(value["path"]):
                raise RequestBodyError(NOT_UPLOADED, 400)
        if num_files > MAX_ITEMS:
            raise RequestBodyError(TOO_MANY_FILES.format(limit=MAX_ITEMS))
        if isinstance(value, list | dict):
            num_values += len(value)
            if num_values > MAX_VALUES:
                raise RequestBodyError(TOO_MANY_VALUES.format(limit=MAX_VALUES))
            inner = value.values() if isinstance(value, dict) else value
            unchecked += [(each, depth + 1) for each in inner]
