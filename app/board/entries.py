"""What a leaderboard knows: one entry for each set of clips that a system made.

Numbers of two entries can be held against each other where they are of the same *test*: the same
clips, the same recorded motion, the same encoder. Entries of other tests stand in other tables.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from app.errors import RunError
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
