"""Log of child processes, and diagnosis of how one ended.

It uses the status, the last lines and the kernel's count of out-of-memory kills.
"""

import re
import signal
import sys
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from conventions.names import printable

NUM_LINES = 8
_MAX_LINE = 300
_CGROUPS = Path("/sys/fs/cgroup")
_OUT_OF_MEMORY = re.compile(
    r"MemoryError|bad_alloc|[Cc]annot allocate memory|can't allocate memory|not enough memory"
)
_CRASH = "Fatal Python error"
_THREAD = "Current thread"
"""Start of a thread's traceback in the report of Python's faulthandler."""
_SKIPPED_LINES = ("Extension modules:", "<no Python frame>")
CRASHES = {
    *(signal.SIGSEGV, signal.SIGBUS, signal.SIGILL, signal.SIGFPE),
    *(signal.SIGABRT, signal.SIGSYS, signal.SIGTRAP),
}
"""Signals that a process gets for a fault in its code."""
_PROGRAM_FAULT_NOTE = "This is a bug in the program or a library, not a problem with your input."


@dataclass(frozen=True)
class ExitReport:
    """Result of a child process that has ended."""

    status: int | None
    """Exit status, or minus the signal's number; None if unknown."""
    log_lines: tuple[str, ...] = ()
    """Last lines of its log."""
    had_memory_kill_nearby: bool = False
    """True if the kernel killed any process for lack of memory since its start or `clear_log`."""

    @property
    def signal(self) -> signal.Signals | None:
        if self.status is None or self.status >= 0:
            return None
        try:
            return signal.Signals(-self.status)
        except ValueError:  # a real-time signal
            return None

    @property
    def was_out_of_memory(self) -> bool:
        """True if memory ran out by the kernel's count, or by the log of a process at its limit."""
        if self.signal == signal.SIGKILL:
            return self.had_memory_kill_nearby
        is_by_itself = self.status is None or self.status > 0 or self.signal == signal.SIGABRT
        return is_by_itself and any(_OUT_OF_MEMORY.search(line) for line in self.log_lines)

    @property
    def exit_text(self) -> str:
        """Text that continues "it ended", such as "with exit status 1"."""
        if self.status is None:
            return "with an unknown exit status"
        if self.status >= 0:
            return f"with exit status {self.status}"
        name = self.signal.name if self.signal else "unknown"
        return f"by signal {-self.status} ({name})"

    def user_message(
        self,
        subject: str,
        memory_advice: str,
        retry_advice: str,
        likely_cause: str = _PROGRAM_FAULT_NOTE,
    ) -> str:
        """Format what happened and what to do, with the last lines of the log.

        Args:
            subject: the process, as the beginning of a sentence.
            memory_advice: what to do if it lacked memory.
            likely_cause: a sentence on the most likely cause of a crash.
        """
        if self.was_out_of_memory:
            source = "the system" if self.signal == signal.SIGKILL else "its log"
            why = f"because it ran out of memory (according to {source})"
            return f"{subject} ended {self.exit_text} {why}; {memory_advice}.{self._lines()}"
        if self.signal == signal.SIGKILL:
            why = "Another program killed it; the system reports no lack of memory."
            return (
                f"{subject} ended {self.exit_text}. {why} {_capital(retry_advice)}.{self._lines()}"
            )
        if self.signal is not None and self.signal not in CRASHES:
            why = "which another program sent"
            return f"{subject} ended {self.exit_text}, {why}; {retry_advice}.{self._lines()}"
        why = likely_cause if self.signal is not None else _PROGRAM_FAULT_NOTE
        report = (
            "report it with these lines" if self.log_lines else "report it; its log has no lines"
        )
        advice = f"{_capital(retry_advice)}; if it happens again, {report}."
        return f"{subject} ended {self.exit_text}. {why} {advice}{self._lines()}"

    def _lines(self) -> str:
        return f" Its last lines: {' | '.join(self.log_lines)}" if self.log_lines else ""


def _capital(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]


def informative_log_lines(log: str) -> tuple[str, ...]:
    """Return the most informative lines of a log.

    For a crash these are the lines before it and its traceback.
    """
    lines = [printable(line.rstrip())[:_MAX_LINE] for line in log.splitlines()]
    lines = [line for line in lines if line and not line.strip().startswith(_SKIPPED_LINES)]
    crashes = [number for number, line in enumerate(lines) if line.startswith(_CRASH)]
    if not crashes:
        return tuple(lines[-NUM_LINES:])
    crash = crashes[-1]
    threads = [number for number, line in enumerate(lines) if line.startswith(_THREAD)]
    frames = lines[(threads[-1] if threads and threads[-1] > crash else crash) + 1 :]
    before = lines[: crash + 1][-3:]
    # If several processes write at once, another's lines may separate the cause from the crash.
    why = [line for line in lines[:crash] if _OUT_OF_MEMORY.search(line) and line not in before][
        -1:
    ]
    return tuple((why + before + frames)[:NUM_LINES])


def count_out_of_memory_kills() -> int:
    """Count the out-of-memory kills in this control group, or else on this machine (or 0)."""
    for path in (*_counters(), Path("/proc/vmstat")):
        try:
            text = path.read_text()
        except OSError:
            continue
        match = re.search(r"^oom_kill (\d+)$", text, re.MULTILINE)
        if match:
            return int(match[1])
    return 0


def _counters() -> Iterator[Path]:
    """Yield counter files of both cgroup versions; a container may hide the group's own path."""
    try:
        groups = Path("/proc/self/cgroup").read_text().splitlines()
    except OSError:
        return
    for line in groups:
        _, controllers, group = line.split(":", 2)
        top, name = _CGROUPS, "memory.events"
        if controllers:
            top, name = _CGROUPS / "memory", "memory.oom_control"
        if not controllers or "memory" in controllers.split(","):
            yield from dict.fromkeys((top / group.lstrip("/") / name, top / name))


_MAX_LINES, _PATIENCE_S = 200, 1.0


class ChildLog:
    """Buffer of the last lines that children write."""

    def __init__(self, stream: IO[bytes], is_handed_on: bool) -> None:
        """Start a thread that reads the stream."""
        self._stream = stream
        self._is_handed_on = is_handed_on
        self._last_lines: deque[str] = deque(maxlen=_MAX_LINES)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def clear(self) -> None:
        """Discard the lines so far, before a new task."""
        self._last_lines.clear()

    def lines(self) -> tuple[str, ...]:
        """Return the last lines of a child that has ended."""
        self._reader.join(_PATIENCE_S)
        return informative_log_lines("\n".join(list(self._last_lines)))

    def _read(self) -> None:
        with self._stream:
            for line in iter(self._stream.readline, b""):
                text = line.decode(errors="replace").rstrip("\r\n")
                self._last_lines.append(text)
                if self._is_handed_on:
                    with suppress(OSError, ValueError):  # nobody reads it any more
                        sys.stderr.write(f"{text}\n")
