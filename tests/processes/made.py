"""Jobs that say what became of them."""

import os
import signal
import sys
import time
from functools import partial
from pathlib import Path

from processes.job import Job, JobsError
from processes.pool import JobPool


def make_jobs(folder: Path, count: int, seconds: float = 0.0) -> list[Job]:
    """Each takes a while, adds its name to ``log`` and leaves a file of its own."""
    return [made_job(folder, f"job{number}", seconds) for number in range(count)]


def made_job(folder: Path, name: str, seconds: float = 0.0, work=None) -> Job:
    result = folder / f"{name}.done"
    return Job(name, result.is_file, partial(work or do, folder, name, seconds))


def do(folder: Path, name: str, seconds: float) -> None:
    (folder / f"{name}.begun").touch()
    time.sleep(seconds)
    with (folder / "log").open("a") as log:
        log.write(f"{name}\n")
    (folder / f"{name}.done").touch()


def fail(folder: Path, name: str, seconds: float) -> None:
    raise ValueError(f"{name} cannot be done")


def kill_worker_once(folder: Path, name: str, seconds: float) -> None:
    """The second time all is well."""
    mark = folder / f"{name}.killed"
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    do(folder, name, seconds)


def kill_worker(folder: Path, name: str, seconds: float) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def crash(folder: Path, name: str, seconds: float) -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def leave(folder: Path, name: str, seconds: float) -> None:
    sys.stderr.write("the last words of it\n")
    sys.stderr.flush()
    os._exit(3)


def run_out_of_memory(folder: Path, name: str, seconds: float) -> None:
    """As C++ does where nobody catches it."""
    sys.stderr.write("terminate called after throwing an instance of 'std::bad_alloc'\n")
    sys.stderr.flush()
    os.abort()


def leave_python(folder: Path, name: str, seconds: float) -> None:
    sys.exit(3)


def done(folder: Path) -> list[str]:
    """Names as they came."""
    log = folder / "log"
    return log.read_text().split() if log.exists() else []


def wait_for(condition, seconds: float = 60.0) -> None:
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "it did not come to that"
        time.sleep(0.05)


if __name__ == "__main__":
    place, who = Path(sys.argv[1]), sys.argv[2]
    pool = JobPool(int(who)) if who.isdigit() else JobPool(scheduler=who)
    try:
        pool.do_all(make_jobs(place, 6, 0.5))
    except JobsError as error:
        sys.exit(str(error))
