"""Plans as ELAN's annotation files (.eaf), in and out.

For each hand a tier of phases from a list to choose from, and below it what tells more of a phase:
kind, word, goal. ELAN's times are whole milliseconds; a moment is a span around it.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from urllib.parse import quote
from xml.parsers import expat

import numpy as np

from model.plan.annotation import NamedTier, PlanRead, Row, plan_of_tiers, tiers_of
from model.plan.plan import PHASES, GesturePlan, PlanError, plan_bytes

AROUND_MS = 50
"""A moment's span begins so long before it, and ends so long after, where there is room."""
MAX_ELEMENTS = 1_000_000
MAX_DEPTH = 16
MAX_HOURS = 24
_PHASE_TYPE, _MORE_TYPE, _FREE_TYPE = "phase", "more of a phase", "time"
_PHASES_LIST = "phases"
_SCHEMA = "http://www.mpi.nl/tools/elan/EAFv3.0.xsd"
_DURATION = "duration_s"


def read_elan_plan(path: Path) -> PlanRead:
    """The plan in an ELAN file: our own, or an annotator's.

    Raises:
        PlanError: if the file is missing, too large, no ELAN file, or tells no plan.
    """
    root = _parsed(path)
    if root.tag != "ANNOTATION_DOCUMENT":
        raise PlanError(f"{path.name} is no ELAN file (.eaf).")
    header = root.find("HEADER")
    if header is not None and header.get("TIME_UNITS", "milliseconds") != "milliseconds":
        raise PlanError(f"{path.name} counts time in {header.get('TIME_UNITS')!r:.40}, not in ms.")
    try:
        slots = _slots(root)
        tiers = list(_tiers(root, slots))
        return plan_of_tiers(tiers, _duration_s(root, slots))
    except PlanError as error:
        raise PlanError(f"{path.name}: {error}") from None


def elan_of(plan: GesturePlan, sound: str = "") -> str:
    """The plan as an ELAN file; times are rounded to milliseconds, numbers to four decimals.

    Args:
        sound: where the speech lies, from the file's own folder.

    Raises:
        PlanError: if events overlap that one tier must hold, or a name holds what XML cannot.
    """
    writer = _Writer()
    for tier in tiers_of(plan):
        writer.add(tier)
    return writer.document(f"{plan.duration_s:.4f}", sound)


