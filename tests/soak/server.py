"""The real server in a process of its own, what it takes, and how its clock is put forward."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.helpers import ROOT
from tests.waiting import wait_for

AHEAD_S = 3700
"""What SIGUSR1 puts the server's clock forward by."""
_START = f"""
import signal, sys, time
from dataclasses import replace

ahead, now = 0, time.time
def put_forward(*_):
    global ahead
    ahead = {AHEAD_S}
time.time = lambda: now() + ahead
signal.signal(signal.SIGUSR1, put_forward)

from app.page import launch
parse, keep_s = launch.parse_config, float(sys.argv.pop(1))
launch.parse_config = lambda argv: replace(parse(argv), result_lifetime_s=keep_s)
launch.main()
"""


@dataclass(frozen=True)
class Server:
    """A page that is open."""

    address: str
    process: subprocess.Popen[str]
    temp: Path
    log: Path

    def memory(self) -> int:
        """Bytes in memory of the server and of all its children."""
        return sum(_resident(pid) for pid in _family(self.process.pid))

    def open_files(self) -> int:
        """Files, sockets and pipes that the server itself holds open."""
        return len(os.listdir(f"/proc/{self.process.pid}/fd"))

    def left(self) -> list[Path]:
        """Every file that lies below its folder, but for locks."""
        return [path for path in self.temp.rglob("*") if path.is_file() and path.name != ".lock"]

    def left_bytes(self) -> int:
        return sum(path.stat().st_size for path in self.left())

    def put_clock_forward(self) -> None:
        """By `AHEAD_S`, once."""
        self.process.send_signal(signal.SIGUSR1)


@contextmanager
def server(folder: Path, keep_s: float) -> Iterator[Server]:
    """``python app.py``, once its first example is drawn, which keeps results for so long."""
    temp, kept, log = folder / "temp", folder / "kept", folder / "log"
    temp.mkdir()
    environment = {**os.environ, "TMPDIR": str(temp), "XDG_CACHE_HOME": str(kept)}
    with log.open("w") as told:
        process = subprocess.Popen(
            [sys.executable, "-c", _START, str(keep_s), "--port", "0"],
            cwd=ROOT,
            env=environment,
            stderr=told,
            text=True,
        )
    try:
        wait_for(lambda: "open at" in log.read_text() or process.poll() is not None)
        assert process.poll() is None, "the server did not start"
        address = log.read_text().split("open at ")[1].split()[0]
        yield Server(address, process, temp, log)
        assert "Traceback" not in log.read_text(), log.read_text()
    finally:
        process.terminate()
        process.wait(30)


def _family(first: int) -> list[int]:
    """A process and all that descend from it."""
    parents: dict[int, int] = {}
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            after_name = status.read_text().rpartition(") ")[2]
        except OSError:
            continue  # it has ended
        parents[int(status.parent.name)] = int(after_name.split()[1])
    family = [first]
    for pid in family:
        family += [child for child, parent in parents.items() if parent == pid]
    return family


def _resident(pid: int) -> int:
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0  # it has ended
    return pages * os.sysconf("SC_PAGE_SIZE")
