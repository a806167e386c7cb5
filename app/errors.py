"""Errors a person meets, and how any other is turned into a sentence or kept apart."""

from __future__ import annotations

import errno
import logging
import os
import re
import secrets
from pathlib import Path

from app import text
from conventions.names import printable
from processes.job import Cancelled as Cancelled

log = logging.getLogger(__name__)


class RunError(ValueError):
    """A run that cannot be done, with the one sentence that says why and what to do."""


class DiskFullError(RunError):
    """A run for which the disk has too little room."""


class FaultElsewhere(Exception):
    """A fault of the program in another process, with its traceback; no sentence for anyone."""


_DISK_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_NOT_ALLOWED = {errno.EACCES, errno.EPERM, errno.EROFS}
_OUR_PACKAGES = ("app", "model", "renderer", "processes")
_FOLDERS = re.compile(r"(?<![\w.:/])/(?:[^\s/'\"]+/)+")
"""Of a file named with its whole path."""
_OPTIONS = re.compile(r" \([^()]*--[a-z][^()]*\)")
"""How sentences name an option of the command line."""


def sentence_of(error: BaseException) -> str | None:
    """The sentence to show a person, or None when the error is a fault of the program.

    Errors that this project raises carry their sentence. Of the system's errors only those are
    put into words that a person can do something about.
    """
    if isinstance(error, FaultElsewhere):
        return None
    is_ours = type(error).__module__.split(".")[0] in _OUR_PACKAGES
    if is_ours and str(error):
        return printable(str(error))
    if isinstance(error, OSError) and error.errno in _DISK_FULL | _NOT_ALLOWED:
        return _file_sentence(error)
    if isinstance(error, MemoryError):
        return "The machine ran out of memory; use shorter speech, fewer systems or samples."
    return None


def visitor_sentence(error: BaseException) -> str:
    """What a visitor is told of an error: no folder of this machine, and of faults of the program,
    which are logged, a number."""
    if is_disk_full(error):
        return text.DISK_FULL
    sentence = sentence_of(error)
    if sentence is not None:
        return page_sentence(without_folders(sentence))
    fault_id = secrets.token_hex(4)
    log.error("fault %s", fault_id, exc_info=error)
    return text.FAULT.format(fault_id=fault_id)


def without_folders(sentence: str) -> str:
    """A sentence without the folders of files that it names."""
    return _FOLDERS.sub("", sentence)


def page_sentence(sentence: str) -> str:
    """A sentence without what it tells users of the command line, which stands in brackets, and
    without signs that only a document turns into letters of code."""
    return _OPTIONS.sub("", sentence).replace("`", "")


def is_disk_full(error: BaseException | None) -> bool:
    """Whether there is no room to write, as the system or this program says."""
    return isinstance(error, DiskFullError) or (
        isinstance(error, OSError) and error.errno in _DISK_FULL
    )


def disk_full_sentence(folder: Path | None) -> str:
    """What to do about it."""
    where = f" at {folder}" if folder else ""
    return f"The disk{where} is full; free some space or write to another folder."


def _file_sentence(error: OSError) -> str:
    path = Path(str(error.filename)) if error.filename else None
    folder = path and path.parent
    if is_disk_full(error):
        return disk_full_sentence(folder)
    if path is not None and _is_unreadable(path):
        return f"{path} may not be read; change its permissions, or give another file."
    where = f" at {folder}" if folder else ""
    return f"Nothing may be written{where or ' there'}; choose a folder that you may write to."


def _is_unreadable(path: Path) -> bool:
    """Whether a file is there, or behind a folder that may not be entered, and cannot be read."""
    try:
        path.stat()
    except PermissionError:
        return True
    except OSError:
        return False
    return not os.access(path, os.R_OK)
