"""Reading and writing of annotation tiers: Praat's TextGrids and ELAN's files (.eaf).

praatio drops the sign of a time, doubles the quotes of a point's label, and cannot read times with
an exponent, or labels of several lines or with ``item [`` in them; pympi-ling loses attributes of
included annotations, loops forever on circular references, has no times for slots left open, and
needs as many checks before it as are here. ELAN's times are whole milliseconds, points are spans.
"""

from __future__ import annotations

import codecs
import io
import re
import xml.etree.ElementTree as ET
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from math import nan
from urllib.parse import quote

import numpy as np

from model.plan.plan import PHASES, PlanError

_CLASSES = ("IntervalTier", "TextTier")
_VALUE = re.compile(r'"([^"]*(?:""[^"]*)*)"|(?<![^\s=])([-+.\d][^\s"]*)')
"""Texts and free-standing numbers, which are all that Praat reads in its text formats."""


@dataclass(frozen=True)
class Interval:
    """A labelled interval of a tier, such as a word (s); a point if both times are equal."""

    start_s: float
    end_s: float
    text: str

    @property
    def middle_s(self) -> float:
        if self.start_s == self.end_s:
            return self.start_s
        return round(0.5 * (self.start_s + self.end_s), 4)


@dataclass(frozen=True)
class NamedTier:
    """A named tier of rows in order of time."""

    name: str
    rows: tuple[Interval, ...]
    has_points: bool = False
    """True if its rows are points."""
    parent: str = ""
    """Name of the parent tier, to some rows of which these rows refer one to one."""


def decode_text(data: bytes, name: str, error: type[ValueError]) -> tuple[str, tuple[str, ...]]:
    """Decode UTF-8, UTF-16 with byte order mark, or Latin-1 (Windows-1252) with a note."""
    is_utf16 = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    with suppress(UnicodeDecodeError):
        return data.decode("utf-16" if is_utf16 else "utf-8-sig"), ()
    with suppress(UnicodeDecodeError):
        text = data.decode("cp1252")
        if not is_utf16 and all(sign >= " " or sign.isspace() for sign in set(text)):
            note = (
                f"{name} is not UTF-8; it was read as Latin-1 (Windows-1252). If letters with "
                "accents are wrong, save it as UTF-8."
            )
            return text, (note,)
    raise error(f"{name} is not text in UTF-8, UTF-16 or Latin-1.")


def is_textgrid(text: str) -> bool:
    """Check whether a text starts as a TextGrid does."""
    return "ooTextFile" in text[:200] and "TextGrid" in text[:200]


def parse_textgrid(text: str, name: str, error: type[ValueError]) -> tuple[list[NamedTier], float]:
    """Parse the tiers of a TextGrid with all rows, and its duration (s); missing numbers are nan.

    Raises ``error`` for another text, or one with fewer tiers or rows than it states.
    """
    if not is_textgrid(text):
        raise error(f"{name} is not a TextGrid; save one as text in Praat.")
    tiers: list[NamedTier] = []
    rows: list[Interval] = []
    numbers: deque[float] = deque(maxlen=6)
    length, kind, called = nan, "", ""
    num_tiers = num_rows = 0.0

    def end_tier() -> None:
        count = num_rows if rows or len(numbers) < 3 else numbers[2]
        if len(rows) < count:
            raise error(
                f"{name} is cut off or damaged: its tier {called[:40]!r} should have {count:g} "
                f"rows and has {len(rows)}; save it again."
            )
        tiers.append(NamedTier(called, tuple(rows), kind == "TextTier"))

    for match in _VALUE.finditer(text):
        if match[2] is not None:
            numbers.append(_number(match[2]))
            continue
        text_value = match[1].replace('""', '"')
        if text_value in _CLASSES and len(numbers) in (
            0,
            3,
        ):  # after a head of two times and a count
            if kind:
                end_tier()
            elif numbers:
                length, num_tiers = numbers[1], numbers[2]
            kind, called, rows, num_rows = text_value, "", [], 0.0
        elif kind and not (called or numbers):
            called = text_value
        elif kind and numbers:
            times = 1 if kind == "TextTier" else 2
            if len(numbers) < times:
                raise error(
                    f"{name} is cut off or damaged: {text_value[:40]!r} in its tier "
                    f"{called[:40]!r} has no start or end time; save it again."
                )
            if not rows and len(numbers) == times + 3:  # after the tier's two times and its count
                num_rows = numbers[2]
            rows.append(Interval(numbers[-times], numbers[-1], text_value))
        numbers.clear()
    if kind:
        end_tier()
    if len(tiers) < num_tiers:
        raise error(
            f"{name} is cut off or damaged: it should have {num_tiers:g} tiers and has "
            f"{len(tiers)}; save it again."
        )
    return tiers, length


