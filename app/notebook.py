"""Python interface for notebooks, with speech, motion, plans and metrics as objects.

It may import the page's player; no module imports it. ``docs/notebook.ipynb`` walks through it.
Errors are ValueErrors with one sentence.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from jaxtyping import Shaped
from pandas import DataFrame

from app.config import BUNDLED_WEIGHTS, drop_missing_matplotlib_backend, http_proxies_disabled
from app.errors import RunError
from app.findings.metric_table import (
    METRICS,
    format_three_digits,
    metric_definition,
    metric_values,
    nearest_names,
)
from app.run.batch.table import title_with_unit
from app.run.bodies import PointTracker
from app.run.callbacks import RunCallbacks
from app.run.diagnostics import cached_speech_onsets, measure_motions
from app.run.generated_motions import write_plan_from_speech
from app.run.output.console import ProgressBars
from app.run.output.run_folder import RunRecord, row_files
from app.run.pipeline import generate as _generate
from app.run.requests.convert import request_from
from app.run.requests.parts import DEFAULT_TRACKED_POINT
from app.run.requests.requests import GenerateRequest, PlanRequest, RenderRequest
from app.run.run_writer import open_run_writer
from app.run.videos.export import render_or_export_motion
from conventions.names import REFERENCE_NAME, FilterVersion
from model.diagnostics import Diagnostics
from model.formats.read import read_any_motion
from model.formats.reading import parse_import_overrides
from model.metrics.lag import speech_bands_by_frame
from model.metrics.protocols.table import protocol_of
from model.metrics.reference_error import rotation_difference_by_part_deg
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, load_motion, save_motion
from model.plan.detection import plan_from_motion
from model.plan.files import read_plan_file, write_plan_file
from model.plan.plan import GesturePlan
from model.speech.audio import Speech, load_speech, write_wav
from model.speech.transcript import EMPTY_TRANSCRIPT, Transcript
from model.storage.files import write_atomically
from model.systems.registry import default_planning_system, family_of, list_systems

drop_missing_matplotlib_backend()
with http_proxies_disabled():  # it imports Gradio
    from app.page.html_export import standalone_html

__all__ = [
    "Comparison",
    "GenerationResult",
    "Player",
    "compare",
    "detect_plan",
    "diagnose",
    "generate",
    "read_motion",
    "read_speech",
    "render",
    "sample_plan",
    "show",
    "systems",
]
SpeechLike = str | Path | Speech | tuple[np.ndarray, int]
"""Audio file, loaded speech, or samples (N,) or (N, channels) with their sample rate (Hz)."""
MotionLike = str | Path | Motion
PlanLike = str | Path | GesturePlan
HEIGHT_PX = 880
_FORMER_NAMES = {
    "Performance": "GenerationResult",
    "find_plan": "detect_plan",
    "plan": "sample_plan",
}
RUN = "run"
"""Folder of the run, next to the input files."""


def _warn_of_name(former: str, name: str) -> None:
    message = f"{former} is deprecated and will be removed; use {name}."
    warnings.warn(message, FutureWarning, stacklevel=3)


def __getattr__(name: str) -> Any:
    if name not in _FORMER_NAMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    _warn_of_name(name, _FORMER_NAMES[name])
    return globals()[_FORMER_NAMES[name]]


def systems() -> dict[str, str]:
    """Return the bundled systems by name, each with a sentence about it."""
    return {name: family_of(name).descriptions[name] for name in list_systems(BUNDLED_WEIGHTS)}


def read_speech(speech: SpeechLike) -> Speech:
    """Load speech as the systems' input, 16 kHz mono; raises SpeechError if it cannot be used."""
    if isinstance(speech, Speech):
        return speech
    with TemporaryDirectory() as folder:
        return load_speech(as_file(Path(folder), speech) or "")


def read_motion(motion: MotionLike, assume: str = "") -> Motion:
    """Read a motion: BEAT2, AMASS and SMPL-X files (.npz), rotations (.npy), .bvh.

    Args:
        assume: how to interpret a file that lacks metadata, such as "up=z,rate=25".

    Returns:
        ``poses`` (T, 165), local axis-angle of the 55 SMPL-X joints in radians; ``trans`` (T, 3) in
            metres, y up; ``expressions`` (T, 100); at 30 frames per second.

    Raises:
        MotionError: if the motion cannot be read.
    """
    if isinstance(motion, Motion):
        return motion
    return read_any_motion(motion, parse_import_overrides(assume)).motion


