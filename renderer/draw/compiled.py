"""Loops compiled to machine code by numba, and where that code is kept between processes.

Numba's own cache is not for several processes that begin at once: two that compile the same loop
write one file of code each under one name, and the index of one ends beside the code of the other,
which ends every later process that calls it. So the code is made by one process, under a lock, in a
folder of its own that gets its final name when it is whole; nobody writes into it after that. Its
name follows from all that the code depends on: the file of the loops, numba, Python and the
processor. A folder whose files are not what was written, or in which a process ended while it tried
the code, is made anew.

The folder lies in the user's cache, unless ``NUMBA_CACHE_DIR`` names another; where that cannot be
written, in a folder of this user's alone among the temporary ones, and else each process compiles
for itself.
"""

import contextlib
import functools
import hashlib
import inspect
import json
import logging
import os
import platform
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numba
from filelock import FileLock, Timeout
from numba.core import config

log = logging.getLogger(__name__)

FACTS = "complete.json"
"""Stands in a folder that is whole, with the checksum of every other file."""
TRIED_BY = "tried-by-"
"""Begins the name of a file that lies there while the process of that number tries the code."""
WAIT_S = 120.0
"""For another process to make the code, before this one compiles for itself."""
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
_config: Any = config


@dataclass(frozen=True)
class Loop:
    """A function that numba compiles for one set of argument types."""

    dispatcher: Any
    signature: str

    def __call__(self, *arguments: Any) -> None:
        self.dispatcher(*arguments)


def inner(function: Callable[..., None]) -> Any:
    """A function that loops of the same file call; its code becomes part of theirs."""
    return numba.njit(**_OPTIONS)(inspect.unwrap(function))  # without a test run's type checks


def loop(signature: str) -> Callable[[Callable[..., None]], Loop]:
    """A function that `prepare` makes into machine code, for arguments of these types alone."""

    def made(function: Callable[..., None]) -> Loop:
        return Loop(inner(function), signature)

    return made


def prepare(loops: Sequence[Loop], sources: Sequence[Path], trial: Callable[[], None]) -> None:
    """Read the loops' machine code, or make it where there is none; other processes wait for it.

    Args:
        sources: the files in which all loops, what they call and their numbers stand.
        trial: calls each loop once.
    """
    place = _writable_folder()
    if place is None:
        _compile(loops, None)
        return
    name = _key_of(sources)
    try:
        # Whoever only reads holds it for a moment, so that nobody else removes what it reads.
        with FileLock(place / f"{name}.lock", timeout=WAIT_S):
            _prepare_in(place / name, loops, trial)
    except (Timeout, OSError, NotImplementedError) as error:
        log.warning("Machine code could not be kept in %s (%s); compiled anew.", place, error)
        _compile(loops, None)


def _prepare_in(folder: Path, loops: Sequence[Loop], trial: Callable[[], None]) -> None:
    fault = _fault_of(folder)
    if fault:
        log.warning("The machine code kept in %s was damaged (%s); made anew.", folder, fault)
    if fault is not None:
        _make(folder, loops)
    else:
        _compile(loops, folder)  # which reads what is kept
    with _tried(folder):
        trial()


def _make(folder: Path, loops: Sequence[Loop]) -> None:
    """Compile into a folder beside it, which then takes its place."""
    for other in folder.parent.glob(f"{folder.name}.unfinished-*"):  # by who was killed
        shutil.rmtree(other, ignore_errors=True)
    with tempfile.TemporaryDirectory(
        prefix=f"{folder.name}.unfinished-", dir=folder.parent, ignore_cleanup_errors=True
    ) as temporary:
        unfinished = Path(temporary, "code")
        unfinished.mkdir()
        _compile(loops, unfinished)
        (unfinished / FACTS).write_text(json.dumps(_checksums(unfinished)))
        shutil.rmtree(folder, ignore_errors=True)
        unfinished.rename(folder)


def _compile(loops: Sequence[Loop], folder: Path | None) -> None:
    """Give each loop its machine code: read from the folder, or compiled and left there."""
    before = _config.CACHE_DIR
    try:
        for each in loops:
            if folder is not None:
                _config.CACHE_DIR = str(folder)  # read as caching is enabled
                each.dispatcher.enable_caching()
            each.dispatcher.compile(each.signature)
            each.dispatcher.disable_compile()  # so nothing is written later
    finally:
        _config.CACHE_DIR = before


def _fault_of(folder: Path) -> str | None:
    """Why the code kept there cannot be used; empty where there is none, None where it can."""
    try:
        written = json.loads((folder / FACTS).read_text())
    except FileNotFoundError:
        return ""
    except (OSError, ValueError):
        return f"{FACTS} cannot be read"
    for tried in folder.glob(f"{TRIED_BY}*"):
        if not _is_alive(tried.name.removeprefix(TRIED_BY)):
            return "a process ended while it tried the code"
    found = _checksums(folder)
    return None if found == written else "a file is not what was written"


def _checksums(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != FACTS and not path.name.startswith(TRIED_BY)
    }


@contextlib.contextmanager
def _tried(folder: Path) -> Iterator[None]:
    """Leaves a note that stays only if this process ends meanwhile."""
    note = folder / f"{TRIED_BY}{os.getpid()}"
    note.write_text("")
    try:
        yield
    finally:
        note.unlink(missing_ok=True)


def _is_alive(number: str) -> bool:
    try:
        os.kill(int(number), 0)
    except (ValueError, ProcessLookupError):
        return False
    except OSError:  # another user's
        return True
    return int(number) != os.getpid()  # a note of an earlier process of this number


def _key_of(sources: Sequence[Path]) -> str:
    """What the code depends on; numba looks for the file's path and time of change, too."""
    parts = (
        *(f"{path}\0{path.stat().st_mtime_ns}\0{path.read_text('utf-8')}" for path in sources),
        *(numba.__version__, platform.python_version(), platform.machine()),
        *(llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()),
    )
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]


@functools.cache
def _writable_folder() -> Path | None:
    """Where machine code may be kept; None where nothing can be written."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    user_cache = os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()
    usual = Path(chosen) if chosen else Path(user_cache) / "co-speech-motion" / "machine-code"
    own = Path(tempfile.gettempdir()) / f"co-speech-motion-{os.getuid()}"
    for folder in (usual, own):
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if _is_ours_alone(folder) and os.access(folder, os.W_OK | os.X_OK):
                return folder
        except OSError:
            continue
    return None


def _is_ours_alone(folder: Path) -> bool:
    """Whether nobody else can have left machine code there for this user to run."""
    status = folder.lstat()
    is_folder = stat.S_ISDIR(status.st_mode)
    return is_folder and status.st_uid == os.getuid() and not status.st_mode & 0o022
