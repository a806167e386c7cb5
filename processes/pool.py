"""Many jobs, each done once: by processes of this machine, or by a Dask cluster whose workers see
the same files. Dask is no requirement of this project; see ``requirements-cluster.txt``."""

import asyncio
import logging
import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

from processes.ended import WorkerLog, log_to
from processes.job import Job, JobsError, use_one_thread

MAX_BREAKS = 3
"""Worker processes that may end abruptly one after another without any job done between."""

_BROKEN = (
    f"Worker processes ended {MAX_BREAKS} times before any got its work done; what is done is kept."
)
_LAST, _FEWER, _AGAIN = "The last one", "use fewer processes", "give the same command again"


@dataclass(frozen=True)
class JobPool:
    """Who works."""

    processes: int | None = None
    """On this machine, one thread each; all cores by default. One works in the calling process."""
    scheduler: str | None = None
    """Address of a Dask scheduler, or the file that it leaves, whose workers see the same files;
    takes the place of processes."""
    uses_torch: bool = True
    """Torch is held to one thread, for which every worker imports it."""
    is_patient: bool = True
    """A job that fails holds up no other; else its error is raised at once, but by a cluster."""

    def do_all(
        self, jobs: Sequence[Job], on_done: Callable[[str], object] = lambda name: None
    ) -> dict[str, Exception]:
        """Do every job that is not done yet.

        Args:
            on_done: told the name of each job as it gets done, in any order.

        Returns:
            What the failed ones raised, by name.

        Raises:
            JobsError: if workers die again and again, or the cluster cannot be reached or is gone.
                What is done stays done.
        """
        waiting = [job for job in jobs if not job.is_done()]
        if not waiting:
            return {}
        if self.scheduler is not None:
            return do_by_cluster(waiting, self.scheduler, on_done)
        workers = min(self.processes or os.cpu_count() or 1, len(waiting))
        if workers == 1:
            return self._do_here(waiting, on_done)
        return self._do_by_processes(waiting, workers, on_done)

    def _do_here(
        self, jobs: Sequence[Job], on_done: Callable[[str], object]
    ) -> dict[str, Exception]:
        failed: dict[str, Exception] = {}
        for job in jobs:
            try:
                job.do()
            except Exception as error:
                if not self.is_patient:
                    raise
                failed[job.name] = error
            else:
                on_done(job.name)
        return failed

    def _do_by_processes(
        self, jobs: Sequence[Job], workers: int, on_done: Callable[[str], object]
    ) -> dict[str, Exception]:
        """A worker that is killed takes its pool with it; another pool goes on with the rest."""
        failed: dict[str, Exception] = {}
        finished: set[str] = set()
        breaks = 0
        while rest := [job for job in jobs if job.name not in {*finished, *failed}]:
            before = len(finished) + len(failed)
            # A forked process would share torch's threads; a new one imports them.
            context = multiprocessing.get_context("spawn")
            begin = partial(_begin_worker, uses_torch=self.uses_torch)
            with (
                WorkerLog() as log,
                ProcessPoolExecutor(workers, context, begin, (log.end,)) as pool,
            ):
                others = multiprocessing.active_children()
                running = {pool.submit(job.do): job.name for job in rest}
                started = [each for each in multiprocessing.active_children() if each not in others]
                try:
                    is_broken = self._gather(running, failed, finished, on_done)
                except BaseException:
                    pool.shutdown(wait=False, cancel_futures=True)
                    for worker in started:
                        worker.terminate()
                    raise
                if not is_broken:
                    continue
                pool.shutdown()
                ended = log.ended(started)
            breaks = 0 if len(finished) + len(failed) > before else breaks + 1
            if breaks == MAX_BREAKS:
                raise JobsError(f"{_BROKEN} {ended.sentences(_LAST, _FEWER, _AGAIN)}")
        return failed

    def _gather(
        self,
        running: Mapping[Future[None], str],
        failed: dict[str, Exception],
        finished: set[str],
        on_done: Callable[[str], object],
    ) -> bool:
        """Returns whether a worker has ended meanwhile."""
        is_broken = False
        for future in as_completed(running):
            name = running[future]
            try:
                future.result()
            except BrokenProcessPool:
                is_broken = True
            except (SystemExit, Exception) as error:
                failed[name] = _left(name, error) if isinstance(error, SystemExit) else error
                if not self.is_patient:
                    raise failed[name] from None
            else:
                finished.add(name)
                on_done(name)
        return is_broken


def _left(name: str, end: SystemExit) -> JobsError:
    return JobsError(
        f"{name} left its worker process with exit status {end.code}; that is a fault of the "
        "program, which please report."
    )


def _begin_worker(log: Connection, uses_torch: bool) -> None:
    log_to(log)
    if uses_torch:
        use_one_thread()
    parent = multiprocessing.parent_process()
    if parent is not None:  # without it nobody would ever end this process
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)


CONNECT_S = 30
SEEN_WITHIN_S = 30.0
"""Until a result that a worker has written must be seen here, on a shared disk."""
_TELL_OF_LOSS = ("distributed.client", "distributed.core", "distributed.utils")
_GIVEN_UP = "Failed to reconnect to scheduler"
"""Loggers of Dask that print tracebacks when a scheduler is lost, or this."""
_ONE_AT_A_TIME = threading.Lock()
"""Of a worker with several threads: jobs are made for processes."""


def do_by_cluster(
    jobs: Sequence[Job], scheduler: str, on_done: Callable[[str], object]
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
                    f"The Dask scheduler at {scheduler} is gone; start one again and give the same "
                    "command, which goes on with what is not done."
                ) from error
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
