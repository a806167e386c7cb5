"""JSON files of a run that the viewer reads: timeline, gesture plans, data of the plan editor."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, NotRequired, TypeVar

from pydantic import Field, RootModel
from typing_extensions import TypeAliasType, TypedDict

from app.errors import RunError
from app.run.output.run_folder import DAMAGED, MAX_RUN_BYTES, RunRecord, existing_file, read_run
from conventions.names import FilterVersion
from model.plan.files import read_plan_file, write_plan_file
from model.plan.kinds import Position
from model.plan.plan import PlanError, Side
from model.speech.transcript import TranscriptSource
from model.storage.json_validation import STRICT, InvalidJsonError, read_json

MAX_POINTS = 1800
"""Maximum number of points of a curve: every frame of a minute. Longer clips keep the maximum of
neighbouring frames."""
NUM_PEAKS = 1200
"""Number of bars of the waveform."""

TimeSpan = TypeAliasType("TimeSpan", tuple[float, float, str])
"""Start and end (s) and text of an interval."""


class Curve(TypedDict):
    """Magnitude of a derivative at equal steps of time (s)."""

    start_s: float
    step_s: float
    values: Annotated[list[float], Field(max_length=MAX_POINTS)]


class WorstSecond(TypedDict):
    """Second with the highest jerk, or with a joint that snaps."""

    name: str
    """Name of the motion."""
    start_s: float
    end_s: float
    jerk_m_s3: NotRequired[float]
    joint: NotRequired[str]
    snap_deg: NotRequired[float]
    """Angle by which the joint jumps."""
    is_gravest: NotRequired[bool]
    """True if the snap is the most severe finding of its motion."""


class Timeline(TypedDict):
    """Content of ``timeline.json``."""

    duration_s: float
    fps: int
    peaks: Annotated[list[int], Field(max_length=NUM_PEAKS)]
    """Magnitude of the waveform by bar, 0 to 100."""
    onsets_s: list[float]
    heard_accents: list[tuple[float, float]]
    """Time (s) and strength of the accents found by the speech encoder."""
    point: str
    """Title of the tracked point."""
    curves: dict[str, dict[FilterVersion, dict[str, Curve]]]
    """Curves by motion, filter and name."""
    worst: list[WorstSecond]
    words: list[TimeSpan]
    words_origin: TranscriptSource
    phones: list[TimeSpan]
    accents: list[tuple[float, float]]
    """Time (s) and strength of annotated accents."""
    gestures: dict[str, list[TimeSpan]]
    """Annotated intervals by tier."""


class EditableGesture(TypedDict):
    """Gesture in the plan editor (s)."""

    side: Side
    start: float
    end: float
    lands: float
    """End of the stroke."""
    hold: float
    """Duration of the holds after the stroke."""
    kind: str
    partner: float | None
    """Stroke end of the other hand's part if the gesture is of both hands."""


class PlanEditorData(TypedDict):
    """Plan as the editor shows it."""

    gestures: list[EditableGesture]
    style: dict[str, float]
    kinds: dict[str, Literal["both", "right"]]
    """Hands that usually make a gesture of each kind."""
    places: dict[str, Position]
    """Usual stroke ends by kind (m), relative to the chest."""
    around: tuple[float, float]
    """Usual start and end of a gesture, relative to its stroke end (s)."""
    words: list[TimeSpan]


class _TimelineFile(RootModel[Timeline]):
    model_config = STRICT


class _EditorFile(RootModel[PlanEditorData]):
    model_config = STRICT


T = TypeVar("T", bound=RootModel)


def read_timeline(folder: Path, record: RunRecord) -> dict[str, Any]:
    """Return the timeline of a run, empty if there is none yet; raises RunError if damaged."""
    path = existing_file(folder, record.timeline)
    return {} if path is None else {**_read(path, _TimelineFile).root}


def check_and_normalise_viewer_files(folder: Path) -> None:
    """Check the viewer's files of a run from elsewhere, and complete its gesture plans.

    Plan files may lack empty lists, which the viewer needs. Raises RunError if a file is damaged.
    """
    record = read_run(folder)
    read_timeline(folder, record)
    for row in record.rows:
        if data := existing_file(folder, row.files.get("editor")):
            _read(data, _EditorFile)
        for plan in {existing_file(folder, row.files.get(kind)) for kind in ("plan", "input_plan")}:
            try:
                if plan is not None:
                    write_plan_file(read_plan_file(plan).plan, plan)
            except PlanError as error:
                raise RunError(str(error)) from None


def _read(path: Path, kind: type[T]) -> T:
    try:
        return read_json(path, kind, MAX_RUN_BYTES)
    except InvalidJsonError as error:
        raise RunError(DAMAGED.format(name=path.name, why=error)) from None
