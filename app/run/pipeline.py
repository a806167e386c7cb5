"""Speech in; motion, numbers, videos and figures out. The page, the command line and the
benchmark all call `generate_all`; it knows nothing of Gradio."""

from __future__ import annotations

import ctypes
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from app import text
from app.errors import CancelledRun
from app.run.body_motion import body_motion
from app.run.diagnostics import (
    check_start,
    draw_figure6,
    draw_jitter,
    measure_motions,
    onsets_of,
    write_diagnostics,
)
from app.run.followed_point import TipSource, choose_tip_source
from app.run.inputs import Inputs, read_inputs
from app.run.models import nothing_draws
from app.run.output.provenance import make_provenance
from app.run.output.result_folder import ResultFolder
from app.run.output.run_folder import RunRecord, begun, cut
from app.run.output.telling import Reporter
from app.run.requests.request import (
    GenerateRequest,
    GenerateResult,
    OnEvent,
    ShouldCancel,
    check_request,
)
from app.run.requests.settings import settings_of_run, title_of
from app.run.run_writer import RunWriter, picture_layout
from app.run.timeline import heard_accents, make_timeline
from app.run.videos.comparison import (
    Row,
    Snapshots,
    draw_all,
    draw_poses,
    joined_side_by_side,
    rows_that_fit,
)
from app.run.videos.own_videos import in_register
from app.run.words import SpokenWords, given_words
from conventions.names import REFERENCE_NAME, SampleName, file_stem, printable

if TYPE_CHECKING:
    import numpy as np

    from conventions.names import Version
    from model.diagnostics import Diagnostics
    from model.generation.base import System
    from model.generation.windows import GenerateOptions, MotionPiece
    from model.measures.seams import Windows
    from model.motion.motion import Motion
    from model.plan.plan import GesturePlan
    from model.plan.style import StyleWish
    from model.speech.audio import Speech
    from model.speech.transcript import Transcript

_M_MMAP_THRESHOLD = -3  # malloc.h
_LARGE_BYTES = 1 << 20
_POSES = 0.6
"""Share of the time of all figures that the poses take where no video is drawn."""
LIVE_NOTE = (
    "This motion was made while the speech was spoken, in windows that start 0.3 s or more "
    "after each other: measures of window joins, which look every 52 frames, do not see its own."
)


def generate_all(
    request: GenerateRequest,
    on_event: OnEvent = lambda event: None,
    should_cancel: ShouldCancel = lambda: False,
) -> GenerateResult:
    """Do one run and leave its files in ``request.out``, all of them or none.

    Args:
        on_event: told of progress and of every file as soon as it is whole.
        should_cancel: asked many times a second.

    Raises:
        CancelledRun: when ``should_cancel`` said so.
        RunError, SpeechError, MotionError, BodyError, UnknownNameError, CheckpointError, GLError,
        VideoError, WriteError: each with one sentence for the person who asked.
    """
    check_request(request)
    _return_large_blocks()
    started = time.monotonic()
    with (
        ResultFolder(request.out, is_kept=request.is_kept) as folder,
        RunWriter(folder, record_of(request), on_event, should_cancel) as run,
    ):
        try:
            request = _as_far_as_anything_draws(request, run)
            with SpokenWords(request.transcript, request.words) as words:
                return _run(request, folder, run, words, started)
        except Exception as error:
            if _is_cancellation(error):
                raise CancelledRun from error
            raise


def record_of(request: GenerateRequest) -> RunRecord:
    """What is known of a run before anything is read."""
    layout = picture_layout(request.views[0], request.size, request.close_ups, request.framing)
    told = title_of(request, request.systems), settings_of_run(request), request.joint, layout
    return begun(request, "generated", *told)


def generate_run(request: GenerateRequest, on_event: OnEvent, should_cancel: ShouldCancel) -> None:
    """As `generate_all`, for whom all that comes of it is in the folder."""
    generate_all(request, on_event, should_cancel)


def _as_far_as_anything_draws(request: GenerateRequest, reporter: Reporter) -> GenerateRequest:
    """Motion, numbers and trajectories need no OpenGL."""
    if not (request.has_video or (request.has_poses and request.has_figures)):
        return request
    missing = nothing_draws()
    reporter.note(*filter(None, [missing]))
    return replace(request, has_video=False, has_poses=False) if missing else request


