"""Commands that generate, measure and render motion, and those of the leaderboard."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg

from app.errors import RunError
from app.flags import Count, Names, export_family_files, family_files_annotation, parsed_type
from app.run import tasks
from app.run.batch.leaderboard import (
    entries_from_results,
    leaderboard_page_html,
    merge_entries,
    read_leaderboard,
    write_leaderboard,
)
from app.run.callbacks import RunCallbacks
from app.run.output.console import ProgressBars, print_message, print_path
from app.run.output.run_folder import read_run
from app.run.requests.convert import refuse_ignored
from app.run.requests.requests import (
    DiagnoseRequest,
    Figure6Request,
    GenerateRequest,
    PlanRequest,
    RenderRequest,
    RotationNoiseRequest,
    SpeechEffectRequest,
    StepSweepRequest,
)
from conventions.names import pluralise
from model.storage.files import write_atomically
from processes.pool import JobPool

_DRAWS_PLANS = ("weights", "speaker", "seed", "guidance", "transcript", "word_source", "style")
"""Options that determine a plan sampled from speech."""
_FIGURE = (
    *("tracked_point", "start_frame"),
    *("figure_formats", "figure_panels", "figure_frames", "figure_width"),
)
_OF_ONE = (
    *("transcript", "word_source", "generation_window_frames", "window_overlap_frames"),
    *(*_FIGURE, "visible", "has_video"),
)
"""Options of `diagnose` that apply to single motions and not to sets."""
_METRICS = ("mean_speeds", "emage_weights", "genea_weights", "semantics", "expected")
"""Options of `diagnose` that apply to metrics."""
Files = Annotated[Any, family_files_annotation()]
Flat = arg(name="")
"""Annotation that names flags after the fields of a request's parts, without the request's name."""


@dataclass(frozen=True)
class PoolOptions:
    """Workers for runs of many clips: local processes or a Dask cluster."""

    processes: Count = None
    """Number of parallel processes on this machine for batch runs, each with one thread."""
    scheduler: Annotated[str | None, parsed_type(str, "ADDRESS", "none")] = None
    """Address of a Dask scheduler for many clips, such as tcp://head:8786; its workers must have
    access to the same files (docs/many-clips.md)."""

    def make_pool(self) -> JobPool:
        """Return the pool of workers; raises RunError if processes and scheduler are both set."""
        if self.processes is not None and self.scheduler is not None:
            raise RunError("Give either --processes or --scheduler; a cluster has its own workers.")
        return JobPool(self.processes, self.scheduler)


def generate(request: Annotated[GenerateRequest, Flat], files: Files, pool: PoolOptions) -> None:
    """Generate motion from speech, with videos, metrics and figures.

    Several systems generate motion for the same speech with the same noise seed, and are compared.
    The output folder contains the motions (.npz), their videos (.mp4), comparison.mp4, the figures,
    the metrics (diagnostics.json and .csv) and the origin of the results (provenance.json). For
    many speeches, each gets its own folder; repeat the command to continue after an interruption.
    """
    from app.run.batch.speech_batch import is_speech_folder_or_list

    export_family_files(vars(files))
    if is_speech_folder_or_list(request.speech.path):
        _generate_many(request, pool.make_pool())
    else:
        _run(tasks.GENERATE, request, request.output.out)


def _run(task: tasks.ImportedFunction, request: Any, out: Path) -> None:
    """Run a task, and report its output files, verdict, findings and notes."""
    with ProgressBars() as shown:
        task(request, RunCallbacks(shown.on_event))
    record = read_run(out)
    verdict = (
        [] if record.verdict is None else [record.verdict.jerk_sentence, record.verdict.comparison]
    )
    captions = [record.figure_captions.get(key) for key in ("step", "beats")]
    findings = record.top_findings if record.kind == "generated" else record.findings
    sentences = [
        f"{record.label(each.motion_name)}: {each.sentence}".removeprefix(": ") for each in findings
    ]
    paths = [out / name for name in record.result_files]
    _finish(paths, [*record.notes, *filter(None, [*verdict, *captions]), *sentences])


def _generate_many(request: GenerateRequest, pool: JobPool) -> None:
    """Generate clip by clip, printing finished folders; raise RunError at the end for failures."""
    from app.run.batch.speech_batch import clip_requests, run_batch

    with ProgressBars() as shown, _report_interruption():

        def on_done(folder: Path, share: float) -> None:
            shown.update("generate clips", share)
            print_path(folder)

        done = run_batch(clip_requests(request), pool, on_done)
    _finish([request.output.out / path.name for path in done.table_files], done.notes)
    for clip, sentence in done.failed.items():
        print_message(f"{clip}: {sentence}")
    if done.num_reused:
        print_message(
            f"{pluralise(done.num_reused, 'clip')} had already been generated; the results "
            "were reused."
        )
    if done.failed:
        count = len(done.failed) + len(done.finished_clips)
        raise RunError(
            f"{len(done.failed)} of {count} clips failed. Run the same command again to retry them."
        )


def diagnose(
    request: Annotated[DiagnoseRequest, Flat],
    pool: PoolOptions,
    check: Annotated[Literal["genea"] | None, parsed_type(str, "genea", "nothing")] = None,
) -> None:
    """Compute metrics and figures for motion files from any source and report faults.

    Motions are measured raw and filtered. The figures show the trajectory of the tracked point
    (Figure 6), the sources of jitter, and the growth of rotation errors along the kinematic chain.

    Args:
        check: Check sets against the rules of the GENEA leaderboard and compute no metrics; needs
            --reference, the recorded test clips (docs/many-clips.md).
    """
    from app.run.batch.archives import is_archive

    if check not in (None, "genea"):
        raise RunError(f"--check accepts only 'genea'; got {check!r}.")
    paths = request.motions.motions
    if not paths:
        raise RunError("No motion was given; name at least one file.")
    if check is not None:
        _check_sets(request)
        return
    if any(path.is_dir() or is_archive(path) for path in paths):
        _diagnose_folders(request, pool.make_pool())
        return
    if request.metrics.emage_weights is not None or request.metrics.genea_weights:
        raise RunError(
            "FGD compares sets of clips; --emage-weights and --genea-weights need folders of clips."
        )
    if request.metrics.expected:
        raise RunError("Papers report values over many clips; --expect needs a folder of clips.")
    _run(tasks.DIAGNOSE, request, request.output.out)


def _check_sets(request: DiagnoseRequest) -> None:
    from app.run.batch.submission_check import check_sets

    ignored = (*_OF_ONE, "speech", "import_overrides", "channel", *_METRICS)
    refuse_ignored(request, ignored, "--check genea computes no metrics")
    out = request.output.out
    checks = check_sets(request.motions.motions, request.imports.reference, out)
    for checked in checks.values():
        for sentence in checked.messages:
            print_message(sentence)
    print_path(out / "check.md")
    wrong = [name for name, checked in checks.items() if not checked.is_valid]
    if wrong:
        raise RunError(
            f"These sets break rules of the leaderboard (see above): {', '.join(wrong)}."
        )


def _diagnose_folders(request: DiagnoseRequest, pool: JobPool) -> None:
    from app.run.batch.motion_sets import diagnose_folders

    why = "For folders, only metric tables and a figure of their distributions are written"
    refuse_ignored(request, _OF_ONE, why)
    with ProgressBars() as shown, _report_interruption():
        result = diagnose_folders(request, partial(shown.update, "measure clips"), pool)
    _finish(result.files, result.notes)
    left_out, clips = result.batch_json["left_out"], result.batch_json["clips"]
    if left_out:
        raise RunError(
            f"{len(left_out)} of {len(left_out) + len(clips)} clips could not be measured. The "
            "tables contain only the others."
        )


def step_sweep(request: Annotated[StepSweepRequest, Flat], files: Files) -> None:
    """Measure quality and speed for several numbers of sampling steps.

    The same motion is generated with few and with many steps. Jerk, and the distance to the result
    with the most steps, are plotted against the time per frame on this machine.
    """
    export_family_files(vars(files))
    _run(tasks.MEASURE_STEPS, request, request.output.out)


def speech_effect(request: Annotated[SpeechEffectRequest, Flat], files: Files) -> None:
    """Measure how much of the motion depends on the speech and how much on the noise seed.

    Each speech is generated with each noise seed, and motions that share the speech, the noise or
    neither are compared. Alternatively, compare a folder of motions from any source, with file
    names of the form SYSTEM__SPEECH__SEED.npz.
    """
    export_family_files(vars(files))
    if request.compares_existing_motions:
        ignored = ("weights", "speaker", "systems", "guidance", "num_seeds")
        refuse_ignored(request, ignored, "With a folder of motions, nothing is generated")
    _run(tasks.MEASURE_SPEECH_EFFECT, request, request.output.out)


def rotation_noise(request: Annotated[RotationNoiseRequest, Flat]) -> None:
    """Show the effect of equal noise on local (parent-relative) and on global joint rotations.

    The same random rotations are applied to a motion's local and global rotations, to illustrate
    the GlobalDiff paper's argument. Both bodies are rendered side by side, and the displacement of
    the tracked point is reported, as measured and as predicted analytically. No network is used.
    """
    _run(tasks.COMPARE_ROTATION_NOISE, request, request.output.out)


def plan(request: Annotated[PlanRequest, Flat]) -> None:
    """Write a gesture plan, sampled from speech or detected in a motion, for `generate --plan`.

    From speech, no motion is generated. The plan describes what each hand does, when, where and on
    which word, and also gaze, nods, brows, smiles, blinks and shifts of weight. It can be edited as
    text, in Praat or in ELAN (docs/plans.md); the suffix of --out (.json, .TextGrid or .eaf)
    selects the format. From a motion file (.npz, .npy, .bvh), the phases are detected
    automatically, without gesture forms and words; check them in ELAN, as the accuracy on recorded
    people is unknown.
    """
    from app.run.generated_motions import (
        has_motion_suffix,
        write_plan_from_motion,
        write_plan_from_speech,
    )

    source = request.speech.path
    if has_motion_suffix(source):
        why = "From a motion file, the plan is detected and not sampled"
        refuse_ignored(request, (*_DRAWS_PLANS, "channel"), why)
        if request.writes_empty_plan:
            raise RunError(f"{why}; remove --empty.")
        _finish(
            [request.out], write_plan_from_motion(source, request.out, request.import_overrides)
        )
        return
    what = "Import settings apply only to motion files, but the input is speech"
    refuse_ignored(request, ("import_overrides",), what)
    if request.writes_empty_plan:
        ignored = tuple(name for name in _DRAWS_PLANS if name != "style")
        refuse_ignored(request, ignored, "With --empty, no plan is sampled")
    _finish([request.out], write_plan_from_speech(request).notes)


def render(request: Annotated[RenderRequest, Flat]) -> None:
    """Render a motion as video or stills, or export it for 3D software.

    The suffix of --out selects the format. A .png is a contact sheet of eight poses, unless
    --stills or --contact-sheet-every selects other frames; with a .mp4, these pictures go next to
    the video. A .blender.npz is for Blender's SMPL-X add-on, a .vrma for players of VRM characters.
    """
    from app.run.videos.export import render_or_export_motion

    if not request.is_video_or_picture:
        ignored = ("speech", "views", "close_ups", "framing", "tracked_point")
        why = f"A {request.suffix} file has no sound, camera or tracked point"
        refuse_ignored(request, ignored, why)
    if request.suffix not in (".obj", ".ply"):
        why = "Only a .obj or .ply file is made from one chosen frame"
        refuse_ignored(request, ("mesh_frame",), why)
    if request.is_video_or_picture or request.suffix in (".obj", ".ply"):
        refuse_ignored(request, ("plan",), f"A {request.suffix} file cannot contain a plan")
    with ProgressBars() as shown:
        files, notes = render_or_export_motion(request, RunCallbacks(shown.on_event))
    _finish(files, notes)


def figure6(request: Annotated[Figure6Request, Flat]) -> None:
    """Draw Figure 6 of a finished run again, with other panels, frames or width.

    It is drawn from the motions in the run's folder; nothing is generated or measured.
    """
    with ProgressBars() as shown:
        files = tasks.REDRAW_FIGURE(request, RunCallbacks(shown.on_event))
    _finish(files, ())


Board = Annotated[Positional[Path], arg(metavar="BOARD.json")]


def leaderboard_add(
    board: Board,
    results: Annotated[
        Positional[tuple[Path, ...]], arg(metavar="DIR", help_behavior_hint="(required)")
    ],
    systems: Names = (),
    note: str = "",
) -> None:
    """Add the results of `diagnose` for complete test sets to a leaderboard.

    A leaderboard is a JSON file. Entries with the same clips, reference and encoders share a table.

    Args:
        board: Leaderboard file; it is created if it does not exist.
        results: Output folders of `diagnose`.
        systems: Systems to add.
        note: Text to show next to the numbers.
    """
    old_entries = read_leaderboard(board) if board.exists() else []
    new = [entries_from_results(folder, note, list(systems)) for folder in results]
    entries = merge_entries([old_entries, *new])
    write_leaderboard(entries, board)
    print_message(
        f"Leaderboard entries: {len(entries)}, {len(entries) - len(old_entries)} of them new."
    )
    print_path(board)


def leaderboard_merge(
    boards: Annotated[
        Positional[tuple[Path, ...]], arg(metavar="BOARD.json", help_behavior_hint="(required)")
    ],
    out: Path,
) -> None:
    """Merge leaderboards.

    Args:
        out: Leaderboard file to write.
    """
    write_leaderboard(merge_entries(read_leaderboard(path) for path in boards), out)
    print_path(out)


def leaderboard_page(board: Board, out: Path) -> None:
    """Write a leaderboard as an HTML page with sortable tables.

    Args:
        out: Page to write; it must end in .html.
    """
    if out.suffix.lower() != ".html":
        raise RunError(f"{out.name} must end in .html.")
    html = leaderboard_page_html(merge_entries([read_leaderboard(board)]))
    write_atomically(out, html)
    print_path(out)


@contextmanager
def _report_interruption() -> Iterator[None]:
    """Raise RunError, saying that it can be continued, when the user stops a run of many clips."""
    try:
        yield
    except KeyboardInterrupt:
        raise RunError(
            "Interrupted. Finished clips are kept; run the same command again to continue."
        ) from None


def _finish(files: Sequence[Path], notes: Sequence[str]) -> None:
    """Write notes for the user to standard error, and file paths for scripts to standard output."""
    for note in notes:
        print_message(note)
    for path in files:
        print_path(path)
