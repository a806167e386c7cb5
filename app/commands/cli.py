"""The command line: generate, diagnose, steps, plan, hearing, render, mechanism, leaderboard,
study, doctor.

Exit status: 0 done, 1 failed with one sentence on standard error, 2 wrong arguments.
"""

from __future__ import annotations

import argparse
import logging
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from app import text
from app.commands.hearing import add_hearing
from app.commands.leaderboard import add_leaderboard
from app.commands.many import add_crew, crew_of, generate_over_many, told_if_stopped
from app.commands.mechanism import add_mechanism
from app.commands.plan import add_plan, add_style
from app.commands.said import LogLines, Parser, name_file, say
from app.commands.study import add_study
from app.config import BUNDLED_WEIGHTS, default_body
from app.errors import CancelledRun, RunError, sentence_of
from app.family_files import add_family_files, use_family_files
from app.findings.ranking import told_findings
from app.findings.sentences import sentences_of
from app.run.display import COLORINGS, Display
from app.run.pictures.export import BACKGROUNDS, ENDINGS, SHEET_POSES, RenderRequest, render_motion
from app.run.pictures.followed_point import TIP
from app.run.pictures.own_videos import VideoOptions
from app.run.request import (
    CLOSE_UPS,
    FRAMINGS,
    LOOKS,
    POST_FILTERS,
    VIEWS,
    WORDS_ASKED,
    CloseUp,
    Framing,
    GenerateRequest,
    View,
    check_size,
    parse_steps,
)
from model.systems.registry import left_out

Command = Callable[[argparse.Namespace], None]
log = logging.getLogger(__name__)
_ROTATIONS = ("axis-angle", "6d", "quaternion-wxyz", "quaternion-xyzw", "matrix")
"""As `model.formats.numbers.ROTATIONS`, which brings torch; a test holds them equal."""

EXAGGERATIONS = (1, 5, 20)
"""What can be asked for here; the page's stage has a slider."""


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
    parser.add_argument(
        "speech", type=Path, metavar="SPEECH",
        help="any sound file; or many: a folder of them, or a .txt with one path a line",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of results")
    parser.add_argument(
        "--systems", type=_names, default=(), metavar="A,B,...|all", help="default: all"
    )
    parser.add_argument("--speaker", metavar="NAME", help="default: the first that is known")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="default: %(default)s")
    parser.add_argument(
        "--samples", type=int, default=1, metavar="N", help="motions per system (default: 1)"
    )
    parser.add_argument(
        "--steps", type=_steps, metavar="N|A=N,...",
        help="sampler steps, of all systems or by name (default: what each usually takes)",
    )  # fmt: skip
    parser.add_argument(
        "--face-steps", type=_steps, metavar="N|A=N,...",
        help="of systems that draw the face by steps of its own (default: the usual share)",
    )  # fmt: skip
    parser.add_argument(
        "--sampler",
        metavar="NAME",
        help="of systems that have it (default: each its usual one)",
    )
    parser.add_argument(
        "--guidance", type=float, metavar="N",
        help="strength of the speech, 0 to 10; 1 is as trained, and as the papers' own code draws\n"
        "(default: as suits each system)",
    )  # fmt: skip
    parser.add_argument(
        "--plan", type=Path, metavar="FILE",
        help="what systems that plan are to perform, as a run or `plan` leaves it, or as annotated "
        "in\nPraat or ELAN: .json, .TextGrid, .eaf; of many pieces a folder of them (default: "
        "drawn from the speech)",
    )  # fmt: skip
    add_style(parser)
    parser.add_argument(
        "--post-filter", choices=POST_FILTERS, default="none",
        help="smooth every system alike; the numbers give both in any case (default: none)",
    )  # fmt: skip
    parser.add_argument(
        "--reference", type=Path, metavar="MOTION.npz", help="recorded motion to compare with"
    )
    _add_point(parser)
    parser.add_argument(
        "--views", type=_views, default=("front",), metavar="V,...",
        help=f"of {', '.join(VIEWS)}; the first is compared (default: front)",
    )  # fmt: skip
    _add_framing(parser, "knees")
    _add_close_up(parser, "hands")
    _add_display(parser)
    parser.add_argument("--no-video", action="store_true", help="no videos, figure without poses")
    parser.add_argument("--no-figures", action="store_true", help="neither Figure 6 nor jitter")
    parser.add_argument(
        "--size", type=_size, default=512, metavar="PX", help="height of a body (default: 512)"
    )
    parser.add_argument(
        "--max-minutes", type=float, default=10.0, metavar="N",
        help="longest speech accepted (default: 10)",
    )  # fmt: skip
    _add_body(parser)
    _add_look(parser)
    parser.add_argument(
        "--weights", type=Path, default=BUNDLED_WEIGHTS, metavar="DIR", help="default: bundled"
    )
    add_family_files(parser)
    add_crew(parser)
    parser.set_defaults(command=_generate)


