"""Anyone's motion files: the same numbers and the same figures as for our systems."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.config import BUNDLED_WEIGHTS
from app.errors import RunError
from app.findings.comparison import point_title
from app.flags import OUT_FOLDER, flag, flags_of, names_of
from app.run.body_motion import body_motion
from app.run.diagnostics import (
    check_start,
    draw_error_growth,
    draw_figure6,
    draw_jitter,
    measure_motions,
    onsets_of,
    write_diagnostics,
)
from app.run.followed_point import TIP, TipSource, choose_tip_source
from app.run.models import get_body, nothing_draws
from app.run.output.result_folder import ResultFolder
from app.run.output.run_folder import SPEECH as HEARD
from app.run.output.run_folder import RunRecord, begun, ending_of
from app.run.output.telling import share_teller
from app.run.requests.request import (
    ASSUME,
    BODY,
    CHANNEL,
    JOINT,
    MAX_COMPARED,
    REFERENCE,
    START,
    TRANSCRIPT,
    WORDS,
    FigureAsked,
    OnEvent,
    ShouldCancel,
    WordsAsked,
)
from app.run.requests.settings import MOTIONS as MOTIONS_ASKED
from app.run.requests.settings import NONE, SPEECH, words_asked
from app.run.run_writer import RunWriter, picture_layout
from app.run.videos.comparison import Snapshots, draw_poses
from app.run.videos.own_videos import SOLE_M, VideoOptions, draw_own_videos, picture_motions
from app.run.words import SpokenWords, given_words
from conventions.names import REFERENCE_NAME, printable
from model.formats.reading import MOTIONS, Assumption, Reading, Told, apart, lengths_apart
from model.speech.transcript import Transcript

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from model.diagnostics import Diagnostics
    from model.faults.evidence import Finding
    from model.measures.error_growth import ErrorGrowth
    from model.measures.seams import Windows
    from model.motion.motion import Motion
    from model.speech.audio import Speech

OnShare = Callable[[float], None]

_READ, _MEASURED, _GROWN, _GROWTH_DRAWN, _SHEET_DRAWN, _POSES_DRAWN = 0.1, 0.5, 0.55, 0.6, 0.7, 0.9
"""Shares of the whole that are done after each part of it."""
_BEFORE_VIDEOS = 0.3
"""Share of the whole where videos are drawn, too."""
PLAYED = VideoOptions(size=512)
"""How the page draws videos of motions; the player frames bodies alike."""
MEASURED = "Measured {motions}."
OPENED = "Opened from its file; its {motions} were measured anew."
_MAX_NAMED = 3
"""Files that a run's title names."""
_NO_SPEECH = (
    "Words are looked for in the speech, and none was given: add it (--speech), or give words with "
    "their times as a TextGrid."
)


@dataclass(frozen=True)
class OpenedRun:
    """What is known of motions that a run has left."""

    record: RunRecord
    said: Transcript
    plans: Mapping[str, Path]
    """That motions performed, by name."""


