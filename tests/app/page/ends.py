"""Tasks that end as they do, each by its own hand."""

import os
import resource
import signal
import sys
from pathlib import Path
from typing import Any

import numpy as np

from app.errors import RunError
from app.run.callbacks import FolderUpdated, RunCallbacks, StageProgress
from app.run.output.result_folder import require_free_space


def carry_on(request: str, *_: Any) -> str:
    """Say it back."""
    return request


def leave(path: Path, callbacks: RunCallbacks) -> Path:
    callbacks.on_event(StageProgress("numbers", 0.5))
    path.touch()
    callbacks.on_event(FolderUpdated(path.parent))
    return path


def wait(*_: Any) -> None:
    """Until somebody ends it from outside."""
    while True:
        signal.pause()


def wait_for_stop(request: str, callbacks: RunCallbacks) -> None:
    while not callbacks.should_cancel():
        pass


def say_no(*_: Any) -> None:
    raise RunError("It is no <good>.")


KEPT: list[bytes] = []


def grow_and_say_no(*_: Any) -> None:
    KEPT.append(bytes(5 * 10**7))
    raise RunError("It has grown.")


def find_no_room(*_: Any) -> None:
    raise OSError(28, "No space left on device", "/results/a.mp4")


def require_room(folder: Path, *_: Any) -> None:
    require_free_space(folder, 2**60)


def fail(*_: Any) -> None:
    raise OverflowError("a secret of /home/somebody")


def data_limits(*_: Any) -> tuple[int, int]:
    return resource.getrlimit(resource.RLIMIT_DATA)


def take_five_gigabytes(*_: Any) -> None:
    """Which are never touched."""
    np.empty(5 * 10**9, np.uint8)


def segfault(*_: Any) -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def terminate(*_: Any) -> None:
    os.kill(os.getpid(), signal.SIGTERM)


def leave_with_3(*_: Any) -> None:
    sys.stderr.write("the last words of it\x1b[2J\n")
    sys.exit(3)


def niceness(*_: Any) -> int:
    return os.getpriority(os.PRIO_PROCESS, 0)