def format_textgrid(
    tiers: Sequence[NamedTier], duration_s: float, tier_end_s: float | None = None
) -> str:
    """Format tiers in Praat's long text format, filling gaps with empty intervals.

    ``tier_end_s`` is the xmax of the tiers, which may end later; by default ``duration_s``.
    """
    tier_end_s = tier_end_s or duration_s
    lines = [
        'File type = "ooTextFile"', 'Object class = "TextGrid"', "", "xmin = 0",
        f"xmax = {duration_s:.4f}", "tiers? <exists>", f"size = {len(tiers)}", "item []:",
    ]  # fmt: skip
    for number, tier in enumerate(tiers, 1):
        kind, what = ("TextTier", "points") if tier.has_points else ("IntervalTier", "intervals")
        rows = tier.rows if tier.has_points else _fill_gaps(tier.rows, tier_end_s)
        lines += [
            f"    item [{number}]:", f"        class = {_quoted(kind)}",
            f"        name = {_quoted(tier.name)}", "        xmin = 0",
            f"        xmax = {tier_end_s:.4f}",
            f"        {what}: size = {len(rows)}",
        ]  # fmt: skip
        for k, row in enumerate(rows, 1):
            lines.append(f"        {what} [{k}]:")
            label = _quoted(row.text)
            if tier.has_points:
                fields = f"number = {row.start_s:.4f}", f"mark = {label}"
            else:
                fields = f"xmin = {row.start_s:.4f}", f"xmax = {row.end_s:.4f}", f"text = {label}"
            lines += [f"            {each}" for each in fields]
    return "\n".join(lines) + "\n"


def _fill_gaps(rows: Sequence[Interval], end_s: float) -> list[Interval]:
    """Return the rows with empty ones in the gaps, and without those of zero length."""
    filled: list[Interval] = []
    at_s = 0.0
    for row in rows:
        if row.end_s <= max(at_s, row.start_s):
            continue
        if row.start_s > at_s:
            filled.append(Interval(at_s, row.start_s, ""))
        filled.append(Interval(max(row.start_s, at_s), row.end_s, row.text))
        at_s = row.end_s
    if at_s < end_s or not filled:
        filled.append(Interval(at_s, end_s, ""))
    return filled


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '""') + '"'


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return nan


