"""HTML tables of metrics: of one run, of the clips of a run, and of sets of clips."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from itertools import groupby
from typing import TYPE_CHECKING, Any, Literal
from urllib.parse import quote

from app import text
from app.errors import without_cli_options, without_folders
from app.findings import metric_table
from app.findings.comparison import (
    format_finding_kinds,
    format_two_digits,
    point_title,
    values_by_metric,
)
from app.findings.metric_table import FGD, JERK, METRICS, TITLES, Metric, Numbers
from app.findings.verdict import make_verdict
from app.page.parts import markup
from app.run.batch.table import format_cells, mean_with_interval, star_legend
from app.run.output.run_folder import FindingRecord, RunRecord
from conventions.names import FILTER_VERSIONS, REFERENCE_NAME, FilterVersion, pluralise, short_names
from model.metrics.protocols.table import WORKBENCH, protocol_of
from model.storage.escaping import csv_text

if TYPE_CHECKING:
    from model.metrics.results import BeatSpeedSource


@dataclass(frozen=True)
class Column:
    """Column of a table: a motion, or the difference of two."""

    name: str
    label: str
    numbers: Numbers
    kind: Literal["", "reference", "difference"] = ""
    beat_speed_source: BeatSpeedSource = "own"
    """Source of the mean speeds of BeatAlign."""

    def value(self, measure: Metric, version: FilterVersion) -> float | None:
        return self.numbers.get(version, {}).get(measure.key)

    def only_if_protocol(self, measure: Metric, protocol: str) -> Column:
        """Return the column, without numbers if the measure is by another protocol here."""
        return (
            self
            if protocol_of(measure.key, self.beat_speed_source) == protocol
            else replace(self, numbers={})
        )

    @property
    def class_attribute(self) -> str:
        return f' class="{self.kind}"' if self.kind else ""

    def minus(self, other: Column, name: str, label: str) -> Column:
        """Return the difference to another motion, in metrics of the same protocol, as a column."""
        differences: dict[FilterVersion, dict[str, float]] = {
            version: {
                key: value - theirs[key]
                for key, value in self.numbers.get(version, {}).items()
                if key in (theirs := other.numbers.get(version, {}))
                and protocol_of(key, self.beat_speed_source)
                == protocol_of(key, other.beat_speed_source)
            }
            for version in FILTER_VERSIONS
        }
        return Column(name, label, differences, "difference", self.beat_speed_source)


def beat_speed_source_of(run: RunRecord) -> BeatSpeedSource:
    """Return the source of the mean speeds of a run's BeatAlign."""
    metrics = run.request.get("metrics")
    if isinstance(metrics, dict) and metrics.get("mean_speeds"):
        return "emage"
    return "reference" if REFERENCE_NAME in run.metrics else "own"


def run_metrics_table(run: RunRecord) -> str:
    """Format the metrics of a run: the reference first, a row for each available metric."""
    labels = short_names(name for name in run.metrics if name != REFERENCE_NAME)
    beat_speed_source = beat_speed_source_of(run)
    columns = [
        Column(
            name,
            labels.get(name, name),
            numbers,
            "reference" if name == REFERENCE_NAME else "",
            beat_speed_source,
        )
        for name, numbers in run.metrics.items()
    ]
    judgement = run.verdict.comparison if run.verdict and jerk_bars(run) else ""
    captions = _says(
        markup.split_first_sentence(judgement)[1],
        run.figure_captions.get("step"),
        run.figure_captions.get("beats"),
    )
    above = _findings(run) + captions
    legend = text.NEAREST_LEGEND if REFERENCE_NAME in run.metrics else text.NO_REFERENCE_LEGEND
    return metrics_table(columns, point_title(run.tracked_point), legend, above)


def _says(*sentences: str | None) -> str:
    return "".join(f'<p class="says">{escape(each)}</p>' for each in sentences if each)


