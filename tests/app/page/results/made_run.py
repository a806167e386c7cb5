"""Runs that have ended, with the folders that the real ones leave, of motions that hardly move."""

from pathlib import Path
from typing import Any

from app.page.results.run_view import RunView
from app.page.results.saved_runs import SavedRun, SavedRuns
from app.page.routes.media import SharedFolders
from app.page.visitors.job_folders import Job
from app.run.output.run_folder import RunRecord
from app.run.run_writer import open_run_writer
from conventions.names import REFERENCE_NAME
from model.diagnostics import Diagnostics
from model.speech.transcript import EMPTY_TRANSCRIPT, Transcript
from tests.app.fakes import made_motion, measures
from tests.app.measured import diagnostics_of
from tests.model.made import made_waveform

SPEECH_SHA256 = "ab" * 32


def made_run(
    job: Path,
    title: str = "speech: local; seed 0",
    reference: float | None = None,
    jerk: dict[str, float] | None = None,
    settings: dict[str, str] | None = None,
    duration_s: float = 2.0,
    said: Transcript = EMPTY_TRANSCRIPT,
    out: str = "results",
    **changes: Any,
) -> RunView:
    """A row with a motion and a video for each jerk, and a time line in which each jerks once."""
    jerk = jerk or {"local": 100.0}
    usual = {"speech": "speech", "systems": "local", "seed": "0", "steps": "default"}
    values = {"kind": "generated", "title": title, "tracked_point": "right_middle"}
    values |= {"speech_sha256": SPEECH_SHA256, "settings": {**usual, **(settings or {})}}
    job.mkdir(exist_ok=True)
    record = RunRecord(**{**values, **changes})
    with open_run_writer(job / out, record, is_incremental=True) as run:
        run.declare_rows([*jerk, *([] if reference is None else [REFERENCE_NAME])])
        run.write_audio(made_waveform(round(16_000 * duration_s)))
        for name in jerk:
            run.write_motion(name, made_motion(8))
            video = run.folder.new_path(f"{name.replace('/', '-')}.mp4")
            video.touch()
            run.add_files(video, row=name, kind="video")
        worst = [
            {"start_s": 0.5, "end_s": 1.5, "name": name, "jerk_m_s3": value}
            for name, value in jerk.items()
        ]
        line = {"duration_s": duration_s, "fps": 30, "peaks": [1], "onsets_s": []}
        line |= {"heard_accents": []}
        line |= {"curves": {name: {"raw": {}} for name in jerk}, "worst": worst}
        run.write_timeline(line | {"point": "Right middle fingertip"}, said)
        run.record_metrics(numbers(reference, **jerk))
        run.finish("Done.")
    return showing_in(job)


def showing_in(job: Path, media: SharedFolders | None = None, cookie: str = "") -> RunView:
    """Of the run that a job's folder holds."""
    return RunView(job / "results", (media or SharedFolders()).share(job, cookie), job.name)


def numbers(reference: float | None = None, **jerk: float) -> Diagnostics:
    return diagnostics_of(
        None if reference is None else measures(reference),
        **{name: measures(value) for name, value in jerk.items()},
    )


def keep(
    runs: SavedRuns,
    job: Path,
    cookie: str,
    tab: str = "generate",
    form: dict[str, Any] | None = None,
    **made: Any,
) -> SavedRun:
    return runs.add_run(Job("visitor", tab, job, cookie), {"": made_run(job, **made)}, form)
