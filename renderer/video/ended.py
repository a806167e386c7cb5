"""How a child process ended, told from what is known: its status, the last lines that it said, and
whether the system has ended processes for want of memory meanwhile.

As `model.jobs.ended` tells it, which this room does not know.
"""

import re
import signal
from pathlib import Path

NUM_LINES = 6
_MAX_LINE = 300
_FAULT = "Fatal Python error"
_THREAD = "Current thread"
_CRASHES = {"SIGSEGV", "SIGBUS", "SIGILL", "SIGFPE", "SIGABRT"}
_SAYS_MEMORY = re.compile(r"MemoryError|bad_alloc|[Cc]annot allocate memory")
_COUNTERS = ("/sys/fs/cgroup/memory.events", "/sys/fs/cgroup/memory/memory.oom_control")


def how_it_ended(status: int) -> str:
    """As the end of "it ended"."""
    if status >= 0:
        return f"with exit status {status}"
    return f"by signal {-status} ({signal_name(status)})"


def signal_name(status: int) -> str:
    try:
        return signal.Signals(-status).name
    except ValueError:  # one of the real-time ones
        return "no name"


def obituary(what: str, status: int, log: str, killed_before: int, is_driver: bool) -> str:
    """What happened to a process that draws, and what to do.

    Args:
        what: the process, as the beginning of a sentence.
        killed_before: what `memory_kills` said when it began.
        is_driver: whether it drew by an OpenGL driver, which is the first to be suspected.
    """
    lines = last_lines(log)
    told = f" Its last lines: {' | '.join(lines)}" if lines else ""
    name = signal_name(status) if status < 0 else ""
    if name == "SIGKILL" and memory_kills() > killed_before:
        return (
            f"{what} ended {how_it_ended(status)} for want of memory, as the system says; draw "
            f"smaller or fewer videos at once.{told}"
        )
    if name == "SIGKILL":
        return (
            f"{what} ended {how_it_ended(status)}. Somebody or something else killed it: the system"
            f" tells of no want of memory. Start it again.{told}"
        )
    if _SAYS_MEMORY.search(" ".join(lines)) and (status > 0 or name == "SIGABRT"):
        return (
            f"{what} ended {how_it_ended(status)} for want of memory, as its log says; draw smaller"
            f" or fewer videos at once.{told}"
        )
    if name in _CRASHES:
        suspect = "this is most likely the OpenGL driver" if is_driver else (
            "that is a fault of the program or of a library"
        )  # fmt: skip
        return (
            f"{what} crashed ({name}); {suspect}. Start it again, which is done by a fresh process;"
            f" if it happens again, report it{' with these lines' if lines else ''}.{told}"
        )
    if status < 0:
        return f"{what} ended {how_it_ended(status)}, which was sent to it; start it again.{told}"
    return (
        f"{what} ended {how_it_ended(status)}; if it happens again, report it"
        f"{' with these lines' if lines else ''}.{told}"
    )


def last_lines(log: str) -> tuple[str, ...]:
    """The few that tell most of an end: of a crash, what it was and where."""
    lines = [line.rstrip()[:_MAX_LINE] for line in log.splitlines()]
    lines = [line for line in lines if line and not line.startswith("Extension modules:")]
    faults = [number for number, line in enumerate(lines) if line.startswith(_FAULT)]
    if not faults:
        return tuple(lines[-NUM_LINES:])
    threads = [number for number, line in enumerate(lines) if line.startswith(_THREAD)]
    frames = lines[(threads[-1] if threads and threads[-1] > faults[-1] else faults[-1]) + 1 :]
    return tuple([*lines[: faults[-1] + 1][-2:], *frames][:NUM_LINES])


def memory_kills() -> int:
    """How many processes the system has ended for want of memory, in this control group or, where
    that does not count them, on this machine; 0 where neither tells."""
    for path in (*_own_counters(), *_COUNTERS, "/proc/vmstat"):
        try:
            found = re.search(r"^oom_kill (\d+)$", Path(path).read_text(), re.MULTILINE)
        except OSError:
            continue
        if found:
            return int(found[1])
    return 0


def _own_counters() -> list[str]:
    try:
        groups = Path("/proc/self/cgroup").read_text().splitlines()
    except OSError:
        return []
    found = []
    for controllers, group in (line.split(":", 2)[1:] for line in groups):
        if not controllers:
            found.append(f"/sys/fs/cgroup{group}/memory.events")
        elif "memory" in controllers.split(","):
            found.append(f"/sys/fs/cgroup/memory{group}/memory.oom_control")
    return found
