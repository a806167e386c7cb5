"""Motions beside each other: the table of measures, and by how much bodies differ."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape
from itertools import combinations

from app.findings.measure_rows import MEASURES, Measure, nearest, numbers_of, written
from app.notebook.inputs import MotionLike, SpeechLike, named_motions
from app.notebook.measuring import diagnose
from conventions.names import REFERENCE_NAME, Version
from model.diagnostics import Diagnostics
from model.measures.differences import degrees_by_part


@dataclass(frozen=True)
class Row:
    """One measure of all motions."""

    measure: Measure
    values: dict[str, float | None]
    """By motion, in the order of all, in the measure's unit; None where there is no such number."""
    nearest: tuple[str, ...]
    """Those nearest to the reference's."""

    @property
    def title(self) -> str:
        unit = f" ({self.measure.unit})" if self.measure.unit else ""
        return f"{self.measure.key}{unit}"


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """A table in a cell, and typed numbers; pandas takes ``as_dict()``."""

    names: tuple[str, ...]
    rows: tuple[Row, ...]
    apart_deg: dict[tuple[str, str], dict[str, float]]
    """Of each two motions, by part of the body: mean angle between the rotations of its joints, the
    part that differs most first."""

    def as_dict(self) -> dict[str, dict[str, float | None]]:
        """By measure, then by motion."""
        return {row.title: dict(row.values) for row in self.rows}

    def __repr__(self) -> str:
        widest = max(len(row.title) for row in self.rows)
        widths = [max(9, len(name)) for name in self.names]

        def line(title: str, cells: Iterable[str]) -> str:
            told = (f"  {cell:>{width}}" for cell, width in zip(cells, widths, strict=True))
            return f"{title:<{widest}}{''.join(told)}"

        rows = (line(row.title, map(written, row.values.values())) for row in self.rows)
        return "\n".join([line("", self.names), *rows])

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{escape(name)}</th>" for name in self.names)
        body = []
        for row in self.rows:
            cells = []
            for name, value in row.values.items():
                told = written(value)
                cells.append(f"<td>{f'<b>{told}</b>' if name in row.nearest else told}</td>")
            title = f'<th title="{escape(row.measure.about)}">{escape(row.title)}</th>'
            body.append(f"<tr>{title}{''.join(cells)}</tr>")
        note = "<caption>As generated. Bold: nearest to the reference.</caption>"
        return f"<table>{note}<tr><th></th>{head}</tr>{''.join(body)}</table>"


def compare(
    motions: Mapping[str, MotionLike],
    *,
    reference: MotionLike | None = None,
    speech: SpeechLike | None = None,
    diagnostics: Diagnostics | None = None,
    kind: Version = "raw",
) -> Comparison:
    """Measure motions beside each other.

    Args:
        reference: recorded motion; one called "reference" among the motions is taken for it, too.
        diagnostics: of these very motions, where they have been measured.
        kind: as generated ("raw") or behind the Savitzky-Golay filter ("savgol").

    Raises:
        ValueError: of what cannot be done, with one sentence.
    """
    named = named_motions(motions)
    if reference is None:
        reference = named.pop(REFERENCE_NAME, None)
    if diagnostics is None:
        diagnostics = diagnose(named, reference=reference, speech=speech, progress=False)
    of_all = dict(diagnostics.systems)
    if diagnostics.reference is not None:
        of_all[REFERENCE_NAME] = diagnostics.reference
    numbers = {name: numbers_of(versions.of(kind)) for name, versions in of_all.items()}
    rows = []
    for measure in MEASURES:
        values = {name: of.get(measure.key) for name, of in numbers.items()}
        if all(value is None for value in values.values()):
            continue
        target = values.get(REFERENCE_NAME) if measure.has_target else None
        of_systems = {name: value for name, value in values.items() if name != REFERENCE_NAME}
        rows.append(Row(measure, values, nearest(of_systems, target)))
    if reference is not None:
        named |= named_motions({REFERENCE_NAME: reference})
    apart = {(a, b): degrees_by_part(named[a], named[b]) for a, b in combinations(named, 2)}
    return Comparison(tuple(of_all), tuple(rows), apart)
