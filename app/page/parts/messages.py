"""Types of the JSON that the player gets, from which `.ci/messages.py` makes web/messages.d.ts."""

from __future__ import annotations

from typing import Literal, NotRequired

from typing_extensions import TypedDict

from app.run.output.run_folder import AssumptionRecord, FramesAvailable
from conventions.joints import BodyPart


class FileReading(TypedDict):
    """Interpretation of an imported file."""

    file_pattern: str
    """Pattern of its name, such as "*.npz"."""
    assumptions: list[AssumptionRecord]


class PlayerRow(TypedDict):
    """One motion of a player. URLs are relative to the page."""

    name: str
    label: NotRequired[str]
    color: str
    stem: str
    """Stem of the names of its files."""
    is_reference: bool
    noise_key: str | None
    """Key that motions of the same noise share; null if the noise is not known."""
    compared_run: NotRequired[str]
    """Run of the motion in a comparison of two."""
    motion: NotRequired[str]
    """URL of the whole motion (.npz)."""
    frames: NotRequired[str]
    """URL of the frames so far, as binary messages."""
    frames_available: NotRequired[FramesAvailable]
    video: NotRequired[str]
    will_have_video: NotRequired[bool]
    """True if the row will have a video."""
    plan: NotRequired[str]
    """URL of its gesture plan."""
    is_planned: NotRequired[bool]
    """True if the system followed the plan; otherwise it was detected."""
    take_number: NotRequired[int]
    """Number of the take of an edited plan."""
    original_row: NotRequired[str]
    """Original row of a take."""
    noise_space: NotRequired[Literal["local", "global"]]
    """Rotations to which the viewer adds noise."""
    interpretation: NotRequired[FileReading]


EditableRow = TypedDict("EditableRow", {"of": str, "from": str, "editor": str})
"""Row whose plan can be edited: the original row of the run, the row whose plan was edited (or ""),
and the URL of the `PlanEditorData`."""


class EditSuggestionJson(TypedDict):
    """Alternative to an edit that was refused."""

    label: str
    edits: list[dict[str, object]]


class PlanEditorState(TypedDict):
    """State of the plan editor."""

    rows: list[str]
    """Original rows of the run that can be edited."""
    editable: dict[str, EditableRow]
    """Rows from which edits can start, by name."""
    message: str
    """Message on the last edit."""
    is_refused: bool
    is_working: bool
    """True while a take is generated."""
    suggestions: list[EditSuggestionJson]


class AudioTrack(TypedDict):
    """Audio track of a comparison of two runs."""

    label: str
    audio_url: str
    timeline_url: str


class ViewerNoise(TypedDict):
    """Noise that the viewer adds to rotations."""

    initial_rad: float
    """Standard deviation about each axis until the slider is moved (rad)."""
    range: tuple[float, float]
    has_slider: bool


class PlayerFinding(TypedDict):
    """Finding of a motion."""

    motion_name: str
    """Name of the motion; empty for a statement on the motions without findings."""
    sentence: str
    worst_time_s: float | None
    """Time (s) at which it is worst."""
    part: BodyPart
    """Body part that shows it; empty for the whole body."""


class PlayerValue(TypedDict, total=False):
    """Value of a player, sent again whenever its run has grown; empty without a run."""

    run: str
    rows: list[PlayerRow]
    audio: str
    timeline: str
    """URL of the `Timeline`."""
    sounds: list[AudioTrack]
    """Sounds to choose from if the motions belong to different speeches."""
    running: bool
    """True if more will follow."""
    is_example: bool
    """True for an example that plays at once."""
    plays_when_ready: bool
    """True if it plays as soon as it can."""
    noise: ViewerNoise
    editing: PlanEditorState
    findings: list[PlayerFinding]
    """Findings, the most severe first."""
