"""A pipeline of the real signature that needs no model and no GL: for tests of the page alone."""

import subprocess
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import imageio_ffmpeg
import numpy as np
from PIL import Image

from app import text
from app.config import AppConfig
from app.errors import Cancelled
from app.live.sessions import LiveSessions
from app.page.parts.catalogue import Catalogue
from app.page.results.saved_runs import SavedRuns
from app.page.tabs.runner import Services
from app.page.visitors.characters import Characters
from app.page.visitors.job_folders import Jobs
from app.page.worker import Task, Worker
from app.run.bodies import PointTracker
from app.run.callbacks import NO_CALLBACKS, FolderUpdated, RunCallbacks, StageProgress
from app.run.generated_motions import row_names
from app.run.output.result_folder import ResultFolder
from app.run.output.run_folder import add_file, read_run
from app.run.pipeline import MEASURED, make_run_record
from app.run.requests.requests import AnyRun
from app.run.run_writer import RunWriter, open_run_writer
from app.run.timeline import TranscriptLoader, make_timeline
from conventions.joints import JOINT_INDEX
from conventions.names import REFERENCE_NAME, safe_file_stem
from model.diagnostics import RawAndFiltered
from model.motion.motion import Motion, first_frames, load_motion
from model.plan.plan import GesturePlan
from model.speech.audio import load_speech
from model.speech.transcript import Transcript, Word
from tests.app.measured import diagnostics_of, measured

ASSUMED = {
    "kind": "up",
    "value": "z",
    "reason": "so (--up)",
    "confidence": "likely",
    "alternatives": ["y"],
}
CATALOGUE = Catalogue(
    systems=("globaldiff/local", "globaldiff/global"),
    speakers=("wayne", "scott"),
    trained_on="0.0 hours of nothing (a test)",
    samplers=("euler", "heun", "reinterpolate"),
)


def catalogue_of(*speeches: Path) -> Catalogue:
    """With these as its examples."""
    return replace(CATALOGUE, examples=speeches)


def does(task: Callable[..., Any], request: Any) -> Any:
    """As `Worker.do`, in this process."""
    return task(request, NO_CALLBACKS)


class FakeWorker(Worker):
    """Does tasks in this process, some by functions of a test's own."""

    def __init__(self, *arguments: Any, does: Mapping[str, Callable[..., Any]], **options: Any):
        """
        Args:
            does: by the name of the task that they take the place of.
        """
        super().__init__(*arguments, **options)
        self._does = does

    def start(self) -> None:
        """There is no process."""

    def do(self, task: Task[Any, Any], request: Any, callbacks: RunCallbacks = NO_CALLBACKS) -> Any:
        return self._does.get(task.__name__, task)(request, callbacks)


def made_services(
    folder: Path, does: Mapping[str, Callable[..., Any]] | None = None, **given: Any
) -> Services:
    """Of a page without models: what is not given is made."""
    worker = FakeWorker(does=does or {})
    usual = {
        "config": AppConfig(temp_folder=folder),
        "catalogue": CATALOGUE,
        "jobs": Jobs(folder / "jobs"),
        "worker": worker,
        "video_worker": worker,
        "upload_worker": worker,
        "saved_runs": SavedRuns(60.0),
        "live": LiveSessions(folder),
        "characters": Characters(folder / "private"),
    }
    return Services(**{**usual, **given})


RECOGNISED = Transcript((Word(0.2, 0.6, "hello", 0.75),), origin="recognised")


def write_video(path: Path, seconds: float = 1.0, size: int = 80) -> None:
    path.write_bytes(_video(seconds, size))


@cache
def _video(seconds: float, size: int) -> bytes:
    """A silent grey video, encoded for a browser."""
    pictures = np.full((round(30 * seconds), size, size), 128, np.uint8)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"
        subprocess.run(
            [
                imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-y",
                "-f", "rawvideo", "-pix_fmt", "gray", "-s", f"{size}x{size}", "-r", "30", "-i", "-",
                "-pix_fmt", "yuv420p", "-c:v", "libx264", "-preset", "ultrafast",
                "-movflags", "+faststart", str(path),
            ],
            input=pictures.tobytes(),
            check=True,
        )  # fmt: skip
        return path.read_bytes()


def made_motion(num_frames: int, tremble: float = 0.02) -> Motion:
    """A body that stands still but for a right elbow that trembles."""
    poses = np.zeros((num_frames, 165), np.float32)
    elbow = 3 * JOINT_INDEX["right_elbow"]
    poses[:, elbow] = tremble * np.random.default_rng(0).standard_normal(num_frames)
    zeros = np.zeros((num_frames, 103), np.float32)
    return Motion(poses, zeros[:, :3], zeros[:, 3:], "flame100", np.zeros(300, np.float32))


def measures(jerk: float) -> RawAndFiltered:
    """Measures of one system, as far as the page is shown them."""
    raw = {
        "tip_jerk_m_s3": jerk,
        "tip_acceleration_m_s2": jerk / 20,
        "tip_velocity_power_share_above_5hz": 0.0123,
        "seam_jerk_ratio": 1.1,
        "foot_slide_m_s": 0.01,
    }
    return RawAndFiltered(
        measured(**raw), measured(**{key: value / 3 for key, value in raw.items()})
    )


def tell_windows(
    run: RunWriter,
    names: Sequence[str],
    num_frames: int,
    before_window: Callable[[int], threading.Event],
) -> None:
    """Motion of all rows in windows of 52 frames, the rows in turn."""
    for window, start in enumerate(range(0, num_frames, 52)):
        while not before_window(window).wait(0.05):
            run.raise_if_cancelled()
        for i, name in enumerate(names):
            whole = made_motion(num_frames, 0.02 / (i + 1))
            run.append_motion(name, whole.part(slice(start, start + 52)), num_frames)


