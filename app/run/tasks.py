"""Tasks of a worker, by module and function name, and their results."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.run.callbacks import RunCallbacks
from app.run.requests.requests import DiagnoseRequest
from model.speech.transcript import EMPTY_TRANSCRIPT, Transcript

if TYPE_CHECKING:
    from model.diagnostics import Diagnostics


@dataclass(frozen=True)
class ImportedFunction:
    """Function of a module that is imported when the task is called."""

    module: str
    name: str

    @property
    def __name__(self) -> str:
        return self.name

    def __call__(self, request: Any, callbacks: RunCallbacks) -> Any:
        return getattr(import_module(self.module), self.name)(request, callbacks)


DIAGNOSE = ImportedFunction("app.run.pipeline", "diagnose")
DRAW_VIDEOS = ImportedFunction("app.run.videos.videos", "draw_run_videos")
REDRAW_FIGURE = ImportedFunction("app.run.pipeline", "redraw_figure6")
DRAW_FIGURE = ImportedFunction("app.run.run_writer", "draw_saved_figure_task")
DRAW_VIEWER_VIDEO = ImportedFunction("app.run.videos.viewer_recording", "draw_viewer_video")
GENERATE = ImportedFunction("app.run.pipeline", "generate")
REGENERATE_EDITED = ImportedFunction("app.run.plan_edits.edited_motion", "regenerate_edited")
MEASURE_SPEECH_EFFECT = ImportedFunction(
    "app.run.experiments.speech_effect", "measure_speech_effect"
)
MEASURE_SETS = ImportedFunction("app.run.batch.motion_sets", "measure_uploaded_sets")
MEASURE_STEPS = ImportedFunction("app.run.experiments.step_sweep", "measure_step_sweep")
RENDER = ImportedFunction("app.run.videos.export", "render_or_export_motion")
COMPARE_ROTATION_NOISE = ImportedFunction(
    "app.run.experiments.rotation_noise", "compare_rotation_noise"
)
WRITE_STAGE_BODY = ImportedFunction("app.run.frame_packets", "write_viewer_body")
WRITE_PLAN = ImportedFunction("app.run.videos.export", "convert_plan")


@dataclass(frozen=True)
class RunResult:
    """Result of a run."""

    out: Path
    diagnostics: Diagnostics
    notes: tuple[str, ...] = ()
    """Sentences for the user, such as what was done to the speech."""
    transcript: Transcript = EMPTY_TRANSCRIPT
    """Transcript of the speech, if it was provided or recognised."""


@dataclass(frozen=True)
class ViewerVideo:
    """Video of the viewer."""

    path: Path
    num_frames: int
    notes: tuple[str, ...] = ()
    """Sentences for the user."""


@dataclass(frozen=True)
class SetResults:
    """Metrics of folders of motions."""

    request: DiagnoseRequest
    files: tuple[Path, ...]
    notes: tuple[str, ...]
    batch_json: dict[str, Any]
    """Content of ``batch.json`` as written by `app.run.batch.table.write_tables`."""
    motion_files: dict[str, dict[str, Path]]
    """Motion file of each clip in the tables, by system, including the reference."""
    audio_files: dict[str, Path]
    """Audio files of those clips that have one."""
