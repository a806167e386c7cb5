"""Leaderboard in one JSON file: entries from results, merging, and the HTML page.

Entries are comparable if they have the same *test*: the same clips, recorded motion and encoder.
Other tests have tables of their own.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any, Literal

import jinja2
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from app.errors import RunError
from app.findings import metric_table
from app.findings.comparison import format_finding_kinds
from app.findings.metric_table import FGD, FGD_EMAGE, FGD_GENEA, METRICS, POWER_ABOVE_5_HZ, TITLES
from app.run.output.run_folder import BATCH, FORMER_BATCH
from conventions.names import REFERENCE_NAME, printable
from model.storage.files import read_within_limit, write_atomically
from model.storage.json_validation import InvalidJsonError, read_json

FORMAT = 2
MAX_BYTES = 32 * 2**20
MAX_NAME = 100
MAX_NOTE = 400
_CONFIG = ConfigDict(
    strict=True, extra="forbid", allow_inf_nan=False, str_max_length=MAX_NOTE, validate_by_name=True
)


@dataclass(frozen=True)
class MetricValue:
    """Mean of one metric over clips, with its 95 % bootstrap interval."""

    __pydantic_config__ = _CONFIG
    mean: float
    low: float
    high: float
    unit: str
    num_clips: Annotated[int, Field(alias="clips")]
    protocol: str = "workbench/1"
    """Id of the protocol; values of different protocols are in different columns."""


@dataclass(frozen=True)
class LeaderboardEntry:
    """Results of one system on one test."""

    __pydantic_config__ = _CONFIG
    system: Annotated[str, AfterValidator(lambda name: printable(name)[:MAX_NAME])]
    test_id: Annotated[str, Field(alias="test")]
    """Short digest of clips, recorded motion and encoder."""
    files_digest: Annotated[str, Field(alias="files")]
    """Digest of the motion files."""
    num_clips: Annotated[int, Field(alias="clips")]
    measured_at: Annotated[str, Field(alias="made_at")]
    """Time of the measurement in ISO 8601."""
    program_version: Annotated[str, Field(alias="project")]
    """Version of this program that measured."""
    measures: dict[str, MetricValue]
    clips_with_finding: Annotated[dict[str, int], Field(alias="findings")]
    """Number of clips by kind of finding."""
    note: str = ""

    @property
    def is_recorded(self) -> bool:
        return self.system == REFERENCE_NAME

    @property
    def key(self) -> tuple[str, str, str]:
        """Key that entries for the same files and test share."""
        return self.test_id, self.system, self.files_digest

    @property
    def finding_count_texts(self) -> list[str]:
        """Kinds of findings with their numbers of clips, the most frequent first."""
        kinds = sorted(self.clips_with_finding.items(), key=lambda item: -item[1])
        return [f"{format_finding_kinds([kind])} {count}" for kind, count in kinds]


class Leaderboard(BaseModel):
    """Content of a leaderboard file, which may be from another lab."""

    format: Literal[2] = FORMAT
    entries: list[LeaderboardEntry]


def entries_from_results(
    folder: Path, note: str = "", systems: Iterable[str] = ()
) -> list[LeaderboardEntry]:
    """Make the entries of a folder of `diagnose` with whole sets.

    The note, such as the training or paper, is on all entries. Raises RunError with one sentence.
    """
    files = (folder / BATCH, folder / FORMER_BATCH)
    path = next(filter(Path.is_file, files), files[0])
    content = read_within_limit(path, MAX_BYTES, RunError)
    try:
        results = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise RunError(f"{path} is not valid JSON; measure the set again with diagnose.") from error
    try:
        return _entries(results, folder, note, set(systems))
    except RunError:
        raise
    except (LookupError, TypeError, AttributeError, ValueError) as error:
        raise RunError(
            f"{path} is damaged, or was written by another version of this program; measure the "
            "set again with diagnose."
        ) from error


def _entries(
    results: dict[str, Any], folder: Path, note: str, names: set[str]
) -> list[LeaderboardEntry]:
    where = results["provenance"]
    if not where["reference"]:
        raise RunError(
            f"{folder.name} was measured without a recorded set, so it cannot be compared with "
            "others; measure it again with --reference."
        )
    wanted = names or set(where["systems"]) - {REFERENCE_NAME}
    unknown = sorted(wanted - set(where["systems"]))
    if unknown:
        raise RunError(
            f"{folder.name} has no system {unknown[0]!r}; it has {', '.join(where['systems'])}."
        )
    if len(note) > MAX_NOTE:
        raise RunError(f"A note may have at most {MAX_NOTE} characters; this one has {len(note)}.")
    taken = wanted | {REFERENCE_NAME}
    entries = [_entry(results, where, name, note) for name in where["systems"] if name in taken]
    return Leaderboard.model_validate_json(
        json.dumps({"entries": list(map(asdict, entries))})
    ).entries


def _entry(
    results: dict[str, Any], where: dict[str, Any], name: str, note: str
) -> LeaderboardEntry:
    rows = [
        row for row in results["measures"] if row["system"] == name and not row["difference_to"]
    ]
    return LeaderboardEntry(
        system=name,
        test_id=_test_id_of(where),
        files_digest=where["systems"][name],
        num_clips=len(results["clips"]),
        measured_at=where["made_at"],
        program_version=where["project"],
        measures={
            row["measure"]: MetricValue(
                *(row[key] for key in ("mean", "low", "high", "unit", "clips", "protocol"))
            )
            for row in rows
        },
        clips_with_finding=results["clips_with_finding"].get(name, {}),
        note="" if name == REFERENCE_NAME else note,
    )


def _test_id_of(where: Mapping[str, Any]) -> str:
    """Compute the digest of everything that must be equal for numbers to be comparable."""
    same = [where[name] for name in ("reference", "encoders", "mean_speeds", "measures")]
    return hashlib.sha256(json.dumps(same, sort_keys=True).encode()).hexdigest()[:12]


def merge_entries(boards: Iterable[Iterable[LeaderboardEntry]]) -> list[LeaderboardEntry]:
    """Merge entries; of those with the same files and test, the latest measurement wins.

    If it has no note, it gets the earlier one's.
    """
    merged: dict[tuple[str, str, str], LeaderboardEntry] = {}
    for board in boards:
        for entry in board:
            existing = merged.get(entry.key)
            if existing is None:
                merged[entry.key] = entry
                continue
            newer, older = sorted((entry, existing), key=lambda one: one.measured_at, reverse=True)
            merged[entry.key] = replace(newer, note=newer.note or older.note)
    return sorted(
        merged.values(), key=lambda one: (one.test_id, one.is_recorded, one.system, one.measured_at)
    )


def write_leaderboard(entries: Iterable[LeaderboardEntry], path: Path) -> None:
    """Write a leaderboard atomically; raises WriteError."""
    board = Leaderboard(entries=list(entries))
    write_atomically(path, f"{board.model_dump_json(indent=1, by_alias=True)}\n")


def read_leaderboard(path: Path) -> list[LeaderboardEntry]:
    """Read a leaderboard; raises RunError if it is not valid."""
    try:
        return read_json(path, Leaderboard, MAX_BYTES).entries
    except InvalidJsonError as error:
        raise RunError(
            f"{path.name} cannot be read as a leaderboard of format {FORMAT}: {error}. Give a file "
            "written by `leaderboard add`."
        ) from None


_BY = " · "
"""Separator of a metric's key and its protocol, where a table has several of one metric."""
_OF_SETS = {FGD, FGD_EMAGE, *FGD_GENEA.values()}
_TO_RECORDED = _OF_SETS | {row.key for row in METRICS if row.is_reference_error}
"""Metrics that are distances to the recorded motion."""
_WITHOUT_AIM = {row.key for row in METRICS if not row.is_compared_with_reference}
_FIRST = {row.key for row in METRICS if row.is_primary or row.key == POWER_ABOVE_5_HZ}