class _Writer:
    """Collects tiers, their times and their annotations."""

    def __init__(self) -> None:
        self._slots: list[int] = []
        self._tiers: list[ET.Element] = []
        self._number = 0
        self._by_time: dict[tuple[str, float], str] = {}

    def add(self, tier: NamedTier) -> None:
        has_list = any(row.label in PHASES for row in tier.rows) or tier.name.startswith("gesture")
        kind = _MORE_TYPE if tier.parent else _PHASE_TYPE if has_list else _FREE_TYPE
        told = ET.Element("TIER", {"LINGUISTIC_TYPE_REF": kind, "TIER_ID": tier.name})
        self._tiers.append(told)
        if tier.parent:
            told.set("PARENT_REF", tier.parent)
            for row in tier.rows:
                parent = self._by_time.get((tier.parent, row.end_s))
                if parent is not None:
                    more = {"ANNOTATION_ID": self._id(), "ANNOTATION_REF": parent}
                    _annotate(told, "REF_ANNOTATION", more, row.label)
            return
        spans = _around(tier.rows) if tier.has_points else [_span(row) for row in tier.rows]
        for row, (start, end) in zip(tier.rows, spans, strict=True):
            if end <= start:
                continue
            name = self._by_time[tier.name, row.end_s] = self._id()
            refs = {f"TIME_SLOT_REF{k}": self._slot(at) for k, at in ((1, start), (2, end))}
            _annotate(told, "ALIGNABLE_ANNOTATION", {"ANNOTATION_ID": name, **refs}, row.label)

    def document(self, duration_s: str, sound: str) -> str:
        """The whole file."""
        root = ET.Element("ANNOTATION_DOCUMENT", {
            "AUTHOR": "", "DATE": datetime.now(UTC).isoformat(timespec="seconds"),
            "FORMAT": "3.0", "VERSION": "3.0",
            "xmlns:xsi": "http://www.w3.org/2001/XMLSchema-instance",
            "xsi:noNamespaceSchemaLocation": _SCHEMA,
        })  # fmt: skip
        header = ET.SubElement(root, "HEADER", MEDIA_FILE="", TIME_UNITS="milliseconds")
        if sound:
            url = f"./{quote(sound)}"
            media = {"MEDIA_URL": url, "RELATIVE_MEDIA_URL": url, "MIME_TYPE": "audio/x-wav"}
            ET.SubElement(header, "MEDIA_DESCRIPTOR", media)
        ET.SubElement(header, "PROPERTY", NAME=_DURATION).text = duration_s
        ET.SubElement(header, "PROPERTY", NAME="lastUsedAnnotationId").text = str(self._number)
        times = ET.SubElement(root, "TIME_ORDER")
        order = sorted(range(len(self._slots)), key=self._slots.__getitem__)
        for k in order:
            ET.SubElement(times, "TIME_SLOT", TIME_SLOT_ID=f"ts{k}", TIME_VALUE=str(self._slots[k]))
        root.extend(self._tiers)
        ET.SubElement(
            root,
            "LINGUISTIC_TYPE",
            {
                "LINGUISTIC_TYPE_ID": _PHASE_TYPE,
                "TIME_ALIGNABLE": "true",
                "GRAPHIC_REFERENCES": "false",
                "CONTROLLED_VOCABULARY_REF": _PHASES_LIST,
            },
        )
        ET.SubElement(
            root,
            "LINGUISTIC_TYPE",
            {
                "LINGUISTIC_TYPE_ID": _MORE_TYPE,
                "TIME_ALIGNABLE": "false",
                "GRAPHIC_REFERENCES": "false",
                "CONSTRAINTS": "Symbolic_Association",
            },
        )
        ET.SubElement(root, "LINGUISTIC_TYPE", {
            "LINGUISTIC_TYPE_ID": _FREE_TYPE, "TIME_ALIGNABLE": "true",
            "GRAPHIC_REFERENCES": "false"})  # fmt: skip
        ET.SubElement(root, "LANGUAGE", {
            "LANG_DEF": "http://cdb.iso.org/lg/CDB-00138502-001", "LANG_ID": "eng",
            "LANG_LABEL": "English (eng)"})  # fmt: skip
        ET.SubElement(root, "CONSTRAINT", {
            "STEREOTYPE": "Symbolic_Association",
            "DESCRIPTION": "1-1 association with a parent annotation"})  # fmt: skip
        phases = ET.SubElement(root, "CONTROLLED_VOCABULARY", CV_ID=_PHASES_LIST)
        ET.SubElement(phases, "DESCRIPTION", LANG_REF="eng").text = "What a hand does"
        for k, phase in enumerate(PHASES):
            entry = ET.SubElement(phases, "CV_ENTRY_ML", CVE_ID=f"cve{k}")
            ET.SubElement(entry, "CVE_VALUE", LANG_REF="eng", DESCRIPTION="").text = phase
        ET.indent(root)
        return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, "unicode") + "\n"

    def _id(self) -> str:
        self._number += 1
        return f"a{self._number}"

    def _slot(self, at: int) -> str:
        self._slots.append(at)
        return f"ts{len(self._slots) - 1}"


def _annotate(tier: ET.Element, kind: str, fields: dict[str, str], label: str) -> None:
    if not all(sign in "\t\n" or (" " <= sign and sign not in "\ufffe\uffff") for sign in label):
        raise PlanError(f"The name {label[:40]!r} holds a sign that no ELAN file can.")
    if any("\ud800" <= sign <= "\udfff" for sign in label):
        raise PlanError(f"The name {label[:40]!r} is no text.")
    one = ET.SubElement(ET.SubElement(tier, "ANNOTATION"), kind, fields)
    ET.SubElement(one, "ANNOTATION_VALUE").text = label


def _span(row: Row) -> tuple[int, int]:
    return max(0, round(1000 * row.start_s)), max(0, round(1000 * row.end_s))


def _around(rows: Sequence[Row]) -> list[tuple[int, int]]:
    """A span around each moment, none over another. Moments lie 2 ms apart at least."""
    at: list[int] = []
    for row in rows:
        at.append(max(round(1000 * row.start_s), at[-1] + 2 if at else 1))
    gaps = [at[0], *(b - a for a, b in pairwise(at)), 2 * AROUND_MS] if at else []
    found = []
    for k, middle in enumerate(at):
        room = min(gaps[k] if k == 0 else gaps[k] // 2, gaps[k + 1] // 2, AROUND_MS)
        found.append((middle - room, middle + room))
    return found


def _parsed(path: Path) -> ET.Element:
    """The elements of a file, read without entities, definitions or anything outside of it."""
    data = plan_bytes(path)
    builder, depth, count = ET.TreeBuilder(), 0, 0
    parser = expat.ParserCreate()
    parser.buffer_text = True

    def start(tag: str, fields: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > MAX_DEPTH or count > MAX_ELEMENTS:
            raise PlanError(f"{path.name} is nested deeper or holds more than any ELAN file.")
        builder.start(tag, fields)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse(*_: object) -> None:
        raise PlanError(f"{path.name} defines a document type, which no ELAN file does.")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    try:
        parser.Parse(data, True)
        return builder.close()
    except (expat.ExpatError, AssertionError, UnicodeError, ValueError, LookupError) as error:
        if isinstance(error, PlanError):
            raise
        raise PlanError(f"{path.name} is no ELAN file: {str(error)[:80]}.") from None


def _slots(root: ET.Element) -> dict[str, float]:
    """Seconds of each time slot; those without a time lie evenly between their neighbours."""
    names, known, times = [], [], []
    for k, slot in enumerate(root.iterfind("TIME_ORDER/TIME_SLOT")):
        names.append(slot.get("TIME_SLOT_ID", ""))
        value = slot.get("TIME_VALUE")
        if value is None:
            continue
        if not value.isascii() or not value.isdigit() or len(value) > 9:
            raise PlanError(f"the time {value[:20]!r} is no number of milliseconds.")
        if int(value) > MAX_HOURS * 3_600_000:
            raise PlanError(f"it goes on for more than {MAX_HOURS} hours.")
        known.append(k)
        times.append(int(value) / 1000)
    if not known:
        return {}
    seconds = np.interp(np.arange(len(names)), known, times)
    return dict(zip(names, seconds.tolist(), strict=True))


def _tiers(root: ET.Element, slots: dict[str, float]) -> Iterator[NamedTier]:
    spans: dict[str, tuple[float, float]] = {}
    refs: dict[str, str] = {}
    for one in root.iterfind("TIER/ANNOTATION/*"):
        name = one.get("ANNOTATION_ID", "")
        if one.tag == "ALIGNABLE_ANNOTATION":
            ends = [one.get(f"TIME_SLOT_REF{k}", "") for k in (1, 2)]
            if not set(ends) <= set(slots):
                raise PlanError(f"annotation {name[:20]!r} has no times.")
            spans[name] = slots[ends[0]], slots[ends[1]]
        else:
            refs[name] = one.get("ANNOTATION_REF", "")

    def span(name: str) -> tuple[float, float] | None:
        for _ in range(MAX_DEPTH):
            if name in spans:
                return spans[name]
            name = refs.get(name, "")
        return None

    for tier in root.iterfind("TIER"):
        rows = []
        for one in tier.iterfind("ANNOTATION/*"):
            times = span(one.get("ANNOTATION_ID", ""))
            if times is not None and times[0] < times[1]:
                rows.append(Row(*times, one.findtext("ANNOTATION_VALUE") or ""))
        yield NamedTier(tier.get("TIER_ID", ""), tuple(rows), parent=tier.get("PARENT_REF", ""))


def _duration_s(root: ET.Element, slots: dict[str, float]) -> float:
    """As we write it, or else until the last time there is."""
    for told in root.iterfind("HEADER/PROPERTY"):
        if told.get("NAME") == _DURATION:
            try:
                return float((told.text or "").strip()[:40])
            except ValueError:
                break
    return max(slots.values(), default=0.0)
