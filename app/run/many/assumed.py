"""What the files of sets were understood as, counted, and where sets differ in it.

Sets of which one was filled in from fewer frames, or has still hands, are compared in what both
have; what one lacks is left out of its numbers, and told above them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from app.findings.measure_rows import MEASURES

if TYPE_CHECKING:
    from model.formats.reading import Reading

LACKS = {
    "detail": "was filled in from fewer frames a second",
    "finger_angles": "has hands whose mean is not known",
    "hands": "has hands that never move",
    "place": "says nothing of where the body stands",
    "legs": "has no legs",
}
"""Of a set that lacks some part, what to say of it."""


@dataclass(frozen=True)
class Assumed:
    """Of one set."""

    files: int
    counted: Mapping[tuple[str, str], int]
    """By what and value, in how many files; what is as in our own files is not told."""
    why: Mapping[tuple[str, str], str]
    lacks: Mapping[str, int]
    """By part, how many files lack it."""


def assumed_in(reading: Reading) -> dict[str, Any]:
    """What is kept of one file."""
    told = [each for each in reading.assumptions if not each.is_usual]
    return {
        "said": [[each.kind, each.value, each.why] for each in told],
        "lacks": sorted(reading.lacks),
    }


def without_what_lacks(values: Sequence[float | None], lacks: Iterable[str]) -> list[float | None]:
    """Values of `MEASURES`, none of those that need a part that is not there."""
    lacks = set(lacks)
    return [
        None if row.needs in lacks else value for row, value in zip(MEASURES, values, strict=True)
    ]


def assumed_of(systems: Iterable[str], numbers: Iterable[dict[str, Any]]) -> dict[str, Assumed]:
    """By set, of all records of clips."""
    numbers = list(numbers)
    found = {}
    for name in systems:
        files = [file for each in numbers for file in each["systems"][name]["assumed"]]
        said = [(kind, value, why) for file in files for kind, value, why in file["said"]]
        found[name] = Assumed(
            len(files),
            Counter((kind, value) for kind, value, _ in said),
            {(kind, value): why for kind, value, why in reversed(said)},
            Counter(part for file in files for part in file["lacks"]),
        )
    return found


def assumed_lines(assumed: Mapping[str, Assumed]) -> list[str]:
    """``mine: up z in 40 of 40: …``, the most frequent first."""
    return [
        f"{name}: {kind} {value} in {count} of {each.files}: {each.why[kind, value]}."
        for name, each in assumed.items()
        for (kind, value), count in sorted(each.counted.items(), key=lambda pair: -pair[1])
    ]


def apart_of(assumed: Mapping[str, Assumed]) -> list[str]:
    """A sentence for whatever some sets lack, with what is left out for it, and for whatever was
    assumed of some alone."""
    told = []
    for part, what in LACKS.items():
        some = [name for name, each in assumed.items() if each.lacks.get(part)]
        titles = [row.title for row in MEASURES if row.needs == part]
        for name in some:
            count, files = assumed[name].lacks[part], assumed[name].files
            of = "" if count == files else f" in {count} of {files} files"
            out = f": {', '.join(titles)} say nothing of it and are left out" if titles else ""
            told.append(f"{name} {what}{of}{out}.")
    kinds = dict.fromkeys(kind for each in assumed.values() for kind, _ in each.counted)
    for kind in kinds:
        of_sets = {
            name: {value for other, value in each.counted if other == kind}
            for name, each in assumed.items()
        }
        if len({frozenset(values) for values in of_sets.values()}) > 1:
            said = "; ".join(
                f"{name} {', '.join(sorted(values)) or 'as ours are'}"
                for name, values in of_sets.items()
            )
            told.append(f"The sets differ in {kind}: {said}.")
    return told