def metrics_table(columns: Sequence[Column], point: str, legend: str, above: str = "") -> str:
    """Format a table of metrics with its heading, legend and switches.

    A metric that columns have by several protocols has a row for each.
    """
    numbers = [
        (measure, protocol_of(measure.key, column.beat_speed_source), column, version, value)
        for measure in METRICS
        for column in columns
        for version in FILTER_VERSIONS
        if (value := column.value(measure, version)) is not None
    ]
    shown = [*dict.fromkeys((measure, protocol) for measure, protocol, *_ in numbers)]
    several = Counter(measure for measure, _ in shown)
    firsts = {measure.group for measure, _ in shown if measure.is_primary}
    head = "".join(
        f'<th scope="col"{each.class_attribute} data-name="{escape(each.name)}" '
        f'title="{escape(each.name)}">{escape(each.label)}</th>'
        for each in columns
    )
    body = "".join(
        f'<tr class="group{"" if group in firsts else " later"}"><th scope="colgroup" '
        f'colspan="{len(columns) + 1}"><span>{escape(group)}</span></th></tr>'
        + "".join(
            _row(
                each if several[each] == 1 else replace(each, title=f"{each.title} · {protocol}"),
                [column.only_if_protocol(each, protocol) for column in columns],
            )
            for each, protocol in rows
        )
        for group, rows in groupby(shown, key=lambda row: row[0].group)
    )
    has_reference = any(column.kind == "reference" for column in columns)
    # All numbers of the table, raw and filtered, one per line.
    lines = [
        (of.key, of.unit, each.name, version, value, protocol)
        for of, protocol, each, version, value in numbers
    ]
    csv = csv_text([("measure", "unit", "name", "filter", "value", "protocol"), *lines])
    more = (
        f'<button type="button" class="more" aria-expanded="false" '
        f'data-fewer="Show fewer">{text.ALL_MEASURES.format(count=len(shown))}</button>'
    )
    mark = '<i class="near" aria-hidden="true"></i>' if has_reference else ""
    about = text.NUMBERS_HELP.format(point=point.lower())
    return (
        '<div class="measures" data-filter="raw">'
        f"{markup.heading(text.NUMBERS_HEADING, about)}{above}"
        f'<div class="bar"><div class="switch" role="group" aria-label="{text.FILTER_SWITCH}">'
        f'<button type="button" data-filter="raw" aria-pressed="true">{text.AS_GENERATED}</button>'
        f'<button type="button" data-filter="savgol" aria-pressed="false">{text.FILTERED}</button>'
        f'</div><span class="legend">{mark}{escape(legend)}</span>'
        f'<a class="csv" download="measures.csv" href="data:text/csv;charset=utf-8,{quote(csv)}">'
        f"{text.CSV_LABEL}</a></div>"
        f"{markup.table(text.NUMBERS_HEADING, 'Metric', head, body)}"
        f"{'' if all(each.is_primary for each, _ in shown) else more}"
        f"{_rules((each.key, protocol) for each, protocol in shown)}</div>"
    )


def _rules(metrics: Iterable[tuple[str, str]]) -> str:
    """Format the definitions of metrics, folded, from their keys and the ids of protocols."""
    rows = "".join(
        f"<dt>{escape(TITLES.get(key, key))}</dt>"
        f"<dd>{escape(metric_table.metric_definition(key, protocol))} "
        f"<code>{escape(protocol)}</code></dd>"
        for key, protocol in metrics
    )
    summary = "Definitions and protocols"
    return f'<details class="rules"><summary>{summary}</summary><dl>{rows}</dl></details>'


def _row(measure: Metric, columns: Sequence[Column]) -> str:
    recorded = [
        each for each in columns if each.kind == "reference" and measure.is_compared_with_reference
    ]
    motions = [each for each in columns if not each.kind]
    near: dict[FilterVersion, Sequence[str]] = {}
    for version in FILTER_VERSIONS:
        target = next((each.value(measure, version) for each in recorded), None)
        of_motions = {each.name: each.value(measure, version) for each in motions}
        near[version] = metric_table.nearest_names(of_motions, target)
    cells = "".join(_cell(measure, column, near) for column in columns)
    unit = f"<small>{escape(measure.unit)}</small>" if measure.unit else ""
    later = "" if measure.is_primary else ' class="later"'
    name = f'<span title="{escape(measure.description)}">{escape(measure.title)}</span>{unit}'
    return (
        f'<tr data-measure="{measure.key}"{later}>'
        f'<th scope="row"><div>{name}</div></th>{cells}</tr>'
    )


