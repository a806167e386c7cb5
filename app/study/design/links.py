"""Participant links that work once: a number signed with a secret that stays with the key.

The page, which anyone can read, cannot tell a good link from a bad one: it carries the token into
the answers, and the analysis looks at it.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from collections.abc import Sequence
from urllib.parse import urlencode, urlsplit

from app.errors import RunError
from app.study.design.key import Key

MAX_LINKS = 10_000
_SIGNATURE_HEX = 32


def new_secret() -> str:
    """64 random hexadecimal digits."""
    return secrets.token_hex(32)


def token_of(key: Key, number: int) -> str:
    """The token of participant ``number``: the number and 128 bits of its HMAC-SHA256.

    Raises:
        ValueError: if the key has no secret.
    """
    if key.link_secret is None:
        raise ValueError("the key has no secret")
    message = f"{key.study}/{number}".encode()
    signature = hmac.new(key.link_secret.encode(), message, hashlib.sha256).hexdigest()
    return f"{number}-{signature[:_SIGNATURE_HEX]}"


def list_of(key: Key, number: int) -> int:
    """The list of participant ``number``: one after the other, then from the first again."""
    lists: Sequence[int] = sorted(key.lists)
    return lists[number % len(lists)]


def link_of(key: Key, number: int, address: str) -> str:
    """What participant ``number`` is sent.

    Args:
        address: where the bundle is hosted.

    Raises:
        RunError: if that is no address of a page.
    """
    parts = urlsplit(address)
    if parts.scheme not in ("http", "https") or not parts.netloc or parts.query or parts.fragment:
        raise RunError(
            f"{address!r} is no address of a page; give it as https://lab.example/study/."
        )
    return f"{address}?{urlencode({'p': list_of(key, number), 't': token_of(key, number)})}"


def doubt_of(key: Key, token: str | None, list_number: int) -> str | None:
    """Why answers did not come by a link of the study, as the end of a sentence; None if they did,
    or if the study has no links."""
    if key.link_secret is None:
        return None
    if token is None:
        return "came without a signed link"
    number = token.partition("-")[0]
    is_number = number.isascii() and number.isdecimal() and len(number) <= len(str(MAX_LINKS))
    if not is_number or not hmac.compare_digest(token_of(key, int(number)), token):
        return "the signature of the link is wrong"
    if list_of(key, int(number)) != list_number:
        return "the link belongs to another list"
    return None
