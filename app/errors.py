"""Errors with a sentence for the user, and the conversion of other exceptions to such sentences."""

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
    """Error with one sentence for the user: in a run, flag, file or study, and what to do."""


class DiskFullError(RunError):
    """Error of a run that needs more disk space than there is."""


class WorkerError(Exception):
    """Program fault in another process; its message is a traceback and is never shown to users."""


_DISK_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_NOT_ALLOWED = {errno.EACCES, errno.EPERM, errno.EROFS}
_OUR_PACKAGES = ("app", "model", "renderer", "processes")
_FOLDERS = re.compile(r"(?<![\w.:/])/(?:[^\s/'\"]+/)+")
"""Folder part of an absolute path in a sentence."""
_OPTIONS = re.compile(r" \([^()]*--[a-z][^()]*\)")
"""Bracketed mention of a command-line option in a sentence."""


def message_for_user(error: BaseException) -> str | None:
    """Return the sentence to show for an error, or None for a fault of the program.

    Errors that this project raises carry their sentence. Among the system's errors only a full
    disk, missing permissions and missing memory get one, because a user can act on them.
    """
    if isinstance(error, WorkerError):
        return None
    is_ours = type(error).__module__.split(".")[0] in _OUR_PACKAGES
    if is_ours and str(error):
        return printable(str(error))
    if isinstance(error, OSError) and error.errno in _DISK_FULL | _NOT_ALLOWED:
        return _file_sentence(error)
    if isinstance(error, MemoryError):
        return "The machine ran out of memory; use shorter speech, or fewer systems or samples."
    return None


def visitor_message(error: BaseException) -> str:
    """Return the sentence that a visitor sees for an error, without folders of this machine.

    A fault of the program is logged and shown as a number.
    """
    if is_disk_full(error):
        return text.DISK_FULL
    sentence = message_for_user(error)
    if sentence is not None:
        return without_cli_options(without_folders(sentence))
    fault_id = secrets.token_hex(4)
    log.error("fault %s", fault_id, exc_info=error)
    return text.INTERNAL_ERROR.format(fault_id=fault_id)


def without_folders(sentence: str) -> str:
    """Remove the folders of file paths from a sentence."""
    return _FOLDERS.sub("", sentence)


def without_cli_options(sentence: str) -> str:
    """Remove bracketed command-line options and backticks from a sentence for the page."""
    return _OPTIONS.sub("", sentence).replace("`", "")


def is_disk_full(error: BaseException | None) -> bool:
    """Check whether an error, of the system or of this program, means that the disk is full."""
    return isinstance(error, DiskFullError) or (
        isinstance(error, OSError) and error.errno in _DISK_FULL
    )


def disk_full_sentence(folder: Path | None) -> str:
    """Return the sentence for a full disk, with the folder if there is one."""
    where = f" at {folder}" if folder else ""
    return f"The disk{where} is full; free some space or write to another folder."


def _file_sentence(error: OSError) -> str:
    path = Path(str(error.filename)) if error.filename else None
    folder = path and path.parent
    if is_disk_full(error):
        return disk_full_sentence(folder)
    if path is not None and _is_unreadable(path):
        return f"Permission to read {path} was denied; change its permissions or give another file."
    return f"Permission to write to {folder or 'the folder'} was denied; choose another folder."


def _is_unreadable(path: Path) -> bool:
    """Check whether a file exists, or is behind a closed folder, and cannot be read."""
    try:
        path.stat()
    except PermissionError:
        return True
    except OSError:
        return False
    return not os.access(path, os.R_OK)
