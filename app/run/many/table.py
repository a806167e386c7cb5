"""Numbers of many clips told together: intervals over clips, and the figure of their spread.

Intervals say how much the mean would vary with other clips of the same kind, not with other seeds
or speakers.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from app.findings.comparison import kinds_told
from app.findings.measure_rows import JERK, MEASURES, Measure, written
from app.findings.verdict import ENOUGH_CLIPS
from app.run.many.distances import distance_rows
from app.run.output.run_folder import TABLES
from conventions.names import REFERENCE_NAME
from model.storage.harmless import csv_text, markdown, tex

NUM_WORST = 10
"""Clips of a system that are named."""
Cells = dict[str, list[str]]
"""By measure, what is told of each system."""
OfSystems = dict[str, list[tuple[str, dict[str, Any]]]]
"""By system, each clip and what is kept of it."""
Row = tuple[Any, ...]
HEADER = (
    *("measure", "unit", "system", "clips", "mean", "low", "high"),
    *("difference_to", "difference", "difference_low", "difference_high"),
)


def mean_of_samples(told: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """What is kept of a clip: of each measure the mean over samples, and in ``spread`` their
    standard deviation; of findings those that half of the samples have; what they share, put
    together."""
    if len(told) == 1:
        return dict(told[0])
    known = {
        row.key: [each["numbers"][row.key] for each in told if row.key in each["numbers"]]
        for row in MEASURES
    }
    counts = Counter(kind for each in told for kind in set(each["findings"]))
    codes = [each["codes"] for each in told]
    return {
        "numbers": {key: float(np.mean(values)) for key, values in known.items() if values},
        "spread": {
            key: float(np.std(values, ddof=1)) for key, values in known.items() if len(values) > 1
        },
        "samples": len(told),
        "findings": [kind for kind, count in counts.items() if 2 * count >= len(told)],
        "codes": {
            "count": sum(each["count"] for each in codes),
            **{
                key: np.sum([each[key] for each in codes], axis=0).tolist()
                for key in ("total", "products")
            },
        },
        "sha256": [each["sha256"] for each in told],
    }


def interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Mean over clips and its 95 % bootstrap interval; the mean alone for a single clip."""
    from model.evaluation.tables import bootstrap

    found = bootstrap(values)
    return found.mean, found.low, found.high


@dataclass(frozen=True)
class Above:
    """What stands above the numbers, and which clips are not in them."""

    notes: Sequence[str] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)
    """By clip, why."""


def write_tables(
    out: Path,
    systems: list[str],
    clips: list[str],
    numbers: list[dict[str, Any]],
    origin: Mapping[str, Any] | None = None,
    more: Iterable[Row] = (),
    above: Above | None = None,
) -> tuple[Path, ...]:
    """Write ``many.csv``, ``many.json``, ``clips.csv``, ``sheet.md`` and ``table.tex``.

    Args:
        numbers: of each clip in ``systems`` by name the ``numbers`` of its motion as it is, by the
            keys of `MEASURES`, and its ``findings`` by kind.
        origin: where they come from.
        more: rows of measures that are taken of whole sets.
    """
    above = above or Above()
    rows = [*_rows(systems, numbers), *distance_rows(systems, numbers), *more]
    table, content, by_clip, sheet, paper = (out / name for name in TABLES)
    table.write_text(csv_text([HEADER, *rows]), "utf-8", newline="")
    kinds = {
        name: Counter(kind for each in numbers for kind in set(each["systems"][name]["findings"]))
        for name in systems
    }
    named = [dict(zip(HEADER, row, strict=True)) for row in rows]
    findings = {name: dict(found.most_common()) for name, found in kinds.items()}
    of_systems = {
        name: [(clip, each["systems"][name]) for clip, each in zip(clips, numbers, strict=True)]
        for name in systems
    }
    worst = worst_clips(of_systems)
    told = {
        "clips": clips,
        "measures": named,
        "clips_with_finding": findings,
        "worst": [asdict(each) for each in worst],
        "notes": list(above.notes),
        "left_out": dict(above.left_out),
    }
    told |= {"provenance": dict(origin)} if origin is not None else {}
    content.write_text(json.dumps(told, indent=1, allow_nan=False) + "\n")
    by_clip.write_text(csv_text(_clip_rows(of_systems, above.left_out)), "utf-8", newline="")
    means = cells_of(systems, named)
    texts = [*_sheet(systems, len(clips), means, findings, above), *_worst_lines(worst)]
    texts += _spread_lines(systems, numbers)
    sheet.write_text("\n".join(texts) + "\n", "utf-8")
    paper.write_text(_latex(systems, len(clips), means), "utf-8")
    return table, content, by_clip, sheet, paper


