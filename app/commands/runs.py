"""Commands that make motion or measure it: generate, diagnose, steps, hearing, mechanism, plan,
render; and the leaderboard of what was measured."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg

from app.config import default_body
from app.errors import RunError
from app.flags import (
    Count,
    File,
    Names,
    family_files,
    no,
    part_of,
    refuse_ignored,
    use_family_files,
    written,
)
from app.run.ask import SAMPLING, Ask, Ear
from app.run.display import Display
from app.run.many.board import board_page, entries_of, merged, read_board, write_board
from app.run.output.run_folder import read_run
from app.run.output.telling import Bars, name_file, say
from app.run.tasks import (
    MEASURE_HEARING,
    MEASURE_STEPS,
    RUN,
    SHOW_MECHANISM,
    HearingAsk,
    MechanismAsk,
    RenderAsk,
    StepsAsk,
    Task,
)
from conventions.views import CLOSE_UPS
from model.storage.files import write_atomically
from model.systems.registry import usual_systems
from processes.pool import JobPool

_FIGURE = ("joint", "start_frame", "figure_forms", "figure_panels", "figure_frames", "figure_width")
_WORDS = ("channel", "transcript", "words")
_DRAWS_PLANS = ("weights", "speaker", "seed", "guidance", "transcript", "words", "style")
"""What decides a plan that is drawn of speech."""
_OF_ONE = ("transcript", "words", "window", "overlap", *_FIGURE, "shown", "has_video")
"""What `diagnose` takes of single motions, and not of sets."""
_SYSTEMS = ("weights", "speaker")


def _speech(about: str) -> tuple[Any]:
    return (Annotated[Positional[Path], arg(metavar="SPEECH", help=about)],)


def _motion(about: str) -> tuple[Any]:
    return (Annotated[Positional[tuple[Path, ...]], arg(metavar="MOTION", help=about)],)


Files = Annotated[Any, family_files()]
_BODY = (File, default_body())
_GENERATE = part_of(
    Ask,
    *("out", "systems", "weights", *SAMPLING),
    *("post_filter", "plan", "style", "reference", "told", *_WORDS),
    *("max_speech_s", *_FIGURE, "look", "views", "close_ups", "framing", "size", "display"),
    "has_figures",
    speech=_speech("Any sound file; or many: a folder of them, or a .txt with one path a line."),
    body=_BODY,
    has_video=(Annotated[bool, no("video", "No videos.")], True),
)
_DIAGNOSE = part_of(
    Ask,
    *("out", "speech", "reference", "told", *_WORDS, "mean_speeds", "window", "overlap"),
    "emage_weights",
    *(*_FIGURE, "shown", "has_poses"),
    motions=_motion(
        ".npz (BEAT2, AMASS, SMPL-X parameters), .npy (rotations, TalkSHOW) or .bvh; or "
        "folders or zips of them, paired by name, for numbers over many clips."
    ),
    body=_BODY,
    has_video=(
        Annotated[
            bool,
            arg(
                name="videos",
                help="A video of each motion that figures show, with close-ups and trail, in "
                "register.",
            ),
        ],
        False,
    ),
)
_STEPS = part_of(
    StepsAsk,
    *("out", *_SYSTEMS, "seed", "counts", "figure_forms"),
    systems=(Annotated[Names, arg(help="At most six.")],),
    speech=_speech("Of which ten seconds are used."),
)
_HEARING = part_of(
    HearingAsk,
    *("out", *_SYSTEMS, "guidance", "seeds", "speakers", "figure_forms"),
    speeches=(Annotated[Positional[tuple[Path, ...]], arg(metavar="SPEECH")],),
    systems=(Names, usual_systems("hearing")),
)
_MECHANISM = part_of(
    MechanismAsk,
    *("out", "seed", "joint", "speech", "told", "size", "noise_rad", "figure_forms"),
    motions=_motion("One."),
    body=_BODY,
)
_PLAN = part_of(
    Ask,
    *("out", *_SYSTEMS, "seed", "guidance", *_WORDS, "style", "told"),
    speech=_speech("Any sound file; or a motion, whose plan is found."),
)
_RENDER = part_of(
    RenderAsk,
    *("out", "speech", "told", "look", "views", "close_ups", "framing", "display", "joint"),
    *("size", "plan", "num_stills", "sheet_every", "frame", "background"),
    motions=_motion("One, in BEAT2's form, or any that is read."),
    body=_BODY,
)


@dataclass(frozen=True)
class Pool:
    """Who works on many clips."""

    processes: Count = None
    """Of many clips: on this machine, one thread each."""
    scheduler: Annotated[str | None, written(str, "ADDRESS", "none")] = None
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


def generate(ask: Annotated[Ask, _GENERATE], files: Files, pool: Pool) -> None:
    """Speech to motion, videos, numbers and Figure 6.

    Several systems move to one piece of speech, with the same noise, and are compared: npz, mp4,
    comparison.mp4, figure6, diagnostics, provenance. Of many pieces each gets a folder of its own;
    started again, it goes on with what is not done.
    """
    from app.run.many.speeches import is_many

    use_family_files(vars(files))
    if ask.speech is not None and is_many(ask.speech):
        _generate_many(ask, pool.jobs())
    else:
        _do(RUN, ask)


def _do(task: Task, ask: Ask, files: Files = None) -> None:
    """Do it, and say what its folder says: its numbers, and what stands out."""
    if files is not None:
        use_family_files(vars(files))
    with Bars() as shown:
        task(ask, Ear(shown.take))
    record = read_run(ask.out)
    verdict = [] if record.verdict is None else [record.verdict.numbers, record.verdict.judgement]
    said = [record.says.get(key) for key in ("step", "beats")]
    findings = record.gravest if record.kind == "generated" else record.findings
    found = [f"{record.label(each.name)}: {each.sentence}".removeprefix(": ") for each in findings]
    paths = [ask.out / name for name in record.results]
    _finish(paths, [*record.notes, *filter(None, [*verdict, *said]), *found])


def _generate_many(ask: Ask, pool: JobPool) -> None:
    """Each folder is named on standard output as it is there; what failed is said.

    Raises:
        RunError: at the end, if any failed.
    """
    from app.run.many.speeches import asks_of, do_clips

    with Bars() as shown, _told_if_stopped():

        def on_done(folder: Path, share: float) -> None:
            shown.show("generate clips", share)
            name_file(folder)

        done = do_clips(asks_of(ask), pool, on_done)
    _finish([ask.out / path.name for path in done.files], done.notes)
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
    ask: Annotated[Ask, _DIAGNOSE],
    pool: Pool,
    check: Annotated[Literal["genea"] | None, written(str, "genea", "nothing")] = None,
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
    ask = replace(ask, size=640, display=Display(has_trail=True), close_ups=CLOSE_UPS)
    if not ask.motions:
        raise RunError("There is no motion to measure; name at least one file.")
    if check is not None:
        _check_sets(ask)
        return
    if any(path.is_dir() or is_packed(path) for path in ask.motions):
        _diagnose_folders(ask, pool.jobs())
        return
    if ask.emage_weights is not None:
        raise RunError("FGD is a measure of many clips; --emage-weights goes with folders.")
    _do(RUN, ask)


def _check_sets(ask: Ask) -> None:
    from app.run.many.check import check_sets

    ignored = (*_OF_ONE, "speech", "told", "channel", "mean_speeds", "emage_weights")
    refuse_ignored(ask, ignored, "--check genea measures nothing")
    found = check_sets(ask.motions, ask.reference, ask.out)
    for checked in found.values():
        for sentence in checked.told:
            say(sentence)
    name_file(ask.out / "check.md")
    wrong = [name for name, checked in found.items() if not checked.is_right]
    if wrong:
        raise RunError(f"{', '.join(wrong)}: not as the leaderboard asks; see above.")


def _diagnose_folders(ask: Ask, pool: JobPool) -> None:
    from app.run.many.motions import diagnose_folders

    refuse_ignored(ask, _OF_ONE, "Of folders only numbers over clips are made")
    with Bars() as shown, _told_if_stopped():
        result = diagnose_folders(ask, partial(shown.show, "measure clips"), pool)
    _finish(result.files, result.notes)
    left_out, clips = result.told["left_out"], result.told["clips"]
    if left_out:
        raise RunError(
            f"{len(left_out)} of {len(left_out) + len(clips)} clips could not be measured; the "
            "tables are of the others."
        )


def steps(ask: Annotated[StepsAsk, _STEPS], files: Files) -> None:
    """Quality against time: what steps of a sampler buy on this machine.

    Generate the same motion with few and with many steps, and plot jerk, and the distance to the
    result of most steps, over milliseconds a frame.
    """
    _do(MEASURE_STEPS, ask, files)


def hearing(ask: Annotated[HearingAsk, _HEARING], files: Files) -> None:
    """Does it hear? What speech decides of the motion, and what chance.

    Generate each speech with each noise seed and compare: motions that share the speech, the noise,
    or neither. Or compare a folder of anyone's motion, whose files are called
    SYSTEM__SPEECH__SEED.npz.
    """
    if ask.is_of_motions:
        ignored = (*_SYSTEMS, "systems", "guidance", "seeds")
        why = "The motions of a folder are compared as they are"
        refuse_ignored(ask, ignored, why, systems=usual_systems("hearing"))
    _do(MEASURE_HEARING, ask, files)


def mechanism(ask: Annotated[MechanismAsk, _MECHANISM]) -> None:
    """The paper's argument on a body: equal noise on local and on global rotations.

    Put the same random turns on the local and on the global rotations of a motion, draw both bodies
    beside each other, and tell how far a fingertip is moved, as measured and by the closed form. No
    network takes part.
    """
    _do(SHOW_MECHANISM, replace(ask, has_video=True))


def plan(ask: Annotated[Ask, _PLAN], is_empty: Annotated[bool, arg(name="empty")] = False) -> None:
    """Speech to a plan of gestures, which `generate --plan` performs.

    Draw a plan from speech without moving anything: what each hand does when, where to and on which
    word; looks, nods, brows, blinks and steps. It is made to be changed, by hand or in Praat or
    ELAN (docs/plans.md): --out ends in .json, .TextGrid or .eaf. Of a motion (.npz, .npy, .bvh) the
    plan is found instead, as annotators do.

    Args:
        is_empty: draw nothing: leave the tiers to be annotated by hand.
    """
    from app.run.made import find_plan, is_motion, make_plan

    source = ask.speech or Path()
    if is_motion(source):
        refuse_ignored(ask, (*_DRAWS_PLANS, "channel"), "In a motion the plan is found")
        if is_empty:
            raise RunError("In a motion the plan is found; leave --empty out.")
        _finish([ask.out], find_plan(source, ask.out, ask.told))
        return
    refuse_ignored(ask, ("told",), "Assumptions are of motion files, and this is speech")
    if is_empty:
        ignored = (name for name in _DRAWS_PLANS if name != "style")
        refuse_ignored(ask, tuple(ignored), "An empty plan is not drawn")
    _finish([ask.out], make_plan(ask, is_empty=is_empty).notes)


def render(ask: Annotated[RenderAsk, _RENDER]) -> None:
    """A motion file to a video, pictures, or a file for 3D software.

    The ending of --out chooses what is made. A .png is a contact sheet of eight poses, or what
    --stills and --sheet ask for; beside a .mp4 they are written under its name. A .blender.npz is
    for the SMPL-X add-on of Blender.
    """
    from app.run.videos.export import render_motion

    if not ask.is_picture:
        ignored = ("speech", "views", "close_ups", "framing", "joint")
        refuse_ignored(ask, ignored, f"A {ask.ending} file holds the body alone")
    if ask.ending not in (".obj", ".ply"):
        refuse_ignored(ask, ("frame",), f"A {ask.ending} file holds all frames")
    if ask.is_picture or ask.ending in (".obj", ".ply"):
        refuse_ignored(ask, ("plan",), f"A {ask.ending} file has no place for a plan")
    with Bars() as shown:
        files, notes = render_motion(ask, Ear(shown.take))
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
