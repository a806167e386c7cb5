"""One queue of independent jobs, and who works it off.

A job leaves its result under a final name when it is whole, and that is the record that it is done:
whatever is killed, the same call goes on with what is not there yet. Nothing travels back but news.
"""

import multiprocessing
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

from model.jobs.ended import Ended, WorkerLog, log_to

MAX_BREAKS = 3
"""Worker processes that may end abruptly one after another without any job done between."""


class JobsError(RuntimeError):
    """The jobs cannot go on; the message is one sentence for a person."""


@dataclass(frozen=True)
class Job:
    """One piece of work. Both functions go to other processes, so they are importable, or
    `functools.partial` of what is."""

    name: str
    is_done: Callable[[], bool]
    """Whether its result is there, whole and of this very job. Asked where the work is done too."""
    work: Callable[[], object]
    """Leaves the result, whole or not at all."""

    def do(self) -> None:
        """The work, unless another worker has done it meanwhile."""
        if not self.is_done():
            self.work()


@dataclass(frozen=True)
class JobPool:
    """Who works."""

    processes: int | None = None
    """On this machine, one thread each; all cores by default. One works in the calling process."""
    scheduler: str | None = None
    """Address of a Dask scheduler, or the file that it leaves, whose workers see the same files;
    takes the place of processes."""

    def do_all(
        self, jobs: Sequence[Job], on_done: Callable[[str], None] = lambda name: None
    ) -> dict[str, Exception]:
        """Do every job that is not done yet; one that fails holds up no other.

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
            from model.jobs.cluster import do_by_cluster

            return do_by_cluster(waiting, self.scheduler, on_done)
        workers = min(self.processes or os.cpu_count() or 1, len(waiting))
        if workers == 1:
            return _do_here(waiting, on_done)
        return _do_by_processes(waiting, workers, on_done)


def _do_here(jobs: Sequence[Job], on_done: Callable[[str], None]) -> dict[str, Exception]:
    failed: dict[str, Exception] = {}
    for job in jobs:
        try:
            job.do()
        except Exception as error:
            failed[job.name] = error
        else:
            on_done(job.name)
    return failed


def _do_by_processes(
    jobs: Sequence[Job], workers: int, on_done: Callable[[str], None]
) -> dict[str, Exception]:
    """A worker that is killed takes its pool with it; another pool goes on with the rest."""
    failed: dict[str, Exception] = {}
    finished: set[str] = set()
    breaks = 0
    ended: Ended | None = None
    while rest := [job for job in jobs if job.name not in {*finished, *failed}]:
        before = len(finished) + len(failed)
        # A forked process would share torch's threads; a new one imports them.
        context = multiprocessing.get_context("spawn")
        others = multiprocessing.active_children()
        with (
            WorkerLog() as log,
            ProcessPoolExecutor(
                workers, mp_context=context, initializer=_begin_worker, initargs=(log.end,)
            ) as pool,
        ):
            running = {pool.submit(job.do): job.name for job in rest}
            started = [each for each in multiprocessing.active_children() if each not in others]
            is_broken = False
            try:
                for future in as_completed(running):
                    name = running[future]
                    try:
                        future.result()
                    except BrokenProcessPool:
                        is_broken = True
                    except SystemExit as error:
                        failed[name] = JobsError(
                            f"{name} left its worker process with exit status {error.code}; that "
                            "is a fault of the program, which please report."
                        )
                    except Exception as error:
                        failed[name] = error
                    else:
                        finished.add(name)
                        on_done(name)
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                for worker in started:
                    worker.terminate()
                raise
            if is_broken:
                pool.shutdown()
                ended = log.ended(started)
        is_further = len(finished) + len(failed) > before
        breaks = 0 if is_further else breaks + 1
        if breaks == MAX_BREAKS and ended is not None:
            told = ended.sentences(
                "The last one", "use fewer processes", "give the same command again"
            )
            raise JobsError(
                f"Worker processes ended {MAX_BREAKS} times before any got its work done; what is "
                f"done is kept. {told}"
            )
    return failed


def _begin_worker(log: Connection) -> None:
    log_to(log)
    use_one_thread()
    parent = multiprocessing.parent_process()
    if parent is not None:  # without it nobody would ever end this process
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)


def use_one_thread() -> None:
    """For torch: workers stand side by side, and numbers do not depend on how many cores there
    are."""
    import torch

    torch.set_num_threads(1)