def _cell(measure: Metric, column: Column, near: Mapping[FilterVersion, Sequence[str]]) -> str:
    write = (
        metric_table.format_difference
        if column.kind == "difference"
        else metric_table.format_three_digits
    )
    spans = ""
    for kind in FILTER_VERSIONS:
        is_near = column.name in near[kind]
        legend = f'<span class="unseen">, {text.NEAREST_LEGEND}</span>' if is_near else ""
        value = write(column.value(measure, kind))
        spans += f'<span class="{kind}{" near" if is_near else ""}">{value}{legend}</span>'
    return f"<td{column.class_attribute}>{spans}</td>"


def _finding(finding: FindingRecord, label: str) -> str:
    """Format a finding, with a button that shows its worst time and its body part."""
    go = ""
    if finding.worst_time_s is not None or finding.part:
        at, where, name = "", f"the {finding.part}", escape(finding.motion_name)
        if finding.worst_time_s is not None:
            tenths = round(10 * finding.worst_time_s)
            at, where = f"{finding.worst_time_s:.3f}", f"{tenths // 600}:{tenths % 600 / 10:04.1f}"
        go = (
            f'<button type="button" class="go" data-at="{at}" data-name="{name}"'
            f' data-part="{finding.part}">{text.GO_THERE.format(where=where)}</button>'
        )
    who = f"<b>{escape(label)}:</b> " if label else ""
    return f"<li>{who}{escape(finding.sentence)}{go}</li>"


NORM = (
    "The thresholds for findings come from two recorded clips of one speaker and 90 procedurally "
    "generated clips."
)


def _findings(run: RunRecord) -> str:
    """Format the findings that do not stand beside the viewer, folded; it shows the most severe."""
    others = [each for each in run.findings if each not in run.top_findings]
    if not run.top_findings or not others:
        return ""
    items = [_finding(each, run.label(each.motion_name)) for each in others]
    return _listed(f'<p class="hint">{NORM}</p>', items, 0, f"More findings ({len(items)})")


def jerk_bars(run: RunRecord) -> str:
    """Format the jerk of each motion as bars; empty for a single motion."""
    raw = {name: of["raw"] for name, of in run.metrics.items()}
    return _bars(run, {name: (of[JERK],) * 3 for name, of in raw.items() if JERK in of})


def _bars(run: RunRecord, jerk: Mapping[str, Sequence[float]], over: str = "") -> str:
    """Format means of the jerk with their intervals, as dots if ``over`` says over what."""
    most = max((high for _, _, high in jerk.values()), default=0.0)
    if len(jerk) < 2 or not most > 0.0:
        return ""
    colors = {row.name: row.color for row in run.rows}
    values = {
        run.label(name): (
            format_two_digits(ends[0]),
            "currentColor" if name == REFERENCE_NAME else colors.get(name, "currentColor"),
            [v / most for v in ends],
        )
        for name, ends in jerk.items()
    }
    return markup.bar_chart(
        f"{point_title(run.tracked_point)} jerk (m/s³){over}", values, bool(over)
    )


def _listed(title: str, items: Sequence[str], most: int, more: str) -> str:
    """Format a list of HTML items, folded after the first few."""
    rest = "".join(items[most:])
    folded = f"<details><summary>{more}</summary><ul>{rest}</ul></details>" if rest else ""
    first = f"<ul>{''.join(items[:most])}</ul>" if most else ""
    return f'<div class="findings">{title}{first}{folded}</div>'


def runs_title(records: Sequence[RunRecord]) -> str:
    """Return the title of a run, or of the runs of several clips."""
    if len(records) < 2:
        return records[0].title
    requested = records[0].settings.get("systems", "")
    return f"{len(records)} clips: {requested}"


def jerk_by_clip_html(runs: Mapping[str, RunRecord]) -> str:
    """Format each system's jerk with its interval over clips, and by clip; empty for one run."""
    if len(runs) < 2:
        return ""
    first = next(iter(runs.values()))
    measured = [run.metrics for run in runs.values()]
    verdict = make_verdict(first.tracked_point, measured)
    raw = values_by_metric({name: of["raw"] for name, of in clip.items()} for clip in measured)
    jerk = raw.get(JERK, {})
    means = {name: mean_with_interval(list(of.values())) for name, of in jerk.items()}
    above = ""
    if verdict is not None:
        bars = _bars(first, means, text.OVER_CLIPS)
        above = markup.verdict(verdict.jerk_sentence, verdict.comparison, bars)
        above += _says(markup.split_first_sentence(verdict.comparison)[1])
    names = short_names(jerk)
    rows = [
        _clip_row(
            clip,
            [format_two_digits(of[number]) if number in of else "…" for of in jerk.values()],
            run,
        )
        for number, (clip, run) in enumerate(runs.items(), 1)
    ]
    cells = [
        metric_table.format_mean_with_interval(*numbers, format_two_digits)
        for numbers in means.values()
    ]
    head = markup.header_cells({name: names[name] for name in jerk})
    title = f"{point_title(first.tracked_point)} jerk by clip (m/s³, as generated)"
    foot = f"<tfoot>{markup.table_row(text.CLIPS_MEAN, cells)}</tfoot>"
    is_done = all(run.state == "done" for run in runs.values())
    return (
        f'<div class="measures all clips">{above}<details{"" if is_done else " open"}>'
        f"<summary>{escape(title)}</summary>"
        f"{markup.table(title, text.CLIP, head, ''.join(rows), foot)}</details>"
        f"{_rules([(JERK, WORKBENCH)])}</div>"
    )


