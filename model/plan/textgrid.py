"""Tiers of rows, as annotators write them down, and Praat's TextGrids of them, read and written.

Not by praatio, which drops the sign of a time, doubles the quotes of a point's label, and cannot
read times with an exponent, or labels of several lines or with ``item [`` in them.
"""

from __future__ import annotations

import codecs
import re
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import nan

_CLASSES = ("IntervalTier", "TextTier")
_VALUE = re.compile(r'"([^"]*(?:""[^"]*)*)"|(?<![^\s=])([-+.\d][^\s"]*)')
"""All that Praat reads in its text formats, long or short: texts, and numbers that stand free."""


@dataclass(frozen=True)
class Row:
    """What a tier says of some time; of a moment where both times are the same."""

    start_s: float
    end_s: float
    label: str

    @property
    def middle_s(self) -> float:
        if self.start_s == self.end_s:
            return self.start_s
        return round(0.5 * (self.start_s + self.end_s), 4)


@dataclass(frozen=True)
class NamedTier:
    """Rows under one name, in time."""

    name: str
    rows: tuple[Row, ...]
    has_points: bool = False
    """Its rows are moments."""
    parent: str = ""
    """The tier whose rows these tell more of, one for one of some of them."""


def decoded(data: bytes) -> str:
    """Text in UTF-8, or in UTF-16 with a byte order mark, as Praat writes it.

    Raises:
        UnicodeDecodeError: if it is neither.
    """
    is_utf16 = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    return data.decode("utf-16" if is_utf16 else "utf-8-sig")


def is_textgrid(text: str) -> bool:
    """Whether it begins as a TextGrid does."""
    return "ooTextFile" in text[:200] and "TextGrid" in text[:200]


def textgrid_tiers(text: str) -> tuple[list[NamedTier], float]:
    """The tiers of a TextGrid with all of their rows, and how long it is; what is no number there
    is nan, as is a length that is not told."""
    tiers: list[NamedTier] = []
    rows: list[Row] = []
    numbers: deque[float] = deque(maxlen=6)
    length, kind, name = nan, "", ""
    for found in _VALUE.finditer(text):
        if found[2] is not None:
            numbers.append(_number(found[2]))
            continue
        told = found[1].replace('""', '"')
        if told in _CLASSES and len(numbers) in (0, 3):  # after a head of two times and a count
            if kind:
                tiers.append(NamedTier(name, tuple(rows), kind == "TextTier"))
            elif numbers:
                length = numbers[1]
            kind, name, rows = told, "", []
        elif kind and not (name or numbers):
            name = told
        elif kind and numbers:
            rows.append(Row(numbers[-1 if kind == "TextTier" else -2], numbers[-1], told))
        numbers.clear()
    if kind:
        tiers.append(NamedTier(name, tuple(rows), kind == "TextTier"))
    return tiers, length


def textgrid_of(tiers: Sequence[NamedTier], duration_s: float, end_s: float | None = None) -> str:
    """Tiers in Praat's long text format. Gaps between intervals are filled with empty ones up to
    ``end_s``, usually the duration; times have four decimals."""
    end_s = end_s or duration_s
    lines = [
        'File type = "ooTextFile"', 'Object class = "TextGrid"', "", "xmin = 0",
        f"xmax = {duration_s:.4f}", "tiers? <exists>", f"size = {len(tiers)}", "item []:",
    ]  # fmt: skip
    for number, tier in enumerate(tiers, 1):
        kind, what = ("TextTier", "points") if tier.has_points else ("IntervalTier", "intervals")
        rows = tier.rows if tier.has_points else _covering(tier.rows, end_s)
        lines += [
            f"    item [{number}]:", f"        class = {_quoted(kind)}",
            f"        name = {_quoted(tier.name)}", "        xmin = 0",
            f"        xmax = {end_s:.4f}",
            f"        {what}: size = {len(rows)}",
        ]  # fmt: skip
        for k, row in enumerate(rows, 1):
            lines.append(f"        {what} [{k}]:")
            label = _quoted(row.label)
            if tier.has_points:
                told = f"number = {row.start_s:.4f}", f"mark = {label}"
            else:
                told = f"xmin = {row.start_s:.4f}", f"xmax = {row.end_s:.4f}", f"text = {label}"
            lines += [f"            {each}" for each in told]
    return "\n".join(lines) + "\n"


def _covering(rows: Sequence[Row], end_s: float) -> list[Row]:
    """The rows, with empty ones in the gaps; of no length are left out."""
    filled: list[Row] = []
    at_s = 0.0
    for row in rows:
        if row.end_s <= max(at_s, row.start_s):
            continue
        if row.start_s > at_s:
            filled.append(Row(at_s, row.start_s, ""))
        filled.append(Row(max(row.start_s, at_s), row.end_s, row.label))
        at_s = row.end_s
    if at_s < end_s or not filled:
        filled.append(Row(at_s, end_s, ""))
    return filled


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '""') + '"'


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return nan