def _clip_rows(of_systems: OfSystems, left_out: Mapping[str, str]) -> Iterator[tuple[Any, ...]]:
    """A header, a row for each clip of each system, and one for each that is left out."""
    titles = [titled(row) for row in MEASURES]
    yield ("clip", "system", "findings", *titles, "left out because")
    for name, clips in of_systems.items():
        for clip, told in clips:
            values = [told["numbers"].get(row.key) for row in MEASURES]
            yield (clip, name, "; ".join(dict.fromkeys(told["findings"])), *values, "")
    for clip, why in left_out.items():
        yield (clip, "", "", *[""] * len(titles), why)


@dataclass(frozen=True)
class WorstClip:
    """A clip of a system in which something stands out."""

    system: str
    clip: str
    kinds: list[str]
    """Of findings."""
    jerk: float
    """Mean of the followed point's, m/s^3."""


def worst_clips(of_systems: OfSystems) -> list[WorstClip]:
    """Those with most kinds of findings; of equal ones, the jerkiest first."""

    def badness(each: WorstClip) -> tuple[int, float]:
        return len(each.kinds), each.jerk

    found: list[WorstClip] = []
    for name, clips in of_systems.items():
        if name == REFERENCE_NAME:
            continue
        faulty = [
            WorstClip(name, clip, kinds, told["numbers"].get(JERK, 0.0))
            for clip, told in clips
            if (kinds := list(dict.fromkeys(told["findings"])))
        ]
        found += sorted(faulty, key=badness, reverse=True)[:NUM_WORST]
    return sorted(found, key=badness, reverse=True)


def _worst_lines(worst: list[WorstClip]) -> list[str]:
    if not worst:
        return []
    rows = (
        map(markdown, (each.system, each.clip, kinds_told(each.kinds), written(each.jerk)))
        for each in worst
    )
    title = f"Clips with most findings, at most {NUM_WORST} of each; of equal ones, the jerkiest"
    (unit,) = (row.unit for row in MEASURES if row.key == JERK)
    table = _grid(("system", "clip", "findings", f"jerk ({unit})"), rows)
    return ["", f"{title} first. All are in `clips.csv`.", "", *table]


def _grid(head: Iterable[str], rows: Iterable[Iterable[str]]) -> list[str]:
    """A table of Markdown; the cells of its rows are harmless."""
    titles = [markdown(title) for title in head]
    lines = [f"| {' | '.join(cells)} |" for cells in (titles, *rows)]
    return [lines[0], "|" + "---|" * len(titles), *lines[1:]]


def _spread_lines(systems: list[str], numbers: list[dict[str, Any]]) -> list[str]:
    """How far samples of one clip lie apart, where there are some."""
    told = {name: [each["systems"][name] for each in numbers] for name in systems}
    several = [name for name in systems if any("spread" in each for each in told[name])]
    if not several:
        return []
    rows = []
    for row in MEASURES:
        spreads = [
            [each["spread"][row.key] for each in told[name] if row.key in each.get("spread", ())]
            for name in several
        ]
        if any(spreads):
            cells = (written(float(np.mean(each)) if each else None) for each in spreads)
            rows.append((titled(row), *cells))
    title = "How far samples of one clip lie apart: their standard deviation, mean over clips."
    return ["", title, "", *_grid(("measure", *several), rows)]


def _latex(systems: list[str], clips: int, means: Cells) -> str:
    lines = [
        "% Needs \\usepackage{booktabs}. Means, 95 % bootstrap intervals over "
        f"{clips} clips. {star_told(systems, clips)}",
        f"\\begin{{tabular}}{{l{'c' * len(systems)}}}",
        "\\toprule",
        " & ".join(["Measure", *map(tex, systems)]) + " \\\\",
        "\\midrule",
        *(" & ".join([tex(title), *map(tex, cells)]) + " \\\\" for title, cells in means.items()),
        "\\bottomrule",
        "\\end{tabular}",
    ]
    return "\n".join(lines) + "\n"


