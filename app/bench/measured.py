"""A measured number, and what is measured in processes of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from app.config import PROJECT

START_TIMEOUT_S = 60.0


@dataclass(frozen=True)
class Figure:
    """One measured number beside what was aimed at."""

    name: str
    value: float
    unit: str
    aim: str = ""
    cpu: float | None = None
    """The same by CPU time, which a busy machine disturbs less."""

    def line(self) -> str:
        cpu = "" if self.cpu is None else f"(CPU {self.cpu:.2f})"
        return f"{self.name:<44} {self.value:>9.2f} {self.unit:<9} {cpu:<14} {self.aim}".rstrip()


def peak_mb(*arguments: str) -> float:
    """Peak memory of Python with these arguments, or of a process it starts if that is more."""
    command, nowhere = [sys.executable, *arguments], subprocess.DEVNULL
    child = subprocess.Popen(command, cwd=PROJECT, stdout=nowhere, stderr=nowhere)
    _, status, usage = os.wait4(child.pid, 0)
    if status:
        raise RuntimeError(f"It failed: {' '.join(command)}")
    return usage.ru_maxrss / 1024  # kilobytes on Linux


@contextmanager
def served_page(weights: Path, folder: Path) -> Iterator[str]:
    """The address of a page that has just been started, as on a fresh machine."""
    address = "http://127.0.0.1:7899/"
    started = time.monotonic()
    with tempfile.TemporaryDirectory(dir=folder) as fresh:
        page = subprocess.Popen(
            [sys.executable, "app.py", "--port", "7899", "--weights", str(weights.resolve())],
            cwd=PROJECT,
            env={**os.environ, "TMPDIR": fresh, "XDG_CACHE_HOME": fresh},
            stdout=subprocess.DEVNULL,  # nothing stands between the rows
            stderr=subprocess.DEVNULL,
        )
        try:
            while True:
                try:
                    urllib.request.urlopen(address, timeout=5).read()
                    break
                except (urllib.error.URLError, ConnectionError) as error:
                    if time.monotonic() - started > START_TIMEOUT_S or page.poll() is not None:
                        raise RuntimeError("The page did not start.") from error
                    time.sleep(0.05)
            yield address
        finally:
            page.terminate()
            page.wait()