def _run(
    request: GenerateRequest,
    folder: ResultFolder,
    reporter: RunWriter,
    words: SpokenWords,
    started: float,
) -> GenerateResult:
    reporter.progress("speech", 0.0)
    inputs, speech = read_inputs(request, reporter.sound, reporter)
    reporter.progress("speech", 1.0)
    _tell_inputs(request, inputs, reporter)
    tip = choose_tip_source(inputs.body, request.body, request.joint)
    compared = (inputs, inputs.reference) if inputs.reference is not None else (inputs,)
    check_start(request.start_frame, min(each.num_frames for each in compared), request.figure)

    follow = any(system.condition_type is not None for system in inputs.systems)
    if follow and (request.plan is None or request.style):  # from words: these come first
        words.begin(speech.waveform)
        words.found(reporter.stop_if_asked)
    rows = _generate(request, inputs, speech, words, folder, reporter)
    onsets_s = onsets_of(speech)
    words.begin(speech.waveform)  # beside the numbers and pictures, never before the motions
    timeline = _timeline(request, rows, speech, tip)
    del speech
    given = given_words(request.transcript)
    reporter.timeline(timeline, given)
    for row in rows:
        notes = inputs.body.notes(body_motion(row.shown))
        reporter.note(*(f"{row.name}: {note}" for note in notes))
    diagnostics = _measure(rows, inputs, onsets_s, tip, reporter)
    reporter.find_plans({row.name: row.shown for row in rows})
    snapshots, beside = Snapshots(), nullcontext()
    if request.has_video:
        snapshots = draw_all(request, inputs, rows, tip, folder, reporter)
        names = [row.name for row in rows_that_fit(rows, reporter)]
        beside = joined_side_by_side(names, inputs.wav, folder, reporter)
    elif request.has_poses and request.has_figures and "b" in request.figure.panels:
        snapshots = _draw_poses(request, rows, reporter)
    with beside:
        if request.has_figures:
            _draw_figures(request, rows, snapshots, tip, diagnostics, folder, reporter)
    said, notes = words.found(reporter.stop_if_asked)
    reporter.note(*notes)
    if said.origin != given.origin:
        reporter.timeline(timeline, said)
    reporter.files("diagnostics", write_diagnostics(diagnostics, folder, said))
    _write_provenance(request, inputs, said, folder, reporter)
    names = tuple(row.name for row in rows)
    line = text.DONE.format(
        seconds=time.monotonic() - started,
        rows=f"{len(names)} {'motion' if len(names) == 1 else 'motions'}",
        frames=inputs.num_frames,
    )
    if request.take is not None and request.take.why_less:
        line = f"{line} {request.take.why_less}"
    return GenerateResult(
        out=request.out,
        files=reporter.finish(line),
        names=names,
        num_frames=inputs.num_frames,
        diagnostics=diagnostics,
        notes=tuple(reporter.notes),
        said=said,
    )


def row_names(request: GenerateRequest, systems: Sequence[str]) -> list[str]:
    """The rows of a run, in the order in which they stand."""
    samples = range(1, request.samples + 1)
    names = [str(SampleName(system, sample)) for system in systems for sample in samples]
    return [*names, REFERENCE_NAME] if request.reference is not None else names


def _tell_inputs(request: GenerateRequest, inputs: Inputs, reporter: RunWriter) -> None:
    """What the run will hold, and the recorded motion, which is there."""
    from model.motion.filtering import smooth_motion

    systems = [system.name for system in inputs.systems]
    record = reporter.record
    record.title = cut(title_of(request, systems))
    record.speech_sha256 = inputs.speech_sha256
    reporter.rows(row_names(request, systems))
    if inputs.reference is not None:
        is_smoothed = request.post_filter == "savgol"
        recorded = smooth_motion(inputs.reference) if is_smoothed else inputs.reference
        reporter.motion(REFERENCE_NAME, recorded)


def _timeline(
    request: GenerateRequest, rows: Sequence[Row], speech: Speech, tip: TipSource
) -> dict[str, Any]:
    """What is seen under the bodies; of the recorded motion also as it is."""
    shown: Version = "savgol" if request.post_filter == "savgol" else "raw"
    systems = {row.name: row.shown for row in rows if row.name != REFERENCE_NAME}
    timeline = make_timeline(speech, systems, shown, tip)
    timeline["heard_accents"] = heard_accents(speech, request.weights)
    recorded = {row.name: row.raw for row in rows if row.name == REFERENCE_NAME}
    timeline["curves"] |= make_timeline(None, recorded, "raw", tip)["curves"]
    return timeline


