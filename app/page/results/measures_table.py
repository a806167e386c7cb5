"""The table of all measures as HTML: every number raw and filtered, one switch for both.

app/page/web/measures.js turns the switch and saves the CSV.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import groupby
from typing import Literal

from app import text
from app.findings.comparison import point_title
from app.findings.measure_rows import MEASURES, Measure, Numbers, nearest, signed, written
from app.page.parts import markup
from app.run.output.run_folder import RunRecord, Told
from conventions.names import REFERENCE_NAME, VERSIONS, Version, short_names


@dataclass(frozen=True)
class Column:
    """One motion of a table, or how far two of them lie apart."""

    name: str
    label: str
    """What its head says."""
    numbers: Numbers
    kind: Literal["", "reference", "difference"] = ""

    def read(self, measure: Measure, version: Version) -> float | None:
        return self.numbers[version].get(measure.key)

    def less(self, other: Column, name: str, label: str) -> Column:
        """By how much another motion has less."""
        differences: dict[Version, dict[str, float]] = {
            version: {
                key: value - other.numbers[version][key]
                for key, value in self.numbers[version].items()
                if key in other.numbers[version]
            }
            for version in VERSIONS
        }
        return Column(name, label, differences, "difference")


def measures_table(run: RunRecord) -> str:
    """The reference first, then the systems; a row for each measure that any of them has."""
    labels = short_names(name for name in run.numbers if name != REFERENCE_NAME)
    columns = [
        Column(name, labels.get(name, name), numbers, "reference" if name == REFERENCE_NAME else "")
        for name, numbers in run.numbers.items()
    ]
    said = filter(None, (run.says.get("step"), run.says.get("beats")))
    told = "".join(f'<p class="says">{escape(sentence)}</p>' for sentence in said)
    above = _findings(run) + told
    legend = text.NEAREST_LEGEND if REFERENCE_NAME in run.numbers else text.NO_REFERENCE_LEGEND
    return table_of(columns, point_title(run.point), legend, above)


def table_of(
    columns: Sequence[Column],
    point: str,
    legend: str,
    above: str = "",
) -> str:
    """A part of the page: heading, switches and the table.

    Args:
        point: the title of the one that was followed.
        legend: a sentence beside the switches; it gets the sign of what is nearest to a reference
            where there is one.
        above: what stands before the table, as HTML.
    """
    shown = [measure for measure in MEASURES if _is_known(measure, columns)]
    about = text.NUMBERS_HELP.format(point=point.lower())
    has_reference = any(column.kind == "reference" for column in columns)
    firsts = {measure.group for measure in shown if measure.is_first}
    head = "".join(_column_head(column) for column in columns)
    body = "".join(
        _group_head(group, len(columns) + 1, group in firsts)
        + "".join(_row(each, columns) for each in measures)
        for group, measures in groupby(shown, key=lambda measure: measure.group)
    )
    return (
        '<div class="measures" data-filter="raw">'
        f"{markup.heading(text.NUMBERS_HEADING, about)}{above}{_bar(legend, has_reference)}"
        f'<div class="scroll" role="region" aria-label="{escape(text.NUMBERS_HEADING)}" '
        'tabindex="0"><table>'
        f'<thead><tr><th scope="col">Measure</th>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>{_more(shown)}</div>"
    )


def _bar(legend: str, has_reference: bool) -> str:
    mark = '<i class="near" aria-hidden="true"></i>' if has_reference else ""
    return (
        f'<div class="bar"><div class="switch" role="group" aria-label="{text.FILTER_SWITCH}">'
        f'<button type="button" data-filter="raw" aria-pressed="true">{text.AS_GENERATED}</button>'
        f'<button type="button" data-filter="savgol" aria-pressed="false">{text.FILTERED}</button>'
        f'</div><span class="legend">{mark}{escape(legend)}</span>'
        f'<button type="button" class="csv">{text.CSV_LABEL}</button></div>'
    )


def _more(shown: Sequence[Measure]) -> str:
    """What asks for all measures, where some are not among the first."""
    if all(measure.is_first for measure in shown):
        return ""
    words = text.ALL_MEASURES.format(count=len(shown))
    return (
        f'<button type="button" class="more" aria-expanded="false" '
        f'data-fewer="{text.FEWER_MEASURES}">{words}</button>'
    )


def _column_head(column: Column) -> str:
    return (
        f'<th scope="col"{_column_class(column)} data-name="{escape(column.name)}" '
        f'title="{escape(column.name)}">{escape(column.label)}</th>'
    )


def _column_class(column: Column) -> str:
    return f' class="{column.kind}"' if column.kind else ""


def _group_head(title: str, width: int, has_first: bool) -> str:
    return (
        f'<tr class="group{"" if has_first else " later"}">'
        f'<th scope="colgroup" colspan="{width}"><span>{escape(title)}</span></th></tr>'
    )


def _row(measure: Measure, columns: Sequence[Column]) -> str:
    near = {kind: _nearest_names(measure, columns, kind) for kind in VERSIONS}
    cells = "".join(_cell(measure, column, near) for column in columns)
    unit = f"<small>{escape(measure.unit)}</small>" if measure.unit else ""
    later = "" if measure.is_first else ' class="later"'
    name = f'<span title="{escape(measure.about)}">{escape(measure.title)}</span>{unit}'
    return (
        f'<tr data-measure="{escape(measure.title)}" data-unit="{escape(measure.unit)}"{later}>'
        f'<th scope="row"><div>{name}</div></th>{cells}</tr>'
    )


def _cell(measure: Measure, column: Column, near: Mapping[str, Sequence[str]]) -> str:
    values = {kind: column.read(measure, kind) for kind in VERSIONS}
    data = "".join(
        f' data-{kind}="{value!r}"' for kind, value in values.items() if value is not None
    )
    write = signed if column.kind == "difference" else written
    spans = "".join(
        f'<span class="{kind}{" near" if column.name in near[kind] else ""}">{write(value)}'
        f"{_NEAR_WORDS if column.name in near[kind] else ''}</span>"
        for kind, value in values.items()
    )
    return f"<td{_column_class(column)}{data}>{spans}</td>"


_NEAR_WORDS = f'<span class="unseen">, {text.NEAREST_LEGEND}</span>'


def _nearest_names(measure: Measure, columns: Sequence[Column], kind: Version) -> tuple[str, ...]:
    recorded = (each.read(measure, kind) for each in columns if each.kind == "reference")
    target = next(recorded, None)
    if not measure.has_target or target is None:
        return ()
    motions = [each for each in columns if not each.kind]
    return nearest({each.name: each.read(measure, kind) for each in motions}, target)


def _is_known(measure: Measure, columns: Sequence[Column]) -> bool:
    return any(column.read(measure, kind) is not None for column in columns for kind in VERSIONS)


def _finding(found: Told, label: str) -> str:
    """With a button that goes to where it is worst, wherever there is a player."""
    go = ""
    if found.at is not None:
        tenths = round(10 * found.at)
        time = f"{tenths // 600}:{tenths % 600 / 10:04.1f}"
        go = (
            f'<button type="button" class="go" data-at="{found.at:.3f}">'
            f"{text.GO_THERE.format(time=time)}</button>"
        )
    return f"<li><b>{escape(label)}</b>{escape(found.sentence)}{go}</li>"


def _findings(run: RunRecord) -> str:
    """What stands out in the motions, the gravest few apart, and in which nothing does."""
    first = [_finding(found, run.label(found.name)) for found in run.gravest]
    if not first:
        return ""
    rest = [
        _finding(each, run.label(each.name)) for each in run.findings if each not in run.gravest
    ]
    also = f"{text.ALSO_FOUND} ({len(rest)})"
    more = f"<details><summary>{also}</summary><ul>{''.join(rest)}</ul></details>" if rest else ""
    title = f"<h3>{text.FINDINGS_TITLE}</h3>" if run.findings[0].name else ""
    return f'<div class="findings">{title}<ul>{"".join(first)}</ul>{more}</div>'
