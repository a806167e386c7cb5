"""Content of a run's folder as described by its `run.json` (docs/formats.md)."""

from __future__ import annotations

import fcntl
import os
import re
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator
from typing_extensions import TypedDict

from app.errors import RunError
from app.findings.metric_table import old_titles_to_keys
from app.run.output.result_folder import zip_files
from app.run.requests.convert import nested_fields
from app.run.requests.parts import MAX_PAGE_CLIPS
from app.run.requests.requests import DiagnoseRequest, GenerateRequest
from conventions.colors import colors_of
from conventions.joints import BodyPart
from conventions.names import (
    COMPARISON,
    REFERENCE_NAME,
    FilterVersion,
    SampleName,
    printable,
    safe_file_stem,
    short_names,
)
from model.formats.reading import with_current_keys
from model.storage.files import open_limited_zip, write_atomically
from model.storage.json_validation import InvalidJsonError, read_json, rename_keys

RUN, SPEECH, TIMELINE = "run.json", "speech.wav", "timeline.json"
BATCH = "batch.json"
BATCH_TABLES = "batch.csv", BATCH, "clips.csv", "summary.md", "table.tex"
"""Tables over several clips, next to the folders of their runs."""
FORMER_BATCH = "many.json"
READABLE_BATCH_TABLES = (*BATCH_TABLES, "many.csv", FORMER_BATCH, "sheet.md")
"""`BATCH_TABLES`, and the former names of three of them."""
VIEWER_FOLDERS = "viewer", "shown"
"""Folder of files that only the viewer uses, and its former name."""
NO_RUN = (
    "{name} is not a run folder that can be opened ({why}). Give a folder written by `generate` "
    "or `diagnose` of this version, or its zip."
)
DAMAGED = "{name} of this run is damaged: {why}; use the run's original folder or zip."
MAX_RUN_BYTES = 20_000_000
MAX_ROWS, MAX_FINDINGS, MAX_TEXT = 512, 5_000, 2_000
NUM_TOP_FINDINGS = 3
_MAX_LIST_BYTES = 300_000
"""Maximum size (bytes) of the directory of a zip that is read."""

Name = Annotated[str, Field(min_length=1, max_length=520), AfterValidator(printable)]
Text = Annotated[str, Field(max_length=MAX_TEXT), AfterValidator(printable)]


_MAX_NAME_BYTES = 255
"""Longest file name of common file systems (bytes)."""


def _stays_inside(name: str) -> str:
    folder, slash, own = name.rpartition("/")
    if slash and folder not in VIEWER_FOLDERS:
        raise ValueError("a file name in it points to another folder")
    if own in ("", ".", "..") or "\0" in own:
        raise ValueError("a file name in it is invalid")
    if len(own.encode()) > _MAX_NAME_BYTES:
        raise ValueError(f"a file name in it is longer than {_MAX_NAME_BYTES} bytes")
    return name


_SUFFIX, _SHA256 = r"^(\.[a-z0-9]{1,8})?$", r"^([0-9a-f]{64})?$"
FileName = Annotated[str, Field(max_length=300), AfterValidator(_stays_inside)]
Count = Annotated[int, Field(ge=0, le=2**40)]
Number = Annotated[float, Field(ge=-1e12, le=1e12)]
RowFileKind = Literal["motion", "frames", "plan", "input_plan", "video", "editor", "state"]
"""Kind of a row's file. ``plan`` is the plan in the player, ``input_plan`` the plan that the system
followed; ``editor`` is the data of the plan editor; ``state``, which stays in its folder, is the
generation state that an edited version starts from."""
RunKind = Literal["generated", "imported"]
State = Literal["running", "done", "failed", "cancelled"]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)
    _former_keys: ClassVar[Mapping[str, str]] = {}
    """Present keys by those of formats 1 to 3."""

    @model_validator(mode="before")
    @classmethod
    def _rename_former_keys(cls, value: Any) -> Any:
        return rename_keys(value, cls._former_keys) if isinstance(value, dict) else value