def _clip_row(clip: str, cells: list[str], run: RunRecord) -> str:
    if run.state not in ("failed", "cancelled"):
        return markup.table_row(clip, cells)
    why = escape(without_cli_options(without_folders(run.message)) or text.STOPPED)
    return f'<tr><th scope="row">{escape(clip)}</th><td colspan="{len(cells)}">{why}</td></tr>'


COUNTED = "Means of {sets} over the same {clips}, unfiltered, with 95 % confidence intervals."
WORST_FIRST = "Clips with the most kinds of findings (ties ordered by jerk)"
SETS_TABLE = "Mean over clips [95 % confidence interval]"
NUM_WORST_CLIPS = 5
"""Maximum number of worst clips that are not folded."""


def sets_html(summary: Mapping[str, Any], systems: Sequence[str], figure: str, links: str) -> str:
    """Format `app.run.tasks.SetResults.batch_json` with figure and links; reference last."""
    clips = summary["clips"]
    count = COUNTED.format(clips=pluralise(len(clips), "clip"), sets=pluralise(len(systems), "set"))
    return (
        f'<div class="sets">{markup.heading("Results for sets of clips", count)}'
        f"{_worst(summary['worst'])}{figure}{_sets_table(summary['measures'], systems, len(clips))}"
        f'<div class="downloads">{links}</div></div>'
    )


def clip_choices(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return label and name of every clip, the worst first."""
    worst: dict[str, str] = {
        each["clip"]: f"{each['clip']}: {format_finding_kinds(each['kinds'])}"
        for each in summary["worst"]
    }
    clips: list[str] = summary["clips"]
    return [(worst.get(clip, clip), clip) for clip in dict.fromkeys([*worst, *clips])]


def _worst(worst: Sequence[Mapping[str, Any]]) -> str:
    if not worst:
        return '<p class="says">No findings in any clip.</p>'
    unit = next(row.unit for row in METRICS if row.key == JERK)
    items = [
        f"<li><b>{escape(each['clip'])}</b><span>{escape(each['system'])}: "
        f"{escape(format_finding_kinds(each['kinds']))}; jerk "
        f"{metric_table.format_three_digits(each['jerk'])} {unit}</span></li>"
        for each in worst
    ]
    return _listed(
        f"<h3>{WORST_FIRST}</h3>", items, NUM_WORST_CLIPS, f"{len(items) - NUM_WORST_CLIPS} more"
    )


def _sets_table(rows: Sequence[Mapping[str, Any]], systems: Sequence[str], clips: int) -> str:
    firsts = {row.key for row in METRICS if row.is_primary} | {FGD}
    head = markup.header_cells({name: name for name in systems})

    def table(chosen: list[Mapping[str, Any]]) -> str:
        cells_by_name = format_cells(list(systems), [dict(row) for row in chosen])
        body = "".join(markup.table_row(title, cells) for title, cells in cells_by_name.items())
        return markup.table(SETS_TABLE, SETS_TABLE, head, body)

    star = f"<p>{escape(star_legend(systems, clips))}</p>" if len(systems) > 1 else ""
    first = table([row for row in rows if row["measure"] in firsts])
    metrics = [(row["measure"], row.get("protocol", WORKBENCH)) for row in rows]
    return (
        f'<div class="measures all">{first}{star}'
        f"<details><summary>All metrics</summary>{table(list(rows))}</details>"
        f"{_rules(dict.fromkeys(metrics))}</div>"
    )
