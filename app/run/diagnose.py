"""Anyone's motion files: the same numbers and the same figures as for our systems."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.errors import RunError
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
    WordsAsked,
)
from app.run.videos.comparison import Snapshots, draw_poses
from app.run.videos.own_videos import SOLE_M, OnFile, VideoOptions, draw_own_videos, picture_motions
from app.run.words import SpokenWords
from conventions.names import REFERENCE_NAME, printable
from model.formats.reading import MOTIONS, Reading, Told, apart, lengths_apart
from model.speech.transcript import NOTHING_SAID, Transcript

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from model.diagnostics import Diagnostics
    from model.measures.error_growth import ErrorGrowth
    from model.measures.seams import Windows
    from model.motion.motion import Motion

OnShare = Callable[[float], None]

_READ, _MEASURED, _GROWN, _GROWTH_DRAWN, _SHEET_DRAWN, _POSES_DRAWN = 0.1, 0.5, 0.55, 0.6, 0.7, 0.9
"""Shares of the whole that are done after each part of it."""
_BEFORE_VIDEOS = 0.3
"""Share of the whole where videos are drawn, too."""
_NO_SPEECH = (
    "Words are looked for in the speech, and none was given: add it (--speech), or give words with "
    "their times as a TextGrid."
)


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
    is_played: bool = False
    """Whether the shown motions are told of before they are measured, for a player."""
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
    error_growth: dict[str, Any] | None
    """None where no rotation moves the followed point."""
    said: Transcript = NOTHING_SAID
    """In the speech, where that was given or found."""


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
    on_progress: OnShare = lambda share: None,
    on_file: OnFile = lambda artefact: None,
) -> Diagnosis:
    """Measure motion files and leave the results in ``request.out``, all of them or none.

    Writes diagnostics.json and .csv, error_growth, figure6, jitter, and videos where they are asked
    for. The page calls this for motions that a visitor brings, the command line for `diagnose`.

    Args:
        on_progress: told of the share done, 0 to 1, between all steps; what it raises ends the
            work and leaves nothing.
        on_file: told of what a player shows, as soon as it is whole.

    Raises:
        RunError, MotionError, SpeechError, TranscriptError, BodyError, GLError, FigureError,
        WriteError: each with one sentence.
    """
    with SpokenWords(request.transcript, request.words) as words:
        if words.need_speech and request.speech is None:
            raise RunError(_NO_SPEECH)
        return _diagnose(request, words, on_progress, on_file)


def _diagnose(
    request: DiagnoseRequest, words: SpokenWords, on_progress: OnShare, on_file: OnFile
) -> Diagnosis:
    missing = nothing_draws() if request.videos or request.has_pictures else ""
    if missing:  # numbers and trajectories need no OpenGL
        request = replace(request, videos=None, has_pictures=False)
    measured = 1.0 if request.videos is None else _BEFORE_VIDEOS

    def on_measured(share: float) -> None:
        on_progress(measured * share)

    body = get_body(request.body)
    tip = choose_tip_source(body, request.body, request.joint)
    read = _read_motions(request, on_measured)
    shown = _shown(request, read)
    shortest = min(motion.num_frames for motion in read.all.values())
    check_start(request.start_frame, shortest, request.figure)
    is_pictured = request.is_played or request.videos is not None
    pictured = picture_motions(shown if is_pictured else {})
    with ResultFolder(request.out) as folder:
        if request.is_played:
            pictured.tell(folder, on_file)
        diagnostics = _measure(request, read, tip, words, on_measured)
        errors = _grow_errors(read.all, request.joint, on_measured)
        growth = _growth_content(errors, request.joint) if errors else None
        if growth is not None:
            text = json.dumps(growth, indent=1, allow_nan=False) + "\n"
            folder.path("error_growth.json").write_text(text)
            draw_error_growth(errors, folder)
            on_measured(_GROWTH_DRAWN)
        systems = [name for name in shown if name != REFERENCE_NAME]
        draw_jitter(diagnostics, tip, folder, systems)
        on_measured(_SHEET_DRAWN)
        placed = {name: _on_the_floor(motion) for name, motion in shown.items()}
        _draw_figure6(request, placed, tip, folder, on_measured)
        on_measured(1.0)
        notes = [*filter(None, [missing]), *diagnostics.notes, *pictured.notes]
        if request.videos is not None:
            draw_own_videos(
                *(pictured.motions, request.videos, body, request.body, tip),
                *(request.speech, folder),
                lambda part: on_progress(measured + (1.0 - measured) * part),
                on_file,
            )
        for motion in shown.values():
            notes += [n for n in body.notes(body_motion(motion)) if n not in notes]
        if len(shown) < len(read.all) and not request.shown:
            notes.append(
                f"The figures show the first {MAX_COMPARED} motions; say which they are to show"
                " (--show)."
            )
        said, notes_of_words = words.found(lambda: on_progress(1.0))
        notes += notes_of_words
        write_diagnostics(diagnostics, folder, said)
        return Diagnosis(folder.publish(), tuple(notes), diagnostics, growth, said)


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

    names = request.names or unique_names(request.motions)
    _check_names(names)
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
    words: SpokenWords,
    on_progress: OnShare,
) -> Diagnostics:
    from model.faults.table import without
    from model.measures.beats import read_mean_speeds
    from model.measures.lag import heard_of
    from model.speech.audio import SpeechLimits, load_speech

    if request.mean_speeds is not None and request.speech is None:
        raise RunError("Mean speeds are of use with a speech only; give both (--speech).")
    mean_speeds = None if request.mean_speeds is None else read_mean_speeds(request.mean_speeds)
    onsets_s = heard = None
    if request.speech is not None:
        speech = load_speech(request.speech, SpeechLimits(channel=request.channel))
        read.notes.extend(speech.notes)
        read.notes.extend(lengths_apart(speech.duration_s, _durations(read.all)))
        on_progress(_READ)
        onsets_s = onsets_of(speech)
        heard = heard_of(speech.waveform)
        words.begin(speech.waveform)
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
            name: [each.as_json() for each in reading.assumptions]
            for name, reading in readings.items()
        },
        lacks={name: sorted(reading.lacks) for name, reading in readings.items()},
    )


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
) -> None:
    from renderer.figures.figure6.spec import choose_snapshot_frames

    shortest = min(motion.num_frames for motion in motions.values())
    frames = request.figure.frames or choose_snapshot_frames(shortest, request.start_frame)
    snapshots = Snapshots(frames)
    if request.has_pictures and "b" in request.figure.panels:
        share = _POSES_DRAWN - _SHEET_DRAWN
        snapshots = draw_poses(
            motions, request.body, frames, lambda part: on_progress(_SHEET_DRAWN + share * part)
        )
    draw_figure6(
        motions,
        snapshots,
        tip,
        folder,
        request.start_frame,
        request.figure,
        is_generated=False,
        on_piece=lambda: on_progress(_POSES_DRAWN),
    )
