"""Many jobs, each done once: by processes of this machine, or by a cluster."""

import multiprocessing
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

from processes.cluster import do_by_cluster
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
        self, jobs: Sequence[Job], on_done: Callable[[str], None] = lambda name: None
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

    def _do_here(self, jobs: Sequence[Job], on_done: Callable[[str], None]) -> dict[str, Exception]:
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
        self, jobs: Sequence[Job], workers: int, on_done: Callable[[str], None]
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
        on_done: Callable[[str], None],
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
