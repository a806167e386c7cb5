"""Loops compiled to machine code by numba, and where that code is kept.

Compiling takes seconds, so the code is kept between processes. Numba's own choice is a
``__pycache__`` beside the source; a program should not write into its own folder, which may be
read-only, shared or under version control. So the folder is the user's cache, unless
``NUMBA_CACHE_DIR`` names another. Numba compiles anew by itself when the source file changes, and
it looks at no other file: what a loop needs stands in the file of the loop.
"""

import inspect
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit
from numba.core import config

_config: Any = config


def compiled(function: Callable[..., None]) -> Callable[..., None]:
    """The function as machine code, compiled at its first call or read from the cache."""
    folder = _cache_folder()
    before = _config.CACHE_DIR
    _config.CACHE_DIR = str(folder or "")  # read while the function is decorated
    try:
        compile_ = njit(cache=folder is not None, nogil=True, error_model="numpy")
        return compile_(inspect.unwrap(function))  # without the type checks of a test run
    finally:
        _config.CACHE_DIR = before


def _cache_folder() -> Path | None:
    """Where to keep machine code; None where nothing can be written."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    user_cache = os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()
    folder = Path(chosen) if chosen else Path(user_cache) / "co-speech-motion" / "numba"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK | os.X_OK) else None
