"""Names of motions and samples in files and on pages, and formatting of lists and counts."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

REFERENCE_NAME = "reference"
"""Name of the recorded motion that systems are compared with."""

FilterVersion = Literal["raw", "savgol"]
"""Version of a motion: unfiltered, or smoothed by a Savitzky-Golay filter."""
FILTER_VERSIONS: tuple[FilterVersion, ...] = get_args(FilterVersion)
PostFilter = Literal["none", "savgol"]
"""Filter that is applied to motions before they are shown."""
POST_FILTERS: tuple[PostFilter, ...] = get_args(PostFilter)


def version_after_post_filter(post_filter: PostFilter) -> FilterVersion:
    """Return the version of a motion after a post-filter."""
    return "savgol" if post_filter == "savgol" else "raw"


_LATER_SAMPLE = re.compile(r"(?P<system>.+)\.s(?P<number>[2-9]|[1-9][0-9]+)")


@dataclass(frozen=True)
class SampleName:
    """Name of a system's sample: the system's name for the first, later with ``.s2`` and so on."""

    system: str
    number: int = 1

    @classmethod
    def parse(cls, name: str) -> SampleName:
        """Parse the name's most likely meaning; a system may also be called ``other.s2``."""
        later = _LATER_SAMPLE.fullmatch(name)
        return cls(later["system"], int(later["number"])) if later else cls(name)

    def __str__(self) -> str:
        return self.system if self.number == 1 else f"{self.system}.s{self.number}"


COMPARISON = "comparison"
"""Stem of the video of all motions of a run side by side; no motion's files have this name."""
MAX_STEM_BYTES = 200
"""Longest stem in bytes; disks allow 255, including the suffix and an unfinished file's mark."""


def safe_file_stem(name: str) -> str:
    """Return a file name without its suffix for any name.

    For example ``globaldiff-local`` for ``globaldiff/local``. The result leads to no other folder,
    is not hidden, printable, and short enough for a disk. Two names may have one stem; see
    `app.run.output.run_folder.check_distinct_file_stems`.
    """
    stem = re.sub(r"[/\\]", "-", printable(name)).strip()
    stem = re.sub(r"^\.+", "_", stem).rstrip(" .") or "_"
    if len(stem.encode()) > MAX_STEM_BYTES:
        stem = f"{stem[:40]}-{hashlib.sha256(stem.encode()).hexdigest()[:8]}"
    return f"{stem}_" if stem == COMPARISON else stem


def printable(text: str) -> str:
    """Replace control and format characters, such as escapes and reversals of direction, by "?"."""
    return "".join(char if char.isprintable() else "?" for char in text)


def join_names(items: Sequence[str]) -> str:
    """Format items as "a, b and c"."""
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"


def pluralise(count: int, noun: str) -> str:
    """Format a count as "1 noun" or "2 nouns"."""
    return f"{count} {noun}{'s' * (count != 1)}"


def short_names(systems: Iterable[str]) -> dict[str, str]:
    """Return each system's name after its slash, if that is not a number and is unique."""
    systems = list(systems)
    ends = [name.rsplit("/", 1)[-1] for name in systems]
    return {
        name: end if ends.count(end) == 1 and not end.isdigit() else name
        for name, end in zip(systems, ends, strict=True)
    }