def _rows(systems: list[str], numbers: list[dict[str, Any]]) -> Iterator[tuple[Any, ...]]:
    for measure in MEASURES:
        title = measure.key
        values = {
            name: [each["systems"][name]["numbers"].get(title) for each in numbers]
            for name in systems
        }
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


def cells_of(systems: list[str], rows: list[dict[str, Any]]) -> Cells:
    """Means with their intervals, and stars as of `star_told`."""
    told: Cells = {}
    for title in dict.fromkeys(row["measure"] for row in rows):
        own = [row for row in rows if row["measure"] == title]
        cells = [_cell(own, name, systems[-1]) for name in systems]
        told[_with_unit(title, own[0]["unit"])] = cells
    return told


def star_told(systems: Sequence[str], clips: int) -> str:
    """What a star is; few clips are no evidence, and have none."""
    if clips < ENOUGH_CLIPS:
        return f"With fewer than {ENOUGH_CLIPS} clips no difference is starred."
    return f"* the interval of the paired difference to {systems[-1]} leaves out 0."


def _cell(rows: list[dict[str, Any]], name: str, last: str) -> str:
    by_other = {row["difference_to"]: row for row in rows if row["system"] == name}
    mean, apart = by_other.get(""), by_other.get(last)
    if mean is None:
        return "n/a"
    is_sure = apart and (apart["difference_low"] > 0 or apart["difference_high"] < 0)
    star = is_sure and by_other[last]["clips"] >= ENOUGH_CLIPS
    told, low, high = (written(mean[key]) for key in ("mean", "low", "high"))
    return f"{told} [{low}, {high}]{'*' if star else ''}"


def _sheet(
    systems: list[str],
    clips: int,
    means: Cells,
    findings: dict[str, dict[str, int]],
    above: Above,
) -> list[str]:
    out = [f"Left out: {clip}: {why}" for clip, why in above.left_out.items()]
    noted = [f"- {markdown(note)}" for note in (*above.notes, *out)]
    lines = [
        f"# {clips} clips",
        "",
        *noted,
        *([""] if noted else []),
        "Mean over clips [95 % bootstrap interval over clips], as generated, never filtered."
        f" {markdown(star_told(systems, clips))} Differences of all pairs are in `many.csv`.",
        "",
        *_grid(("measure", *systems), ((title, *cells) for title, cells in means.items())),
    ]
    kinds = sorted({kind for found in findings.values() for kind in found})
    if kinds:
        counts = (
            (kinds_told([kind]), *(str(findings[name].get(kind, 0)) for name in systems))
            for kind in kinds
        )
        lines += ["", *_grid(("clips with", *systems), counts)]
    return lines


LEAST_CLIPS = 5
"""A spread of fewer says nothing."""


def draw_spread(
    out: Path, systems: list[str], numbers: list[dict[str, Any]]
) -> tuple[tuple[Path, ...], list[str]]:
    """Write ``distributions.png`` and beside it; files and what must be said of them.

    Args:
        numbers: as of `write_tables`.
    """
    if len(numbers) < LEAST_CLIPS:
        return (), []
    from pandas import DataFrame

    from renderer.figures.curves import distributions_figure
    from renderer.figures.style import SYSTEM_STYLES

    generated = [name for name in systems if name != REFERENCE_NAME]
    left_out = generated[len(SYSTEM_STYLES) :]
    shown = [name for name in systems if name not in left_out]
    values = DataFrame(
        [
            (_with_unit(f"{row.title}{_whose(row)}", row.unit), name, value)
            for row in MEASURES
            if row.is_first
            for name in shown
            for each in numbers
            if (value := each["systems"][name]["numbers"].get(row.key)) is not None
        ],
        columns=["measure", "system", "value"],
    )
    if values.empty:
        return (), []
    files = distributions_figure(values, shown, out / "distributions", REFERENCE_NAME)
    if not left_out:
        return tuple(files), []
    return tuple(files), [f"distributions.png leaves out {', '.join(left_out)}: too many systems."]


def _whose(row: Measure) -> str:
    return " of the point" if row.group == "Followed point" else ""


def titled(row: Measure) -> str:
    """Its key and its unit."""
    return _with_unit(row.key, row.unit)


def _with_unit(title: str, unit: str) -> str:
    return f"{title} ({unit})" if unit else title
