"""Tables of metrics over many clips, with intervals over clips, and the figure of distributions.

Intervals show how the mean would vary with other similar clips, not with other seeds or speakers.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.findings import metric_table
from app.findings.comparison import format_finding_kinds
from app.findings.metric_table import JERK, METRICS, TITLES, Metric
from app.findings.verdict import MIN_CLIPS_FOR_CLAIM
from app.run.output.run_folder import BATCH_TABLES
from conventions.names import REFERENCE_NAME
from model.metrics.protocols.table import WORKBENCH, protocol_of
from model.storage.escaping import csv_text, escape_latex, escape_markdown

if TYPE_CHECKING:
    from model.metrics.results import BeatSpeedSource

NUM_WORST = 10
"""Maximum number of worst clips of a system that are listed."""
CellsByMetric = dict[str, list[str]]
"""Table cells of all systems by metric."""
ClipsBySystem = dict[str, list[tuple[str, dict[str, Any]]]]
"""Clips with their records by system."""
Row = tuple[Any, ...]
OTHER_PROTOCOLS = f"Rows that name no protocol follow this program's own, {WORKBENCH}."
HEADER = (
    *("measure", "unit", "system", "clips", "mean", "low", "high"),
    *("difference_to", "difference", "difference_low", "difference_high", "protocol"),
)


def average_samples(samples: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Average the samples of a clip: means, standard deviations (``spread``) and common findings.

    Common findings are those of at least half of the samples.
    """
    if len(samples) == 1:
        return dict(samples[0])
    values_by_metric = {
        row.key: [each["numbers"][row.key] for each in samples if row.key in each["numbers"]]
        for row in METRICS
    }
    counts = Counter(kind for each in samples for kind in set(each["findings"]))
    return {
        "numbers": {
            key: float(np.mean(values)) for key, values in values_by_metric.items() if values
        },
        "spread": {
            key: float(np.std(values, ddof=1))
            for key, values in values_by_metric.items()
            if len(values) > 1
        },
        "samples": len(samples),
        "findings": [kind for kind, count in counts.items() if 2 * count >= len(samples)],
        "sha256": [each["sha256"] for each in samples],
    }