AROUND_MS = 50
"""Time before and after a point that its span covers in ELAN, if there is room."""
MAX_ELEMENTS = 250_000
"""Largest number of elements; an hour annotated with all its phones has 200,000."""
MAX_TAG_BYTES = 50_000
"""Longest tag with its attributes and the text after it."""
MAX_DEPTH = 16
MAX_HOURS = 24
_DURATION = "duration_s"
_ORIGIN = re.compile(r"-?[0-9]{1,9}")
_PHRASES = "gesture"
"""Prefix of the names of tiers that have a vocabulary of phases."""
_DOCUMENT = """\
<ANNOTATION_DOCUMENT AUTHOR="" DATE="" FORMAT="3.0" VERSION="3.0"
    xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
    xsi:noNamespaceSchemaLocation="http://www.mpi.nl/tools/elan/EAFv3.0.xsd">
  <HEADER MEDIA_FILE="" TIME_UNITS="milliseconds"/>
  <TIME_ORDER/>
  <LINGUISTIC_TYPE LINGUISTIC_TYPE_ID="phase" TIME_ALIGNABLE="true" GRAPHIC_REFERENCES="false"
    CONTROLLED_VOCABULARY_REF="phases"/>
  <LINGUISTIC_TYPE LINGUISTIC_TYPE_ID="phase attribute" TIME_ALIGNABLE="false"
    GRAPHIC_REFERENCES="false" CONSTRAINTS="Symbolic_Association"/>
  <LINGUISTIC_TYPE LINGUISTIC_TYPE_ID="time" TIME_ALIGNABLE="true" GRAPHIC_REFERENCES="false"/>
  <LANGUAGE LANG_DEF="http://cdb.iso.org/lg/CDB-00138502-001" LANG_ID="eng"
    LANG_LABEL="English (eng)"/>
  <CONSTRAINT STEREOTYPE="Symbolic_Association"
    DESCRIPTION="1-1 association with a parent annotation"/>
  <CONTROLLED_VOCABULARY CV_ID="phases">
    <DESCRIPTION LANG_REF="eng">What a hand does</DESCRIPTION>
  </CONTROLLED_VOCABULARY>
</ANNOTATION_DOCUMENT>
"""


def parse_elan(data: bytes, name: str) -> tuple[list[NamedTier], float, tuple[str, ...]]:
    """Parse an ELAN file's tiers in media time, its duration or last time (s), and notes.

    Raises PlanError, with the file's name, if it is not an ELAN file, or a dangerous one.
    """
    root = _parsed(data, name)
    if root.tag != "ANNOTATION_DOCUMENT":
        raise PlanError(f"{name} is not an ELAN file (.eaf).")
    header = root.find("HEADER")
    if header is not None and header.get("TIME_UNITS", "milliseconds") != "milliseconds":
        raise PlanError(
            f"{name} has the time unit {header.get('TIME_UNITS')!r:.40}; it must be milliseconds."
        )
    slots, notes = _slots(root, name), ()
    if (origin_s := _media_origin_s(root, name)) != 0:
        slots = {slot: max(0.0, time_s + origin_s) for slot, time_s in slots.items()}
        notes = (
            f"{name}: the ELAN timeline begins {origin_s:g} s after the start of the media "
            f"(TIME_ORIGIN), so {origin_s:g} s were added to all times.",
        )
    durations = (
        each.text for each in root.iterfind("HEADER/PROPERTY") if each.get("NAME") == _DURATION
    )
    try:
        duration_s = float((next(durations, "") or "").strip()[:40])
    except ValueError:
        duration_s = max(slots.values(), default=0.0)
    duration_s = max([duration_s, *slots.values()]) if origin_s > 0 else duration_s
    return list(_tiers(root, slots, name)), duration_s, notes