def _generate(
    request: GenerateRequest,
    inputs: Inputs,
    speech: Speech,
    words: SpokenWords,
    folder: ResultFolder,
    reporter: RunWriter,
) -> list[Row]:
    """Motion of all systems from the same noise; the reference is the last row."""
    from model.motion.filtering import smooth_motion
    from model.motion.motion import load_motion
    from model.plan.plan import read_plan

    is_smoothed = request.post_filter == "savgol"

    def told(name: str, sample: int, raw: Motion) -> Row:
        shown = smooth_motion(raw) if is_smoothed else raw
        row = Row(str(SampleName(name, sample)), raw, shown, sample == 1)
        reporter.motion(row.name, shown, f"{file_stem(row.name)}.npz")
        return row

    if request.take is not None:
        name = inputs.systems[0].name
        if request.take.plan is not None:  # before the motion, for which one would be found
            reporter.performed(name, read_plan(request.take.plan))
        rows = [told(name, 1, load_motion(request.take.motion))]
        reporter.note(LIVE_NOTE)
        reporter.progress("motion", 1.0)
    else:
        rows = _made_in_turns(inputs, speech, words, reporter, told, not is_smoothed)
    if inputs.reference is not None:
        raw = inputs.reference
        rows.append(Row(REFERENCE_NAME, raw, smooth_motion(raw) if is_smoothed else raw))
    return rows


def _made_in_turns(
    inputs: Inputs,
    speech: Speech,
    words: SpokenWords,
    reporter: RunWriter,
    told: Callable[[str, int, Motion], Row],
    is_seen: bool,
) -> list[Row]:
    """A window of each system, then the next of each: all bodies of a comparison begin to move
    early, and go on together.

    Args:
        told: makes a row of a whole motion.
        is_seen: whether windows are told of as they are made.
    """
    from model.generation.one_thread import one_thread
    from model.motion.motion import put_together

    making = {
        system.name: _pieces_of(system, inputs, speech, words, reporter)
        for system in inputs.systems
    }
    parts: dict[tuple[str, int], list[Motion]] = {}
    shares = dict.fromkeys(making, 0.0)
    rows: dict[tuple[str, int], Row] = {}
    with one_thread():
        while making:
            for name in list(making):
                piece = next(making[name])
                for sample, motion in enumerate(piece.motions, start=piece.first_sample + 1):
                    key = name, sample
                    parts.setdefault(key, []).append(motion)
                    if is_seen:
                        reporter.grow(str(SampleName(*key)), motion, inputs.num_frames)
                shares[name] = piece.share
                reporter.progress("motion", sum(shares.values()) / len(shares), name)
                if piece.share == 1.0:
                    del making[name]
                    for key in [key for key in parts if key[0] == name]:
                        rows[key] = told(*key, put_together(parts.pop(key)))
    names = list(shares)
    return [rows[key] for key in sorted(rows, key=lambda key: (names.index(key[0]), key[1]))]


def _pieces_of(
    system: System,
    inputs: Inputs,
    speech: Speech,
    words: SpokenWords,
    reporter: RunWriter,
) -> Iterator[MotionPiece]:
    from model.generation.windows import motion_pieces
    from model.plan.plan import GesturePlan

    options = inputs.options[system.name]
    if system.condition_type is GesturePlan:
        said, _ = words.found(reporter.stop_if_asked)
        options = _with_plans(system, speech, options, said, inputs.wish, reporter)
    yield from motion_pieces(system, speech, options, reporter.should_cancel)


def _with_plans(
    system: System,
    speech: Speech,
    options: GenerateOptions,
    said: Transcript,
    wish: StyleWish | None,
    reporter: RunWriter,
) -> GenerateOptions:
    """The options with the plans that the system performs, each left beside its motion."""
    from model.generation.windows import draw_conditions

    plans = options.conditions
    if not plans:
        plans = draw_conditions(system, speech, replace(options, words=said.words))
    written: list[GesturePlan] = []
    for sample, plan in enumerate(plans, start=1):
        name = str(SampleName(system.name, sample))
        if wish is not None:
            styled = wish.done(plan, said.words)
            reporter.note(*(f"{name}: {note}" for note in styled.notes))
            plan = styled.plan
        written.append(reporter.performed(name, plan))
    return replace(options, conditions=tuple(written))


def _measure(
    rows: Sequence[Row],
    inputs: Inputs,
    onsets_s: np.ndarray,
    tip: TipSource,
    reporter: RunWriter,
) -> Diagnostics:
    def on_share(part: float) -> None:
        reporter.stop_if_asked()
        reporter.progress("numbers", part)

    on_share(0.0)
    motions = {row.name: row.raw for row in rows}
    diagnostics = measure_motions(motions, tip, onsets_s, on_share, _windows(rows, inputs))
    reporter.note(*diagnostics.notes)
    reporter.progress("numbers", 1.0)
    reporter.measured(diagnostics)
    return diagnostics


def _windows(rows: Sequence[Row], inputs: Inputs) -> dict[str, Windows]:
    """How each row was cut. The recorded one was not; it is folded beside systems that agree."""
    from model.measures.seams import Windows

    found = {}
    for system in inputs.systems:
        own = Windows(system.windowing.advance, system.windowing.overlap)
        named = {str(SampleName(system.name, sample)) for sample in range(1, len(rows) + 1)}
        found |= {row.name: own for row in rows if row.name in named}
    if len(set(found.values())) == 1:
        found[REFERENCE_NAME] = next(iter(found.values()))
    return found