def mean_with_interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Compute the mean over clips with its 95 % bootstrap interval, which a single clip lacks."""
    from model.evaluation.tables import bootstrap_mean

    estimate = bootstrap_mean(values)
    return estimate.mean, estimate.low, estimate.high


def write_tables(
    out: Path,
    systems: list[str],
    records: Mapping[str, dict[str, Any]],
    notes: Sequence[str] = (),
    left_out: Mapping[str, str] | None = None,
    *,
    origin: Mapping[str, Any] | None = None,
    extra_rows: Iterable[Row] = (),
    speeds: BeatSpeedSource = "own",
    lines_below: Sequence[str] = (),
) -> tuple[tuple[Path, ...], dict[str, Any]]:
    """Write ``batch.csv``, ``batch.json``, ``clips.csv``, ``summary.md`` and ``table.tex``.

    Args:
        records: records by clip, with the raw ``numbers`` (keys of `METRICS`) and the ``findings``
            of each of the ``systems``.
        left_out: reasons by omitted clip.
        speeds: source of the mean speeds of BeatAlign.
        lines_below: Markdown lines below the tables of ``summary.md``.

    Returns:
        The files, and the content of ``batch.json``.
    """
    left_out = left_out or {}
    of_systems = {
        name: [(clip, each["systems"][name]) for clip, each in records.items()] for name in systems
    }
    rows = [*_rows(of_systems, speeds), *extra_rows]
    findings = {
        name: dict(Counter(kind for _, each in of for kind in set(each["findings"])).most_common())
        for name, of in of_systems.items()
    }
    results: dict[str, Any] = {
        "clips": list(records),
        "measures": [dict(zip(HEADER, row, strict=True)) for row in rows],
        "clips_with_finding": findings,
        "worst": worst_clips(of_systems),
        "notes": list(notes),
        "left_out": dict(left_out),
    } | ({} if origin is None else {"provenance": dict(origin)})
    means = format_cells(systems, results["measures"])
    sheet = [
        *_sheet(systems, results, means),
        *_worst_lines(results["worst"]),
        *_spread_lines(of_systems),
        *lines_below,
    ]
    contents = {
        "batch.csv": csv_text([HEADER, *rows]),
        "batch.json": json.dumps(results, indent=1, allow_nan=False) + "\n",
        "clips.csv": csv_text(_clip_rows(of_systems, left_out, speeds)),
        "summary.md": "\n".join(sheet) + "\n",
        "table.tex": _latex(systems, len(records), means),
    }
    for name, content in contents.items():
        (out / name).write_text(content, "utf-8", newline="")
    return tuple(out / name for name in BATCH_TABLES), results


def _clip_rows(
    of_systems: ClipsBySystem, left_out: Mapping[str, str], speeds: BeatSpeedSource
) -> Iterator[tuple[Any, ...]]:
    """Yield the header, a row for each clip of each system, and one for each omitted clip."""
    keys = [row.key for row in METRICS]
    rest = [(key, protocol) for key in keys if (protocol := protocol_of(key, speeds)) != WORKBENCH]
    protocols = "; ".join([WORKBENCH, *(f"{key} {protocol}" for key, protocol in rest)])
    yield ("clip", "system", "findings", *keys, "left out because", "protocols")
    for name, clips in of_systems.items():
        for clip, record in clips:
            values = [record["numbers"].get(key) for key in keys]
            findings = "; ".join(dict.fromkeys(record["findings"]))
            yield (clip, name, findings, *values, "", protocols)
    for clip, why in left_out.items():
        yield (clip, "", "", *[""] * len(keys), why, "")


def worst_clips(of_systems: ClipsBySystem) -> list[dict[str, Any]]:
    """Return the worst clips of each system, by kinds of findings, then by jerk.

    ``jerk`` is the mean of the tracked point in m/s^3, or None if it is not comparable.
    """

    def badness(each: dict[str, Any]) -> tuple[int, float]:
        return len(each["kinds"]), each["jerk"] or 0.0

    worst: list[dict[str, Any]] = []
    for name, clips in of_systems.items():
        if name == REFERENCE_NAME:
            continue
        faulty = [
            {"system": name, "clip": clip, "kinds": kinds, "jerk": record["numbers"].get(JERK)}
            for clip, record in clips
            if (kinds := list(dict.fromkeys(record["findings"])))
        ]
        worst += sorted(faulty, key=badness, reverse=True)[:NUM_WORST]
    return sorted(worst, key=badness, reverse=True)


def _worst_lines(worst: Sequence[Mapping[str, Any]]) -> list[str]:
    if not worst:
        return []
    rows = (
        map(
            escape_markdown,
            (
                of["system"],
                of["clip"],
                format_finding_kinds(of["kinds"]),
                metric_table.format_three_digits(of["jerk"]),
            ),
        )
        for of in worst
    )
    title = (
        f"Clips with the most kinds of findings first, at most {NUM_WORST} per system; "
        "ties are ordered by jerk"
    )
    (unit,) = (row.unit for row in METRICS if row.key == JERK)
    table = _grid(("system", "clip", "findings", f"jerk ({unit})"), rows)
    return ["", f"{title}. All clips are in `clips.csv`.", "", *table]


def _grid(head: Iterable[str], rows: Iterable[Iterable[str]]) -> list[str]:
    """Format a Markdown table; the cells of its rows must be escaped."""
    titles = [escape_markdown(title) for title in head]
    lines = [f"| {' | '.join(cells)} |" for cells in (titles, *rows)]
    return [lines[0], "|" + "---|" * len(titles), *lines[1:]]


def _spread_lines(of_systems: ClipsBySystem) -> list[str]:
    """Format the standard deviations between samples of one clip, if there are any."""
    spreads = {
        name: [record["spread"] for _, record in clips if "spread" in record]
        for name, clips in of_systems.items()
    }
    spreads = {name: of for name, of in spreads.items() if of}
    rows = []
    for row in METRICS:
        by_metric = [[each[row.key] for each in of if row.key in each] for of in spreads.values()]
        if any(by_metric):
            cells = (
                metric_table.format_three_digits(float(np.mean(each)) if each else None)
                for each in by_metric
            )
            rows.append((title_with_unit(row), *cells))
    title = "Standard deviation between the samples of a clip, averaged over clips."
    return ["", title, "", *_grid(("measure", *spreads), rows)] if spreads else []


def _latex(systems: list[str], clips: int, means: CellsByMetric) -> str:
    lines = [
        "% Needs \\usepackage{booktabs}. Means with 95 % bootstrap intervals over "
        f"{clips} clips. {OTHER_PROTOCOLS} {star_legend(systems, clips)}",
        f"\\begin{{tabular}}{{l{'c' * len(systems)}}}",
        "\\toprule",
        " & ".join(["Measure", *map(escape_latex, systems)]) + " \\\\",
        "\\midrule",
        *(
            " & ".join([escape_latex(title), *map(escape_latex, cells)]) + " \\\\"
            for title, cells in means.items()
        ),
        "\\bottomrule",
        "\\end{tabular}",
    ]
    return "\n".join(lines) + "\n"


def _rows(of_systems: ClipsBySystem, speeds: BeatSpeedSource) -> Iterator[Row]:
    """Yield the mean of each system and the differences of all pairs, by metric."""
    for measure in METRICS:
        values = {
            name: np.array([record["numbers"].get(measure.key, np.nan) for _, record in clips])
            for name, clips in of_systems.items()
        }
        for place, (name, own) in enumerate(values.items()):
            finite = own[~np.isnan(own)]
            if not len(finite):
                continue
            head, protocol = (measure.key, measure.unit, name), protocol_of(measure.key, speeds)
            yield (*head, len(finite), *mean_with_interval(finite.tolist()), *[""] * 4, protocol)
            for other in list(values)[place + 1 :]:
                pairs = own - values[other]
                pairs = pairs[~np.isnan(pairs)]
                if len(pairs):
                    yield (
                        *head,
                        len(pairs),
                        "",
                        "",
                        "",
                        other,
                        *mean_with_interval(pairs.tolist()),
                        protocol,
                    )


def format_cells(systems: list[str], rows: list[dict[str, Any]]) -> CellsByMetric:
    """Format means with their intervals, and stars as explained by `star_legend`.

    Values of different protocols are never in one row; the title names all but the workbench's own.
    """
    cells_by_title: CellsByMetric = {}
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["measure"], row["protocol"]), []).append(row)
    for (key, protocol), own in groups.items():
        cells = [_cell(own, name, systems[-1]) for name in systems]
        title = _with_unit(TITLES.get(str(key), str(key)), own[0]["unit"])
        is_named = protocol == WORKBENCH or str(key).startswith(protocol)
        cells_by_title[title if is_named else f"{title} · {protocol}"] = cells
    return cells_by_title


def star_legend(systems: Sequence[str], clips: int) -> str:
    """Return the explanation of stars; with few clips there are none."""
    if clips < MIN_CLIPS_FOR_CLAIM:
        return f"Differences are starred only with {MIN_CLIPS_FOR_CLAIM} clips or more."
    return (
        f"* Differs from {systems[-1]}: the 95 % confidence interval of the paired difference "
        "excludes 0."
    )


def _cell(rows: list[dict[str, Any]], name: str, last: str) -> str:
    by_other = {row["difference_to"]: row for row in rows if row["system"] == name}
    mean, apart = by_other.get(""), by_other.get(last)
    if mean is None:
        return "n/a"
    is_sure = apart and (apart["difference_low"] > 0 or apart["difference_high"] < 0)
    star = is_sure and by_other[last]["clips"] >= MIN_CLIPS_FOR_CLAIM
    text = metric_table.format_mean_with_interval(mean["mean"], mean["low"], mean["high"])
    return f"{text}{'*' if star else ''}"


def _sheet(systems: list[str], results: Mapping[str, Any], means: CellsByMetric) -> list[str]:
    findings = results["clips_with_finding"]
    out = [f"{clip} was left out: {why}" for clip, why in results["left_out"].items()]
    noted = [f"- {escape_markdown(note)}" for note in (*results["notes"], *out)]
    lines = [
        f"# {len(results['clips'])} clips",
        "",
        *noted,
        *([""] if noted else []),
        "Mean over clips [95 % bootstrap interval over clips] of unfiltered motion."
        f" {escape_markdown(star_legend(systems, len(results['clips'])))} {OTHER_PROTOCOLS}"
        " Differences between all pairs of systems are in `batch.csv`.",
        "",
        *_grid(("measure", *systems), ((title, *cells) for title, cells in means.items())),
    ]
    kinds = sorted({kind for by_kind in findings.values() for kind in by_kind})
    if kinds:
        counts = (
            (format_finding_kinds([kind]), *(str(findings[name].get(kind, 0)) for name in systems))
            for kind in kinds
        )
        lines += ["", *_grid(("clips with", *systems), counts)]
    return lines


MIN_CLIPS_FOR_DISTRIBUTION = 5
"""Minimum number of clips of a distribution figure."""


def draw_distribution_figure(
    out: Path, systems: list[str], numbers: list[dict[str, Any]], speeds: BeatSpeedSource = "own"
) -> tuple[tuple[Path, ...], list[str]]:
    """Draw ``distributions.png`` in all formats, and return the files with notes.

    ``numbers`` are values of the records of `write_tables`.
    """
    if len(numbers) < MIN_CLIPS_FOR_DISTRIBUTION:
        return (), []
    from pandas import DataFrame

    from renderer.figures.curves import DISTRIBUTIONS_CAPTION, draw_cumulative_distributions
    from renderer.figures.style import MAX_SYSTEMS, save_figure

    generated = [name for name in systems if name != REFERENCE_NAME]
    left_out = generated[MAX_SYSTEMS:]
    shown = [name for name in systems if name not in left_out]
    values = DataFrame(
        [
            (_with_unit(f"{row.title}{_point_suffix(row)}", row.unit), name, value)
            for row in METRICS
            if row.is_primary
            for name in shown
            for each in numbers
            if (value := each["systems"][name]["numbers"].get(row.key)) is not None
        ],
        columns=["measure", "system", "value"],
    )
    if values.empty:
        return (), []
    draw = partial(draw_cumulative_distributions, values, shown, REFERENCE_NAME)
    beat_protocol = protocol_of("beat_align", speeds)
    sentence = f"Metrics follow protocol {WORKBENCH}; BeatAlign follows {beat_protocol}."
    files = save_figure(draw, out / "distributions", f"{DISTRIBUTIONS_CAPTION} {sentence}")
    if not left_out:
        return tuple(files), []
    return tuple(files), [
        f"distributions.png shows at most {MAX_SYSTEMS} systems and leaves out "
        f"{', '.join(left_out)}."
    ]


def _point_suffix(row: Metric) -> str:
    return " of the tracked point" if row.key.startswith("tracked_point") else ""


def title_with_unit(row: Metric) -> str:
    return _with_unit(row.full_title, row.unit)


def _with_unit(title: str, unit: str) -> str:
    return f"{title} ({unit})" if unit else title
