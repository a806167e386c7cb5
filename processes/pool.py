"""Parallel execution of jobs by processes of this machine, or by a Dask cluster.

The cluster's workers must see the same files. Dask is optional; see ``requirements-cluster.txt``.
"""

import asyncio
import logging
import os
import pickle
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from processes.child import Child, ChildExited, parent_channel, start_receiving
from processes.job import Cancelled, Job, JobsError

MAX_BREAKS = 3
"""Number of worker processes in a row that may crash without any job done in between."""

_BROKEN = (
    f"Worker processes ended {MAX_BREAKS} times in a row without finishing a job; finished jobs "
    "are kept."
)
_LAST, _FEWER, _AGAIN = "The last one", "use fewer processes", "run the same command again"
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Environment with one thread for numpy and torch: results do not depend on the core count."""
_POLL_S = 0.02


@dataclass(frozen=True)
class JobPool:
    """Choice of workers for jobs: processes of this machine, or a Dask cluster."""

    processes: int | None = None
    """Number of single-threaded workers (default: all cores); one works in the calling process."""
    scheduler: str | None = None
    """Address or scheduler file of a Dask scheduler with workers that see the same files;
    replaces the processes."""

    def run_all(
        self,
        jobs: Sequence[Job],
        on_done: Callable[[str], object] = lambda name: None,
        on_message: Callable[[str, Any], object] = lambda name, message: None,
        should_cancel: Callable[[], bool] = lambda: False,
    ) -> dict[str, Exception]:
        """Do every job that is not done yet; one that fails does not stop the others.

        Args:
            on_done: called with the name of each job as it completes, in any order.
            on_message: called with the name of a job and its progress message; not by a cluster.
            should_cancel: called many times a second; not by a cluster. Worker processes are killed
                then; in the calling process a job that takes callbacks is given this function.

        Returns:
            Exceptions of the jobs that failed, by name.

        Raises:
            Cancelled: as soon as a job raises it or ``should_cancel`` is true; no other is begun.
            JobsError: if workers die repeatedly, or the cluster cannot be reached or is gone.
                What is done stays done.
        """
        waiting = [job for job in jobs if not job.is_done()]
        if not waiting:
            return {}
        if self.scheduler is not None:
            return run_on_cluster(waiting, self.scheduler, on_done)
        workers = min(self.processes or os.cpu_count() or 1, len(waiting))
        if workers > 1:
            return run_in_processes(waiting, workers, on_done, on_message, should_cancel)
        return run_sequentially(waiting, on_done, on_message, should_cancel)


def run_sequentially(
    jobs: Sequence[Job],
    on_done: Callable[[str], object],
    on_message: Callable[[str, Any], object],
    should_cancel: Callable[[], bool],
) -> dict[str, Exception]:
    """Do jobs in this process, as `JobPool.run_all`."""
    failed: dict[str, Exception] = {}
    for job in jobs:
        if should_cancel():
            raise Cancelled
        try:
            job.run(partial(on_message, job.name), should_cancel)
        except Cancelled:
            raise
        except Exception as error:
            failed[job.name] = error
        else:
            on_done(job.name)
    return failed


def run_in_processes(
    jobs: Sequence[Job],
    workers: int,
    on_done: Callable[[str], object],
    on_message: Callable[[str, Any], object],
    should_cancel: Callable[[], bool],
) -> dict[str, Exception]:
    """Do jobs in worker processes, as `JobPool.run_all`; a crashed one's job comes last again."""
    waiting, failed, breaks = [*jobs], dict[str, Exception](), 0
    busy: dict[Child, Job] = {}
    idle = [_worker() for _ in range(workers)]
    try:
        while waiting or busy:
            if should_cancel():
                raise Cancelled
            while waiting and idle:
                child, job = idle.pop(), waiting.pop(0)
                busy[child] = job
                child.send(pickle.dumps(job))  # unpickled by the thread that does it
            for child, job in [*busy.items()]:
                try:
                    has_ended, message = False, None
                    while not has_ended and child.has_message(0.0):
                        has_ended, message = child.receive()
                        if not has_ended:
                            on_message(job.name, message)
                    if not has_ended:
                        continue
                    breaks = 0
                    idle.append(child)
                except ChildExited:
                    breaks += 1
                    if breaks == MAX_BREAKS:
                        how = child.exit_report().user_message(_LAST, _FEWER, _AGAIN)
                        raise JobsError(f"{_BROKEN} {how}") from None
                    child.kill()
                    waiting.append(job)
                    idle.append(_worker())
                else:
                    if isinstance(message, Cancelled):
                        raise message
                    if message is None:
                        on_done(job.name)
                    else:
                        failed[job.name] = message
                del busy[child]
            time.sleep(_POLL_S)
    finally:
        for child in (*busy, *idle):
            child.kill()
    return failed


