"""Import of librosa, and the cache of the code that numba compiles for it.

librosa compiles on import: about twenty seconds of processor time without a cache, and numba's
cache is not safe for processes that compile at once (the index of one may be combined with the code
of another, which crashes the caller). So processes import it in turn until one has compiled
everything, into a folder of the user's named by all that the code depends on.

    python -m model.speech.librosa_cache    fills the cache ahead of time
"""

import functools
import hashlib
import importlib.metadata
import os
import platform
import stat
import sys
import tempfile
import threading
from pathlib import Path
from types import ModuleType

from filelock import FileLock

_importing = threading.Lock()


def load_librosa() -> ModuleType:
    """Return librosa, compiled: 2 s on a process's first call, half a minute on a user's."""
    with _importing:
        return _imported()


def import_in_background() -> None:
    """Import the library in a thread, while the caller reads something else.

    SciPy is imported before: its modules import each other in circles, and two threads that import
    it at once can each find a half of it.
    """
    import scipy.ndimage
    import scipy.signal
    import scipy.stats  # noqa: F401

    threading.Thread(target=load_librosa, daemon=True).start()


@functools.cache
def _imported() -> ModuleType:
    place = _own_folder()
    if place is None:
        return _import()
    folder = place / _key()
    os.environ["NUMBA_CACHE_DIR"] = str(folder)  # read when numba is first imported
    whole = folder / "whole"
    if not whole.exists():
        with FileLock(f"{folder}.lock"):
            library = _import()
            folder.mkdir(exist_ok=True)  # where numba was there before, it has not
            whole.touch()
            return library
    return _import()


def _import() -> ModuleType:
    """Import every part of librosa that is used, which compiles it."""
    import librosa.core.pitch
    import librosa.feature
    import librosa.filters
    import librosa.onset

    return librosa


def _key() -> str:
    """Hash the versions, librosa's location (numba's cache depends on it) and the processor."""
    import llvmlite.binding as llvm

    versions = [importlib.metadata.version(name) for name in ("librosa", "numba", "llvmlite")]
    versions += [platform.python_version(), sys.prefix]
    versions += [llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()]
    return hashlib.sha256("\0".join(versions).encode()).hexdigest()[:16]


def _own_folder() -> Path | None:
    """Return a cache folder that only this user can write to; None if there is none."""
    cache = os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()
    temporary = Path(tempfile.gettempdir()) / f"co-speech-motion-{os.getuid()}"
    for folder in (Path(cache) / "co-speech-motion" / "librosa", temporary / "librosa"):
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            status = folder.lstat()
        except OSError:
            continue
        is_own = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid()
        if is_own and not status.st_mode & 0o022 and os.access(folder, os.W_OK | os.X_OK):
            return folder
    return None


if __name__ == "__main__":
    load_librosa()
