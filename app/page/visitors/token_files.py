"""Files under tokens that nobody can guess, each for one browser and for a while."""

from __future__ import annotations

import math
import secrets
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from app.page.visitors.visitors import is_same

_TOKEN_BYTES = 32


@dataclass(frozen=True)
class _TokenFile:
    path: Path
    cookie: str | None
    until: float


class TokenFiles:
    """Which file lies behind which token. Safe to use from several threads."""

    def __init__(self) -> None:
        self._token_files: dict[str, _TokenFile] = {}
        self._lock = threading.Lock()

    def add(self, path: Path, cookie: str | None, keep_s: float = math.inf) -> str:
        """Keep a file ready for so many seconds; returns its token of 256 random bits.

        Args:
            cookie: of the browser that may have it. None asks for no cookie, an empty one lets
                nobody have it.
        """
        token = secrets.token_urlsafe(_TOKEN_BYTES)
        with self._lock:
            self._token_files[token] = _TokenFile(path, cookie, time.monotonic() + keep_s)
        return token

    def find(self, token: str, cookie: str) -> Path | None:
        """The file, or None when there is none for this browser (any longer)."""
        with self._lock:
            return self._find(token, cookie)

    def take(self, token: str, cookie: str) -> Path | None:
        """The file, which nobody can have again; a token tried in vain stays good for its owner."""
        with self._lock:
            path = self._find(token, cookie)
            if path is not None:
                del self._token_files[token]
            return path

    def forget_ended(self) -> list[Path]:
        """Forget what is ready no longer or has been deleted; returns the paths."""
        with self._lock:
            ended = [token for token, file in self._token_files.items() if _has_ended(file)]
            return [self._token_files.pop(token).path for token in ended]

    def _find(self, token: str, cookie: str) -> Path | None:
        file = self._token_files.get(token)
        if file is None or _has_ended(file):
            return None
        return file.path if file.cookie is None or is_same(file.cookie, cookie) else None


def _has_ended(file: _TokenFile) -> bool:
    return file.until < time.monotonic() or not file.path.is_file()