@dataclass(frozen=True)
class DiagnoseRequest:
    """Which files to measure, beside what, and what to look at."""

    motions: tuple[Path, ...] = field(
        metadata=flag(
            ".npz (BEAT2, AMASS, SMPL-X parameters), .npy (rotations, TalkSHOW) or .bvh; or "
            "folders or zips of them, paired by name, for numbers over many clips",
            "MOTION",
            Path,
            is_positional=True,
            takes_several=True,
        )
    )
    out: Path = field(metadata=OUT_FOLDER)
    names: tuple[str, ...] = ()
    """What to call the motions; by default their files' stems (`unique_names`)."""
    reference: Path | None = field(default=None, metadata=REFERENCE)
    speech: Path | None = field(
        default=None,
        metadata=flag(
            "their sound, for BeatAlign and its chance level; a folder of it for folders",
            "WAV",
            Path,
        ),
    )
    """The sound that all of them belong to, for BeatAlign."""
    channel: int | None = field(default=None, metadata=CHANNEL)
    """Of that sound, from 0; None mixes all."""
    mean_speeds: Path | None = field(
        default=None,
        metadata=flag(
            "EMAGE's mean_vel_smplxflame_30.npy (BEAT2's folder weights): BeatAlign with its "
            "published speeds of the joints, to be held against papers",
            "NPY",
            Path,
        ),
    )
    """EMAGE's published speeds of the joints (``mean_vel_smplxflame_30.npy``), for a BeatAlign that
    can be held against papers."""
    transcript: Path | None = field(default=None, metadata=TRANSCRIPT)
    """A TextGrid of that speech, or a plain text (.txt) of it, for numbers and time line."""
    words: WordsAsked = field(default="none", metadata=WORDS)
    """Whether the words of the speech are recognised where there is no transcript."""
    shown: tuple[str, ...] = field(
        default=(),
        metadata=flag(
            "which motions the figures show, by the names of their files (default: the first six)",
            "A,B,...",
            names_of,
            "--show",
        ),
    )
    """Names of the motions that the figures show, where there are more than `MAX_COMPARED`; by
    default the first. All are measured."""
    joint: str = field(default=TIP, metadata=JOINT)
    """The fingertip or joint that figure and tip measures follow."""
    start_frame: int = field(default=0, metadata=START)
    """First frame of Figure 6."""
    figure: FigureAsked = field(default_factory=FigureAsked, metadata=flags_of(FigureAsked))
    body: Path | None = field(default=None, metadata=BODY)
    has_pictures: bool = field(
        default=True, metadata=flag("a figure without poses", name="--no-pictures")
    )
    videos: VideoOptions | None = None
    """How the shown motions are drawn as videos; None draws none."""
    weights: Path = BUNDLED_WEIGHTS
    """Where the speech encoder is whose accents a viewer shows."""
    is_kept: bool = False
    """As of `GenerateRequest`."""
    title: str = ""
    """What the run is called; by default after its motions."""
    is_run: bool = False
    """Whether what stands in ``motions`` is a run's folder or its zip (`app.run.many.opened`)."""
    opened: OpenedRun | None = None
    """The run that these motions are from, where they are measured anew to be shown."""
    window: int | None = field(
        default=None,
        metadata=flag(
            "frames of the windows that the motions were made of, if you know it (default: every "
            "period from 2 to 240 frames is tried)",
            "N",
            int,
        ),
    )
    """Frames of the windows that all motions but the reference were made of, if that is known;
    otherwise each is searched for a period of its own."""
    overlap: int = field(
        default=0,
        metadata=flag("frames that two such windows share (default: %(default)s)", "M", int),
    )
    """Frames that two windows share."""
    max_frames: int | None = None
    """Of all files together, at 30 a second."""
    told: Told = field(default=Told(), metadata=ASSUME)
    """How files are to be read, where they do not say it."""


@dataclass(frozen=True)
class Diagnosis:
    """What was written, found and must be said."""

    files: tuple[Path, ...]
    notes: tuple[str, ...]
    diagnostics: Diagnostics


@dataclass(frozen=True)
class _Read:
    """The motions as they are shown, and the notes of reading them."""

    motions: dict[str, Motion]
    reference: Motion | None
    notes: list[str]
    readings: dict[str, Reading]

    @property
    def all(self) -> dict[str, Motion]:
        """The reference comes last."""
        reference = {} if self.reference is None else {REFERENCE_NAME: self.reference}
        return self.motions | reference


def diagnose_files(
    request: DiagnoseRequest,
    on_event: OnEvent = lambda event: None,
    should_cancel: ShouldCancel = lambda: False,
) -> Diagnosis:
    """Measure motion files and leave the results in ``request.out``, all of them or none.

    Writes diagnostics.json and .csv, error_growth, figure6, jitter, and videos where they are asked
    for. The page calls this for motions that a visitor brings, the command line for `diagnose`.

    Args:
        on_event: told of progress between all steps, and when the folder holds more.

    Raises:
        CancelledRun: when ``should_cancel`` said so; nothing is left.
        RunError, MotionError, SpeechError, TranscriptError, BodyError, GLError, FigureError,
        WriteError: each with one sentence.
    """
    with SpokenWords(request.transcript, request.words) as words:
        if words.need_speech and request.speech is None:
            raise RunError(_NO_SPEECH)
        on_progress = share_teller("numbers", on_event, should_cancel)
        with (
            ResultFolder(request.out, is_kept=request.is_kept) as folder,
            RunWriter(folder, record_of(request), on_event) as run,
        ):
            return _diagnose(request, folder, run, words, on_progress)


def record_of(request: DiagnoseRequest) -> RunRecord:
    """What is known of a run before anything is read."""
    options = request.videos or PLAYED
    opened = request.opened
    layout = picture_layout("front", options.size, options.close_ups, options.framing)
    told = "given", _title(request), settings_of_own(request), request.joint, layout
    run = begun(request, *told)
    if opened is None:
        return run.model_copy(update={"speech_sha256": sha256_of(request.speech)})
    known = {key: getattr(opened.record, key) for key in ("title", "settings", "speech_sha256")}
    return run.model_copy(update=known)