def _draw_poses(request: GenerateRequest, rows: Sequence[Row], reporter: Reporter) -> Snapshots:
    """For Figure 6, without any video."""
    from renderer.figures.figure6.spec import choose_snapshot_frames

    def on_share(part: float) -> None:
        reporter.stop_if_asked()
        reporter.progress("figure", _POSES * part)

    placed = {row.name: in_register(row.shown) for row in rows_that_fit(rows, reporter)}
    shortest = min(motion.num_frames for motion in placed.values())
    frames = request.figure.frames or choose_snapshot_frames(shortest, request.start_frame)
    return draw_poses(placed, request.body, frames, on_share)


def _draw_figures(
    request: GenerateRequest,
    rows: Sequence[Row],
    snapshots: Snapshots,
    tip: TipSource,
    diagnostics: Diagnostics,
    folder: ResultFolder,
    reporter: RunWriter,
) -> None:
    """Figure 6, of trajectories only where no pose was drawn, and the jitter sheet."""
    begun = _POSES if snapshots.pictures and not request.has_video else 0.0
    reporter.progress("figure", begun)
    reporter.stop_if_asked()
    shown = {row.name: row.shown for row in rows_that_fit(rows, reporter)}
    clip = printable(request.speech.stem)
    figure6 = draw_figure6(
        shown,
        snapshots,
        tip,
        folder,
        request.start_frame,
        request.figure,
        is_generated=True,
        post_filter=request.post_filter,
        clip=clip,
        on_piece=reporter.stop_if_asked,
    )
    reporter.files("figure", figure6)
    reporter.progress("figure", (begun + 1) / 2)
    reporter.stop_if_asked()
    systems = [name for name in shown if name != REFERENCE_NAME]
    reporter.files("figure", draw_jitter(diagnostics, tip, folder, systems, clip))
    reporter.progress("figure", 1.0)


def _write_provenance(
    request: GenerateRequest,
    inputs: Inputs,
    said: Transcript,
    folder: ResultFolder,
    reporter: Reporter,
) -> None:
    record = make_provenance(
        inputs.systems,
        speech={
            "file": request.speech.name,
            "sha256": inputs.speech_sha256,
            "duration_s": round(inputs.speech_s, 6),
            "frames": inputs.num_frames,
            "words": {"origin": said.origin, "count": len(said.words)} if said.words else None,
        },
        options={
            "speaker": inputs.speaker,
            "seed": request.seed,
            "samples": request.samples,
            "steps": {name: asked.steps for name, asked in inputs.options.items()},
            "face_steps": {
                name: asked.face_steps
                for name, asked in inputs.options.items()
                if asked.face_steps is not None
            },
            "sampler": {name: asked.sampler for name, asked in inputs.options.items()},
            "guidance": {name: asked.guidance for name, asked in inputs.options.items()},
            "post_filter": request.post_filter,
            "transcript": request.transcript.name if request.transcript else None,
            "words": request.words,
            "plan": request.plan.name if request.plan else None,
            "style": request.style.name if request.style else None,
            "joint": request.joint,
            "start_frame": request.start_frame,
            "reference": request.reference.name if request.reference else None,
            "live": dict(request.take.facts) if request.take else None,
        },
        drawing={
            "body": inputs.body.name,
            "body_sha256": inputs.body.sha256,
            "look": inputs.body.look,
            "backend": inputs.backend,
            "views": list(request.views),
            "framing": request.framing,
            "close_ups": list(request.close_ups),
            "display": asdict(request.display),
            "size": request.size,
        },
        notes=reporter.notes,
    )
    path = folder.path("provenance.json")
    path.write_text(json.dumps(record, indent=1) + "\n")
    reporter.file("provenance", "provenance", path)


def _is_cancellation(error: Exception) -> bool:
    from model.generation.windows import Cancelled as GenerationCancelled
    from renderer.video.encoder import Cancelled as RenderCancelled

    return isinstance(error, GenerationCancelled | RenderCancelled)


def _return_large_blocks() -> None:
    """Make glibc map each block of a megabyte and more by itself, and return it when it is freed.

    By default it raises that limit to 32 MB as a program goes on, and what a long clip needs for a
    moment then stays in the heap: the peak of a ten-minute clip grows by a tenth. Elsewhere than on
    glibc this does nothing.
    """
    if not sys.platform.startswith("linux"):
        return
    try:
        ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)
    except (OSError, AttributeError):  # another C library
        return
