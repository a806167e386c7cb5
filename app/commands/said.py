"""What commands say: sentences and progress on standard error, files for a script on standard
output."""

from __future__ import annotations

import io
import logging
import sys
from pathlib import Path

from conventions.names import printable


def say(sentence: str) -> None:
    """One line for a person."""
    sys.stderr.write(f"{printable(sentence)}\n")


def name_file(path: Path) -> None:
    """One line for a script, which gets the very name; a terminal gets what it does not obey."""
    out = sys.stdout
    if isinstance(out, io.TextIOWrapper):
        out.reconfigure(errors="surrogateescape")  # a name may be no text at all
    out.write(f"{printable(str(path)) if out.isatty() else path}\n")
    out.flush()


class LogLines(logging.Formatter):
    """Lines of the log that no terminal obeys."""

    def format(self, record: logging.LogRecord) -> str:
        return "\n".join(map(printable, super().format(record).split("\n")))