def settings_of_own(asked: DiagnoseRequest) -> dict[str, str]:
    """What was asked for, in words, as of `app.run.requests.settings.settings_of_run`."""
    return {
        SPEECH: asked.speech.stem if asked.speech else NONE,
        MOTIONS_ASKED: ", ".join(_names_of(asked)),
        "reference": asked.reference.name if asked.reference else NONE,
        "words": words_asked(asked.transcript, asked.words),
        "followed point": point_title(asked.joint).lower(),
        "windows": f"{asked.window} frames, {asked.overlap} shared" if asked.window else NONE,
    }


def _names_of(asked: DiagnoseRequest) -> Sequence[str]:
    return asked.names or unique_names(asked.motions)


def _title(asked: DiagnoseRequest) -> str:
    if asked.title:
        return asked.title
    names = _names_of(asked)
    more = len(names) - _MAX_NAMED
    others = f" and {more} more" if more > 0 else ""
    beside = f" beside {asked.reference.stem}" if asked.reference else ""
    return f"{', '.join(names[:_MAX_NAMED])}{others}{beside}"


def sha256_of(path: Path | None) -> str:
    """Of a file that somebody gave; empty of none, or of one that is not there."""
    if path is None or not path.is_file():
        return ""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _diagnose(
    request: DiagnoseRequest,
    folder: ResultFolder,
    run: RunWriter,
    words: SpokenWords,
    on_progress: OnShare,
) -> Diagnosis:
    missing = nothing_draws() if request.videos or request.has_pictures else ""
    if missing:  # numbers and trajectories need no OpenGL
        request = replace(request, videos=None, has_pictures=False)
        run.note(missing)
    measured = 1.0 if request.videos is None else _BEFORE_VIDEOS

    def on_measured(share: float) -> None:
        on_progress(measured * share)

    body = get_body(request.body)
    tip = choose_tip_source(body, request.body, request.joint)
    read = _read_motions(request, on_measured)
    shown = _shown(request, read)
    shortest = min(motion.num_frames for motion in read.all.values())
    check_start(request.start_frame, shortest, request.figure)
    speech = _read_speech(request)
    if speech is not None:
        words.begin(speech.waveform)
    pictured = picture_motions(shown)
    plans = {} if request.opened is None else request.opened.plans
    timeline = run.show(pictured.motions, speech, tip, request.weights, plans)
    given = _given_words(request)
    run.timeline(timeline, given)
    diagnostics = _measure(request, read, tip, speech, on_measured)
    run.note(*diagnostics.notes, *pictured.notes)
    files = dict(zip(_names_of(request), request.motions, strict=True))
    files |= {REFERENCE_NAME: request.reference} if request.reference else {}
    for row in run.record.rows:
        row.ending = ending_of(files[row.name])
    run.measured(diagnostics)
    run.find_plans(pictured.motions)
    errors = _grow_errors(read.all, request.joint, on_measured)
    if errors:
        path, growth = folder.path("error_growth.json"), _growth_content(errors, request.joint)
        path.write_text(json.dumps(growth, indent=1, allow_nan=False) + "\n")
        run.file("numbers", path.stem, path)
        run.files("figure", draw_error_growth(errors, folder))
        on_measured(_GROWTH_DRAWN)
    systems = [name for name in shown if name != REFERENCE_NAME]
    run.files("figure", draw_jitter(diagnostics, tip, folder, systems))
    on_measured(_SHEET_DRAWN)
    placed = {name: _on_the_floor(motion) for name, motion in shown.items()}
    run.files("figure", _draw_figure6(request, placed, tip, folder, on_measured))
    on_measured(1.0)
    if request.videos is not None:
        draw_own_videos(
            *(pictured.motions, request.videos, body, request.body, tip),
            *(request.speech if request.channel is None else folder.at(HEARD), folder),
            lambda part: on_progress(measured + (1.0 - measured) * part),
            lambda made: run.file(made.kind, made.name, made.path),
        )
    for motion in shown.values():
        run.note(*body.notes(body_motion(motion)))
    if len(shown) < len(read.all) and not request.shown:
        run.note(
            f"The figures show the first {MAX_COMPARED} motions; say which they are to show"
            " (--show)."
        )
    said, notes_of_words = words.found(lambda: on_progress(1.0))
    run.note(*notes_of_words)
    if said.origin != given.origin and request.opened is None:
        run.timeline(timeline, said)
    run.files("diagnostics", write_diagnostics(diagnostics, folder, said))
    count = len(diagnostics.systems)
    line = MEASURED if request.opened is None else OPENED
    files = run.finish(line.format(motions=f"{count} motion{'s' if count > 1 else ''}"))
    return Diagnosis(files, tuple(run.notes), diagnostics)


def _given_words(request: DiagnoseRequest) -> Transcript:
    return given_words(request.transcript) if request.opened is None else request.opened.said


def _read_speech(request: DiagnoseRequest) -> Speech | None:
    from model.speech.audio import SpeechLimits, load_speech

    if request.speech is None:
        return None
    return load_speech(request.speech, SpeechLimits(channel=request.channel))


def _shown(request: DiagnoseRequest, read: _Read) -> dict[str, Motion]:
    """As many motions as a figure holds, the reference among them.

    Raises:
        RunError: if there is no motion of a name that was asked for, or too many were.
    """
    limit = MAX_COMPARED - (read.reference is not None)
    asked = dict.fromkeys(map(printable, request.shown))
    names = [name for name in asked if name != REFERENCE_NAME]
    unknown = [name for name in names if name not in read.motions]
    if unknown:
        raise RunError(
            f"There is no motion {unknown[0]!r} to show; there are {', '.join(read.motions)}."
        )
    if len(names) > limit:
        raise RunError(f"Figures show at most {limit} motions of these; {len(names)} were named.")
    systems = {name: read.motions[name] for name in names or list(read.motions)[:limit]}
    reference = {} if read.reference is None else {REFERENCE_NAME: read.reference}
    return systems | reference


def _on_the_floor(motion: Motion) -> Motion:
    """For the pictures only: a body whose translation never changes would stand sunk to the chest,
    or in the air, beside one that has a floor."""
    import numpy as np

    from model.measures.posture import FEET
    from model.motion.kinematics import open_body_skeleton
    from model.motion.tracks import track_points

    if np.ptp(motion.trans, axis=0).any():
        return motion
    feet = track_points(motion, open_body_skeleton()).joints[:, list(FEET), 1]
    trans = motion.trans.copy()
    trans[:, 1] += SOLE_M - float(np.median(feet.min(axis=1)))
    return replace(motion, trans=trans)


def unique_names(paths: Sequence[Path]) -> list[str]:
    """The stem of each file, as it can be printed, with its folder where two have the same stem.

    Raises:
        RunError: if two files cannot be told apart even so.
    """
    stems = [path.stem for path in paths]
    names = [
        f"{path.resolve().parent.name}/{path.stem}" if stems.count(path.stem) > 1 else path.stem
        for path in paths
    ]
    names = [printable(name) for name in names]
    _check_names(names)
    return names


def _check_names(names: Sequence[str]) -> None:
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise RunError(f"Two of the files would be called {twice!r}; rename one of them.")
    if REFERENCE_NAME in names:
        raise RunError(f"A motion may not be called {REFERENCE_NAME!r}; rename the file.")


def _read_motions(request: DiagnoseRequest, on_progress: OnShare) -> _Read:
    from model.formats.read import read_any_motion

    names = _names_of(request)
    _check_names(names)
    files = [*request.motions, *filter(None, [request.reference])]
    request.told.check(files, *names)
    notes: list[str] = []
    motions: dict[str, Motion] = {}
    readings: dict[str, Reading] = {}
    for done, (name, path) in enumerate(zip(names, request.motions, strict=True)):
        on_progress(_READ * done / len(names))
        found = read_any_motion(path, request.told, request.body, MOTIONS, name)
        motions[name], readings[name] = found.motion, found
        notes += found.notes
        _check_frames(request, motions.values())
    reference = None
    if request.reference is not None:
        on_progress(_READ)
        found = read_any_motion(request.reference, request.told, request.body, REFERENCE_NAME)
        reference, readings[REFERENCE_NAME] = found.motion, found
        notes += found.notes
        _check_frames(request, [*motions.values(), reference])
    on_progress(_READ)
    return _Read(motions, reference, [*apart(readings), *notes], readings)


def _check_frames(request: DiagnoseRequest, motions: Iterable[Motion]) -> None:
    count = sum(motion.num_frames for motion in motions)
    if request.max_frames is not None and count > request.max_frames:
        raise RunError(
            f"The files have over {request.max_frames} frames together "
            f"({request.max_frames / 1800:.0f} minutes), the most that is measured at once here."
        )


def _measure(
    request: DiagnoseRequest,
    read: _Read,
    tip: TipSource,
    speech: Speech | None,
    on_progress: OnShare,
) -> Diagnostics:
    from model.faults.table import without
    from model.measures.beats import read_mean_speeds
    from model.measures.lag import heard_of

    if request.mean_speeds is not None and request.speech is None:
        raise RunError("Mean speeds are of use with a speech only; give both (--speech).")
    mean_speeds = None if request.mean_speeds is None else read_mean_speeds(request.mean_speeds)
    onsets_s = heard = None
    if speech is not None:
        read.notes.extend(speech.notes)
        read.notes.extend(lengths_apart(speech.duration_s, _durations(read.all)))
        on_progress(_READ)
        onsets_s = onsets_of(speech)
        heard = heard_of(speech.waveform)
    measured = measure_motions(
        read.all,
        tip,
        onsets_s,
        on_share=lambda part: on_progress(_READ + (_MEASURED - _READ) * part),
        windows=_windows(request, read),
        heard=heard,
        mean_speeds=mean_speeds,
    )
    readings = read.readings
    return replace(
        measured,
        notes=[*read.notes, *measured.notes],
        findings={
            name: without(found, readings[name].lacks) for name, found in measured.findings.items()
        },
        assumed={
            name: [
                each.as_json()
                for each in (*reading.assumptions, *_in_step(measured.findings.get(name, ())))
            ]
            for name, reading in readings.items()
        },
        lacks={name: sorted(reading.lacks) for name, reading in readings.items()},
    )


def _in_step(findings: Iterable[Finding]) -> Iterator[Assumption]:
    """That a motion is in step with the speech, where it does not seem so."""
    for finding in findings:
        numbers = finding.numbers
        if finding.kind == "time_shift" and numbers.get("lag_drift_s") == 0.0:
            late = f"{numbers['lag_s']:.2f}"
            yield Assumption("lag", "0", f"it seems {late} s late", "unsure", (late,))


def _durations(motions: Mapping[str, Motion]) -> dict[str, float]:
    return {name: motion.duration_s for name, motion in motions.items()}


def _windows(request: DiagnoseRequest, read: _Read) -> dict[str, Windows]:
    """What the user says of how the motions were cut.

    Raises:
        RunError: for windows that cannot be.
    """
    from model.measures.seams import Windows

    if request.window is None:
        if request.overlap:
            raise RunError("An overlap says nothing without a window; give both (--window).")
        return {}
    try:
        windows = Windows(request.window - request.overlap, request.overlap)
    except ValueError as error:
        raise RunError(str(error)) from error
    return dict.fromkeys(read.all, windows)


def _grow_errors(
    motions: Mapping[str, Motion], joint: str, on_progress: OnShare
) -> dict[str, ErrorGrowth]:
    """By name; empty where nothing moves the followed joint."""
    from model.measures.error_growth import measure_error_growth
    from model.motion.kinematics import open_body_skeleton
    from model.motion.tracks import moving_chain

    found = {}
    if moving_chain(joint):
        for done, (name, motion) in enumerate(motions.items()):
            on_progress(_MEASURED + (_GROWN - _MEASURED) * done / len(motions))
            found[name] = measure_error_growth(motion, open_body_skeleton(), joint)
        on_progress(_GROWN)
    return found


def _growth_content(errors: Mapping[str, ErrorGrowth], joint: str) -> dict[str, Any]:
    """The content of error_growth.json."""
    from model.measures.error_growth import DRAWS, NOISE_RAD, growth_sentence
    from model.measures.results import as_json

    return {
        "noise_rad": NOISE_RAD,
        "draws": DRAWS,
        "seed": 0,
        "joint": joint,
        "motions": {
            name: as_json(vars(growth))
            | {"ratio": growth.ratio, "predicted_ratio": growth.predicted_ratio}
            | {"sentence": growth_sentence(growth, NOISE_RAD)}
            for name, growth in errors.items()
        },
    }


def _draw_figure6(
    request: DiagnoseRequest,
    motions: dict[str, Motion],
    tip: TipSource,
    folder: ResultFolder,
    on_progress: OnShare,
) -> list[Path]:
    from renderer.figures.figure6.spec import choose_snapshot_frames

    shortest = min(motion.num_frames for motion in motions.values())
    frames = request.figure.frames or choose_snapshot_frames(shortest, request.start_frame)
    snapshots = Snapshots(frames)
    if request.has_pictures and "b" in request.figure.panels:
        share = _POSES_DRAWN - _SHEET_DRAWN
        snapshots = draw_poses(
            motions, request.body, frames, lambda part: on_progress(_SHEET_DRAWN + share * part)
        )
    return draw_figure6(
        motions,
        snapshots,
        tip,
        folder,
        request.start_frame,
        request.figure,
        is_generated=False,
        on_piece=lambda: on_progress(_POSES_DRAWN),
    )
