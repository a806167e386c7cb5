"""The program from Python: speech and motion as arrays in, motion, plans and numbers out, bodies
that play in a notebook's cell. It may import the page's player; nothing of the program imports it.

``docs/notebook.ipynb`` walks through it. What cannot be done is a ValueError with one sentence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from pandas import DataFrame

from app.config import BUNDLED_WEIGHTS, drop_missing_backend, without_proxies
from app.errors import RunError
from app.findings.measure_rows import MEASURES, nearest, numbers_of, written
from app.run.bodies import TipSource
from app.run.callbacks import Ear
from app.run.diagnostics import measure_motions, onsets_of
from app.run.made import make_plan
from app.run.many.table import titled
from app.run.output.run_folder import RunRecord, row_files
from app.run.output.telling import Bars
from app.run.pipeline import generate as _generate
from app.run.requests.convert import request_from
from app.run.requests.parts import DEFAULT_TRACKED_POINT
from app.run.requests.requests import GenerateRequest, PlanRequest, RenderRequest
from app.run.run_writer import writing_run
from app.run.videos.export import render_motion
from conventions.names import REFERENCE_NAME, Version
from model.diagnostics import Diagnostics
from model.formats.read import read_any_motion, read_told
from model.measures.differences import degrees_by_part
from model.measures.lag import heard_of
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, load_motion, save_motion
from model.plan.files import read_plan_file, write_plan_file
from model.plan.found import found_plan
from model.plan.plan import GesturePlan
from model.speech.audio import Speech, load_speech, write_wav
from model.speech.transcript import NOTHING_SAID, Transcript
from model.storage.files import write_atomically
from model.systems.registry import family_of, list_systems, usual_planner

drop_missing_backend()
with without_proxies():  # it imports Gradio
    from app.page.alone import player_alone

__all__ = [
    "Comparison",
    "Performance",
    "Player",
    "compare",
    "diagnose",
    "find_plan",
    "generate",
    "plan",
    "read_motion",
    "read_speech",
    "render",
    "show",
    "systems",
]
SpeechLike = str | Path | Speech | tuple[np.ndarray, int]
"""A sound file; speech that was read; or samples, (N,) or (N, channels), and their rate in Hz."""
MotionLike = str | Path | Motion
PlanLike = str | Path | GesturePlan
HEIGHT_PX = 880
RUN = "run"
"""Folder of a run, beside what was handed over."""


def systems() -> dict[str, str]:
    """The bundled systems by name, with a sentence on each."""
    return {name: family_of(name).about[name] for name in list_systems(BUNDLED_WEIGHTS)}


def read_speech(speech: SpeechLike) -> Speech:
    """Sound as the systems hear it: 16 kHz, mono.

    Raises:
        SpeechError: with one sentence, if it cannot be used.
    """
    if isinstance(speech, Speech):
        return speech
    with TemporaryDirectory() as folder:
        return load_speech(in_file(Path(folder), speech) or "")


def read_motion(motion: MotionLike, assume: str = "") -> Motion:
    """Anyone's motion: BEAT2, AMASS and SMPL-X files (.npz), rotations (.npy), .bvh.

    Args:
        assume: how it is to be read, such as "up=z,rate=25".

    Returns:
        ``poses`` (T, 165), local axis-angle of the 55 SMPL-X joints in radians; ``trans`` (T, 3) in
        metres, y up; ``expressions`` (T, 100); at 30 frames per second.

    Raises:
        MotionError: with one sentence, if it cannot be read.
    """
    if isinstance(motion, Motion):
        return motion
    return read_any_motion(motion, read_told(assume)).motion


def named_motions(
    motions: MotionLike | Mapping[str, MotionLike], reference: MotionLike | None = None
) -> dict[str, Motion]:
    """By name; a file alone is called as it is, a motion alone "motion", a reference so.

    Raises:
        RunError: of none.
        MotionError: as `read_motion`.
    """
    if isinstance(motions, str | Path):
        motions = {Path(motions).stem: motions}
    elif isinstance(motions, Motion):
        motions = {"motion": motions}
    if not motions:
        raise RunError("There is no motion; give at least one.")
    recorded = {} if reference is None else {REFERENCE_NAME: reference}
    return {name: read_motion(motion) for name, motion in {**motions, **recorded}.items()}


def in_file(folder: Path, given: SpeechLike | MotionLike | PlanLike | None) -> Path | None:
    """What was handed over as a file, which is made in the folder where it is none."""
    match given:
        case None:
            return None
        case str() | Path():
            return Path(given)
        case Speech():
            write_wav(path := folder / "speech.wav", given.waveform)
        case Motion():
            save_motion(given, path := folder / "motion.npz")
        case GesturePlan():
            write_plan_file(given, path := folder / "plan.json")
        case (samples, rate):
            _write_samples(path := folder / "speech.wav", np.asarray(samples), int(rate))
    return path


def _write_samples(path: Path, samples: np.ndarray, rate: int) -> None:
    from scipy.io import wavfile

    if samples.ndim not in (1, 2) or not np.issubdtype(samples.dtype, np.number):
        raise RunError(
            "Speech as an array is numbers of the shape (N,) or (N, channels); it is "
            f"{samples.dtype} of the shape {samples.shape}."
        )
    if samples.dtype not in (np.int16, np.int32, np.uint8):
        samples = samples.astype(np.float32)
    wavfile.write(path, rate, samples)


@dataclass(frozen=True, eq=False, repr=False)
class Player:
    """A cell shows it; `save` keeps it as a file for any browser, about 3 MB and 50 kB a second of
    each body."""

    html: str
    height: int = HEIGHT_PX
    """Of the cell, in pixels."""

    def save(self, path: str | Path) -> Path:
        """Write it whole or not at all.

        Raises:
            WriteError: with the reason.
        """
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
    """Motions in lock-step under the sound, with the stage's displays and the time line.

    Args:
        motions: one, or several by name; or the folder of a run, or of those of several clips,
            which is shown as it is.
        joint: whose jerk and speed the time line shows.
    """
    if isinstance(motions, str | Path) and Path(motions).is_dir():
        return Player(player_alone(Path(motions)), height)
    named = named_motions(motions, reference)
    heard = None if speech is None else read_speech(speech)
    tip = TipSource(joint)
    record = RunRecord(kind="given", title="Co-speech motion", point=joint)
    with TemporaryDirectory() as folder:
        with writing_run(Path(folder), record, is_kept=True) as run:
            run.timeline(run.show(named, heard, tip), NOTHING_SAID)
            run.finish("")
        return Player(player_alone(Path(folder)), height)


def diagnose(
    motions: MotionLike | Mapping[str, MotionLike],
    *,
    reference: MotionLike | None = None,
    speech: SpeechLike | None = None,
    joint: str = DEFAULT_TRACKED_POINT,
    progress: bool = True,
) -> Diagnostics:
    """Measure motions, raw and filtered, and name their faults.

    Args:
        motions: one, or several by name.
        reference: recorded motion to compare with; all are then cut to the shortest.
        speech: the sound that all of them belong to, for BeatAlign.
        joint: the fingertip or joint that the ``tip_`` measures follow.

    Returns:
        ``systems`` and ``findings`` by name; ``as_json()`` is what ``diagnostics.json`` holds.
    """
    named = named_motions(motions, reference)
    tip = TipSource(joint)
    sound = None if speech is None else read_speech(speech)
    with Bars(is_shown=progress, stays=False) as bars:
        return measure_motions(
            named,
            tip,
            onsets_s=None if sound is None else onsets_of(sound),
            heard=None if sound is None else heard_of(sound.waveform),
            on_share=partial(bars.show, "measure"),
        )


def find_plan(motion: MotionLike) -> GesturePlan:
    """Phases of both hands, nods, looks and steps, as they seem to be in a motion."""
    return found_plan(read_motion(motion), open_body_skeleton())


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """Measures of several motions, a table in a cell."""

    table: DataFrame
    """A row for each measure, a column for each motion; None where there is no such number."""
    nearest: Mapping[str, Sequence[str]]
    """By measure the motions that are nearest to the reference."""
    apart_deg: Mapping[tuple[str, str], Mapping[str, float]]
    """Of each two motions, by part of the body: mean angle between the rotations of its joints, the
    part that differs most first."""

    def __repr__(self) -> str:
        return self.table.map(written).to_string()

    def _repr_html_(self) -> str:
        told = self.table.map(written)
        for title, names in self.nearest.items():
            for name in names:
                told.loc[title, name] = f"<b>{told.loc[title, name]}</b>"
        told = told.rename(index=_explained, columns=escape)
        note = "<p>As generated. Bold: nearest to the reference.</p>"
        return note + told.to_html(escape=False, border=0)


def _explained(title: str) -> str:
    """With what the measure is of, under the pointer."""
    about = next(measure.about for measure in MEASURES if titled(measure) == title)
    return f'<span title="{escape(about)}">{escape(title)}</span>'


def compare(
    motions: Mapping[str, MotionLike],
    *,
    reference: MotionLike | None = None,
    speech: SpeechLike | None = None,
    diagnostics: Diagnostics | None = None,
    kind: Version = "raw",
) -> Comparison:
    """Measure motions beside each other.

    Args:
        reference: recorded motion; one called "reference" among the motions is taken for it, too.
        diagnostics: of these very motions, where they have been measured.
        kind: as generated ("raw") or behind the Savitzky-Golay filter ("savgol").
    """
    named = named_motions(motions, reference)
    if diagnostics is None:
        diagnostics = diagnose(named, speech=speech, progress=False)
    of_all = diagnostics.of_all
    numbers = {name: numbers_of(versions.of(kind)) for name, versions in of_all.items()}
    rows: dict[str, dict[str, float | None]] = {}
    best: dict[str, Sequence[str]] = {}
    for measure in MEASURES:
        values = {name: of.get(measure.key) for name, of in numbers.items()}
        if any(value is not None for value in values.values()):
            rows[titled(measure)] = values
            target = values.get(REFERENCE_NAME) if measure.has_target else None
            others = {name: values[name] for name in diagnostics.systems}
            best[titled(measure)] = nearest(others, target)
    apart = {(a, b): degrees_by_part(named[a], named[b]) for a, b in combinations(named, 2)}
    table = DataFrame(list(rows.values()), list(rows), list(of_all), dtype=object)
    return Comparison(table, best, apart)


@dataclass(frozen=True, eq=False)
class Performance:
    """What several systems made of one piece of speech, with the same noise."""

    speech: Speech
    motions: dict[str, Motion]
    """By system, and ``SYSTEM.s2`` and on of further samples; a recorded one as "reference"."""
    plans: dict[str, GesturePlan]
    """Of the systems that plan."""
    said: Transcript
    """Words with their times, where they were given or found."""
    diagnostics: Diagnostics
    notes: tuple[str, ...]
    """What a person should know, such as what was done to the speech."""
    _folder: TemporaryDirectory[str]
    """Holds the run's."""

    def __getitem__(self, name: str) -> Motion:
        return self.motions[name]

    def show(self, height: int = HEIGHT_PX) -> Player:
        """All bodies in lock-step with the sound, in a cell or as a file."""
        return show(Path(self._folder.name) / RUN, height=height)

    def compare(self) -> Comparison:
        """The measures beside each other."""
        return compare(self.motions, diagnostics=self.diagnostics)