def format_elan(tiers: Sequence[NamedTier], duration_s: float, sound: str = "") -> str:
    """Format tiers as an ELAN file; times are rounded to milliseconds.

    The path of the sound is relative to the file's folder. Raises PlanError if a label holds
    characters that XML cannot.
    """
    slots: list[int] = []
    names: dict[tuple[str, float], str] = {}
    count = 0
    root = ET.fromstring(_DOCUMENT)
    root.set("DATE", datetime.now(UTC).isoformat(timespec="seconds"))
    header, order, *_, vocabulary = root
    for place, tier in enumerate(tiers, 2):
        spans = _around(tier.rows) if tier.has_points else [_span(row) for row in tier.rows]
        kind = "phase" if tier.name.startswith(_PHRASES) else "time"
        tier_element = ET.Element("TIER", LINGUISTIC_TYPE_REF=kind, TIER_ID=tier.name)
        if tier.parent:
            tier_element.attrib |= {
                "LINGUISTIC_TYPE_REF": "phase attribute",
                "PARENT_REF": tier.parent,
            }
        root.insert(place, tier_element)
        for row, (start, end) in zip(tier.rows, spans, strict=True):
            of = names.get((tier.parent, row.end_s), "")
            if not of if tier.parent else end <= start:
                continue
            count += 1
            if tier.parent:
                what, where = "REF", {"ANNOTATION_REF": of}
            else:
                names[tier.name, row.end_s] = f"a{count}"
                what = "ALIGNABLE"
                where = {f"TIME_SLOT_REF{k + 1}": f"ts{len(slots) + k}" for k in (0, 1)}
                slots += start, end
            one = _add_element(
                _add_element(tier_element, "ANNOTATION"), f"{what}_ANNOTATION", **where
            )
            one.set("ANNOTATION_ID", f"a{count}")
            _add_element(one, "ANNOTATION_VALUE", _label(row.text))
    if sound:
        url = f"./{quote(sound)}"
        media = {"MEDIA_URL": url, "RELATIVE_MEDIA_URL": url, "MIME_TYPE": "audio/x-wav"}
        _add_element(header, "MEDIA_DESCRIPTOR", **media)
    _add_element(header, "PROPERTY", f"{duration_s:.4f}", NAME=_DURATION)
    _add_element(header, "PROPERTY", str(count), NAME="lastUsedAnnotationId")
    for k in sorted(range(len(slots)), key=slots.__getitem__):
        _add_element(order, "TIME_SLOT", TIME_SLOT_ID=f"ts{k}", TIME_VALUE=str(slots[k]))
    for k, phase in enumerate(PHASES):
        entry = _add_element(vocabulary, "CV_ENTRY_ML", CVE_ID=f"cve{k}")
        _add_element(entry, "CVE_VALUE", phase, LANG_REF="eng", DESCRIPTION="")
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, "unicode")}\n'


def _add_element(
    parent: ET.Element, tag: str, text: str | None = None, **attributes: str
) -> ET.Element:
    element = ET.SubElement(parent, tag, attributes)
    element.text = text
    return element


def _label(label: str) -> str:
    if any("\ud800" <= sign <= "\udfff" for sign in label):
        raise PlanError(f"The label {label[:40]!r} is not valid Unicode text.")
    if not all(sign in "\t\n" or (" " <= sign and sign not in "\ufffe\uffff") for sign in label):
        raise PlanError(f"The label {label[:40]!r} has a character that ELAN does not allow.")
    return label


def _span(row: Interval) -> tuple[int, int]:
    return max(0, round(1000 * row.start_s)), max(0, round(1000 * row.end_s))