def motions_by_name(
    motions: MotionLike | Mapping[str, MotionLike], reference: MotionLike | None = None
) -> dict[str, Motion]:
    """Read motions by name: a single file under its stem, a single motion as "motion".

    Args:
        reference: recorded motion, added under the name "reference".

    Raises:
        RunError: if there is no motion.
        MotionError: as in `read_motion`.
    """
    if isinstance(motions, str | Path):
        motions = {Path(motions).stem: motions}
    elif isinstance(motions, Motion):
        motions = {"motion": motions}
    if not motions:
        raise RunError("No motion was given; give at least one.")
    recorded = {} if reference is None else {REFERENCE_NAME: reference}
    return {name: read_motion(motion) for name, motion in {**motions, **recorded}.items()}


def as_file(folder: Path, value: SpeechLike | MotionLike | PlanLike | None) -> Path | None:
    """Return the path of an input; an input that is not a file is written into the folder first."""
    match value:
        case None:
            return None
        case str() | Path():
            return Path(value)
        case Speech():
            write_wav(path := folder / "speech.wav", value.waveform)
        case Motion():
            save_motion(value, path := folder / "motion.npz")
        case GesturePlan():
            write_plan_file(value, path := folder / "plan.json")
        case (samples, rate):
            _write_samples(path := folder / "speech.wav", np.asarray(samples), int(rate))
    return path


def _write_samples(path: Path, samples: Shaped[np.ndarray, " N *channels"], rate: int) -> None:
    from scipy.io import wavfile

    if samples.ndim not in (1, 2) or not np.issubdtype(samples.dtype, np.number):
        raise RunError(
            "Speech as an array must contain numbers and have the shape (N,) or (N, channels); got "
            f"{samples.dtype} of shape {samples.shape}."
        )
    if samples.dtype not in (np.int16, np.int32, np.uint8):
        samples = samples.astype(np.float32)
    wavfile.write(path, rate, samples)


@dataclass(frozen=True, eq=False, repr=False)
class Player:
    """Player of a run as HTML for notebook cells; about 3 MB plus 50 kB per second of each body."""

    html: str
    height: int = HEIGHT_PX
    """Height of the cell in pixels."""

    def save(self, path: str | Path) -> Path:
        """Write the player to a file atomically; raises WriteError if that fails."""
        write_atomically(Path(path), self.html)
        return Path(path)

    def __repr__(self) -> str:
        return f"Player({len(self.html) / 1e6:.1f} MB)"

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{escape(self.html)}" sandbox="allow-scripts allow-same-origin" '
            f'style="width: 100%; height: {self.height}px; border: 0"></iframe>'
        )


def show(
    motions: MotionLike | Mapping[str, MotionLike],
    speech: SpeechLike | None = None,
    *,
    reference: MotionLike | None = None,
    joint: str = DEFAULT_TRACKED_POINT,
    height: int = HEIGHT_PX,
) -> Player:
    """Play motions in sync with the sound, with the viewer's display options and the timeline.

    Args:
        motions: one motion, several by name, or the folder of a run or of a run of several clips,
            which is played unchanged.
        joint: tracked point for the timeline's jerk and speed curves.
    """
    if isinstance(motions, str | Path) and Path(motions).is_dir():
        return Player(standalone_html(Path(motions)), height)
    named = motions_by_name(motions, reference)
    audio = None if speech is None else read_speech(speech)
    tracker = PointTracker(joint)
    record = RunRecord(kind="imported", title="Co-speech motion", tracked_point=joint)
    with TemporaryDirectory() as folder:
        with open_run_writer(Path(folder), record, is_incremental=True) as run:
            run.write_timeline(
                run.write_motions_and_make_timeline(named, audio, tracker), EMPTY_TRANSCRIPT
            )
            run.finish("")
        return Player(standalone_html(Path(folder)), height)


def diagnose(
    motions: MotionLike | Mapping[str, MotionLike],
    *,
    reference: MotionLike | None = None,
    speech: SpeechLike | None = None,
    joint: str = DEFAULT_TRACKED_POINT,
    progress: bool = True,
) -> Diagnostics:
    """Compute the metrics of motions, raw and filtered, and report their faults.

    Args:
        motions: one motion, or several by name.
        reference: recorded motion to compare with; all motions are then cut to the shortest.
        speech: sound that all motions belong to, for BeatAlign.
        joint: tracked fingertip or joint of the ``tip_`` metrics.

    Returns:
        ``systems`` and ``findings`` by name; ``as_json()`` is the content of ``diagnostics.json``.

    Example:
        >>> motion = read_motion("examples/procedural_speaker/a_procedural_speaker.npz")
        >>> diagnostics = diagnose({"speaker": motion.part(slice(60))}, progress=False)
        >>> diagnostics.findings["speaker"]
        []
        >>> f"{diagnostics.systems['speaker'].raw.point.tip_jerk_m_s3:.0f} m/s³"
        '81 m/s³'
    """
    named = motions_by_name(motions, reference)
    tracker = PointTracker(joint)
    sound = None if speech is None else read_speech(speech)
    with ProgressBars(is_visible=progress, stays=False) as bars:
        return measure_motions(
            named,
            tracker,
            onsets_s=None if sound is None else cached_speech_onsets(sound),
            speech_log_mel=None if sound is None else speech_bands_by_frame(sound.waveform),
            on_share=partial(bars.update, "measure"),
        )


