"""What one browser may have, behind tokens that nobody can guess, for as long as its files are
there."""

from __future__ import annotations

import secrets
import threading
from pathlib import Path
from typing import Generic, TypeVar

from app.page.visitors.visitors import is_same

Thing = TypeVar("Thing")
_TOKEN_BYTES = 32


class Kept(Generic[Thing]):
    """Which thing lies behind which token. Safe to use from several threads."""

    def __init__(self) -> None:
        self._kept: dict[str, tuple[Path, str | None, Thing]] = {}
        self._lock = threading.Lock()

    def keep(self, thing: Thing, files: Path, cookie: str | None) -> str:
        """Let a browser have it; returns the token, of 256 random bits, each time the same.

        Args:
            files: with whose end it is gone.
            cookie: of that browser. None asks for no cookie, an empty one lets nobody have it.
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
