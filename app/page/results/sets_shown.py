"""Sets of clips on the page: the worst clips, how measures are spread, a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from app.findings.measure_rows import JERK, MEASURES, written
from app.page.parts import markup
from app.run.many.distances import TITLE as DISTANCE
from app.run.many.table import cells_of

HEADING = "Results as sets"
COUNTED = (
    "{clips} in {sets}, each measured as it is. Means over clips, with 95 % intervals over clips."
)
WORST = "Worst clips first: most kinds of findings, of equal ones the jerkiest"
NONE_FOUND = "Nothing stands out in any clip."
TABLE = "Mean over clips [95 % interval]"
MORE = "All measures"
STAR = "* the paired difference to {last} is not chance."
MOST_SHOWN = 5
"""Worst clips that are seen unfolded."""


def sets_html(told: Mapping[str, Any], systems: Sequence[str], figure: str, links: str) -> str:
    """All that is told of them.

    Args:
        told: as `app.run.many.motions.Sets.told`.
        systems: names of the sets, the reference last.
        figure: that of the spread, as HTML; empty of few clips.
        links: to what can be saved, as HTML.
    """
    clips = told["clips"]
    counted = COUNTED.format(
        clips=number_of(len(clips), "clip"), sets=number_of(len(systems), "set")
    )
    return (
        f'<div class="sets">{markup.heading(HEADING, counted)}'
        f"{_worst(told['worst'])}{figure}{_table(told['measures'], systems)}"
        f'<div class="downloads">{links}</div></div>'
    )


def number_of(count: int, what: str) -> str:
    """So many of them, in words."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def clip_choices(told: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Every clip by what is said of it, the worst first."""
    worst: dict[str, str] = {
        each["clip"]: f"{each['clip']}: {kinds_of(each)}" for each in told["worst"]
    }
    clips: list[str] = told["clips"]
    return [(worst.get(clip, clip), clip) for clip in dict.fromkeys([*worst, *clips])]


def _worst(worst: Sequence[Mapping[str, Any]]) -> str:
    if not worst:
        return f'<p class="says">{NONE_FOUND}</p>'
    unit = next(row.unit for row in MEASURES if row.key == JERK)
    items = [
        f"<li><b>{escape(each['clip'])}</b><span>{escape(each['system'])}: "
        f"{escape(kinds_of(each))}; jerk {written(each['jerk'])} {unit}</span></li>"
        for each in worst
    ]
    rest = items[MOST_SHOWN:]
    more = f"<details><summary>{len(rest)} more</summary><ul>{''.join(rest)}</ul></details>"
    return (
        f'<div class="findings"><h3>{WORST}</h3><ul>{"".join(items[:MOST_SHOWN])}</ul>'
        f"{more if rest else ''}</div>"
    )


def kinds_of(worst: Mapping[str, Any]) -> str:
    """Of findings, in words."""
    return ", ".join(kind.replace("_", " ") for kind in worst["kinds"])


def _table(rows: Sequence[Mapping[str, Any]], systems: Sequence[str]) -> str:
    firsts = {f"{row.key}" for row in MEASURES if row.is_first} | {DISTANCE}
    head = "".join(f'<th scope="col">{escape(name)}</th>' for name in systems)

    def table(chosen: list[Mapping[str, Any]]) -> str:
        body = "".join(
            f'<tr><th scope="row">{escape(title)}</th>'
            f"{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>"
            for title, cells in cells_of(list(systems), [dict(row) for row in chosen]).items()
        )
        return (
            f'<div class="scroll" role="region" aria-label="{TABLE}" tabindex="0"><table><thead>'
            f'<tr><th scope="col">{TABLE}</th>{head}</tr></thead><tbody>{body}</tbody></table>'
            "</div>"
        )

    star = f"<p>{escape(STAR.format(last=systems[-1]))}</p>" if len(systems) > 1 else ""
    first = table([row for row in rows if row["measure"] in firsts])
    return (
        f'<div class="measures all">{first}{star}'
        f"<details><summary>{MORE}</summary>{table(list(rows))}</details></div>"
    )
