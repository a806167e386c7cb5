"""Jobs that say what became of them."""

import os
import signal
import sys
from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from processes.job import Cancelled, Job, JobsError
from processes.pool import JobPool
from tests.waiting import wait_for


def make_jobs(folder: Path, count: int, are_held: bool = False) -> list[Job]:
    """Each adds its name to ``log``, which is all that it leaves; those that are held wait, once
    two are done, until the file ``go`` is there."""
    work = do_when_let if are_held else do
    return [made_job(folder, f"job{number}", work) for number in range(count)]


def made_job(folder: Path, name: str, work: Callable[..., object]) -> Job:
    return Job(name, partial(is_done, folder, name), partial(work, folder, name))


def is_done(folder: Path, name: str) -> bool:
    return name in done(folder)


def do(folder: Path, name: str) -> None:
    with (folder / "log").open("a") as log:
        log.write(f"{name}\n")


def do_when_let(folder: Path, name: str) -> None:
    wait_for(lambda: len(done(folder)) < 2 or (folder / "go").exists())
    do(folder, name)


def tell_and_wait(
    folder: Path, name: str, on_message: Callable[[Any], None], should_cancel: Callable[[], bool]
) -> None:
    """Ends when it is cancelled, and never by itself."""
    for number in range(3):
        on_message(number)
    wait_for(should_cancel)
    raise Cancelled


def fail(folder: Path, name: str) -> None:
    raise ValueError(f"{name} cannot be done")


def cancel(folder: Path, name: str) -> None:
    do(folder, name)
    raise Cancelled


def kill_worker_once(folder: Path, name: str) -> None:
    """The second time all is well."""
    mark = folder / f"{name}.killed"
    if not mark.exists():
        mark.touch()
        kill()
    do(folder, name)


def kill(*_: Any) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def run_out_of_memory(*_: Any) -> None:
    """As C++ does where nobody catches it."""
    sys.stderr.write("terminate called after throwing an instance of 'std::bad_alloc'\n")
    sys.stderr.flush()
    os.abort()


def leave_python(folder: Path, name: str) -> None:
    sys.exit(3)


def done(folder: Path) -> list[str]:
    """Names as they came."""
    log = folder / "log"
    return log.read_text().split() if log.exists() else []


def main(place: Path, who: str) -> None:
    pool = JobPool(int(who)) if who.isdigit() else JobPool(scheduler=who)
    try:
        pool.run_all(make_jobs(place, 6, are_held=True))
    except JobsError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    # By the name under which other processes find what it hands them.
    import_module("tests.processes.made").main(Path(sys.argv[1]), sys.argv[2])