def _around(rows: Sequence[Interval]) -> list[tuple[int, int]]:
    """Return a span around each point without overlaps; points are at least 2 ms apart."""
    at: list[int] = []
    for row in rows:
        at.append(max(round(1000 * row.start_s), at[-1] + 2 if at else 1))
    gaps = [at[0], *(b - a for a, b in pairwise(at)), 2 * AROUND_MS] if at else []
    nearby = []
    for k, middle in enumerate(at):
        room = min(gaps[k] if k == 0 else gaps[k] // 2, gaps[k + 1] // 2, AROUND_MS)
        nearby.append((middle - room, middle + room))
    return nearby


def _parsed(data: bytes, name: str) -> ET.Element:
    """Parse the elements of a file, without entities, definitions or anything outside of it."""
    if re.search(rb"<!\s*(DOCTYPE|ENTITY)", data.replace(b"\0", b""), re.IGNORECASE):
        raise PlanError(
            f"{name} has a DOCTYPE or ENTITY declaration, which ELAN files do not have; save it "
            "again in ELAN."
        )
    if data.count(b"<") > 2 * MAX_ELEMENTS:  # before any of them takes time
        raise PlanError(f"{name} exceeds the limit of {MAX_ELEMENTS:,} XML elements.")
    if (
        max(map(len, data.split(b"<"))) > MAX_TAG_BYTES
    ):  # of attributes each costs more than all before
        raise PlanError(f"{name} has a label or tag above the limit of {MAX_TAG_BYTES:,} bytes.")
    depth = count = 0
    try:
        events = ET.iterparse(io.BytesIO(data), ("start", "end"))
        for event, _ in events:
            depth, count = (depth + 1, count + 1) if event == "start" else (depth - 1, count)
            if depth > MAX_DEPTH or count > MAX_ELEMENTS:
                raise PlanError(
                    f"{name} exceeds the limit of {MAX_ELEMENTS:,} XML elements or {MAX_DEPTH} "
                    "nesting levels."
                )
        return events.root  # pyright: ignore[reportAttributeAccessIssue]
    except PlanError:
        raise
    except (ET.ParseError, LookupError, ValueError) as error:
        raise PlanError(f"{name} is not an ELAN file: {str(error)[:80]}.") from None


def _media_origin_s(root: ET.Element, file: str) -> float:
    """Return where ELAN's timeline starts in the first sound file, or else the first file (s)."""
    media = root.findall("HEADER/MEDIA_DESCRIPTOR")
    sounds = [each for each in media if each.get("MIME_TYPE", "").startswith("audio/")]
    value = next((each.get("TIME_ORIGIN") for each in sounds or media), None) or "0"
    if not _ORIGIN.fullmatch(value) or abs(int(value)) > MAX_HOURS * 3_600_000:
        raise PlanError(f"{file}: the TIME_ORIGIN {value[:20]!r} is not a number of milliseconds.")
    return int(value) / 1000


def _slots(root: ET.Element, file: str) -> dict[str, float]:
    """Return the time of each slot (s); those without one lie evenly between their neighbours."""
    names, slots, times = [], [], []
    for k, slot in enumerate(root.iterfind("TIME_ORDER/TIME_SLOT")):
        names.append(slot.get("TIME_SLOT_ID", ""))
        value = slot.get("TIME_VALUE")
        if value is None:
            continue
        if not value.isascii() or not value.isdigit() or len(value) > 9:
            raise PlanError(f"{file}: the time {value[:20]!r} is not a number of milliseconds.")
        if int(value) > MAX_HOURS * 3_600_000:
            raise PlanError(f"{file} is longer than the limit of {MAX_HOURS} hours.")
        slots.append(k)
        times.append(int(value) / 1000)
    if not slots:
        return {}
    seconds = np.interp(np.arange(len(names)), slots, times)
    return dict(zip(names, seconds.tolist(), strict=True))


def _tiers(root: ET.Element, slots: dict[str, float], file: str) -> Iterator[NamedTier]:
    spans: dict[str, tuple[float, float]] = {}
    refs: dict[str, str] = {}
    for one in root.iterfind("TIER/ANNOTATION/*"):
        name = one.get("ANNOTATION_ID", "")
        if one.tag == "ALIGNABLE_ANNOTATION":
            ends = [one.get(f"TIME_SLOT_REF{k}", "") for k in (1, 2)]
            if not set(ends) <= set(slots):
                raise PlanError(f"{file}: annotation {name[:20]!r} has no times.")
            spans[name] = slots[ends[0]], slots[ends[1]]
        else:
            refs[name] = one.get("ANNOTATION_REF", "")
    for tier in root.iterfind("TIER"):
        rows = []
        for one in tier.iterfind("ANNOTATION/*"):
            name = one.get("ANNOTATION_ID", "")
            for _ in range(MAX_DEPTH):
                if name in spans:
                    break
                name = refs.get(name, "")
            start_s, end_s = spans.get(name, (0.0, 0.0))
            if start_s < end_s:
                rows.append(Interval(start_s, end_s, one.findtext("ANNOTATION_VALUE") or ""))
        yield NamedTier(tier.get("TIER_ID", ""), tuple(rows), parent=tier.get("PARENT_REF", ""))
