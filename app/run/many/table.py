"""Numbers of many clips told together: each measure with an interval over clips.

Intervals say how much the mean would vary with other clips of the same kind, not with other seeds
or speakers.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.findings.measure_rows import MEASURES
from model.storage.harmless import csv_text, markdown

if TYPE_CHECKING:
    from model.measures.faults.finding import Finding
    from model.measures.results import Measures

HEADER = (
    *("measure", "unit", "system", "clips", "mean", "low", "high"),
    *("difference_to", "difference", "difference_low", "difference_high"),
)


def numbers_of(raw: Measures, findings: Iterable[Finding]) -> dict[str, Any]:
    """What is kept of one motion, as it is, for the tables of all."""
    values = [row.read(raw) for row in MEASURES]
    return {
        "values": [
            None if value is None or not np.isfinite(value) else row.scale * float(value)
            for row, value in zip(MEASURES, values, strict=True)
        ],
        "findings": [finding.kind for finding in findings],
    }


def interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Mean over clips and its 95 % bootstrap interval; the mean alone for a single clip."""
    from model.evaluation.intervals import bootstrap

    found = bootstrap(values)
    return found.mean, found.low, found.high


def write_tables(
    out: Path, systems: list[str], clips: list[str], numbers: list[dict[str, Any]]
) -> tuple[Path, ...]:
    """Write ``many.csv``, ``many.json`` and ``sheet.md``.

    Args:
        numbers: of each clip, as `numbers_of` in ``systems`` by name.
    """
    rows = list(_rows(systems, numbers))
    table, sheet, content = out / "many.csv", out / "sheet.md", out / "many.json"
    table.write_text(csv_text([HEADER, *rows]), "utf-8", newline="")
    kinds = {
        name: Counter(kind for each in numbers for kind in set(each["systems"][name]["findings"]))
        for name in systems
    }
    named = [dict(zip(HEADER, row, strict=True)) for row in rows]
    findings = {name: dict(found.most_common()) for name, found in kinds.items()}
    told = {"clips": clips, "measures": named, "clips_with_finding": findings}
    content.write_text(json.dumps(told, indent=1, allow_nan=False) + "\n")
    sheet.write_text(_sheet(systems, len(clips), named, findings), "utf-8")
    return table, content, sheet


def _rows(systems: list[str], numbers: list[dict[str, Any]]) -> Iterator[tuple[Any, ...]]:
    for place, measure in enumerate(MEASURES):
        values = {
            name: [each["systems"][name]["values"][place] for each in numbers] for name in systems
        }
        title = f"{measure.group}: {measure.title}"
        for name in systems:
            known = [value for value in values[name] if value is not None]
            if not known:
                continue
            yield (title, measure.unit, name, len(known), *interval(known), *[""] * 4)
            for other in systems[systems.index(name) + 1 :]:
                pairs = [
                    a - b
                    for a, b in zip(values[name], values[other], strict=True)
                    if a is not None and b is not None
                ]
                if pairs:
                    difference = (other, *interval(pairs))
                    yield (title, measure.unit, name, len(pairs), "", "", "", *difference)


def _sheet(
    systems: list[str],
    clips: int,
    rows: list[dict[str, Any]],
    findings: dict[str, dict[str, int]],
) -> str:
    """Means with their intervals, a star where the paired difference to the last is not chance."""
    last = systems[-1]
    lines = [
        f"# {clips} clips",
        "",
        "Mean over clips [95 % bootstrap interval over clips], as generated, never filtered. `*`:"
        f" the interval of the paired difference to {markdown(last)} leaves out 0. Differences of"
        " all pairs are in `many.csv`.",
        "",
        "| measure | " + " | ".join(map(markdown, systems)) + " |",
        "|---|" + "---|" * len(systems),
    ]
    for title in dict.fromkeys(row["measure"] for row in rows):
        own = [row for row in rows if row["measure"] == title]
        unit = own[0]["unit"]
        cells = []
        for name in systems:
            by_other = {row["difference_to"]: row for row in own if row["system"] == name}
            mean, apart = by_other.get(""), by_other.get(last)
            star = apart and (apart["difference_low"] > 0 or apart["difference_high"] < 0)
            told = "n/a"
            if mean is not None:
                told = f"{mean['mean']:.3g} [{mean['low']:.3g}, {mean['high']:.3g}]"
            cells.append(f"{told}*" if star else told)
        lines.append(f"| {title}{f' ({unit})' if unit else ''} | " + " | ".join(cells) + " |")
    kinds = sorted({kind for found in findings.values() for kind in found})
    if kinds:
        lines += [
            "",
            "| clips with | " + " | ".join(map(markdown, systems)) + " |",
            "|---|" + "---|" * len(systems),
        ]
        for kind in kinds:
            counts = [str(findings[name].get(kind, 0)) for name in systems]
            lines.append(f"| {kind} | " + " | ".join(counts) + " |")
    return "\n".join(lines) + "\n"