class FramesAvailable(_Strict):
    """Number of frames of a row so far, and their root transform."""

    _former_keys = {"end": "num_ready", "bytes": "num_bytes", "place": "root_transform"}
    num_ready: Count
    num_frames: Count
    num_bytes: Count
    """Size so far (bytes) of the row's ``frames`` file."""
    root_transform: tuple[Number, Number, Number, Number]
    """Rotation about the vertical (rad), then translation (m)."""


class EditInfo(_Strict):
    """Origin of a motion with an edited plan."""

    _former_keys = {
        "number": "take_number",
        "of": "original_row",
        "start": "parent_row",
        "fresh": "regenerated_s",
    }
    take_number: Count
    original_row: Name
    """Name of the run's unedited row."""
    parent_row: Name
    """Name of the row with the plan that was edited."""
    regenerated_s: Annotated[list[tuple[Number, Number]], Field(max_length=5_000)] = []
    """Time spans (s) that were generated again."""


class AssumptionRecord(TypedDict):
    """Interpretation of a file in one respect; see `model.formats.reading.Assumption`."""

    kind: Text
    value: Text
    reason: Text
    confidence: Literal["user", "stated", "sure", "likely", "unsure"]
    alternatives: Annotated[list[Text], Field(max_length=40)]


def _current(assumption: Any) -> Any:
    return with_current_keys(assumption) if isinstance(assumption, dict) else assumption


_FORMER_KINDS = {"performed": "input_plan", "told": "editor", "windows": "state"}


def _with_current_kinds(files: Any) -> Any:
    return rename_keys(files, _FORMER_KINDS) if isinstance(files, dict) else files


_FORMER_SETTINGS = {
    "followed point": "tracked point",
    "strength of the speech": "speech guidance scale",
}
_WITH_DEFAULT = ("speaker", "steps", "sampler", "speech guidance scale")


def _with_current_settings(settings: Any) -> Any:
    """Rename settings of earlier versions, and "usual" to "default"."""
    if not isinstance(settings, dict):
        return settings
    return {
        name: "default" if value == "usual" and name in _WITH_DEFAULT else value
        for name, value in rename_keys(settings, _FORMER_SETTINGS).items()
    }


class Row(_Strict):
    """Motion of a run, with its files."""

    _former_keys = {
        "there": "available",
        "take": "edit",
        "assumed": "assumptions",
        "ending": "source_suffix",
        "file_suffix": "source_suffix",
    }
    name: Name
    label: Name
    color: Annotated[str, Field(pattern=r"^#[0-9a-fA-F]{6}$")]
    files: Annotated[dict[RowFileKind, FileName], BeforeValidator(_with_current_kinds)] = {}
    available: FramesAvailable | None = None
    edit: EditInfo | None = None
    assumptions: Annotated[
        list[Annotated[AssumptionRecord, BeforeValidator(_current)]], Field(max_length=40)
    ] = []
    """Interpretation of the motion's file, if it was imported."""
    source_suffix: Annotated[str, Field(pattern=_SUFFIX)] = ""
    """Suffix of the imported file, see `suffix_or_empty`; empty for generated motion."""


class FindingRecord(_Strict):
    """Finding of a motion; without a name, a statement on the motions that have none."""

    _former_keys = {"name": "motion_name", "at": "worst_time_s"}
    motion_name: Annotated[str, Field(max_length=520), AfterValidator(printable)] = ""
    kind: Annotated[str, Field(max_length=80), AfterValidator(printable)] = ""
    sentence: Text
    worst_time_s: Number | None = None
    """Time (s) at which it is worst."""
    part: BodyPart = ""
    """Body part that shows it; empty for the whole body."""


class VerdictRecord(_Strict):
    _former_keys = {"numbers": "jerk_sentence", "judgement": "comparison"}
    jerk_sentence: Text
    comparison: Text