def generate(
    speech: SpeechLike,
    systems: str | Sequence[str] | None = None,
    *,
    plan: PlanLike | None = None,
    reference: MotionLike | None = None,
    progress: bool = True,
    **asked: Any,
) -> Performance:
    """Generate motion of one or more systems, with the same noise.

    Args:
        systems: a name or several (`systems`); "all" are all there are, None is the
            one that plans.
        plan: what the systems that plan are to perform; None lets them plan.
        reference: recorded motion of the same speech, to be measured and shown beside.
        asked: further fields of `app.run.requests.requests.GenerateRequest` and its parts, such as
            ``seed``, ``speaker``,
            ``samples``, ``steps``, ``transcript`` or ``words="recognise"``.
    """
    systems = usual_planner() if systems is None else systems
    named = () if systems == "all" else (systems,) if isinstance(systems, str) else tuple(systems)
    held = TemporaryDirectory()
    folder = Path(held.name)
    request = request_from(
        GenerateRequest,
        {
            "speech": in_file(folder, speech),
            "out": folder / RUN,
            "systems": named,
            "plan": in_file(folder, plan),
            "reference": in_file(folder, reference),
            "has_video": False,
            "has_figures": False,
            **_paths(asked),
        },
    )
    with Bars(is_shown=progress, stays=False) as bars:
        result = _generate(request, Ear(bars.take))
    motions, plans = (row_files(request.output.out, kind) for kind in ("motion", "performed"))
    return Performance(
        speech=read_speech(request.speech.path),
        motions={name: load_motion(path) for name, path in motions.items()},
        plans={name: read_plan_file(path).plan for name, path in plans.items()},
        said=result.said,
        diagnostics=result.diagnostics,
        notes=result.notes,
        _folder=held,
    )


