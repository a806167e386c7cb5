"""What the files of sets were understood as, counted, and where sets differ in it.

Sets of which one was filled in from fewer frames are compared in what both have; what one lacks is
left out of its numbers, and told above them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any

from app.findings.measure_rows import MEASURES
from model.formats.read import LACKS, Reading

Counts = Mapping[str, Counter[tuple[str, str]]]
"""By set, in how many files what was assumed had which value."""


def assumed_in(reading: Reading) -> dict[str, Any]:
    """What is kept of one file: what is not as in our own files, and what it lacks."""
    told = [each for each in reading.assumptions if not each.is_usual]
    return {
        "said": [[each.kind, each.value, each.why] for each in told],
        "lacks": sorted(reading.lacks),
    }


def without_what_lacks(numbers: Mapping[str, float], lacks: Collection[str]) -> dict[str, float]:
    """By the keys of `MEASURES`, none of those that need a part that is not there."""
    needs = {row.key: row.needs for row in MEASURES}
    return {key: value for key, value in numbers.items() if needs[key] not in lacks}


def told_above(systems: Iterable[str], numbers: Sequence[dict[str, Any]]) -> list[str]:
    """Sentences of all records of clips: what sets lack, what they differ in, and, the most
    frequent first, ``mine: up z in 40 of 40``."""
    files = {
        name: [file for each in numbers for file in each["systems"][name]["assumed"]]
        for name in systems
    }
    told = [each for of_set in files.values() for file in of_set for each in file["said"]]
    why = {(kind, value): because for kind, value, because in reversed(told)}
    counts: Counts = {
        name: Counter((kind, value) for file in of_set for kind, value, _ in file["said"])
        for name, of_set in files.items()
    }
    counted = [
        f"{name}: {kind} {value} in {count} of {len(files[name])}: {why[kind, value]}."
        for name, many in counts.items()
        for (kind, value), count in many.most_common()
    ]
    return [*_lacking(files), *_apart(counts), *counted]


def _lacking(files: Mapping[str, Sequence[Mapping[str, Any]]]) -> Iterator[str]:
    for part, (what, _) in LACKS.items():
        if part == "face":  # is counted
            continue
        titles = [row.title for row in MEASURES if row.needs == part]
        out = f": {', '.join(titles)} say nothing of it and are left out" if titles else ""
        for name, of_set in files.items():
            count = sum(part in file["lacks"] for file in of_set)
            some = "" if count == len(of_set) else f" in {count} of {len(of_set)} files"
            if count:
                yield f"{name} {what}{some}{out}."


def _apart(counts: Counts) -> Iterator[str]:
    for kind in dict.fromkeys(kind for many in counts.values() for kind, _ in many):
        values = {
            name: ", ".join(sorted(value for other, value in many if other == kind))
            for name, many in counts.items()
        }
        if len(set(values.values())) > 1:
            said = "; ".join(f"{name} {told or 'as ours are'}" for name, told in values.items())
            yield f"The sets differ in {kind}: {said}."
