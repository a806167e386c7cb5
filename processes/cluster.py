"""Jobs on a Dask cluster whose workers see the same files as this machine.

Dask brings the queue: it hands jobs to workers as they get free, and those of a lost worker to
others. It is no requirement of this project; see ``requirements-cluster.txt``.
"""

import asyncio
import logging
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError
from pathlib import Path

from processes.job import Job, JobsError, use_one_thread

CONNECT_S = 30
SEEN_WITHIN_S = 30.0
"""Until a result that a worker has written must be seen here, on a shared disk."""
_TELL_OF_LOSS = ("distributed.client", "distributed.core", "distributed.utils")
_GIVEN_UP = "Failed to reconnect to scheduler"
"""Loggers of Dask that print tracebacks when a scheduler is lost, or this."""
_ONE_AT_A_TIME = threading.Lock()
"""Of a worker with several threads: jobs are made for processes."""


def do_by_cluster(
    jobs: Sequence[Job], scheduler: str, on_done: Callable[[str], None]
) -> dict[str, Exception]:
    """As `processes.pool.JobPool.do_all`, of jobs that are not done."""
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise JobsError(
            "A scheduler needs Dask: pip install --no-deps -r locks/cluster.txt."
        ) from error
    for name in _TELL_OF_LOSS:
        logging.getLogger(name).addFilter(_is_no_lost_connection)
    is_file = Path(scheduler).is_file()
    try:
        client = Client(
            address=None if is_file else scheduler,
            scheduler_file=scheduler if is_file else None,
            timeout=CONNECT_S,
            set_as_default=False,
        )
    except (OSError, ValueError) as error:
        raise JobsError(
            f"No Dask scheduler answers at {scheduler}; start one with `dask scheduler`."
        ) from error
    failed: dict[str, Exception] = {}
    try:
        # A key of its own for each call: Dask would take equal keys of two callers for one job.
        running = {client.submit(_do, job, key=_key(job), pure=False): job for job in jobs}
        for future in as_completed(running, loop=client.loop):
            job = running[future]
            try:
                future.result()
            except CancelledError as error:  # of all that are left
                raise _gone(scheduler) from error
            except Exception as error:
                failed[job.name] = _told(error, job)
            else:
                if _is_seen(job):
                    on_done(job.name)
                else:
                    failed[job.name] = JobsError(
                        f"{job.name} was done by a worker, but its result is not here; workers "
                        "must see the same folders."
                    )
            future.release()  # or Dask would do it again if this worker were lost
    finally:
        client.close(timeout=5)
    return failed


def _is_no_lost_connection(record: logging.LogRecord) -> bool:
    """Whether a line of Dask's log is none that our own sentence tells, with its tracebacks."""
    from distributed.comm.core import CommClosedError

    lost = (CommClosedError, OSError, TimeoutError, CancelledError, asyncio.CancelledError)
    error = record.exc_info[1] if record.exc_info else None
    return not (isinstance(error, lost) or str(record.msg).startswith(_GIVEN_UP))


def _key(job: Job) -> str:
    return f"{job.name}-{time.time_ns()}"


def _do(job: Job) -> None:
    """On a worker."""
    with _ONE_AT_A_TIME:
        use_one_thread()
        job.do()


def _is_seen(job: Job) -> bool:
    until = time.monotonic() + SEEN_WITHIN_S
    while not job.is_done():
        if time.monotonic() > until:
            return False
        time.sleep(0.5)
    return True


def _told(error: Exception, job: Job) -> Exception:
    from distributed import KilledWorker

    if isinstance(error, KilledWorker):
        return JobsError(
            f"Every worker that began {job.name} ended before it was done; the logs of the workers "
            "say how."
        )
    return error


def _gone(scheduler: str) -> JobsError:
    return JobsError(
        f"The Dask scheduler at {scheduler} is gone; start one again and give the same command, "
        "which goes on with what is not done."
    )