class RunRecord(_Strict):
    """Content of ``run.json``."""

    _former_keys = {
        "sentence": "message",
        "whole": "inputs_stamp",
        "inputs_sha256": "inputs_stamp",
        "point": "tracked_point",
        "numbers": "metrics",
        "missing": "pending_videos",
        "sound": "audio",
        "says": "figure_captions",
    }
    format: Literal[4] = 4
    state: State = "running"
    message: Text = ""
    """Final status message, or the reason of a failure."""
    kind: RunKind
    title: Text = ""
    request: Annotated[dict[Name, Any], Field(max_length=80)] = {}
    """Request of the run, by its parts, with names in place of paths."""
    settings: Annotated[
        dict[Name, Text], Field(max_length=60), BeforeValidator(_with_current_settings)
    ] = {}
    """Settings of the request in words, by which two runs are compared."""
    speech_sha256: Annotated[str, Field(pattern=_SHA256)] = ""
    """SHA-256 of the speech file; empty without one."""
    noise_seed: Annotated[int, Field(ge=0)] | None = None
    """Seed of the noise of generated motion, computed from the requested seed and the speech file;
    None in runs of earlier versions, which used the requested seed."""
    inputs_stamp: Annotated[str, Field(pattern=_SHA256)] = ""
    """SHA-256 of the request and of names, sizes and times of its files; set when one clip of
    several is complete."""
    tracked_point: Name
    """Tracked fingertip or joint of the metrics."""
    rows: Annotated[list[Row], Field(max_length=MAX_ROWS)] = []
    audio: FileName | None = None
    timeline: FileName | None = None
    verdict: VerdictRecord | None = None
    findings: Annotated[list[FindingRecord], Field(max_length=MAX_FINDINGS)] = []
    """Findings, the most severe first."""
    figure_captions: dict[Name, Text] = {}
    """Sentences on the metrics, by figure."""
    metrics: Annotated[
        dict[Name, dict[FilterVersion, dict[Name, Number]]], Field(max_length=MAX_ROWS)
    ] = {}
    """Metrics by motion, filter and key of the metric; missing ones were not computed."""
    notes: Annotated[list[Text], Field(max_length=MAX_FINDINGS)] = []
    files: Annotated[list[FileName], Field(max_length=MAX_FINDINGS)] = []
    """Complete files, including those of rows."""
    pending_videos: Annotated[list[FileName], Field(max_length=MAX_FINDINGS)] = []
    """Videos that are rendered after the run and are not complete yet, nor in a zip saved
    meanwhile. They remain listed if the rendering is abandoned."""

    @model_validator(mode="before")
    @classmethod
    def _from_earlier_formats(cls, record: Any) -> Any:
        """Convert formats 1 to 3, but for keys in `_former_keys`.

        The kind of imported motions was ``given``. In 1 and 2 the keys of ``numbers`` were titles
        of metrics; 1 had ``asked`` in place of ``request``.
        """
        if not isinstance(record, dict) or record.get("format") not in (1, 2, 3):
            return record
        number, record = record["format"], record | {"format": 4}
        if record.get("kind") == "given":
            record["kind"] = "imported"
        if number < 3 and isinstance(numbers := record.get("numbers"), dict):
            record["numbers"] = _numbers_by_key(numbers)
        if number == 1:
            request = record.pop("asked", None)
            kind = GenerateRequest if record.get("kind") == "generated" else DiagnoseRequest
            record["request"] = nested_fields(kind, request) if isinstance(request, dict) else {}
        return record

    @model_validator(mode="after")
    def _each_once(self) -> RunRecord:
        names = [row.name for row in self.rows]
        if len(set(names)) < len(names):
            raise ValueError("two rows have the same name")
        return self

    def row(self, name: str) -> Row | None:
        return next((row for row in self.rows if row.name == name), None)

    def set_row(self, row: Row) -> None:
        """Replace the row of the same name, or append the row."""
        names = [each.name for each in self.rows]
        at = names.index(row.name) if row.name in names else len(names)
        self.rows[at : at + 1] = [row]

    @property
    def top_findings(self) -> list[FindingRecord]:
        """The most severe findings, and the statement on motions that have none."""
        return [
            *self.findings[:NUM_TOP_FINDINGS],
            *(each for each in self.findings[NUM_TOP_FINDINGS:] if not each.motion_name),
        ]

    def label(self, name: str) -> str:
        row = self.row(name)
        return name if row is None else row.label

    @property
    def all_files(self) -> list[str]:
        """All files that the record names."""
        frames = [row.files["frames"] for row in self.rows if "frames" in row.files]
        return list(dict.fromkeys([*self.files, *frames]))

    @property
    def result_files(self) -> list[str]:
        """``run.json`` and all files except those that only the viewer uses."""
        return [RUN, *(name for name in self.files if "/" not in name)]

    @property
    def is_playable(self) -> bool:
        """True if there is anything to play."""
        return any(row.files for row in self.rows)

    def write(self, path: Path) -> None:
        write_atomically(path, self.model_dump_json(exclude_none=True))


