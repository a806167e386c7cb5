"""Sets of clips that have been measured, for as long as their files are kept: any clip of them can
be opened by the browser that brought them."""

from __future__ import annotations

import secrets
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from app.page.visitors.visitors import is_same

if TYPE_CHECKING:
    from app.run.many.sets import Sets

_TOKEN_BYTES = 32


@dataclass(frozen=True)
class KeptSet:
    """What was measured together."""

    token: str
    cookie: str
    """Of the browser that brought it; empty for one that keeps none, whose page alone knows the
    token."""
    folder: Path
    sets: Sets


class KeptSets:
    """All of them. Safe to use from several threads."""

    def __init__(self) -> None:
        self._kept: dict[str, KeptSet] = {}
        self._lock = threading.Lock()

    def keep(self, cookie: str, folder: Path, sets: Sets) -> KeptSet:
        """
        Args:
            folder: with whose end the clips are gone.
        """
        kept = KeptSet(secrets.token_urlsafe(_TOKEN_BYTES), cookie, folder, sets)
        with self._lock:
            for token in [token for token, one in self._kept.items() if not one.folder.is_dir()]:
                del self._kept[token]
            self._kept[kept.token] = kept
        return kept

    def find(self, token: str, cookie: str) -> KeptSet | None:
        """None of what is another browser's, or kept no longer."""
        with self._lock:
            kept = self._kept.get(token)
        if kept is None or not kept.folder.is_dir():
            return None
        return kept if not kept.cookie or is_same(kept.cookie, cookie) else None