def _generate(options: argparse.Namespace) -> None:
    from app.commands.terminal import ProgressBars
    from app.findings.verdict import verdict_of
    from app.run.many.speeches import is_many
    from app.run.pipeline import generate_all

    use_family_files(options)
    request = GenerateRequest(
        speech=options.speech,
        out=options.out,
        weights=options.weights,
        systems=options.systems,
        speaker=options.speaker,
        seed=options.seed,
        samples=options.samples,
        steps=options.steps,
        face_steps=options.face_steps,
        sampler=options.sampler,
        guidance=options.guidance,
        plan=options.plan,
        style=options.style,
        post_filter=options.post_filter,
        reference=options.reference,
        transcript=options.transcript,
        words=options.words,
        joint=options.joint,
        start_frame=options.start,
        body=options.body,
        look=options.look,
        views=options.views,
        framing=options.framing,
        close_ups=options.close_up,
        display=_display(options),
        size=options.size,
        has_video=not options.no_video,
        has_figures=not options.no_figures,
        max_speech_s=60 * options.max_minutes,
    )
    if is_many(options.speech):
        generate_over_many(request, crew_of(options))
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
    parser.add_argument(
        "motions", type=Path, nargs="+", metavar="MOTION",
        help=".npz (BEAT2, AMASS, SMPL-X parameters), .npy (rotations, TalkSHOW) or .bvh; or "
        "folders or zips of them, paired by name, for numbers over many clips",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of results")
    parser.add_argument(
        "--reference", type=Path, metavar="MOTION.npz", help="recorded motion to compare with"
    )
    parser.add_argument(
        "--speech", type=Path, metavar="WAV",
        help="their sound, for BeatAlign and its chance level; a folder of it for folders",
    )  # fmt: skip
    parser.add_argument(
        "--mean-speeds", type=Path, metavar="NPY",
        help="EMAGE's mean_vel_smplxflame_30.npy (BEAT2's folder weights): BeatAlign with its "
        "published speeds of the joints, to be held against papers",
    )  # fmt: skip
    parser.add_argument(
        "--emage-weights", type=Path, metavar="BIN",
        help="folders beside --reference: EMAGE's AESKConv_240_100.bin, for FGD as papers on BEAT2 "
        "tell it (docs/many-clips.md)",
    )  # fmt: skip
    parser.add_argument(
        "--show", type=_names, default=(), metavar="A,B,...",
        help="which motions the figures show, by the names of their files (default: the first six)",
    )  # fmt: skip
    _add_point(parser)
    parser.add_argument(
        "--window", type=int, metavar="N",
        help="frames of the windows that the motions were made of, if you know it (default: every "
        "period from 2 to 240 frames is tried)",
    )  # fmt: skip
    parser.add_argument(
        "--overlap", type=int, default=0, metavar="M",
        help="frames that two such windows share (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--fps", type=float, metavar="N", help="frame rate of files that do not tell theirs, or lie"
    )
    parser.add_argument(
        "--rotations", choices=_ROTATIONS, metavar="FORM",
        help=f"of the joints, where their number says too little: {', '.join(_ROTATIONS)}",
    )  # fmt: skip
    parser.add_argument("--no-pictures", action="store_true", help="a figure without poses")
    parser.add_argument(
        "--videos", action="store_true",
        help="a video of each motion that figures show, with close-ups and trail, in register",
    )  # fmt: skip
    _add_body(parser)
    add_crew(parser)
    parser.set_defaults(command=_diagnose)


def _diagnose_folders(options: argparse.Namespace) -> None:
    from app.commands.terminal import ProgressBar
    from app.run.many.motions import ManyRequest, diagnose_folders

    request = ManyRequest(
        folders=tuple(options.motions),
        out=options.out,
        reference=options.reference,
        speech=options.speech,
        mean_speeds=options.mean_speeds,
        emage_weights=options.emage_weights,
        fps=options.fps,
        rotations=options.rotations,
        crew=crew_of(options),
    )
    with ProgressBar("measure clips") as bar, told_if_stopped():
        result = diagnose_folders(request, bar.show)
    _finish(result.files, result.notes)


def _diagnose(options: argparse.Namespace) -> None:
    from app.run.many.unpacked import is_zip

    if any(path.is_dir() or is_zip(path) for path in options.motions):
        _diagnose_folders(options)
        return
    if options.emage_weights is not None:
        raise RunError("FGD is a measure of many clips; --emage-weights goes with folders.")
    from app.commands.terminal import ProgressBar
    from app.run.diagnose import DiagnoseRequest, diagnose_files
    from model.formats.numbers import ReadOptions

    request = DiagnoseRequest(
        motions=tuple(options.motions),
        out=options.out,
        reference=options.reference,
        speech=options.speech,
        mean_speeds=options.mean_speeds,
        transcript=options.transcript,
        words=options.words,
        shown=options.show,
        joint=options.joint,
        start_frame=options.start,
        body=options.body,
        has_pictures=not options.no_pictures,
        videos=VideoOptions() if options.videos else None,
        window=options.window,
        overlap=options.overlap,
        read_as=ReadOptions(options.fps, options.rotations),
    )
    with ProgressBar("measure and draw") as bar:
        diagnosis = diagnose_files(request, bar.show)
    beats = sentences_of(diagnosis.diagnostics)["beats"]
    found = told_findings(diagnosis.diagnostics.findings)
    _finish(diagnosis.files, [*diagnosis.notes, *([beats] if beats else []), *found])


def _add_steps(commands) -> None:
    from app.run.step_curve import COUNTS, MAX_S

    parser = commands.add_parser(
        "steps",
        help="quality against time: what steps of a sampler buy on this machine",
        description="Generate the same motion with few and with many steps, and plot jerk, and the "
        f"distance to the result of most steps, over milliseconds a frame. Of {MAX_S:g} s of the "
        "speech.",
    )
    parser.add_argument("speech", type=Path, metavar="SPEECH", help="any sound file")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of results")
    parser.add_argument(
        "--systems", type=_names, required=True, metavar="A,B,...", help="at most six"
    )
    parser.add_argument(
        "--steps", type=_counts, default=COUNTS, metavar="N,N,...",
        help=f"numbers of steps (default: {','.join(map(str, COUNTS))})",
    )  # fmt: skip
    parser.add_argument("--speaker", metavar="NAME", help="default: the first that is known")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="default: %(default)s")
    parser.add_argument(
        "--weights", type=Path, default=BUNDLED_WEIGHTS, metavar="DIR", help="default: bundled"
    )
    add_family_files(parser)
    parser.set_defaults(command=_steps_command)


