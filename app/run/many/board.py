"""A leaderboard that a lab keeps as one file: where results come from, put together, and as a page.

Numbers of two entries can be held against each other where they are of the same *test*: the same
clips, the same recorded motion, the same encoder. Entries of other tests stand in other tables.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from html import escape
from itertools import groupby
from pathlib import Path
from typing import Any

from app.errors import RunError
from app.findings.measure_rows import MEASURES, written
from conventions.names import REFERENCE_NAME, printable
from model.storage.files import written_atomically

FORMAT = 1
MAX_BYTES = 32 * 2**20
MAX_NAME = 100
MAX_NOTE = 400


@dataclass(frozen=True)
class Value:
    """Of one measure: the mean over clips and its 95 % bootstrap interval."""

    mean: float
    low: float
    high: float
    unit: str
    clips: int


@dataclass(frozen=True)
class Entry:
    """One system on one test."""

    system: str
    test: str
    """Short digest of the clips, the recorded motion and the encoder."""
    files: str
    """Digest of the motion files."""
    clips: int
    made_at: str
    """ISO 8601."""
    project: str
    """The version that measured."""
    measures: Mapping[str, Value]
    findings: Mapping[str, int]
    """Clips by kind of finding."""
    note: str = ""

    @property
    def is_recorded(self) -> bool:
        return self.system == REFERENCE_NAME

    @property
    def key(self) -> tuple[str, str, str]:
        """Two entries that share it are of the same files on the same test."""
        return self.test, self.system, self.files


def entries_of(folder: Path, note: str = "", names: Iterable[str] = ()) -> list[Entry]:
    """What ``diagnose`` left of whole sets.

    Args:
        folder: its ``--out``.
        note: what a person should know, such as the training or the paper; of all entries.
        names: of the systems that are taken; empty takes all.

    Raises:
        RunError: with one sentence.
    """
    path = folder / "many.json"
    told = _read(path)
    where = told.get("provenance")
    if not isinstance(where, dict):
        raise RunError(f"{path} does not say what it is of; measure the set again with diagnose.")
    if not where["reference"]:
        raise RunError(
            f"{folder.name} was measured without a recorded set, and so cannot be held against "
            "others; measure it again with --reference."
        )
    wanted = set(names) or set(where["systems"]) - {REFERENCE_NAME}
    unknown = sorted(wanted - set(where["systems"]))
    if unknown:
        raise RunError(
            f"{folder.name} has no {unknown[0]!r}; it has {', '.join(where['systems'])}."
        )
    if len(note) > MAX_NOTE:
        raise RunError(f"A note has at most {MAX_NOTE} letters; this one has {len(note)}.")
    return [_entry(told, where, name, note) for name in where["systems"] if _is_taken(name, wanted)]


def _is_taken(name: str, wanted: set[str]) -> bool:
    return name in wanted or name == REFERENCE_NAME


def _entry(told: dict[str, Any], where: dict[str, Any], name: str, note: str) -> Entry:
    rows = [row for row in told["measures"] if row["system"] == name and not row["difference_to"]]
    return Entry(
        system=name,
        test=_test_of(where),
        files=where["systems"][name],
        clips=len(told["clips"]),
        made_at=where["made_at"],
        project=where["project"],
        measures={
            row["measure"]: Value(row["mean"], row["low"], row["high"], row["unit"], row["clips"])
            for row in rows
        },
        findings=told["clips_with_finding"].get(name, {}),
        note="" if name == REFERENCE_NAME else note,
    )


def _test_of(where: Mapping[str, Any]) -> str:
    """Of what must be equal, or numbers cannot be held against each other."""
    same = [where[name] for name in ("reference", "encoders", "mean_speeds", "measures")]
    return hashlib.sha256(json.dumps(same, sort_keys=True).encode()).hexdigest()[:12]


def merged(boards: Iterable[Iterable[Entry]]) -> list[Entry]:
    """All entries; of the same files on the same test the latest measurement, with its note or,
    where that has none, the one before."""
    found: dict[tuple[str, str, str], Entry] = {}
    for board in boards:
        for entry in board:
            known = found.get(entry.key)
            if known is None:
                found[entry.key] = entry
                continue
            newer, older = sorted((entry, known), key=lambda one: one.made_at, reverse=True)
            found[entry.key] = replace(newer, note=newer.note or older.note)
    return sorted(
        found.values(), key=lambda one: (one.test, one.is_recorded, one.system, one.made_at)
    )


def write_board(entries: Iterable[Entry], path: Path) -> None:
    """Write it whole or not at all.

    Raises:
        WriteError: with the reason.
    """
    told = {"format": FORMAT, "entries": [asdict(entry) for entry in entries]}
    with written_atomically(path) as part:
        part.write_text(json.dumps(told, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def read_board(path: Path) -> list[Entry]:
    """A board as `write_board` wrote it, maybe in another lab.

    Raises:
        RunError: if it is none, with one sentence.
    """
    told = _read(path)
    if told.get("format") != FORMAT or not isinstance(told.get("entries"), list):
        raise RunError(f"{path.name} is no leaderboard of format {FORMAT}.")
    try:
        return [_checked(entry) for entry in told["entries"]]
    except (TypeError, KeyError, ValueError, AttributeError) as error:
        raise RunError(f"{path.name} is damaged: an entry is not as it should be.") from error


def _read(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise RunError(f"{path} is larger than {MAX_BYTES // 2**20} MiB.")
        told = json.loads(path.read_text("utf-8"))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise RunError(f"{path} could not be read: {reason}.") from error
    except (ValueError, RecursionError) as error:
        raise RunError(f"{path} is no JSON.") from error
    if not isinstance(told, dict):
        raise RunError(f"{path} holds nothing that can be used.")
    return told


def _checked(told: dict[str, Any]) -> Entry:
    values = {name: Value(**value) for name, value in told["measures"].items()}
    entry = Entry(**{**told, "measures": values, "findings": dict(told["findings"])})
    texts = entry.system, entry.test, entry.files, entry.made_at, entry.project, entry.note
    if not all(isinstance(text, str) and len(text) <= MAX_NOTE for text in texts):
        raise ValueError("a name or note")
    numbers = [entry.clips, *entry.findings.values()]
    for value in values.values():
        numbers += [value.mean, value.low, value.high, value.clips]
        if not isinstance(value.unit, str):
            raise ValueError("a unit")
    for number in numbers:
        if (
            isinstance(number, bool)
            or not isinstance(number, int | float)
            or not math.isfinite(number)
        ):
            raise ValueError("a number")
    return replace(entry, system=printable(entry.system)[:MAX_NAME])


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
        entries: as `app.run.many.board.merged` orders them.
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