def leaderboard_page_html(entries: Sequence[LeaderboardEntry]) -> str:
    """Format the page with a table for each test; entries as ordered by `merge_entries`."""
    folder = Path(__file__).parent
    env = jinja2.Environment(
        loader=jinja2.FileSystemLoader(folder),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    style, script = ((folder / f"board.{kind}").read_text("utf-8") for kind in ("css", "js"))
    tests = [list(of) for _, of in groupby(entries, lambda entry: entry.test_id)]
    return env.get_template("board.html").render(
        style=style,
        script=script,
        tables=[_table(of) for of in tests],
        titles=TITLES,
        written=metric_table.format_three_digits,
    )


def _by_protocol(entry: LeaderboardEntry, entries: Sequence[LeaderboardEntry]) -> LeaderboardEntry:
    """Give metrics that the entries measured by several protocols keys with their protocol."""
    used: dict[str, set[str]] = {}
    for each in entries:
        for key, value in each.measures.items():
            used.setdefault(key, set()).add(value.protocol)
    measures = metric_table.drop_unpaired(entry.measures).items()
    return replace(
        entry,
        measures={
            key if len(used[key]) == 1 else f"{key}{_BY}{value.protocol}": value
            for key, value in measures
        },
    )


def _table(entries: list[LeaderboardEntry]) -> dict[str, Any]:
    """Return one test for the template; BeatAlign is only included with its chance level."""
    entries = [_by_protocol(entry, entries) for entry in entries]
    keys = dict.fromkeys(key for entry in entries for key in entry.measures)
    names = {key: key.partition(_BY)[0] for key in keys}
    protocols = {
        key: next(each.measures[key].protocol for each in entries if key in each.measures)
        for key in keys
    }
    recorded = next((entry.measures for entry in entries if entry.is_recorded), {})

    def distance(key: str, value: MetricValue) -> float | None:
        """Return the distance to the recorded motion; None if the metric has no target."""
        name = names[key]
        if name in _TO_RECORDED:
            return abs(value.mean)
        aim = None if name in _WITHOUT_AIM else recorded.get(key)
        return None if aim is None else abs(value.mean - aim.mean)

    return {
        "test": entries[0].test_id,
        "entries": entries,
        "clips": max(entry.num_clips for entry in entries),
        "units": {
            key: next(each.measures[key].unit for each in entries if key in each.measures)
            for key in keys
        },
        "protocols": protocols,
        "definitions": {
            key: metric_table.metric_definition(names[key], protocols[key]) for key in keys
        },
        "rare": {key for key in keys if names[key] not in _OF_SETS | _FIRST},
        "apart": distance,
    }
