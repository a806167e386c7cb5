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
class Task:
    """Function of a module that is imported when the task is called."""

    module: str
    name: str

    @property
    def __name__(self) -> str:
        return self.name

    def __call__(self, request: Any, callbacks: RunCallbacks) -> Any:
        return getattr(import_module(self.module), self.name)(request, callbacks)


DIAGNOSE = Task("app.run.pipeline", "diagnose")
DRAW_VIDEOS = Task("app.run.videos.videos", "draw_videos_in_background")
REDRAW_FIGURE = Task("app.run.pipeline", "redraw_figure6")
DRAW_FIGURE = Task("app.run.run_writer", "draw_figure")
DRAW_VIEWER_VIDEO = Task("app.run.videos.viewer_recording", "draw_viewer_video")
GENERATE = Task("app.run.pipeline", "generate")
REGENERATE_EDITED = Task("app.run.plan_edits.edited_motion", "regenerate_edited")
MEASURE_SPEECH_EFFECT = Task("app.run.experiments.speech_effect", "measure_speech_effect")
MEASURE_SETS = Task("app.run.batch.motion_sets", "measure_sets")
MEASURE_STEPS = Task("app.run.experiments.step_sweep", "measure_step_sweep")
RENDER = Task("app.run.videos.export", "render_motion")
COMPARE_ROTATION_NOISE = Task("app.run.experiments.rotation_noise", "compare_rotation_noise")
WRITE_STAGE_BODY = Task("app.run.frame_packets", "write_viewer_body")
WRITE_PLAN = Task("app.run.videos.export", "write_plan")


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
    summary: dict[str, Any]
    """Content of ``batch.json`` as written by `app.run.batch.table.write_tables`."""
    clips: dict[str, dict[str, Path]]
    """Motion file of each clip in the tables, by system, including the reference."""
    audio_files: dict[str, Path]
    """Audio files of those clips that have one."""