def _worker() -> Child:
    here = os.getcwd()  # files may be named from it
    return Child("processes.pool", here, environment=_ONE_THREAD, is_log_handed_on=True)


def main() -> None:
    """Run a worker process: do jobs as they come; send their messages, and what each raised."""
    channel, (folder,) = parent_channel()
    os.chdir(folder)
    jobs, lock = start_receiving(channel), threading.Lock()

    def tell(message: object, has_ended: bool = False) -> None:
        with lock:
            channel.send((has_ended, message))

    while True:
        work, _ = jobs.get()
        tell(_raised(work, tell), has_ended=True)


def _raised(work: bytes, on_message: Callable[[Any], object]) -> Exception | None:
    name = "A job"
    try:
        job = pickle.loads(work)
        name = job.name
        job.run(on_message)
    except SystemExit as end:
        return JobsError(
            f"{name} ended its worker process with exit status {end.code}. This is a bug in the "
            "program; please report it."
        )
    except Exception as error:
        error.add_note(traceback.format_exc())
        return error


CONNECT_S = 30
RESULT_TIMEOUT_S = 30.0
"""Longest wait until a worker's result is visible on a shared disk (s)."""
_CONNECTION_LOGGERS = [f"distributed.{part}" for part in ("batched", "client", "core", "utils")]
_RECONNECT_FAILED = "Failed to reconnect to scheduler"
"""Loggers of Dask that print tracebacks when a scheduler is lost, and their message."""
_ONE_AT_A_TIME = threading.Lock()
"""Lock for a Dask worker with several threads: jobs are made for processes."""


def run_on_cluster(
    jobs: Sequence[Job], scheduler: str, on_done: Callable[[str], object]
) -> dict[str, Exception]:
    """Do jobs by a Dask cluster, as `JobPool.run_all`."""
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise JobsError(
            "A scheduler needs Dask; install it with: pip install --no-deps -r locks/cluster.txt"
        ) from error
    for name in _CONNECTION_LOGGERS:
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
        # A unique key for each call: Dask would take equal keys of two callers for one job.
        running = {
            client.submit(_do, job, key=f"{job.name}-{time.time_ns()}", pure=False): job
            for job in jobs
        }
        for future in as_completed(running, loop=client.loop):
            job = running[future]
            try:
                future.result()
            except CancelledError as error:  # of all that are left
                raise JobsError(
                    f"The Dask scheduler at {scheduler} has stopped. Start it again and repeat the "
                    "command, which continues with the remaining jobs."
                ) from error
            except Cancelled:
                raise
            except Exception as error:
                failed[job.name] = _worker_error(error, job)
            else:
                if _wait_until_done(job):
                    on_done(job.name)
                else:
                    failed[job.name] = JobsError(
                        f"A worker finished {job.name}, but its result is missing on this machine; "
                        "workers must share its folders."
                    )
            future.release()  # or Dask would do it again if this worker were lost
    finally:
        client.close(timeout=5)
    return failed


def _is_no_lost_connection(record: logging.LogRecord) -> bool:
    """Check that a line of Dask's log is not about a lost connection, which we report ourselves."""
    from distributed.comm.core import CommClosedError

    lost = (CommClosedError, OSError, TimeoutError, CancelledError, asyncio.CancelledError)
    error = record.exc_info[1] if record.exc_info else None
    return not (isinstance(error, lost) or str(record.msg).startswith(_RECONNECT_FAILED))


def _do(job: Job) -> None:
    """Do a job on a Dask worker."""
    import torch

    with _ONE_AT_A_TIME:
        torch.set_num_threads(1)
        job.run()


def _wait_until_done(job: Job) -> bool:
    until = time.monotonic() + RESULT_TIMEOUT_S
    while not job.is_done():
        if time.monotonic() > until:
            return False
        time.sleep(0.5)
    return True


def _worker_error(error: Exception, job: Job) -> Exception:
    from distributed import KilledWorker

    if isinstance(error, KilledWorker):
        return JobsError(
            f"Every worker that started {job.name} ended before finishing it; the workers' logs "
            "show why."
        )
    return error


if __name__ == "__main__":
    main()
