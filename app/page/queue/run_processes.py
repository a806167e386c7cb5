"""Visitors' runs in processes of their own, with limits of memory, time and silence.

A process reads its models once and is kept for the next run. It is ended when a visitor cancels
and it does not hear that at once, when it takes too long or says nothing new for long, and when a
run has left it much larger than it was. The process of a run that has stepped aside
(`app.page.queue.jobs`) works while the others leave it a core, and is not kept.
"""

from __future__ import annotations

import os
import queue
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.errors import CancelledRun, RunError
from app.run.requests.request import (
    Artefact,
    Event,
    GenerateRequest,
    OnEvent,
    Progress,
    ShouldCancel,
)
from processes.child import Child, Gone

if TYPE_CHECKING:
    from app.run.diagnose import DiagnoseRequest
    from app.run.examples import FirstLook
    from app.run.experiments.hearing import Hearing, HearingRequest
    from app.run.experiments.mechanism import MechanismRequest
    from app.run.experiments.step_curve import StepCurve, StepCurveRequest
    from app.run.many.sets import Sets, SetsRequest
    from app.run.requests.upload_check import UploadKind
    from app.run.takes.take import Take, TakeRequest
    from app.run.videos.behind import VideosRequest
    from app.run.videos.seen_video import SeenRequest, SeenVideo
    from app.study.make.workspace import ExportOptions, Workspace


GRACE_S = 1.0
"""How long a process may go on after it was told to stop."""
GROWN_BYTES = 10**9
"""A process that is larger by this than before its run is not kept."""
HEARD = True
"""Sent back for a file that has been told of: only then may the child move it."""
_POLL_S = 0.05
_LEAST_URGENT = 19
"""Niceness: gets a seventieth of what others get where both want the same core."""
_PATIENCE = 4.0
"""So many times as long a run that has stepped aside may be silent."""

TOO_LONG = (
    "This run took longer than the {minutes:.0f} minutes that a run may take here; ask for less."
)
SILENT = (
    "This run had stopped getting on and was ended after {seconds:.0f} s; start it again, and if "
    "that happens again, ask for less."
)
ENDED = "The process of this run"
FOR_MEMORY = "a run may take {gigabytes:.1f} GB here, so ask for less"
AGAIN = "start it again, which is done by a fresh process"


@dataclass(frozen=True)
class Limits:
    """Of one run."""

    memory_bytes: int = 4 * 10**9
    """Above what the process has before it."""
    seconds: float = 2 * 3600.0
    silent_s: float = 240.0
    """Without any progress."""


class FaultInRunProcess(RuntimeError):
    """A fault of the program in a run's process, with its traceback."""