def _steps_command(options: argparse.Namespace) -> None:
    from app.commands.terminal import ProgressBar
    from app.run.step_curve import StepCurveRequest, measure_step_curve

    use_family_files(options)
    request = StepCurveRequest(
        speech=options.speech,
        out=options.out,
        systems=options.systems,
        counts=options.steps,
        speaker=options.speaker,
        seed=options.seed,
        weights=options.weights,
    )
    with ProgressBar("measure") as bar:
        curve = measure_step_curve(request, bar.show)
    for point in curve.points:
        say(
            f"{point.system}, {point.steps} steps: {point.ms_per_frame:.2f} ms a frame, jerk "
            f"{point.tip_jerk_m_s3:.0f} m/s3, {point.distance_cm:.1f} cm from most steps"
        )
    _finish(curve.files, ())


def _add_point(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--transcript", type=Path, metavar="FILE",
        help="what is said: a TextGrid, or a plain English text (.txt), which is looked for in the "
        "speech; the words go to the numbers",
    )  # fmt: skip
    parser.add_argument(
        "--words", choices=WORDS_ASKED, default="none",
        help="recognise English words where there is no transcript; a fifth of the speech's length "
        "on one core (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--joint", default=TIP, metavar="NAME",
        help="fingertip or joint to follow, such as left_index or right_wrist "
        "(default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--start", type=int, default=0, metavar="FRAME",
        help="first frame of Figure 6 (default: %(default)s)",
    )  # fmt: skip


