"""A leaderboard as one page that needs nothing beside it; a click on a measure sorts by it."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from itertools import groupby
from pathlib import Path

from app.board.entries import Entry, Value
from app.findings.measure_rows import MEASURES, written

_FOLDER = Path(__file__).parent
_DISTRIBUTION = "Distribution"
"""How measures of whole sets begin, whose aim is 0."""
_ABOUT = {f"{row.group}: {row.title}": row.about for row in MEASURES}
_FIRST = {f"{row.group}: {row.title}" for row in MEASURES if row.is_first} | {
    f"{row.group}: {row.title}" for row in MEASURES if row.title == "Power above 5 Hz"
}
_ABOUT_PAGE = """<p>Means over clips and their 95 % bootstrap intervals, as generated, unfiltered.
Nearer to the recorded motion is better: a click on a measure sorts by the distance to it, a second
one by the value. Only numbers of one table can be held against each other: it has the same clips,
the same recorded motion and the same encoder.</p>
<p class="tools"><label><input type="checkbox" id="all"> all measures</label>
<label>Only <input type="search" id="only" placeholder="systems named ..."></label></p>"""


def board_page(entries: Sequence[Entry], title: str = "Leaderboard") -> str:
    """The whole page: a table for each test.

    Args:
        entries: as `app.board.entries.merged` orders them.
    """
    style, script = ((_FOLDER / f"board.{kind}").read_text("utf-8") for kind in ("css", "js"))
    tables = [_table(test, list(of)) for test, of in groupby(entries, lambda entry: entry.test)]
    body = [f"<h1>{escape(title)}</h1>", _ABOUT_PAGE, *tables]
    if not tables:
        body.append("<p>Nothing has been added yet.</p>")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n"
        + "\n".join(body)
        + f"\n<script>\n{script}</script>\n</body>\n</html>\n"
    )


def _table(test: str, entries: list[Entry]) -> str:
    titles = list(dict.fromkeys(name for entry in entries for name in entry.measures))
    recorded = next((entry for entry in entries if entry.is_recorded), None)
    head = "".join(_head(title, entries) for title in titles)
    rows = "".join(_row(entry, titles, recorded) for entry in entries)
    clips = max(entry.clips for entry in entries)
    what = "Digest of clips, recorded motion and encoder"
    return (
        f'<section><h2>{clips} clips <small title="{what}">test {escape(test)}</small></h2>'
        '<div class="scroll" tabindex="0"><table><thead><tr>'
        f'<th><button type="button">System</button></th>{head}'
        "<th>Clips with findings</th><th>Measured</th><th>Note</th></tr></thead>"
        f"<tbody>{rows}</tbody></table></div></section>"
    )


def _kind(title: str) -> str:
    """Measures that are not shown at first."""
    is_shown = title in _FIRST or title.startswith(_DISTRIBUTION)
    return "" if is_shown else ' class="rare"'


def _head(title: str, entries: list[Entry]) -> str:
    unit = next(entry.measures[title].unit for entry in entries if title in entry.measures)
    told = f"{escape(title)}{f' <small>{escape(unit)}</small>' if unit else ''}"
    about = escape(_ABOUT.get(title, ""))
    return f'<th{_kind(title)} title="{about}"><button type="button">{told}</button></th>'


def _row(entry: Entry, titles: list[str], recorded: Entry | None) -> str:
    cells = "".join(_cell(title, entry.measures.get(title), recorded) for title in titles)
    kinds = sorted(entry.findings.items(), key=lambda item: -item[1])
    found = ", ".join(f"{escape(kind)} {count}" for kind, count in kinds[:3]) or "none"
    made = entry.made_at[:10]
    every = escape(", ".join(f"{kind} {count}" for kind, count in kinds))
    name = "recorded" if entry.is_recorded else entry.system
    kind = ' class="recorded"' if entry.is_recorded else ""
    return (
        f'<tr{kind}><th scope="row" title="files {escape(entry.files[:12])}">{escape(name)}</th>'
        f'{cells}<td class="text" title="{every}">{found}</td>'
        f'<td class="text" title="version {escape(entry.project)}">{escape(made)}</td>'
        f'<td class="text">{escape(entry.note)}</td></tr>'
    )


def _cell(title: str, value: Value | None, recorded: Entry | None) -> str:
    if value is None:
        return f"<td{_kind(title)}></td>"
    target = recorded.measures.get(title) if recorded is not None else None
    aim = 0.0 if title.startswith(_DISTRIBUTION) else target.mean if target else value.mean
    interval = f"[{written(value.low)}, {written(value.high)}]"
    return (
        f'<td{_kind(title)} data-value="{value.mean:.9g}" data-apart="{abs(value.mean - aim):.9g}">'
        f"{written(value.mean)} <small>{interval}</small></td>"
    )