def detect_plan(motion: MotionLike) -> GesturePlan:
    """Detect the gesture plan of a motion: phases of both hands, nods, gaze and steps."""
    return plan_from_motion(read_motion(motion), open_body_skeleton())


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """Metrics of several motions, shown as a table in a notebook cell."""

    table: DataFrame
    """Table with a row for each metric, by keys such as ``tracked_point_jerk_m_s3``, and a column
    for each motion; None if a metric does not apply."""
    nearest_to_reference: Mapping[str, Sequence[str]]
    """Names of the motions nearest to the reference, by metric."""
    rotation_difference_deg: Mapping[tuple[str, str], Mapping[str, float]]
    """Mean angle (degrees) between joint rotations, by motion pair and body part, largest first."""
    protocol_id_by_metric: Mapping[str, str]
    """Ids of the protocols; values of different protocols cannot be compared."""

    @property
    def apart_deg(self) -> Mapping[tuple[str, str], Mapping[str, float]]:
        """Former name of ``rotation_difference_deg``."""
        _warn_of_name("apart_deg", "rotation_difference_deg")
        return self.rotation_difference_deg

    @property
    def nearest(self) -> Mapping[str, Sequence[str]]:
        """Former name of ``nearest_to_reference``."""
        _warn_of_name("nearest", "nearest_to_reference")
        return self.nearest_to_reference

    @property
    def protocols(self) -> Mapping[str, str]:
        """Former name of ``protocol_id_by_metric``."""
        _warn_of_name("protocols", "protocol_id_by_metric")
        return self.protocol_id_by_metric

    def __repr__(self) -> str:
        return self.table.map(format_three_digits).to_string()

    def _repr_html_(self) -> str:
        cells = self.table.map(format_three_digits)
        for key, names in self.nearest_to_reference.items():
            for name in names:
                cells.loc[key, name] = f"<b>{cells.loc[key, name]}</b>"
        cells = cells.rename(index=self._explained, columns=escape)
        note = "<p>As generated. Bold: closest to the reference.</p>"
        return note + cells.to_html(escape=False, border=0)

    def _explained(self, key: str) -> str:
        """Format the title of a metric as HTML with its rule and protocol as a tooltip."""
        measure = next(measure for measure in METRICS if measure.key == key)
        protocol = self.protocol_id_by_metric[key]
        about = f"{metric_definition(key, protocol)} Protocol {protocol}."
        return f'<span title="{escape(about)}">{escape(title_with_unit(measure))}</span>'


def compare(
    motions: Mapping[str, MotionLike],
    *,
    reference: MotionLike | None = None,
    speech: SpeechLike | None = None,
    diagnostics: Diagnostics | None = None,
    kind: FilterVersion = "raw",
) -> Comparison:
    """Compare the metrics of motions.

    Args:
        reference: recorded motion; a motion named "reference" is used as one, too.
        diagnostics: existing results of `diagnose` for these motions.
        kind: as generated ("raw") or after the Savitzky-Golay filter ("savgol").
    """
    named = motions_by_name(motions, reference)
    if diagnostics is None:
        diagnostics = diagnose(named, speech=speech, progress=False)
    of_all = diagnostics.metrics_by_name
    numbers = {name: metric_values(versions.version(kind)) for name, versions in of_all.items()}
    rows: dict[str, dict[str, float | None]] = {}
    best: dict[str, Sequence[str]] = {}
    for measure in METRICS:
        values = {name: of.get(measure.key) for name, of in numbers.items()}
        if any(value is not None for value in values.values()):
            rows[measure.key] = values
            target = values.get(REFERENCE_NAME) if measure.is_compared_with_reference else None
            others = {name: values[name] for name in diagnostics.systems}
            best[measure.key] = nearest_names(others, target)
    apart = {
        (a, b): rotation_difference_by_part_deg(named[a], named[b])
        for a, b in combinations(named, 2)
    }
    table = DataFrame(list(rows.values()), list(rows), list(of_all), dtype=object)
    protocols = {key: protocol_of(key, diagnostics.beat_speed_source) for key in rows}
    return Comparison(table, best, apart, protocols)


