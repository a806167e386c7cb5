"""The command line: generate, diagnose, steps, plan, hearing, render, convert, mechanism,
leaderboard, study, doctor.

Exit status: 0 done, 1 failed with one sentence on standard error, 2 wrong arguments.
"""

from __future__ import annotations

import argparse
import logging
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from app import text
from app.commands.convert import add_convert
from app.commands.experiments import add_hearing, add_mechanism
from app.commands.leaderboard import add_leaderboard
from app.commands.many import add_pool, generate_over_many, pool_of, told_if_stopped
from app.commands.plan import add_plan
from app.commands.said import LogLines, Parser, name_file, say
from app.commands.study import add_study
from app.config import BUNDLED_WEIGHTS
from app.errors import CancelledRun, RunError, sentence_of
from app.findings.sentences import sentences_of, told_findings
from app.flags import WEIGHTS, add_family_files, add_flags, read_flags, use_family_files
from app.run.diagnose import DiagnoseRequest
from app.run.requests.request import BODY, GenerateRequest
from app.run.videos.export import ENDINGS, SHEET_POSES, RenderRequest, render_motion
from app.run.videos.own_videos import VideoOptions
from model.formats.reading import MOTIONS, ROTATIONS, told_as
from model.systems.registry import left_out

Command = Callable[[argparse.Namespace], None]
log = logging.getLogger(__name__)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status."""
    log_to = logging.StreamHandler()
    log_to.setFormatter(LogLines("%(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.WARNING, handlers=[log_to])
    options = make_parser().parse_args(argv)
    for sentence in left_out():
        say(sentence)
    command: Command = options.command
    # A termination must pass through every `with`, so that it leaves no half file or child.
    previous = signal.signal(signal.SIGTERM, _interrupt)
    try:
        command(options)
    except (KeyboardInterrupt, CancelledRun):
        say("stopped; nothing was kept.")
        return 1
    except Exception as error:
        sentence = sentence_of(error)
        if sentence is None:
            raise
        say(sentence)
        return 1
    finally:
        signal.signal(signal.SIGTERM, previous)
    return 0


def make_parser() -> argparse.ArgumentParser:
    """All commands with their flags."""
    parser = Parser(prog="python -m app", description=text.TAGLINE)
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    _add_generate(commands)
    _add_diagnose(commands)
    _add_steps(commands)
    _add_render(commands)
    add_convert(commands)
    add_plan(commands)
    add_hearing(commands)
    add_mechanism(commands)
    add_leaderboard(commands)
    _add_doctor(commands)
    add_study(commands)
    return parser


def _add_generate(commands) -> None:
    parser = commands.add_parser(
        "generate",
        help="speech to motion, videos, numbers and Figure 6",
        description="Generate motion of several systems for one piece of speech, with the same "
        "noise, and compare them: npz, mp4, comparison.mp4, figure6, diagnostics, provenance. Of "
        "many pieces each gets a folder of its own; started again, it goes on with what is not "
        "done.",
    )
    add_flags(parser, GenerateRequest)
    add_family_files(parser)
    add_pool(parser)
    parser.set_defaults(command=_generate)


def _generate(options: argparse.Namespace) -> None:
    from app.commands.said import ProgressBars
    from app.findings.verdict import verdict_of
    from app.run.many.speeches import is_many
    from app.run.pipeline import generate_all

    use_family_files(options)
    request = read_flags(GenerateRequest, options)
    if is_many(options.speech):
        generate_over_many(request, pool_of(options))
        return
    with ProgressBars() as bars:
        result = generate_all(request, bars.take)
    verdict = verdict_of(result.diagnostics)
    _finish(result.files, [*result.notes, *([] if verdict is None else [verdict.text])])


def _add_diagnose(commands) -> None:
    parser = commands.add_parser(
        "diagnose",
        help="numbers, Figure 6 and jitter of anyone's motion files",
        description="Measure motion files, whoever made them, raw and filtered; name their faults; "
        "draw Figure 6 and where the jitter sits; show how rotation errors grow along the chain.",
    )
    add_flags(parser, DiagnoseRequest)
    parser.add_argument(
        "--emage-weights",
        type=Path,
        metavar="BIN",
        help="folders beside --reference: EMAGE's AESKConv_240_100.bin, for FGD as papers on BEAT2 "
        "tell it (docs/many-clips.md)",
    )
    parser.add_argument(
        "--check",
        choices=["genea"],
        help="measure nothing: hold sets against the rules of the GENEA leaderboard, beside "
        "--reference, the recorded test clips (docs/many-clips.md)",
    )
    parser.add_argument(
        "--fps", type=float, metavar="N", help="frame rate of files that do not tell theirs, or lie"
    )
    parser.add_argument(
        "--rotations",
        choices=ROTATIONS,
        metavar="FORM",
        help=f"of the joints, where their number says too little: {', '.join(ROTATIONS)}",
    )
    parser.add_argument(
        "--videos",
        action="store_true",
        help="a video of each motion that figures show, with close-ups and trail, in register",
    )
    add_pool(parser)
    parser.set_defaults(command=_diagnose)


def _check_sets(options: argparse.Namespace) -> None:
    from app.run.many.check import check_sets, told

    found = check_sets(tuple(options.motions), options.reference, options.out)
    for name, checked in found.items():
        for sentence in told(name, checked):
            say(sentence)
    name_file(options.out / "check.md")
    wrong = [name for name, checked in found.items() if not checked.is_right]
    if wrong:
        raise RunError(f"{', '.join(wrong)}: not as the leaderboard asks; see above.")


def _diagnose_folders(options: argparse.Namespace) -> None:
    from app.commands.said import ProgressBar
    from app.run.many.motions import ManyRequest, diagnose_folders

    request = ManyRequest(
        folders=tuple(options.motions),
        out=options.out,
        reference=options.reference,
        speech=options.speech,
        mean_speeds=options.mean_speeds,
        emage_weights=options.emage_weights,
        told=told_as(options.fps, options.rotations, MOTIONS) + options.told,
        body=options.body,
        channel=options.channel,
        pool=pool_of(options),
    )
    with ProgressBar("measure clips") as bar, told_if_stopped():
        result = diagnose_folders(request, bar.show)
    _finish(result.files, result.notes)
    if result.left_out:
        raise RunError(
            f"{len(result.left_out)} of {len(result.left_out) + len(result.clips)} clips could not"
            " be measured; the tables are of the others."
        )


def _diagnose(options: argparse.Namespace) -> None:
    from app.run.many.unpacked import is_packed

    if options.check is not None:
        _check_sets(options)
        return
    if any(path.is_dir() or is_packed(path) for path in options.motions):
        _diagnose_folders(options)
        return
    if options.emage_weights is not None:
        raise RunError("FGD is a measure of many clips; --emage-weights goes with folders.")
    from app.commands.said import ProgressBar
    from app.run.diagnose import diagnose_files

    request = read_flags(
        DiagnoseRequest,
        options,
        videos=VideoOptions() if options.videos else None,
        told=told_as(options.fps, options.rotations, MOTIONS) + options.told,
    )
    with ProgressBar("measure and draw") as bar:
        diagnosis = diagnose_files(request, bar.take)
    sentences = sentences_of(diagnosis.diagnostics)
    heard = filter(None, (sentences["step"], sentences["beats"]))
    found = told_findings(diagnosis.diagnostics.findings)
    _finish(diagnosis.files, [*diagnosis.notes, *heard, *found])


def _add_steps(commands) -> None:
    from app.run.experiments.step_curve import MAX_S, StepCurveRequest

    parser = commands.add_parser(
        "steps",
        help="quality against time: what steps of a sampler buy on this machine",
        description="Generate the same motion with few and with many steps, and plot jerk, and the "
        f"distance to the result of most steps, over milliseconds a frame. Of {MAX_S:g} s of the "
        "speech.",
    )
    add_flags(parser, StepCurveRequest)
    add_family_files(parser)
    parser.set_defaults(command=_steps_command)


def _steps_command(options: argparse.Namespace) -> None:
    from app.commands.said import ProgressBar
    from app.run.experiments.step_curve import StepCurveRequest, measure_step_curve

    use_family_files(options)
    request = read_flags(StepCurveRequest, options)
    with ProgressBar("measure") as bar:
        curve = measure_step_curve(request, bar.take)
    for point in curve.points:
        say(
            f"{point.system}, {point.steps} steps: {point.ms_per_frame:.2f} ms a frame, jerk "
            f"{point.tip_jerk_m_s3:.0f} m/s3, {point.distance_cm:.1f} cm from most steps"
        )
    _finish(curve.files, ())


def _add_render(commands) -> None:
    parser = commands.add_parser(
        "render",
        help="a motion file to a video, pictures, or a file for 3D software",
        description="Draw a BEAT2-format motion file. The ending of --out chooses what is made: "
        f"{', '.join(ENDINGS)}. A .png is a contact sheet of {SHEET_POSES} poses, or what --stills "
        "and --sheet ask for; beside a .mp4 they are written under its name. A .blender.npz is "
        "for the SMPL-X add-on of Blender.",
    )
    add_flags(parser, RenderRequest)
    parser.set_defaults(command=_render)


def _render(options: argparse.Namespace) -> None:
    from app.commands.said import ProgressBar

    request = read_flags(RenderRequest, options)
    with ProgressBar(f"draw {options.out.name}") as bar:
        files, notes = render_motion(request, bar.take)
    _finish(files, notes)


@dataclass(frozen=True)
class _Examined:
    body: Path | None = field(default=None, metadata=BODY)
    weights: Path = field(default=BUNDLED_WEIGHTS, metadata=WEIGHTS)


def _add_doctor(commands) -> None:
    parser = commands.add_parser(
        "doctor",
        help="what works on this machine, what is missing, what to do",
        description="Try OpenGL, body, weights, ffmpeg, memory and disk. Exit status 1 when "
        "something needed does not work.",
    )
    add_flags(parser, _Examined)
    add_family_files(parser)
    parser.set_defaults(command=_doctor)


def _doctor(options: argparse.Namespace) -> None:
    from app.commands.doctor import examine, report

    use_family_files(options)
    findings = examine(options.weights, options.body)
    sys.stdout.write(report(findings))
    broken = [finding.name for finding in findings if finding.is_broken]
    if broken:
        raise RunError(f"not everything works: {', '.join(broken)}; see what to do above.")


def _finish(files: Sequence[Path], notes: Sequence[str]) -> None:
    """Notes for a person on standard error, files for a script on standard output."""
    for note in notes:
        say(note)
    for path in files:
        name_file(path)


def _interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt
