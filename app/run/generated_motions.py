"""Rows of a run that systems generate from speech, and gesture plans without motion."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from app.errors import RunError
from app.run.bodies import align_average_to_origin, make_point_tracker
from app.run.diagnostics import cached_speech_onsets, check_figure6
from app.run.models import get_body, get_system
from app.run.output.provenance import make_provenance, run_title
from app.run.output.result_folder import require_free_space
from app.run.output.run_folder import truncate
from app.run.requests.parts import MAX_COMPARED, SamplingOptions, steps_for
from app.run.requests.requests import GenerateRequest, PlanRequest
from app.run.run_writer import RunMotions, RunWriter
from app.run.timeline import TranscriptLoader, make_timeline
from app.run.videos.videos import choose_compared_motions
from conventions.names import (
    REFERENCE_NAME,
    SampleName,
    printable,
    safe_file_stem,
    version_after_post_filter,
)
from conventions.rates import SAMPLE_RATE
from model.formats.read import ENDINGS, read_any_motion
from model.formats.reading import ImportOverrides
from model.generation import windows
from model.generation.base import System, Windowing
from model.generation.windows import GenerateOptions, MotionPiece
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, concatenate, first_frames, load_motion
from model.motion.transforms import apply_post_filter
from model.plan.detection import plan_from_motion
from model.plan.files import check_plan_suffix, read_plan_file, write_plan_file
from model.plan.plan import GesturePlan, PlanResult
from model.plan.style import StyleChange, read_style_file
from model.sampling.samplers import Sampling, noise_seed_of_clip
from model.speech.audio import Speech, SpeechReadOptions, load_speech
from model.speech.transcript import SPARE_S
from model.systems.registry import default_planning_system, list_systems
from renderer.draw.probe import choose_backend

LIVE_NOTE = (
    "This motion was generated live, in windows that start at least 0.3 s apart. The seam metrics "
    "assume windows every 52 frames and do not apply to it."
)


def generate_motions(
    request: GenerateRequest, transcript_loader: TranscriptLoader, run: RunWriter
) -> RunMotions:
    """Generate the motions of the systems window by window, and return the rows of the run.

    Raises RunError, SpeechError, MotionError, BodyError, UnknownNameError, CheckpointError,
    GLError, PlanError, WriteError, each with one sentence.
    """
    options = SpeechReadOptions(max_s=request.speech.max_speech_s, channel=request.speech.channel)
    speech = load_speech(request.speech.path, options)
    run.add_notes(*speech.notes)
    body = get_body(request.video.body, request.video.look)
    systems = _load_systems(request)
    speaker = request.sampling.speaker or _first_speaker(systems)
    for system in systems:
        system.speaker_index(speaker)  # raises for an unknown name
    recorded = _read_reference(request, speech, run)
    backend = choose_backend() if request.output.has_video else None
    require_free_space(
        request.output.out, _needed_bytes(request, speech.num_motion_frames, len(systems))
    )
    sound = run.write_audio(speech.waveform)
    seed = request.sampling.seed
    if request.live_recording is None:
        seed = noise_seed_of_clip(seed, speech.sha256)
    sampling = replace(request.sampling, speaker=speaker, seed=seed)
    options = _options(request, sampling, systems, speech, run)
    run.record.noise_seed = seed
    wish = None if request.planning.style is None else read_style_file(request.planning.style)
    run.report_progress("speech", 1.0)
    run.record.title = truncate(run_title(request, list(options)))
    run.record.speech_sha256 = speech.sha256
    run.declare_rows(names := row_names(request, list(options)))
    post_filter = request.sampling.post_filter
    shown = {name: apply_post_filter(raw, post_filter) for name, raw in recorded.items()}
    for name, motion in shown.items():
        run.write_motion(name, motion)
    tracker = make_point_tracker(request.video.body, request.tracked_point)
    shortest = min([speech.num_motion_frames, *(each.num_frames for each in recorded.values())])
    is_drawn = request.output.has_figures
    check_figure6(request.figures, shortest, min(MAX_COMPARED, len(names)), is_drawn)
    if any(map(_performs, systems)) and (request.planning.plan is None or request.planning.style):
        transcript_loader.begin(
            speech.waveform
        )  # plans are sampled from words, which are needed first
        transcript_loader.wait(run.raise_if_cancelled)

    def filter_and_write(name: str, raw: Motion) -> tuple[Motion, Motion]:
        shown = apply_post_filter(raw, post_filter)
        run.write_motion(name, shown, f"{safe_file_stem(name)}.npz")
        return raw, shown

    recording = request.live_recording
    if recording is None:
        making = {
            system.name: _pieces_of(
                system, speech, options[system.name], transcript_loader, wish, run
            )
            for system in systems
        }
        made = _generate_in_turns(
            making, speech.num_motion_frames, run, filter_and_write, post_filter == "none"
        )
    else:
        name = systems[0].name
        if recording.plan is not None:  # before the motion, or a plan would be detected in it
            run.write_plan(name, read_plan_file(recording.plan).plan)
        run.add_notes(LIVE_NOTE)
        run.report_progress("motion", 1.0)
        made = {name: filter_and_write(name, load_motion(recording.motion))}
    transcript_loader.begin(
        speech.waveform
    )  # in parallel with metrics and pictures, after the motions
    staged = {name: motion for name, (_, motion) in made.items()} | shown
    version = version_after_post_filter(post_filter)
    is_pictured = request.output.has_video or request.output.has_figures
    fitting, notes = choose_compared_motions(list(staged) if is_pictured else [])
    run.add_notes(*notes)
    return RunMotions(
        motions={name: raw for name, (raw, _) in made.items()} | recorded,
        viewer_motions=staged,
        figure_motions={name: staged[name] for name in fitting},
        timeline=make_timeline(
            speech, staged | recorded, version, tracker, request.sampling.weights
        ),
        body=body,
        tracker=tracker,
        audio_path=sound,
        onsets_s=cached_speech_onsets(speech),
        windows=_windows(request, systems),
        provenance=make_provenance(request, speech, systems, options, body, backend),
        align=align_average_to_origin,
        speech_name=printable(request.speech.path.stem),
    )


def row_names(request: GenerateRequest, systems: Sequence[str]) -> list[str]:
    """Return the names of a run's rows in order."""
    samples = range(1, request.sampling.samples + 1)
    names = [str(SampleName(system, sample)) for system in systems for sample in samples]
    return [*names, REFERENCE_NAME] if request.imports.reference is not None else names


def _generate_in_turns(
    making: dict[str, Iterator[MotionPiece]],
    num_frames: int,
    run: RunWriter,
    filter_and_write: Callable[[str, Motion], tuple[Motion, Motion]],
    is_published: bool,
) -> dict[str, tuple[Motion, Motion]]:
    """Generate one window of each system in turn, so that all bodies start early and keep pace.

    ``filter_and_write`` writes a whole motion, and returns it raw and filtered.
    """
    parts: dict[str, dict[str, list[Motion]]] = {name: {} for name in making}
    shares = dict.fromkeys(making, 0.0)
    generated: dict[str, tuple[Motion, Motion]] = {}

    def generate_piece(name: str) -> None:
        piece = next(making[name])
        for sample, motion in enumerate(piece.motions, start=piece.first_index + 1):
            row = str(SampleName(name, sample))
            parts[name].setdefault(row, []).append(motion)
            if is_published:
                run.append_motion(row, motion, num_frames)
        shares[name] = piece.progress
        run.report_progress("motion", sum(shares.values()) / len(shares), name)
        if piece.progress == 1.0:
            del making[name]
            for row, of in parts.pop(name).items():
                generated[row] = filter_and_write(row, concatenate(of))

    with windows.single_threaded():
        while making:
            for name in list(making):
                generate_piece(name)
    return {row.name: generated[row.name] for row in run.record.rows if row.name in generated}


def _performs(system: System) -> bool:
    """Check whether a system uses gesture plans."""
    return system.condition_type is GesturePlan


def _pieces_of(
    system: System,
    speech: Speech,
    options: GenerateOptions,
    transcript_loader: TranscriptLoader,
    wish: StyleChange | None,
    run: RunWriter,
) -> Iterator[MotionPiece]:
    """Yield a system's motion pieces; its plans, with ``wish`` applied, are written first."""
    if _performs(system):
        transcript, _ = transcript_loader.wait(run.raise_if_cancelled)
        plans = options.conditions
        if not plans:
            plans = windows.draw_conditions(
                system, speech, replace(options, words=transcript.words)
            )
        written: list[GesturePlan] = []
        for sample, plan in enumerate(plans, start=1):
            name = str(SampleName(system.name, sample))
            if wish is not None:
                styled = wish.apply(plan, transcript.words)
                run.add_notes(*(f"{name}: {note}" for note in styled.notes))
                plan = styled.plan
            written.append(run.write_plan(name, plan))
        options = replace(options, conditions=tuple(written))
    yield from windows.motion_pieces(system, speech, options, run.should_cancel)


def _windows(request: GenerateRequest, systems: Sequence[System]) -> dict[str, Windowing]:
    """Return the generation windows by row, with those of the reference if all systems agree."""
    windowings = {
        str(SampleName(system.name, sample)): system.windowing
        for system in systems
        for sample in range(1, request.sampling.samples + 1)
    }
    if len(set(windowings.values())) == 1:
        windowings[REFERENCE_NAME] = next(iter(windowings.values()))
    return windowings


def _first_speaker(systems: tuple[System, ...]) -> str:
    """Return the first speaker that all systems have, otherwise the first of the first system."""
    first = systems[0].speakers
    shared = (name for name in first if all(name in each.speakers for each in systems))
    return next(shared, next(iter(first)))


def _load_systems(request: GenerateRequest) -> tuple[System, ...]:
    sampling = request.sampling
    names = sampling.systems or list_systems(sampling.weights)
    if not names:
        raise RunError(
            f"No trained systems were found in {sampling.weights}; "
            "give a folder of trained systems with --weights DIR."
        )
    by_name = sampling.steps if isinstance(sampling.steps, Mapping) else {}
    unused = [name for name in by_name if name not in names]
    if unused:
        raise RunError(
            f"Steps were given for {unused[0]}, which is not part of this run. Systems of this "
            f"run: {', '.join(names)}."
        )
    return tuple(get_system(name, sampling.weights) for name in dict.fromkeys(names))


def generation_options(sampling: SamplingOptions, system: System, **more: Any) -> GenerateOptions:
    """Return options of a system, its defaults where it lacks one; ``more`` overrides them."""
    steps = steps_for(sampling.steps, system.name)
    sampling_of_system = Sampling(sampler=sampling.sampler, steps=steps, guidance=sampling.guidance)
    drawn = vars(system.resolve_sampling(system.supported_sampling(sampling_of_system)))
    speaker = sampling.speaker or next(iter(system.speakers))
    usual = {"speaker": speaker, "seed": sampling.seed, "num_samples": sampling.samples, **drawn}
    return GenerateOptions(**{**usual, **more})


def load_first_seconds(path: Path, first_s: float, max_speech_s: float) -> Speech:
    """Load the first ``first_s`` of a speech, which is refused if longer than ``max_speech_s``."""
    whole = load_speech(path, SpeechReadOptions(max_s=max_speech_s))
    return replace(whole, waveform=whole.waveform[: int(first_s * SAMPLE_RATE)])


def _plan_for(path: Path, speech: Speech) -> PlanResult:
    """Read a gesture plan, and cut it at the end of the speech."""
    read = read_plan_file(path)
    if read.plan.duration_s <= speech.duration_s + SPARE_S:
        return read
    note = (
        f"The plan {printable(path.name)} lasts {read.plan.duration_s:.1f} s and the speech "
        f"{speech.duration_s:.1f} s: it may belong to another clip. Its part after the end "
        "of the speech is ignored."
    )
    return PlanResult(read.plan.until(speech.duration_s), (*read.notes, note))


def _options(
    request: GenerateRequest,
    sampling: SamplingOptions,
    systems: Sequence[System],
    speech: Speech,
    run: RunWriter,
) -> dict[str, GenerateOptions]:
    """Return the generation options by system, with notes on those that a system does not support.

    Raises RunError if no system has the sampler, or none supports guidance or a plan; PlanError if
    the plan cannot be used.
    """
    plan, style = request.planning.plan, request.planning.style
    read = None if plan is None else _plan_for(plan, speech)
    plans = () if read is None else (read.plan,)
    for what, file in (("plan", plan), ("style", style)):
        if file is not None and not any(map(_performs, systems)):
            raise RunError(f"None of these systems uses gesture plans; remove the {what}.")
    run.add_notes(*(() if read is None else read.notes))
    sampler, guidance = sampling.sampler, sampling.guidance
    samplers = dict.fromkeys(sampler.name for each in systems for sampler in each.samplers)
    if sampler not in (None, *samplers):
        raise RunError(f"There is no sampler {sampler!r}; choose one of {', '.join(samplers)}.")
    if guidance not in (None, 1) and all(each.guidance is None for each in systems):
        raise RunError("None of these systems supports guidance; remove the guidance scale.")
    options: dict[str, GenerateOptions] = {}
    for system in systems:
        performs = _performs(system)
        own = generation_options(sampling, system, conditions=plans if performs else ())
        if sampler not in (None, own.sampler):
            run.add_notes(f"{system.name} has no sampler {sampler}; it used {own.sampler}.")
        if guidance not in (None, own.guidance):
            run.add_notes(
                f"{system.name} does not support guidance; the guidance scale does not apply to it."
            )
        if (plans or style) and not performs:
            run.add_notes(
                f"{system.name} does not use gesture plans; plan and style do not apply to it."
            )
        options[system.name] = own
    return options


def _read_reference(request: GenerateRequest, speech: Speech, run: RunWriter) -> dict[str, Motion]:
    """Read the reference motion by its name, cut to the speech; empty if there is none."""
    path, overrides = request.imports.reference, request.imports.import_overrides
    if path is None:
        return {}
    overrides.check_files_exist([path])
    read = read_any_motion(path, overrides, request.video.body, REFERENCE_NAME)
    run.add_notes(*read.notes)
    motion = read.motion
    if motion.num_frames != speech.num_motion_frames:
        is_longer = motion.num_frames > speech.num_motion_frames
        run.add_notes(
            f"The reference has {motion.num_frames} frames and the speech "
            f"{speech.num_motion_frames}; "
            + (
                f"the reference was cut to {speech.num_motion_frames}."
                if is_longer
                else "after the reference ends, the comparison video repeats its last frame."
            )
        )
    return {REFERENCE_NAME: first_frames(motion, speech.num_motion_frames)}


def _needed_bytes(request: GenerateRequest, num_frames: int, num_systems: int) -> int:
    """Estimate the disk space of a run, half as much again as measured runs have taken."""
    count = num_systems * request.sampling.samples + 1
    motion_bytes = (4 * 268 + 504) * num_frames  # npz file, and frames for the browser
    # Pictures and close-ups (half a body's height) are in the comparison, too.
    video = request.video
    pixels = video.picture_height_px**2 * (len(video.views) + len(video.close_ups) / 2) * 2
    video_bytes = 0.012 * pixels * num_frames if request.output.has_video else 0.0
    return int(1.5 * count * (motion_bytes + video_bytes) + 10e6)


MAX_SPEECH_S = 3600.0


def has_motion_suffix(path: Path) -> bool:
    """Check whether a file has the suffix of a motion."""
    return path.suffix.lower() in ENDINGS


def write_plan_from_motion(
    motion: Path, out: Path, overrides: ImportOverrides | None = None
) -> list[str]:
    """Detect and write a motion's plan; return notes; raises MotionError, PlanError, WriteError."""
    check_plan_suffix(out)
    (overrides or ImportOverrides()).check_files_exist([motion])
    read = read_any_motion(motion, overrides)
    write_plan_file(plan_from_motion(read.motion, open_body_skeleton()), out)
    return list(read.notes)


def write_plan_from_speech(request: PlanRequest) -> PlanResult:
    """Sample a gesture plan from speech and write it; return it with notes on its style.

    An empty plan has the length of the speech and no events. Raises with one sentence RunError,
    SpeechError, TranscriptError, UnknownNameError, CheckpointError, PlanError or WriteError.
    """
    request.check()
    check_plan_suffix(request.out)
    if request.writes_empty_plan and request.style is not None:
        raise RunError("An empty plan cannot have a style; remove one of the two options.")
    sound = request.speech.path
    speech = load_speech(
        sound, SpeechReadOptions(max_s=MAX_SPEECH_S, channel=request.speech.channel)
    )
    if request.writes_empty_plan:
        plan = GesturePlan(speech.duration_s)
        write_plan_file(plan, request.out, sound)
        return PlanResult(plan, speech.notes)
    wish = None if request.style is None else read_style_file(request.style)
    system = get_system(default_planning_system(), request.weights)
    with TranscriptLoader(request.speech.transcript, request.speech.word_source) as words:
        words.begin(speech.waveform)
        transcript, notes = words.wait(lambda: None)
    sampling = replace(request.sampling, seed=noise_seed_of_clip(request.seed, speech.sha256))
    (plan,) = windows.draw_conditions(
        system, speech, generation_options(sampling, system, words=transcript.words)
    )
    edited = PlanResult(plan) if wish is None else wish.apply(plan, transcript.words)
    write_plan_file(edited.plan, request.out, sound)
    return PlanResult(edited.plan, (*speech.notes, *notes, *edited.notes))
