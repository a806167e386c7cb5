"""librosa, and where numba keeps what librosa compiles.

librosa compiles on import: some twenty seconds of a processor where nothing is kept, and numba's
cache is not for processes that compile at once (the index of one ends beside the code of another,
which ends whoever calls it). So they import it in turn until one has compiled all of it, into a
folder of the user's own that is named by all that the code depends on.

    python -m model.speech.prepared_librosa    fills it ahead of time
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


def librosa() -> ModuleType:
    """The library, ready for use: two seconds of the first call in a process, and half a minute of
    the first for this user."""
    with _importing:
        return _imported()


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
    """All that is used of it, by which it is compiled."""
    import librosa.core.pitch
    import librosa.feature
    import librosa.filters
    import librosa.onset

    return librosa


def _key() -> str:
    """Of versions, of where the library lies (numba keeps code by the path of its source) and of
    the processor."""
    import llvmlite.binding as llvm

    versions = [importlib.metadata.version(name) for name in ("librosa", "numba", "llvmlite")]
    versions += [platform.python_version(), sys.prefix]
    versions += [llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()]
    return hashlib.sha256("\0".join(versions).encode()).hexdigest()[:16]


def _own_folder() -> Path | None:
    """Where nobody else can have left code for this user to run; None where nothing can be kept."""
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
    librosa()
