"""Commands that make motion or measure it: generate, diagnose, steps, hearing, mechanism, plan,
render; and the leaderboard of what was measured."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg

from app.errors import RunError
from app.flags import Count, Names, family_files, text_type, use_family_files
from app.run.callbacks import Ear
from app.run.many.board import board_page, entries_of, merged, read_board, write_board
from app.run.output.run_folder import read_run
from app.run.output.telling import Bars, name_file, say
from app.run.requests.convert import refuse_ignored
from app.run.requests.requests import (
    DiagnoseRequest,
    GenerateRequest,
    PlanRequest,
    RenderRequest,
    RotationNoiseRequest,
    SpeechEffectRequest,
    StepSweepRequest,
)
from app.run.tasks import DIAGNOSE, GENERATE, MEASURE_HEARING, MEASURE_STEPS, SHOW_MECHANISM, Task
from model.storage.files import write_atomically
from processes.pool import JobPool

_FIGURE = ("joint", "start_frame", "figure_forms", "figure_panels", "figure_frames", "figure_width")
_DRAWS_PLANS = ("weights", "speaker", "seed", "guidance", "transcript", "words", "style")
"""What decides a plan that is sampled from speech."""
_FIGURE = ("joint", "start_frame", "figure_panels", "figure_frames", "figure_width")
_OF_ONE = ("transcript", "words", "window", "overlap", *_FIGURE, "shown", "has_video")
"""Options of `diagnose` for single motions, and not for sets."""
Files = Annotated[Any, family_files()]
Flat = arg(name="")
"""Groups of flags are named after the parts of a request alone."""


@dataclass(frozen=True)
class Pool:
    """Who works on many clips."""

    processes: Count = None
    """Of many clips: on this machine, one thread each."""
    scheduler: Annotated[str | None, text_type(str, "ADDRESS", "none")] = None
    """Of many clips: of Dask, such as tcp://head:8786, whose workers see the same files
    (docs/many-clips.md)."""

    def jobs(self) -> JobPool:
        """
        Raises:
            RunError: if both are named.
        """
        if self.processes is not None and self.scheduler is not None:
            raise RunError("Give --processes or --scheduler; a cluster has workers of its own.")
        return JobPool(self.processes, self.scheduler)


def generate(request: Annotated[GenerateRequest, Flat], files: Files, pool: Pool) -> None:
    """Speech to motion, videos, numbers and Figure 6.

    Several systems move to one piece of speech, with the same noise, and are compared: npz, mp4,
    comparison.mp4, figure6, diagnostics, provenance. Of many pieces each gets a folder of its own;
    started again, it goes on with what is not done.
    """
    from app.run.many.speeches import is_many

    use_family_files(vars(files))
    if is_many(request.speech.path):
        _generate_many(request, pool.jobs())
    else:
        _run(GENERATE, request, request.output.out)


def _run(task: Task, request: Any, out: Path) -> None:
    """Run a task, and say what its folder says: its metrics, and what stands out."""
    with Bars() as shown:
        task(request, Ear(shown.take))
    record = read_run(out)
    verdict = [] if record.verdict is None else [record.verdict.numbers, record.verdict.judgement]
    said = [record.says.get(key) for key in ("step", "beats")]
    findings = record.gravest if record.kind == "generated" else record.findings
    found = [f"{record.label(each.name)}: {each.sentence}".removeprefix(": ") for each in findings]
    paths = [out / name for name in record.results]
    _finish(paths, [*record.notes, *filter(None, [*verdict, *said]), *found])


def _generate_many(request: GenerateRequest, pool: JobPool) -> None:
    """Each folder is named on standard output as it is there; what failed is said.

    Raises:
        RunError: at the end, if any failed.
    """
    from app.run.many.speeches import clip_requests, do_clips

    with Bars() as shown, _told_if_stopped():

        def on_done(folder: Path, share: float) -> None:
            shown.show("generate clips", share)
            name_file(folder)

        done = do_clips(clip_requests(request), pool, on_done)
    _finish([request.output.out / path.name for path in done.files], done.notes)
    for clip, sentence in done.failed.items():
        say(f"{clip}: {sentence}")
    if done.kept:
        say(f"{done.kept} clips had been made before and were kept.")
    if done.failed:
        raise RunError(
            f"{len(done.failed)} of {len(done.failed) + len(done.clips)} clips could not be made; "
            "the same command tries these again."
        )


def diagnose(
    request: Annotated[DiagnoseRequest, Flat],
    pool: Pool,
    check: Annotated[Literal["genea"] | None, text_type(str, "genea", "nothing")] = None,
) -> None:
    """Numbers, Figure 6 and jitter of anyone's motion files.

    Measure motion files, whoever made them, raw and filtered; name their faults; draw Figure 6 and
    where the jitter sits; show how rotation errors grow along the chain.

    Args:
        check: measure nothing: hold sets against the rules of the GENEA leaderboard, beside
            --reference, the recorded test clips (docs/many-clips.md).
    """
    from app.run.many.unpacked import is_packed

    if check not in (None, "genea"):
        raise RunError("--check takes genea.")
    paths = request.motions.motions
    if not paths:
        raise RunError("There is no motion to measure; name at least one file.")
    if check is not None:
        _check_sets(request)
        return
    if any(path.is_dir() or is_packed(path) for path in paths):
        _diagnose_folders(request, pool.jobs())
        return
    if request.metrics.emage_weights is not None:
        raise RunError("FGD is a measure of many clips; --emage-weights goes with folders.")
    _run(DIAGNOSE, request, request.output.out)


def _check_sets(request: DiagnoseRequest) -> None:
    from app.run.many.check import check_sets

    ignored = (*_OF_ONE, "speech", "import_overrides", "channel", "mean_speeds", "emage_weights")
    refuse_ignored(request, ignored, "--check genea measures nothing")
    out = request.output.out
    found = check_sets(request.motions.motions, request.imports.reference, out)
    for checked in found.values():
        for sentence in checked.told:
            say(sentence)
    name_file(out / "check.md")
    wrong = [name for name, checked in found.items() if not checked.is_right]
    if wrong:
        raise RunError(f"{', '.join(wrong)}: not as the leaderboard asks; see above.")


def _diagnose_folders(request: DiagnoseRequest, pool: JobPool) -> None:
    from app.run.many.motions import diagnose_folders

    refuse_ignored(request, _OF_ONE, "Of folders only numbers over clips are made")
    with Bars() as shown, _told_if_stopped():
        result = diagnose_folders(request, partial(shown.show, "measure clips"), pool)
    _finish(result.files, result.notes)
    left_out, clips = result.told["left_out"], result.told["clips"]
    if left_out:
        raise RunError(
            f"{len(left_out)} of {len(left_out) + len(clips)} clips could not be measured; the "
            "tables are of the others."
        )


def steps(request: Annotated[StepSweepRequest, Flat], files: Files) -> None:
    """Quality against time: what steps of a sampler buy on this machine.

    Generate the same motion with few and with many steps, and plot jerk, and the distance to the
    result of most steps, over milliseconds a frame.
    """
    use_family_files(vars(files))
    _run(MEASURE_STEPS, request, request.out)


def hearing(request: Annotated[SpeechEffectRequest, Flat], files: Files) -> None:
    """Does it hear? What speech decides of the motion, and what chance.

    Generate each speech with each noise seed and compare: motions that share the speech, the noise,
    or neither. Or compare a folder of anyone's motion, whose files are called
    SYSTEM__SPEECH__SEED.npz.
    """
    use_family_files(vars(files))
    if request.is_of_motions:
        ignored = ("weights", "speaker", "systems", "guidance", "seeds")
        refuse_ignored(request, ignored, "The motions of a folder are compared as they are")
    _run(MEASURE_HEARING, request, request.out)


def mechanism(request: Annotated[RotationNoiseRequest, Flat]) -> None:
    """The paper's argument on a body: equal noise on local and on global rotations.

    Put the same random turns on the local and on the global rotations of a motion, draw both bodies
    beside each other, and tell how far a fingertip is moved, as measured and by the closed form. No
    network takes part.
    """
    _run(SHOW_MECHANISM, request, request.out)


def plan(request: Annotated[PlanRequest, Flat]) -> None:
    """Speech to a plan of gestures, which `generate --plan` performs.

    Draw a plan from speech without moving anything: what each hand does when, where to and on which
    word; looks, nods, brows, blinks and steps. It is made to be changed, by hand or in Praat or
    ELAN (docs/plans.md): --out ends in .json, .TextGrid or .eaf. Of a motion (.npz, .npy, .bvh) the
    plan is found instead, as annotators do.
    """
    from app.run.made import find_plan, is_motion, make_plan

    source = request.speech.path
    if is_motion(source):
        refuse_ignored(request, (*_DRAWS_PLANS, "channel"), "In a motion the plan is found")
        if request.is_empty:
            raise RunError("In a motion the plan is found; leave --empty out.")
        _finish([request.out], find_plan(source, request.out, request.import_overrides))
        return
    what = "Assumptions are of motion files, and this is speech"
    refuse_ignored(request, ("import_overrides",), what)
    if request.is_empty:
        ignored = tuple(name for name in _DRAWS_PLANS if name != "style")
        refuse_ignored(request, ignored, "An empty plan is not drawn")
    _finish([request.out], make_plan(request).notes)


def render(request: Annotated[RenderRequest, Flat]) -> None:
    """A motion file to a video, pictures, or a file for 3D software.

    The ending of --out chooses what is made. A .png is a contact sheet of eight poses, or what
    --stills and --sheet ask for; beside a .mp4 they are written under its name. A .blender.npz is
    for the SMPL-X add-on of Blender.
    """
    from app.run.videos.export import render_motion

    if not request.is_picture:
        ignored = ("speech", "views", "close_ups", "framing", "joint")
        refuse_ignored(request, ignored, f"A {request.suffix} file holds the body alone")
    if request.suffix not in (".obj", ".ply"):
        refuse_ignored(request, ("frame",), f"A {request.suffix} file holds all frames")
    if request.is_picture or request.suffix in (".obj", ".ply"):
        refuse_ignored(request, ("plan",), f"A {request.suffix} file has no place for a plan")
    with Bars() as shown:
        files, notes = render_motion(request, Ear(shown.take))
    _finish(files, notes)


Board = Annotated[Positional[Path], arg(metavar="BOARD.json")]


def leaderboard_add(
    board: Board,
    results: Annotated[Positional[tuple[Path, ...]], arg(metavar="DIR")],
    systems: Names = (),
    note: str = "",
) -> None:
    """Take what `diagnose` left of whole sets into a leaderboard.

    A leaderboard is one JSON file. Entries of the same clips, recorded motion and encoders stand in
    one table.

    Args:
        board: made if it is not there.
        results: folders that `diagnose` has left.
        systems: take these only.
        note: stands beside the numbers.
    """
    known = read_board(board) if board.exists() else []
    new = [entries_of(folder, note, list(systems)) for folder in results]
    entries = merged([known, *new])
    write_board(entries, board)
    say(f"{len(entries) - len(known)} of {len(entries)} entries are new.")
    name_file(board)


def leaderboard_merge(
    boards: Annotated[Positional[tuple[Path, ...]], arg(metavar="BOARD.json")], out: Path
) -> None:
    """Put leaderboards together.

    Args:
        out: where.
    """
    write_board(merged(read_board(path) for path in boards), out)
    name_file(out)


def leaderboard_page(board: Board, out: Path) -> None:
    """Write a leaderboard as a page that can be sorted.

    Args:
        out: ends in .html.
    """
    if out.suffix.lower() != ".html":
        raise RunError(f"{out.name} must end in .html.")
    told = board_page(merged([read_board(board)]))
    write_atomically(out, told)
    name_file(out)


@contextmanager
def _told_if_stopped() -> Iterator[None]:
    """Say that work on many clips that a person stops goes on later.

    Raises:
        RunError: in place of KeyboardInterrupt.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise RunError("stopped; what is done is kept, and the same command goes on.") from None


def _finish(files: Sequence[Path], notes: Sequence[str]) -> None:
    """Notes for a person on standard error, files for a script on standard output."""
    for note in notes:
        say(note)
    for path in files:
        name_file(path)
