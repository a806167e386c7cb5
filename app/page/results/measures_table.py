"""The table of all measures as HTML: every number raw and filtered, one switch for both.

app/page/web/measures.js turns the switch, orders the columns and saves the CSV.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from itertools import groupby
from math import isfinite
from typing import TYPE_CHECKING

from app import text
from app.findings.measure_rows import MEASURES, Measure, nearest, written
from app.findings.points import point_title
from app.findings.ranking import GRAVEST
from app.findings.sentences import sentences_of
from app.page.parts import markup
from app.run.request import REFERENCE_NAME

if TYPE_CHECKING:
    from model.measures.diagnostics import Diagnostics, Kind, Versions
    from model.measures.faults.finding import Finding

_KINDS: tuple[Kind, ...] = ("raw", "savgol")
Columns = Mapping[str, "Versions"]
"""By name of a motion its measures, raw and filtered."""


def measures_table(diagnostics: Diagnostics) -> str:
    """The reference first, then the systems; a row for each measure that any of them has."""
    reference, columns = diagnostics.reference, diagnostics.systems
    if reference is not None:
        columns = {REFERENCE_NAME: reference, **columns}
    head = "".join(_column_head(name) for name in columns)
    shown = [measure for measure in MEASURES if _is_known(measure, columns)]
    body = "".join(
        _group_head(group, len(columns) + 1) + "".join(_row(each, columns) for each in measures)
        for group, measures in groupby(shown, key=lambda measure: measure.group)
    )
    return (
        '<div class="measures" data-filter="raw">'
        f"{markup.heading(text.NUMBERS_HEADING, _explanation(diagnostics.point))}"
        f"{_findings(diagnostics.findings)}"
        f"{_beats(diagnostics)}"
        f"{_bar(has_reference=reference is not None)}"
        f'<div class="scroll" role="region" aria-label="{escape(text.NUMBERS_HEADING)}" '
        'tabindex="0"><table>'
        f'<thead><tr><th scope="col">Measure</th>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div></div>"
    )


def _explanation(point: str) -> str:
    return text.NUMBERS_HELP.format(point=point_title(point).lower())


def _bar(has_reference: bool) -> str:
    legend = text.NEAREST_LEGEND if has_reference else text.NO_REFERENCE_LEGEND
    mark = '<i class="near" aria-hidden="true"></i>' if has_reference else ""
    return (
        f'<div class="bar"><div class="switch" role="group" aria-label="{text.FILTER_SWITCH}">'
        f'<button type="button" data-filter="raw" aria-pressed="true">{text.AS_GENERATED}</button>'
        f'<button type="button" data-filter="savgol" aria-pressed="false">{text.FILTERED}</button>'
        f'</div><span class="legend">{mark}{escape(legend)}</span>'
        f'<button type="button" class="csv">{text.CSV_LABEL}</button></div>'
    )


def _column_head(name: str) -> str:
    return f'<th scope="col"{_reference_class(name)} data-name="{escape(name)}">{escape(name)}</th>'


def _reference_class(name: str) -> str:
    return ' class="reference"' if name == REFERENCE_NAME else ""


def _group_head(title: str, width: int) -> str:
    return (
        f'<tr class="group"><th scope="colgroup" colspan="{width}">'
        f"<span>{escape(title)}</span></th></tr>"
    )


def _row(measure: Measure, columns: Columns) -> str:
    near = {kind: _nearest_names(measure, columns, kind) for kind in _KINDS}
    cells = "".join(_cell(measure, name, columns[name], near) for name in columns)
    unit = f"<small>{escape(measure.unit)}</small>" if measure.unit else ""
    return (
        f'<tr data-measure="{escape(measure.title)}" data-unit="{escape(measure.unit)}">'
        f'<th scope="row"><button type="button" title="{text.SORT_HELP}">'
        f"{escape(measure.title)}{unit}</button></th>{cells}</tr>"
    )


def _cell(
    measure: Measure,
    name: str,
    versions: Versions,
    near: Mapping[str, Sequence[str]],
) -> str:
    values = {kind: _value(measure, versions, kind) for kind in _KINDS}
    data = "".join(
        f' data-{kind}="{value!r}"' for kind, value in values.items() if value is not None
    )
    spans = "".join(
        f'<span class="{kind}{" near" if name in near[kind] else ""}">{written(value)}'
        f"{_NEAR_WORDS if name in near[kind] else ''}</span>"
        for kind, value in values.items()
    )
    return f"<td{_reference_class(name)}{data}>{spans}</td>"


_NEAR_WORDS = f'<span class="unseen">, {text.NEAREST_LEGEND}</span>'


def _nearest_names(measure: Measure, columns: Columns, kind: Kind) -> tuple[str, ...]:
    if not measure.has_target or REFERENCE_NAME not in columns:
        return ()
    values = {name: _value(measure, versions, kind) for name, versions in columns.items()}
    target = values.pop(REFERENCE_NAME)
    return nearest(values, target)


def _value(measure: Measure, versions: Versions, kind: Kind) -> float | None:
    value = measure.read(versions.of(kind))
    return None if value is None or not isfinite(value) else measure.scale * value


def _is_known(measure: Measure, columns: Columns) -> bool:
    return any(
        _value(measure, versions, kind) is not None
        for versions in columns.values()
        for kind in _KINDS
    )


def _beats(diagnostics: Diagnostics) -> str:
    sentence = sentences_of(diagnostics)["beats"]
    return f'<p class="says">{escape(sentence)}</p>' if sentence else ""


def _finding(name: str, finding: Finding) -> str:
    """With a button that goes to where it is worst, wherever there is a player."""
    from model.measures.faults.finding import clock

    go = ""
    if finding.worst_frame is not None and finding.worst_s is not None:
        go = (
            f'<button type="button" class="go" data-at="{finding.worst_s:.3f}">'
            f"{text.GO_THERE.format(time=clock(finding.worst_frame))}</button>"
        )
    return f"<li><b>{escape(name)}</b>{escape(finding.sentence)}{go}</li>"


def _findings(findings: Mapping[str, Sequence[Finding]]) -> str:
    """What stands out in the motions, in sentences, the gravest few apart; nothing where nothing
    does."""
    from model.measures.faults.finding import ranked

    items = [_finding(name, finding) for name, finding in ranked(findings)]
    if not items:
        return ""
    rest = "".join(items[GRAVEST:])
    more = f"<h3>{text.ALSO_FOUND}</h3><ul>{rest}</ul>" if rest else ""
    return (
        f'<div class="findings"><h3>{text.FINDINGS_TITLE}</h3>'
        f"<ul>{''.join(items[:GRAVEST])}</ul>{more}</div>"
    )