@dataclass(frozen=True, eq=False)
class GenerationResult:
    """Motions of several systems for one speech, generated with the same noise seed."""

    speech: Speech
    motions: dict[str, Motion]
    """Motions by system; ``SYSTEM.s2`` and on are more samples, "reference" is a recorded one."""
    plans: dict[str, GesturePlan]
    """Gesture plans, by name, of the systems that use one."""
    transcript: Transcript
    """Words with their times, if they were provided or recognised."""
    diagnostics: Diagnostics
    notes: tuple[str, ...]
    """Notes for the user, such as how the speech was changed."""
    _folder: TemporaryDirectory[str]
    """Temporary folder of the run, deleted with this object."""

    def __getitem__(self, name: str) -> Motion:
        return self.motions[name]

    @property
    def said(self) -> Transcript:
        """Former name of ``transcript``."""
        _warn_of_name("said", "transcript")
        return self.transcript

    def show(self, height: int = HEIGHT_PX) -> Player:
        """Play all motions in sync with the sound, in a cell or as a file."""
        return show(Path(self._folder.name) / RUN, height=height)

    def compare(self) -> Comparison:
        return compare(self.motions, diagnostics=self.diagnostics)


def generate(
    speech: SpeechLike,
    systems: str | Sequence[str] | None = None,
    *,
    plan: PlanLike | None = None,
    reference: MotionLike | None = None,
    progress: bool = True,
    **options: Any,
) -> GenerationResult:
    """Generate the motion of one or more systems, with the same noise seed.

    Args:
        systems: one name or several of `systems`; "all" for all of them, None for the default one,
            which uses a plan.
        plan: gesture plan for the systems that use one; None samples a plan from the speech.
        reference: recorded motion of the same speech, to be measured and shown with the others.
        options: further fields of `app.run.requests.requests.GenerateRequest` and its parts, such
            as ``seed``, ``speaker``, ``samples``, ``steps``, ``transcript`` or
            ``word_source="recognise"``.
    """
    systems = default_planning_system() if systems is None else systems
    named = () if systems == "all" else (systems,) if isinstance(systems, str) else tuple(systems)
    held = TemporaryDirectory()
    folder = Path(held.name)
    request = request_from(
        GenerateRequest,
        {
            "speech": as_file(folder, speech),
            "out": folder / RUN,
            "systems": named,
            "plan": as_file(folder, plan),
            "reference": as_file(folder, reference),
            "has_video": False,
            "has_figures": False,
            **_paths(options),
        },
    )
    with ProgressBars(is_visible=progress, stays=False) as bars:
        result = _generate(request, RunCallbacks(bars.on_event))
    motions, plans = (row_files(request.output.out, kind) for kind in ("motion", "input_plan"))
    return GenerationResult(
        speech=read_speech(request.speech.path),
        motions={name: load_motion(path) for name, path in motions.items()},
        plans={name: read_plan_file(path).plan for name, path in plans.items()},
        transcript=result.transcript,
        diagnostics=result.diagnostics,
        notes=result.notes,
        _folder=held,
    )


def sample_plan(speech: SpeechLike, **options: Any) -> GesturePlan:
    """Sample the gesture plan that a system would follow for a speech; see `model.plan.plan`.

    Args:
        options: further fields, as in `generate`.
    """
    with TemporaryDirectory() as held:
        sound, out = as_file(Path(held), speech), Path(held, "drawn.json")
        values = {"speech": sound, "out": out, **_paths(options)}
        return write_plan_from_speech(request_from(PlanRequest, values)).plan


def _paths(options: Mapping[str, Any]) -> dict[str, Any]:
    if "recognise_words" in options:
        raise RunError('There is no option recognise_words; use word_source="recognise".')
    files = ("weights", "transcript", "style", "body")
    return {
        name: Path(value) if name in files and isinstance(value, str) else value
        for name, value in options.items()
    }


def render(
    motion: MotionLike,
    out: str | Path,
    *,
    speech: SpeechLike | None = None,
    progress: bool = True,
    **options: Any,
) -> tuple[Path, ...]:
    """Render a motion, or export it, in the format of the suffix of ``out``.

    Args:
        out: file with the suffix .mp4, .png, .glb, .bvh or .blender.npz.
        speech: sound of the video.
        options: further fields of `app.run.requests.requests.RenderRequest`, such as ``size``,
            ``views``, ``close_ups``, ``framing``, ``num_stills`` or
            ``contact_sheet_interval``.

    Returns:
        The files that were written.
    """
    out = Path(out)
    with TemporaryDirectory() as held, ProgressBars(is_visible=progress, stays=False) as bars:
        moved, sound = (as_file(Path(held), path) for path in (motion, speech))
        values = {"motion": moved, "out": out, "speech": sound, **_paths(options)}
        files, _ = render_or_export_motion(
            request_from(RenderRequest, values), RunCallbacks(bars.on_event)
        )
    return files