def plan(speech: SpeechLike, **asked: Any) -> GesturePlan:
    """Draw what the system that plans is going to do with the speech; see `model.plan.plan`.

    Args:
        asked: as of `generate`.
    """
    with TemporaryDirectory() as held:
        sound, out = in_file(Path(held), speech), Path(held, "drawn.json")
        values = {"speech": sound, "out": out, **_paths(asked)}
        return make_plan(request_from(PlanRequest, values)).plan


def _paths(asked: Mapping[str, Any]) -> dict[str, Any]:
    """With files named by text, too."""
    if "recognise_words" in asked:
        raise RunError('recognise_words=True is words="recognise" now.')
    files = ("weights", "transcript", "style", "body")
    return {
        name: Path(value) if name in files and isinstance(value, str) else value
        for name, value in asked.items()
    }


def render(
    motion: MotionLike,
    out: str | Path,
    *,
    speech: SpeechLike | None = None,
    progress: bool = True,
    **asked: Any,
) -> tuple[Path, ...]:
    """Draw a motion; the ending of ``out`` says what is made: .mp4, .png, .glb, .bvh, .blender.npz.

    Args:
        speech: sound of the video.
        asked: further fields of `app.run.requests.requests.RenderRequest`, such as ``size``,
            ``views``, ``close_ups``, ``framing``, ``num_stills`` or ``sheet_every``.

    Returns:
        The files that were written.
    """
    out = Path(out)
    with TemporaryDirectory() as held, Bars(is_shown=progress, stays=False) as bars:
        moved, sound = (in_file(Path(held), given) for given in (motion, speech))
        values = {"motion": moved, "out": out, "speech": sound, **_paths(asked)}
        files, _ = render_motion(request_from(RenderRequest, values), Ear(bars.take))
    return files
