"""What motions are called, as files and pages tell them apart."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

REFERENCE_NAME = "reference"
"""The recorded motion beside the systems."""

Version = Literal["raw", "savgol"]
"""A motion as it is, or behind the Savitzky-Golay filter."""
VERSIONS: tuple[Version, ...] = get_args(Version)
PostFilter = Literal["none", "savgol"]
"""What is done to motions before they are shown."""
POST_FILTERS: tuple[PostFilter, ...] = get_args(PostFilter)

_LATER_SAMPLE = re.compile(r"(?P<system>.+)\.s(?P<number>[2-9]|[1-9][0-9]+)")


@dataclass(frozen=True)
class SampleName:
    """The name of one sample of a system: the system's own for the first, ``.s2`` and on after
    it."""

    system: str
    number: int = 1

    @classmethod
    def parse(cls, name: str) -> SampleName:
        """What a name most likely stands for; a system may be called ``other.s2``, too."""
        later = _LATER_SAMPLE.fullmatch(name)
        return cls(later["system"], int(later["number"])) if later else cls(name)

    def __str__(self) -> str:
        return self.system if self.number == 1 else f"{self.system}.s{self.number}"


COMPARISON = "comparison"
"""Stem of the video of all motions of a run side by side; no motion's files are called so."""
MAX_STEM_BYTES = 200
"""Disks take 255, and an ending and the mark of an unfinished file are added."""


def file_stem(name: str) -> str:
    """Return a file name without its suffix for any name: ``globaldiff-local`` for
    ``globaldiff/local``.

    The result leads to no other folder, is not hidden, printable, and short enough for a disk. Two
    names may have one stem; see `app.run.output.run_folder.check_file_stems`.
    """
    stem = re.sub(r"[/\\]", "-", printable(name)).strip()
    stem = re.sub(r"^\.+", "_", stem).rstrip(" .") or "_"
    if len(stem.encode()) > MAX_STEM_BYTES:
        stem = f"{stem[:40]}-{hashlib.sha256(stem.encode()).hexdigest()[:8]}"
    return f"{stem}_" if stem == COMPARISON else stem


def printable(text: str) -> str:
    """With ? for what a terminal would obey, what turns the text around, and what no file of text
    can hold."""
    return "".join(char if char.isprintable() else "?" for char in text)


def listed(items: Sequence[str]) -> str:
    """a, b and c."""
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"


def counted(count: int, noun: str) -> str:
    """1 noun, 2 nouns."""
    return f"{count} {noun}{'s' * (count != 1)}"


def short_names(systems: Iterable[str]) -> dict[str, str]:
    """Each system's name after its slash, where that is a word and no other's too."""
    systems = list(systems)
    ends = [name.rsplit("/", 1)[-1] for name in systems]
    return {
        name: end if ends.count(end) == 1 and not end.isdigit() else name
        for name, end in zip(systems, ends, strict=True)
    }