def _numbers_by_key(numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Return metrics by motion and filter with keys in place of titles; others as they are."""
    return {
        name: {
            version: old_titles_to_keys(values) if isinstance(values, dict) else values
            for version, values in of.items()
        }
        if isinstance(of, dict)
        else of
        for name, of in numbers.items()
    }


def noise_group(name: str) -> str | None:
    """Return a key that rows with the same noise share, or None if the noise is not known.

    It consists of the system's family, before the slash, and the number of the sample.
    """
    sample = SampleName.parse(name)
    family, slash, _ = sample.system.partition("/")
    return f"{family} {sample.number}" if slash else None


def check_distinct_file_stems(names: Iterable[str]) -> None:
    """Check that no two names map to the same file name; raises RunError naming both."""
    owners: dict[str, str] = {}
    for name in dict.fromkeys(names):
        other = owners.setdefault(safe_file_stem(name), name)
        if other != name:
            raise RunError(
                f"{other!r} and {name!r} would both be written as {safe_file_stem(name)}; rename "
                "one of them."
            )


def make_rows(names: Sequence[str]) -> list[Row]:
    """Make rows with labels and colours; raises RunError if two would share their files."""
    check_distinct_file_stems(names)
    labels = short_names(names)
    return [
        Row(name=name, label=labels[name], color=color)
        for name, color in colors_of(names, REFERENCE_NAME).items()
    ]


def read_run(folder: Path) -> RunRecord:
    """Read the ``run.json`` of a folder; raises RunError if there is none of this version."""
    name = printable(folder.name)
    if not (folder / RUN).is_file():
        raise RunError(NO_RUN.format(name=name, why=f"{RUN} is missing"))
    try:
        return read_json(folder / RUN, RunRecord, MAX_RUN_BYTES)
    except (InvalidJsonError, OverflowError, RecursionError) as error:
        why = f"{RUN} is damaged: {error}"
        raise RunError(NO_RUN.format(name=name, why=why)) from None


def find_runs(folder: Path) -> dict[str, Path]:
    """Return the folders of runs by clip: the folder itself under "", or its subfolders."""
    if existing_file(folder, RUN) is not None:
        return {"": folder}
    folders = (path.parent for path in sorted(folder.glob(f"*/{RUN}")))
    own = (
        path for path in folders if not path.is_symlink() and existing_file(path, RUN) is not None
    )
    return {path.name: path for path in own if not path.name.startswith(".")}


def existing_file(folder: Path, name: str | None) -> Path | None:
    """Return the path of a file named by ``run.json``; None if it is missing or leads outside."""
    path = None if name is None else folder / name
    if path is None or not path.is_file():
        return None
    return path if path.resolve().is_relative_to(folder.resolve()) else None


def row_files(folder: Path, kind: RowFileKind) -> dict[str, Path]:
    """Return the files of one kind by row; raises RunError as `read_run`."""
    files = (
        (row.name, existing_file(folder, row.files.get(kind))) for row in read_run(folder).rows
    )
    return {name: path for name, path in files if path is not None}


@contextmanager
def locked_record(folder: Path) -> Iterator[RunRecord]:
    """Lock and read a run's record, and write its changes after the block; may raise RunError."""
    place = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(place, fcntl.LOCK_EX)
        record = read_run(folder)
        yield record
        record.write(folder / RUN)
    finally:
        os.close(place)


def add_file(folder: Path, path: Path, row: str = "", kind: RowFileKind | None = None) -> None:
    """Add a file made after the end of a run to its folder; see `RunWriter.add_files`."""
    own = path.name
    with locked_record(folder) as record:
        (folder / own).unlink(missing_ok=True)
        os.link(path, folder / own)
        of = record.row(row)
        if of is not None and kind is not None:
            of.files[kind] = own
        if own not in record.files:
            record.files.append(own)
        record.pending_videos = [name for name in record.pending_videos if name != own]


def declare_expected_videos(folder: Path, views: Sequence[str]) -> None:
    """Record in `RunRecord.pending_videos` the videos that will be rendered of a run's motions."""
    with locked_record(folder) as record:
        names = [row.name for row in record.rows if row.edit is None and "motion" in row.files]
        videos = [video_file_name(name, view, views) for view in views for name in names]
        record.pending_videos = videos + [f"{COMPARISON}.mp4"] * (len(names) > 1)


def drop_unfinished_edits(folder: Path) -> None:
    """Remove takes that are incomplete."""
    with locked_record(folder) as record:
        for row in [row for row in record.rows if row.edit and "editor" not in row.files]:
            record.rows.remove(row)
            for name in row.files.values():
                (folder / name).unlink(missing_ok=True)
            record.files = [name for name in record.files if name not in row.files.values()]


def mark_run_failed(folder: Path, sentence: str) -> bool:
    """Record the reason of a failure as visitors see it; return whether any motion was written."""
    try:
        with locked_record(folder) as record:
            record.state, record.message = "failed", truncate(sentence)
    except (RunError, OSError):
        return False  # the run had not started
    return any("motion" in row.files for row in record.rows)


def zip_run_task(folder_and_zip: tuple[Path, Path], *_: object) -> None:
    """Zip a folder into a file, as a task."""
    zip_run(*folder_and_zip)


def zip_run(folder: Path, out: Path) -> Path:
    """Zip all files of a run, or of the runs of several clips with their tables."""
    return zip_files(files_of_run(folder), out, relative_to=folder)


def files_of_run(folder: Path) -> list[Path]:
    """Return all files of a run, or of the runs of several clips; raises RunError without any."""
    runs = find_runs(folder) or {"": folder}
    named = [(run, name) for run in runs.values() for name in (RUN, *read_run(run).all_files)]
    named += [(folder, name) for name in READABLE_BATCH_TABLES if "" not in runs]
    paths = (existing_file(*each) for each in named)
    return [path for path in paths if path is not None]


def is_run_zip(path: Path) -> bool:
    """Check whether a zip holds a run, or several, by its directory; nothing is unpacked."""
    try:
        with open_limited_zip(path, _MAX_LIST_BYTES) as archive:
            names = archive.namelist()
    except (OSError, zipfile.BadZipFile, ValueError, NotImplementedError):
        return False
    num_runs = sum(name.split("/")[-1] == RUN and name.count("/") <= 2 for name in names)
    return 0 < num_runs <= MAX_PAGE_CLIPS


def truncate(text: str) -> str:
    """Shorten a text to the maximum length in ``run.json``."""
    return printable(text)[:MAX_TEXT]


def suffix_or_empty(path: Path) -> str:
    """Return the suffix of a file if it is plausible for a file type, otherwise ""."""
    ending = path.suffix.lower()
    return ending if re.fullmatch(_SUFFIX, ending) else ""


def video_file_name(name: str, view: str, views: Sequence[str]) -> str:
    """Return the file name of a row's video in one of the rendered views."""
    return f"{safe_file_stem(name)}{'' if view == views[0] else f'.{view}'}.mp4"


def viewer_file_name(name: str, ending: str) -> str:
    """Return the name of a row's file that only a player uses."""
    return f"{VIEWER_FOLDERS[0]}/{safe_file_stem(name)}{ending}"