def make_generate(
    on_start: Callable[[AnyRun], None] | None = None,
    error: BaseException | None = None,
    seconds: float = 1.0,
    before_window: Callable[[int], threading.Event] | None = None,
    before_figures: threading.Event | None = None,
    plan: GesturePlan | None = None,
    late_error: BaseException | None = None,
) -> Callable[[AnyRun, RunCallbacks], None]:
    """A pipeline without models, which writes a run's folder as the real one does; it can be told
    to fail, at once or with all motion there; with ``before_window`` motion comes in windows, held
    before each; figures wait for ``before_figures``; the first system performs ``plan``."""

    def generate(request: AnyRun, callbacks: RunCallbacks) -> None:
        if on_start is not None:
            on_start(request)
        names, num_frames = row_names(request, request.sampling.systems), round(30 * seconds)
        systems = [name for name in names if name != REFERENCE_NAME]
        how = request.output.out, make_run_record(request), callbacks
        with open_run_writer(*how, is_incremental=request.output.is_incremental) as run:
            run.report_progress("speech", 1.0)
            run.report_progress("motion", 0.4, names[0])
            if error is not None:
                raise error
            speech = load_speech(request.speech.path or "")
            run.record.speech_sha256 = speech.sha256
            run.declare_rows(names)
            run.write_audio(speech.waveform)
            recorded = {}
            if request.imports.reference is not None:
                recorded[REFERENCE_NAME] = first_frames(
                    load_motion(request.imports.reference), num_frames
                )
                run.write_motion(REFERENCE_NAME, recorded[REFERENCE_NAME])
            if before_window is not None:
                tell_windows(run, systems, num_frames, before_window)
            if plan is not None:
                run.write_plan(names[0], plan)
            motions = {
                name: made_motion(num_frames, 0.02 / (i + 1)) for i, name in enumerate(systems)
            }
            for name, motion in motions.items():
                run.write_motion(name, motion, f"{safe_file_stem(name)}.npz")
            run.report_progress("motion", 1.0)
            if late_error is not None:
                raise late_error
            tracker = PointTracker()
            said = (
                RECOGNISED
                if request.speech.word_source == "recognise"
                else TranscriptLoader(request.speech.transcript, "none").provided
            )
            run.write_timeline(make_timeline(speech, motions | recorded, "raw", tracker), said)
            run.detect_plans(motions | recorded)
            reference = measures(104.0) if request.imports.reference else None
            jerk = {name: measures(110.0 + 10 * i) for i, name in enumerate(systems)}
            run.report_progress("numbers", 1.0)
            run.record_metrics(diagnostics_of(reference, **jerk))
            while before_figures is not None and not before_figures.wait(0.05):
                run.raise_if_cancelled()
            figure = run.folder.new_path("figure6.png")
            Image.fromarray(np.full((90, 160, 3), 200, np.uint8)).save(figure)
            run.report_progress("figure", 1.0)
            run.add_files(figure)
            run.add_notes("A note.")
            why = "" if request.live_recording is None else request.live_recording.truncation_note
            done = text.DONE.format(seconds=0, rows=f"{len(names)} motions", frames=num_frames)
            run.finish(f"{done} {why}".strip())

    return generate


def diagnose(request: AnyRun, callbacks: RunCallbacks) -> None:
    """Measures nothing, and leaves what the real one does of a motion of its own."""
    callbacks.on_event(StageProgress("numbers", 0.5))
    with open_run_writer(
        request.output.out,
        make_run_record(request),
        callbacks,
        is_incremental=request.output.is_incremental,
    ) as run:
        motions = {name: made_motion(30) for name in request.motions.names}
        run.declare_rows(motions)
        for name, motion in motions.items():
            run.write_motion(name, motion)
        run.add_notes("A <note>.")
        found = diagnostics_of(**{name: measures(120.0) for name in request.motions.names})
        assumed = {name: [dict(ASSUMED)] for name in request.motions.names}
        for row, path in zip(run.record.rows, request.motions.motions, strict=True):
            row.source_suffix = path.suffix
        run.record_metrics(replace(found, assumptions=assumed))
        for name in ("diagnostics.json", "jitter.png"):
            path = run.folder.new_path(name)
            path.write_bytes(b"0")
            run.add_files(path)
        run.finish(MEASURED.format(motions=f"{len(motions)} motion"))


def make_draw(
    before_video: Callable[[int], threading.Event] | None = None, seconds: float = 1.0
) -> Callable[[AnyRun, RunCallbacks], None]:
    """Draws test pictures as the videos of a run; it can be told to wait before each."""

    def draw(request: AnyRun, callbacks: RunCallbacks) -> None:
        run = request.run
        names = [row.name for row in read_run(run).rows]
        with ResultFolder(request.out) as folder:
            for i, name in enumerate(names):
                while before_video is not None and not before_video(i).wait(0.05):
                    if callbacks.should_cancel():
                        raise Cancelled
                video = folder.new_path(f"{safe_file_stem(name)}.mp4")
                write_video(video, seconds)
                callbacks.on_event(StageProgress("video", (i + 1) / len(names)))
                add_file(run, video, name, "video")
                callbacks.on_event(FolderUpdated(run))
            comparison = folder.new_path("comparison.mp4")
            write_video(comparison, seconds)
            add_file(run, comparison)
            callbacks.on_event(FolderUpdated(run))

    return draw