def _add_render(commands) -> None:
    parser = commands.add_parser(
        "render",
        help="a motion file to a video, pictures, or a file for 3D software",
        description="Draw a BEAT2-format motion file. The ending of --out chooses what is made: "
        f"{', '.join(ENDINGS)}. A .png is a contact sheet of {SHEET_POSES} poses, or what --stills "
        "and --sheet ask for; beside a .mp4 they are written under its name. A .blender.npz is "
        "for the SMPL-X add-on of Blender.",
    )
    parser.add_argument("motion", type=Path, metavar="MOTION.npz")
    parser.add_argument("--out", type=Path, required=True, metavar=f"FILE{'|'.join(ENDINGS)}")
    parser.add_argument("--speech", type=Path, metavar="WAV", help="sound of the video")
    parser.add_argument(
        "--plan", type=Path, metavar="FILE",
        help="whose events .glb, .bvh (in a .markers.csv beside it) and .blender.npz carry as "
        "markers (default: the .plan.json beside the motion, if there is one)",
    )  # fmt: skip
    parser.add_argument(
        "--views", type=_views, default=("front",), metavar="V,...",
        help=f"of {', '.join(VIEWS)}; the files of all but the first have the view in their name "
        "(default: front)",
    )  # fmt: skip
    _add_framing(parser, "whole")
    _add_close_up(parser, "off")
    _add_display(parser)
    parser.add_argument(
        "--joint", default=TIP, metavar="NAME",
        help="fingertip or joint that a trail follows (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--size", type=_size, default=720, metavar="PX", help="height (default: 720)"
    )
    parser.add_argument("--draft", action="store_true", help="faster, with jagged edges")
    parser.add_argument("--stills", type=int, metavar="N", help="N single pictures as .png")
    parser.add_argument(
        "--sheet", type=int, metavar="N",
        help="one picture with every N-th frame above its time, as .png",
    )  # fmt: skip
    parser.add_argument(
        "--background", choices=BACKGROUNDS, default="studio",
        help="transparent: the body alone, in a .png (default: studio)",
    )  # fmt: skip
    _add_body(parser)
    _add_look(parser)
    parser.set_defaults(command=_render)


def _render(options: argparse.Namespace) -> None:
    from app.commands.terminal import ProgressBar

    request = RenderRequest(
        motion=options.motion,
        out=options.out,
        plan=options.plan,
        speech=options.speech,
        body=options.body,
        look=options.look,
        views=options.views,
        framing=options.framing,
        close_ups=options.close_up,
        display=_display(options),
        joint=options.joint,
        size=options.size,
        is_draft=options.draft,
        num_stills=options.stills,
        sheet_every=options.sheet,
        background=options.background,
    )
    with ProgressBar(f"draw {options.out.name}") as bar:
        files, notes = render_motion(request, bar.show)
    _finish(files, notes)


