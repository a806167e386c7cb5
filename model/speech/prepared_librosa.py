"""librosa, and where numba keeps what librosa compiles.

librosa compiles on import: some twenty seconds of a processor where nothing is kept, and numba's
cache is not for processes that compile at once (the index of one ends beside the code of another,
which ends whoever calls it). So one process fills a folder under a lock while the others wait, and
nobody writes there afterwards. The folder is the user's own, named by all that the code depends on;
one whose files are not what was written is made anew.

    python -m model.speech.prepared_librosa    fills it ahead of time
"""

import functools
import hashlib
import importlib.metadata
import json
import logging
import os
import platform
import shutil
import stat
import sys
import tempfile
import threading
from pathlib import Path
from types import ModuleType

from filelock import FileLock

log = logging.getLogger(__name__)

WHOLE = "whole.json"
"""In a folder that is whole: the checksum of every other file."""
_importing = threading.Lock()


def librosa() -> ModuleType:
    """The library, ready for use: two seconds of the first call in a process, and half a minute of
    the first for this user."""
    with _importing:
        return _imported()


@functools.cache
def _imported() -> ModuleType:
    folder = _filled_folder()
    if folder is not None:
        os.environ["NUMBA_CACHE_DIR"] = str(folder)  # read when numba is first imported
    return _import()


def _import() -> ModuleType:
    """All that is used of it, by which it is compiled."""
    import librosa.core.pitch
    import librosa.feature
    import librosa.filters
    import librosa.onset

    return librosa


def _filled_folder() -> Path | None:
    """The folder of compiled code, filled by this process or another; None where none can be."""
    place = _own_folder()
    if place is None:
        return None
    folder = place / _key()
    with FileLock(place / f"{folder.name}.lock"):
        if not _is_whole(folder):
            try:
                _fill(folder)
            except OSError as error:
                log.warning("What librosa compiles could not be kept in %s (%s).", place, error)
                return None
    return folder


def _fill(folder: Path) -> None:
    """By importing, into a folder beside it that then takes its place."""
    for begun in folder.parent.glob(f"{folder.name}.begun-*"):  # by who was killed
        shutil.rmtree(begun, ignore_errors=True)
    shutil.rmtree(folder, ignore_errors=True)
    begun = Path(tempfile.mkdtemp(prefix=f"{folder.name}.begun-", dir=folder.parent))
    os.environ["NUMBA_CACHE_DIR"] = str(begun)
    _import()
    (begun / WHOLE).write_text(json.dumps(_checksums(begun)))
    begun.rename(folder)


def _is_whole(folder: Path) -> bool:
    try:
        return json.loads((folder / WHOLE).read_text()) == _checksums(folder)
    except FileNotFoundError:
        return False
    except (OSError, ValueError):
        log.warning("%s cannot be read; what librosa compiles is made anew.", folder / WHOLE)
        return False


def _checksums(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != WHOLE
    }


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