class RunProcesses:
    """Does runs, as many at once as there are processes. Safe to use from several threads."""

    def __init__(
        self,
        num_processes: int = 1,
        limits: Limits = Limits(),
        warm: tuple[Path, Path | None] | None = None,
        num_aside: int = 0,
    ) -> None:
        """
        Args:
            num_processes: that are ready for runs.
            warm: weights and body that every process reads before its first run; None reads what a
                run needs when it needs it.
            num_aside: more processes, started when they are needed; then the runs that began first
                have stepped aside.
        """
        self._num_ready = num_processes
        self._limits = limits
        self._warm = warm
        self._is_closed = False
        self._free: queue.LifoQueue[_Process | None] = queue.LifoQueue()
        self._all: set[_Process] = set()
        self._busy: list[_Process] = []
        """Whose run began first stands first."""
        for _ in range(num_processes + num_aside):
            self._free.put(None)

    def generate(
        self, request: GenerateRequest, on_event: OnEvent, should_cancel: ShouldCancel
    ) -> None:
        """As `app.run.pipeline.generate_all`; all of it is in the run's folder."""
        self.do("generate", (request,), on_event, should_cancel)

    def diagnose(
        self,
        request: DiagnoseRequest,
        on_share: Callable[[float], None],
        on_event: OnEvent = lambda event: None,
    ) -> None:
        """As `app.run.many.opened.diagnose_opened`; all of it is in the run's folder."""
        self._with_shares("diagnose", (request,), on_share, on_event)

    def measure_sets(self, request: SetsRequest, on_share: Callable[[float], None]) -> Sets:
        """As `app.run.many.sets.measure_sets`."""
        return self._with_shares("measure_sets", (request,), on_share)

    def draw_behind(
        self, request: VideosRequest, on_event: OnEvent, should_cancel: ShouldCancel
    ) -> tuple[Path, ...]:
        """As `app.run.videos.behind.draw_behind`."""
        return self.do("draw_behind", (request,), on_event, should_cancel)

    def draw_seen(
        self, request: SeenRequest, on_event: OnEvent, should_cancel: ShouldCancel
    ) -> SeenVideo:
        """As `app.run.videos.seen_video.draw_seen`."""
        return self.do("draw_seen", (request,), on_event, should_cancel)

    def make_take(
        self, request: TakeRequest, on_event: OnEvent, should_cancel: ShouldCancel
    ) -> Take:
        """As `app.run.takes.take.make_take`."""
        return self.do("make_take", (request,), on_event, should_cancel)

    def show_mechanism(
        self,
        request: MechanismRequest,
        on_share: Callable[[float], None],
        on_event: OnEvent = lambda event: None,
    ) -> tuple[Path | None, tuple[str, ...]]:
        """As `app.run.experiments.mechanism.show_mechanism`."""
        return self._with_shares("show_mechanism", (request,), on_share, on_event)

    def make_first_look(self, look: FirstLook, weights: Path) -> None:
        """As `app.run.examples.make_first_look`."""
        self._with_shares("make_first_look", (look, weights), lambda share: None)

    def measure_steps(
        self, request: StepCurveRequest, on_share: Callable[[float], None]
    ) -> StepCurve:
        """As `app.run.experiments.step_curve.measure_step_curve`."""
        return self._with_shares("measure_steps", (request,), on_share)

    def measure_hearing(
        self, request: HearingRequest, on_share: Callable[[float], None]
    ) -> Hearing:
        """As `app.run.experiments.hearing.measure_hearing`."""
        return self._with_shares("measure_hearing", (request,), on_share)

    def export_study(
        self,
        plan: Path,
        out: Path,
        options: ExportOptions,
        on_event: OnEvent,
        should_cancel: ShouldCancel,
    ) -> Workspace:
        """As `app.study.export.export_study`, of the plan in a file."""
        return self.do("export_study", (plan, out, options), on_event, should_cancel)

    def analyse_study(
        self,
        answers: list[Path],
        key: Path,
        out: Path,
        on_event: OnEvent,
        should_cancel: ShouldCancel,
    ) -> tuple[Path, ...]:
        """As `app.study.analyse.analyse`; returns the files written, the report first."""
        return self.do("analyse_study", (answers, key, out), on_event, should_cancel)

    def refuse(self, kind: UploadKind, paths: Sequence[Path], max_speech_s: float) -> str:
        """As `app.run.requests.upload_check.refusal_of`."""
        arguments = (kind, paths, max_speech_s)
        return self.do("refuse", arguments, lambda event: None, lambda: False)

    def start(self) -> None:
        """Start all processes, so that the first visitors need not wait for that."""
        for process in [self._fit(self._free.get()) for _ in range(self._num_ready)]:
            self._free.put(process)

    def do(
        self, task: str, arguments: tuple[Any, ...], on_event: OnEvent, should_cancel: ShouldCancel
    ) -> Any:
        """Do one of the tasks of `app.page.queue.run_process_child`.

        Raises:
            CancelledRun: within about a second of ``should_cancel`` saying so.
            RunError: with the sentence of what went wrong, or the limit that was met.
            FaultInRunProcess: for a fault of the program.
        """
        process = self._free.get()
        try:
            if should_cancel():
                raise CancelledRun
            process = self._fit(process)
            work = (task, arguments)
            self._busy.append(process)
            return process.do(work, self._limits, on_event, should_cancel, self._is_aside)
        finally:
            if process in self._busy:
                self._busy.remove(process)
            is_fit = process is not None and process.is_fit()
            num_ready = len(self._all) - (len(self._busy) if is_fit else 0)
            if self._is_closed or num_ready > self._num_ready:
                self._drop(process)
                process = None
            elif process is not None and not is_fit:
                # At once: the next visitor should find its models read.
                process = self._fit(process)
            self._free.put(process)

    def close(self) -> None:
        """End all processes."""
        self._is_closed = True
        for process in list(self._all):
            self._drop(process)

    def _is_aside(self, process: _Process) -> bool:
        return process in self._busy[: -self._num_ready]

    def _fit(self, process: _Process | None) -> _Process:
        """This one, or another in its place."""
        if process is not None and process.is_fit():
            return process
        self._drop(process)
        process = _Process(self._warm)
        self._all.add(process)
        return process

    def _drop(self, process: _Process | None) -> None:
        if process is not None:
            process.child.end()
            self._all.discard(process)

    def _with_shares(
        self,
        task: str,
        arguments: tuple[Any, ...],
        on_share: Callable[[float], None],
        on_event: OnEvent = lambda event: None,
    ) -> Any:
        """``on_share`` ends the run by raising CancelledRun, which it must be asked for."""
        share = 0.0

        def take(event: Event) -> None:
            nonlocal share
            if isinstance(event, Progress):
                share = event.fraction
            else:
                on_event(event)

        def should_cancel() -> bool:
            try:
                on_share(share)
            except CancelledRun:
                return True
            return False

        return self.do(task, arguments, take, should_cancel)