def _add_doctor(commands) -> None:
    parser = commands.add_parser(
        "doctor",
        help="what works on this machine, what is missing, what to do",
        description="Try OpenGL, body, weights, ffmpeg, memory and disk. Exit status 1 when "
        "something needed does not work.",
    )
    _add_body(parser)
    parser.add_argument(
        "--weights", type=Path, default=BUNDLED_WEIGHTS, metavar="DIR", help="default: bundled"
    )
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


def _add_body(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--body", type=Path, default=default_body(), metavar="FILE",
        help="licensed SMPLX_NEUTRAL*.npz (default: $SMPLX_MODEL, else the open body)",
    )  # fmt: skip


def _add_framing(parser: argparse.ArgumentParser, usual: Framing) -> None:
    parser.add_argument(
        "--framing", choices=FRAMINGS, default=usual,
        help="the whole body, or from the knees up and larger (default: %(default)s)",
    )  # fmt: skip


def _add_close_up(parser: argparse.ArgumentParser, usual: str) -> None:
    parser.add_argument(
        "--close-up", type=_close_ups, default=usual, metavar="V,...|off",
        help=f"of {', '.join(CLOSE_UPS)}: beside the body in the first view's video "
        "(default: %(default)s)",
    )  # fmt: skip


def _add_display(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--exaggerate", type=int, choices=EXAGGERATIONS, default=1, metavar="N",
        help="draw tremble, all above 5 Hz, N times as large, and say so in the picture: "
        f"{', '.join(str(factor) for factor in EXAGGERATIONS)} (default: 1)",
    )  # fmt: skip
    parser.add_argument(
        "--trail", action="store_true",
        help="the way of the followed point through the last second, coloured by its speed",
    )  # fmt: skip
    parser.add_argument(
        "--color", choices=COLORINGS, default=COLORINGS[0],
        help="jerk: each region of the body by how much it jerks (default: %(default)s)",
    )  # fmt: skip


def _display(options: argparse.Namespace) -> Display:
    return Display(options.exaggerate, options.trail, options.color)


def _add_look(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--look", choices=LOOKS, default=LOOKS[0], metavar="BUILD-TONE",
        help="of the open body: average, slender or broad, in light, medium, dark or clay "
        f"(default: {LOOKS[0]})",
    )  # fmt: skip


def _names(value: str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in value.split(",") if name.strip())
    if not names:
        raise argparse.ArgumentTypeError("name at least one")
    return () if names == ("all",) else names


def _counts(value: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in value.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{value!r} are no whole numbers") from None


def _steps(value: str) -> int | dict[str, int] | None:
    try:
        return parse_steps(value)
    except RunError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _views(value: str) -> tuple[View, ...]:
    known: dict[str, View] = {view: view for view in VIEWS}
    unknown = [name for name in _names(value) if name not in known]
    if unknown:
        raise argparse.ArgumentTypeError(f"no view {unknown[0]!r}; views are {', '.join(VIEWS)}")
    return tuple(known[name] for name in dict.fromkeys(_names(value)))


def _close_ups(value: str) -> tuple[CloseUp, ...]:
    known: dict[str, CloseUp] = {close_up: close_up for close_up in CLOSE_UPS}
    names = () if value == "off" else _names(value)
    unknown = [name for name in names if name not in known]
    if unknown:
        raise argparse.ArgumentTypeError(
            f"no close-up {unknown[0]!r}; there are {', '.join(CLOSE_UPS)}, or off"
        )
    return tuple(known[name] for name in dict.fromkeys(names))


def _size(value: str) -> int:
    size = int(value)
    try:
        check_size(size)
    except RunError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return size


def _finish(files: Sequence[Path], notes: Sequence[str]) -> None:
    """Notes for a person on standard error, files for a script on standard output."""
    for note in notes:
        say(note)
    for path in files:
        name_file(path)


def _interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt
