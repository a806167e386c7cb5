"""Plans as Praat's TextGrids, in and out, and those of the corpus."""

from __future__ import annotations

import codecs
import re
from collections.abc import Sequence
from pathlib import Path

from model.plan.annotation import (
    GOAL_TIER,
    PHASE_TIER,
    NamedTier,
    PlanRead,
    Row,
    plan_of_tiers,
    tiers_of,
)
from model.plan.plan import SIDES, GesturePlan, PlanError, plan_bytes

_ITEM = re.compile(r"^[ \t]*item \[\d+\]:", re.MULTILINE)
_NAME = re.compile(r'name = "((?:[^"]|"")*)"')
_XMAX = re.compile(r"^xmax = ([\d.]{1,40})", re.MULTILINE)
_INTERVAL = re.compile(r'xmin = ([^\s"]{1,40})\s+xmax = ([^\s"]{1,40})\s+text = "((?:[^"]|"")*)"')
_POINT = re.compile(r'(?:number|time) = ([^\s"]{1,40})\s+mark = "((?:[^"]|"")*)"')


def read_textgrid_plan(path: Path) -> PlanRead:
    """The plan in a TextGrid: our own, the corpus's, or an annotator's.

    Raises:
        PlanError: if the file is missing, too large, no TextGrid, or tells no plan.
    """
    tiers, duration_s = _read(path)
    try:
        return plan_of_tiers(tiers, duration_s)
    except PlanError as error:
        raise PlanError(f"{path.name}: {error}") from None


def annotated_plan(path: Path) -> GesturePlan:
    """The plan in a TextGrid of the corpus, whose hands have phases and goals.

    Raises:
        PlanError: if it tells no gestures of both hands with their goals.
    """
    tiers, duration_s = _read(path)
    needed = [f"{what}_{side}" for side in SIDES for what in (PHASE_TIER, GOAL_TIER)]
    missing = sorted(set(needed) - {tier.name for tier in tiers}, key=needed.index)
    if missing:
        raise PlanError(f"{path.name} has no tier {missing[0]}.")
    return plan_of_tiers(tiers, duration_s).plan


def textgrid_of(plan: GesturePlan) -> str:
    """The plan in Praat's long text format; times and numbers have four decimals.

    Raises:
        PlanError: if events overlap that one tier must hold.
    """
    end_s = max([plan.duration_s, *_ends(plan)])
    return textgrid_of_tiers(_joined(tiers_of(plan)), plan.duration_s, end_s)


def textgrid_of_tiers(
    tiers: Sequence[NamedTier], duration_s: float, end_s: float | None = None
) -> str:
    """Tiers in Praat's long text format. Gaps between intervals are filled with empty ones up to
    ``end_s``, usually the duration."""
    head = (
        'File type = "ooTextFile"\nObject class = "TextGrid"\n\n'
        f"xmin = 0\nxmax = {duration_s:.4f}\ntiers? <exists>\nsize = {len(tiers)}\nitem []:\n"
    )
    return head + "".join(
        f"    item [{number}]:\n{_written(tier, end_s or duration_s)}"
        for number, tier in enumerate(tiers, 1)
    )


def _ends(plan: GesturePlan) -> list[float]:
    return [row.end_s for tier in tiers_of(plan) for row in tier.rows]


def _joined(tiers: Sequence[NamedTier]) -> list[NamedTier]:
    """Phases with their kinds in one label, as in the corpus; what tells more of them as points at
    their ends."""
    kinds = {
        (tier.parent, row.end_s): row.label
        for tier in tiers
        if tier.name.startswith("kind_")
        for row in tier.rows
    }
    found = []
    for tier in tiers:
        if tier.name.startswith("kind_"):
            continue
        if tier.parent:
            points = tuple(Row(row.end_s, row.end_s, row.label) for row in tier.rows)
            tier = NamedTier(tier.name, points, has_points=True)
        elif tier.name.startswith(PHASE_TIER):
            rows = (
                Row(
                    row.start_s,
                    row.end_s,
                    f"{row.label} {kinds.get((tier.name, row.end_s), '')}".rstrip(" "),
                )
                for row in tier.rows
            )
            tier = NamedTier(tier.name, tuple(rows))
        found.append(tier)
    return found


def _written(tier: NamedTier, end_s: float) -> str:
    kind = "TextTier" if tier.has_points else "IntervalTier"
    what = "points" if tier.has_points else "intervals"
    rows = tier.rows if tier.has_points else _covering(tier.rows, end_s)
    lines = [
        f'        class = "{kind}"',
        f'        name = "{tier.name}"',
        "        xmin = 0",
        f"        xmax = {end_s:.4f}",
        f"        {what}: size = {len(rows)}",
    ]
    for number, row in enumerate(rows, 1):
        label = row.label.replace('"', '""')
        lines.append(f"        {what} [{number}]:")
        if tier.has_points:
            lines += [f"            number = {row.start_s:.4f}", f'            mark = "{label}"']
        else:
            lines += [
                f"            xmin = {row.start_s:.4f}",
                f"            xmax = {row.end_s:.4f}",
                f'            text = "{label}"',
            ]
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


def _read(path: Path) -> tuple[list[NamedTier], float]:
    text = _text(path)
    if "ooTextFile" not in text[:200] or "TextGrid" not in text[:200]:
        raise PlanError(f"{path.name} is no TextGrid; save one in Praat's long text format.")
    length = _XMAX.search(text)
    tiers: list[NamedTier] = []
    for part in _ITEM.split(text)[1:]:
        name = _NAME.search(part)
        if name is None:
            continue
        has_points = '"TextTier"' in part[: name.end()]
        rows = (
            [(at, at, label) for at, label in _POINT.findall(part)]
            if has_points
            else _INTERVAL.findall(part)
        )
        told = (_told(path, *row) for row in rows if row[2] or has_points)
        tiers.append(NamedTier(_unquoted(name[1]), tuple(told), has_points))
    if length is None or not tiers:
        raise PlanError(f"{path.name} has no tier at all, or another format than Praat's long one.")
    return tiers, _seconds(path, length[1])


def _told(path: Path, start: str, end: str, label: str) -> Row:
    return Row(_seconds(path, start), _seconds(path, end), _unquoted(label))


def _seconds(path: Path, text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0 <= seconds < 1e6:
        raise PlanError(f"{path.name} has the time {text[:20]!r}, which is no time of a plan.")
    return seconds


def _unquoted(text: str) -> str:
    return text.replace('""', '"')


def _text(path: Path) -> str:
    """Praat writes UTF-8, or UTF-16 with a byte order mark."""
    data = plan_bytes(path)
    is_utf16 = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        return data.decode("utf-16" if is_utf16 else "utf-8-sig")
    except UnicodeDecodeError as error:
        raise PlanError(f"{path.name} is no text in UTF-8 or UTF-16.") from error