class _Process:
    """One child, and what it was like at first."""

    def __init__(self, warm: tuple[Path, Path | None] | None) -> None:
        needed = (str(path) for path in warm or () if path is not None)
        self.child = Child("app.page.queue.run_process_child", *needed, is_log_handed_on=True)
        self._is_idle = True
        self._is_last = False
        self._grown = 0

    def is_fit(self) -> bool:
        """Whether it can take another run."""
        is_urgent = not self._is_last  # it cannot be made so again
        is_small = self._grown < GROWN_BYTES
        return self._is_idle and is_urgent and is_small and self.child.is_alive()

    def do(
        self,
        work: tuple[str, tuple[Any, ...]],
        limits: Limits,
        on_event: OnEvent,
        should_cancel: ShouldCancel,
        is_aside: Callable[[_Process], bool],
    ) -> Any:
        self._is_idle = False
        self.child.forget()
        started = told_at = time.monotonic()
        news: object = None
        stop_by: float | None = None
        try:
            self.child.send((*work, limits.memory_bytes))
            while True:
                now = time.monotonic()
                if stop_by is None and should_cancel():
                    stop_by = now + GRACE_S
                    self.child.send(None)
                if not self._is_last and is_aside(self):
                    self._come_last()
                if stop_by is not None and now > stop_by:
                    raise CancelledRun
                if now - started > limits.seconds:
                    raise RunError(TOO_LONG.format(minutes=limits.seconds / 60))
                silent_s = limits.silent_s * (_PATIENCE if self._is_last else 1)
                if now - told_at > silent_s:
                    raise RunError(SILENT.format(seconds=silent_s))
                if not self.child.has_message(_POLL_S):
                    continue
                kind, value = self.child.receive()
                if kind != "event":
                    self._is_idle = True
                    return self._outcome(kind, value)
                if value != news:
                    news, told_at = value, now
                on_event(value)
                if isinstance(value, Artefact):
                    self.child.send(HEARD)
        except Gone as error:
            if stop_by is not None:
                raise CancelledRun from error
            allowed = FOR_MEMORY.format(gigabytes=limits.memory_bytes / 1e9)
            raise RunError(self.child.ended().sentences(ENDED, allowed, AGAIN)) from error

    def _outcome(self, kind: str, value: Any) -> Any:
        if kind == "done":
            result, self._grown = value
            return result
        if kind == "cancelled":
            raise CancelledRun
        if kind == "sentence":
            raise RunError(value)
        raise FaultInRunProcess(value)

    def _come_last(self) -> None:
        """Work only while nobody else wants to. What draws a video for it draws that to its end."""
        self._is_last = True
        try:
            os.setpriority(os.PRIO_PGRP, self.child.pid, _LEAST_URGENT)
        except ProcessLookupError:
            return  # it has ended, as is seen next
