"""The program from Python: speech and motion as arrays in, motion, plans and numbers out, bodies
that play in a notebook's cell. It may import the page's player; nothing of the program imports it.

``docs/notebook.ipynb`` walks through it. What cannot be done is a ValueError with one sentence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from html import escape
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from app.config import BUNDLED_WEIGHTS
from app.errors import RunError
from app.findings.measure_rows import MEASURES, Measure, nearest, numbers_of, written
from app.page.alone import player_alone
from app.run.ask import Ask
from app.run.diagnostics import measure_motions, onsets_of
from app.run.followed_point import TIP, choose_tip_source
from app.run.models import get_body
from app.run.output.result_folder import ResultFolder
from app.run.output.run_folder import RunRecord
from app.run.output.telling import Bars
from app.run.pipeline import do
from app.run.planning import make_plan
from app.run.run_writer import RunWriter
from app.run.videos.export import RenderAsk, render_motion
from conventions.names import REFERENCE_NAME, Version, file_stem
from model.diagnostics import Diagnostics
from model.formats.read import read_any_motion, read_told
from model.measures.differences import degrees_by_part
from model.measures.lag import heard_of
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, first_frames, load_motion, save_motion
from model.plan.found import found_plan
from model.plan.plan import GesturePlan, read_plan
from model.speech.audio import Speech, load_speech, write_wav
from model.speech.transcript import NOTHING_SAID, Transcript
from model.storage.files import written_atomically
from model.systems.registry import family_of, list_systems, usual_planner

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
        return load_speech(speech_in(Path(folder), speech))


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


def named_motions(motions: MotionLike | Mapping[str, MotionLike]) -> dict[str, Motion]:
    """By name; a file alone is called as it is, a motion alone "motion".

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
    return {name: read_motion(motion) for name, motion in motions.items()}


def speech_in(folder: Path, speech: SpeechLike) -> Path:
    """The sound as a file, which is made in the folder where it is none."""
    path = folder / "speech.wav"
    if isinstance(speech, str | Path):
        return Path(speech)
    if isinstance(speech, Speech):
        write_wav(path, speech.waveform)
        return path
    from scipy.io import wavfile

    samples, rate = np.asarray(speech[0]), speech[1]
    if samples.ndim not in (1, 2) or not np.issubdtype(samples.dtype, np.number):
        raise RunError(
            "Speech as an array is numbers of the shape (N,) or (N, channels); it is "
            f"{samples.dtype} of the shape {samples.shape}."
        )
    if samples.dtype not in (np.int16, np.int32, np.uint8):
        samples = samples.astype(np.float32)
    wavfile.write(path, int(rate), samples)
    return path


def motion_in(folder: Path, motion: MotionLike) -> Path:
    """The motion as a file of BEAT2's form in the folder."""
    path = folder / "motion.npz"
    save_motion(read_motion(motion), path)
    return path


def plan_in(folder: Path, plan: PlanLike) -> Path:
    """The plan as a file, which is made in the folder where it is none."""
    path = folder / "plan.json"
    if not isinstance(plan, GesturePlan):
        return Path(plan)
    plan.write(path)
    return path


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
        with written_atomically(Path(path)) as part:
            part.write_text(self.html, encoding="utf-8")
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
    joint: str = TIP,
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
    named = named_motions(motions)
    if reference is not None:
        named[REFERENCE_NAME] = read_motion(reference)
    heard = None if speech is None else read_speech(speech)
    tip = choose_tip_source(get_body(None), None, joint)
    record = RunRecord(kind="given", title="Co-speech motion", point=joint)
    with TemporaryDirectory() as folder:
        with ResultFolder(Path(folder), is_kept=True) as results:
            run = RunWriter(results, record)
            run.timeline(run.show(named, heard, tip), NOTHING_SAID)
            run.finish("")
        return Player(player_alone(Path(folder)), height)


def diagnose(
    motions: MotionLike | Mapping[str, MotionLike],
    *,
    reference: MotionLike | None = None,
    speech: SpeechLike | None = None,
    joint: str = TIP,
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
    named = named_motions(motions)
    if reference is not None:
        named[REFERENCE_NAME] = read_motion(reference)
    tip = choose_tip_source(get_body(None), None, joint)
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


@dataclass(frozen=True)
class MeasureRow:
    """One measure of all motions."""

    measure: Measure
    values: dict[str, float | None]
    """By motion, in the order of all, in the measure's unit; None where there is no such number."""
    nearest: tuple[str, ...]
    """Those nearest to the reference's."""

    @property
    def title(self) -> str:
        unit = f" ({self.measure.unit})" if self.measure.unit else ""
        return f"{self.measure.key}{unit}"


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """A table in a cell, and typed numbers; pandas takes ``as_dict()``."""

    names: tuple[str, ...]
    rows: tuple[MeasureRow, ...]
    apart_deg: dict[tuple[str, str], dict[str, float]]
    """Of each two motions, by part of the body: mean angle between the rotations of its joints, the
    part that differs most first."""

    def as_dict(self) -> dict[str, dict[str, float | None]]:
        """By measure, then by motion."""
        return {row.title: dict(row.values) for row in self.rows}

    def __repr__(self) -> str:
        from pandas import DataFrame

        told = {row.title: map(written, row.values.values()) for row in self.rows}
        return DataFrame({key: list(each) for key, each in told.items()}, self.names).T.to_string()

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{escape(name)}</th>" for name in self.names)
        body = []
        for row in self.rows:
            cells = []
            for name, value in row.values.items():
                told = written(value)
                cells.append(f"<td>{f'<b>{told}</b>' if name in row.nearest else told}</td>")
            title = f'<th title="{escape(row.measure.about)}">{escape(row.title)}</th>'
            body.append(f"<tr>{title}{''.join(cells)}</tr>")
        note = "<caption>As generated. Bold: nearest to the reference.</caption>"
        return f"<table>{note}<tr><th></th>{head}</tr>{''.join(body)}</table>"


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
    named = named_motions(motions)
    if reference is None:
        reference = named.pop(REFERENCE_NAME, None)
    if diagnostics is None:
        diagnostics = diagnose(named, reference=reference, speech=speech, progress=False)
    of_all = dict(diagnostics.systems)
    if diagnostics.reference is not None:
        of_all[REFERENCE_NAME] = diagnostics.reference
    numbers = {name: numbers_of(versions.of(kind)) for name, versions in of_all.items()}
    rows = []
    for measure in MEASURES:
        values = {name: of.get(measure.key) for name, of in numbers.items()}
        if all(value is None for value in values.values()):
            continue
        target = values.get(REFERENCE_NAME) if measure.has_target else None
        of_systems = {name: value for name, value in values.items() if name != REFERENCE_NAME}
        rows.append(MeasureRow(measure, values, nearest(of_systems, target)))
    if reference is not None:
        named |= named_motions({REFERENCE_NAME: reference})
    apart = {(a, b): degrees_by_part(named[a], named[b]) for a, b in combinations(named, 2)}
    return Comparison(tuple(of_all), tuple(rows), apart)


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
        asked: further fields of `app.run.ask.Ask`, such as ``seed``, ``speaker``,
            ``samples``, ``steps``, ``transcript`` or ``words="recognise"``.
    """
    systems = usual_planner() if systems is None else systems
    named = () if systems == "all" else (systems,) if isinstance(systems, str) else tuple(systems)
    held = TemporaryDirectory()
    folder = Path(held.name)
    ask = Ask(
        speech=speech_in(folder, speech),
        out=folder / RUN,
        systems=named,
        plan=None if plan is None else plan_in(folder, plan),
        reference=None if reference is None else motion_in(folder, reference),
        has_figures=False,
        **_fields(Ask, asked),
    )
    with Bars(is_shown=progress, stays=False) as bars:
        result = do(ask, bars.take)
    stems = {name: result.out / file_stem(name) for name in result.names if name != REFERENCE_NAME}
    motions = {name: load_motion(f"{stem}.npz") for name, stem in stems.items()}
    plans = {name: Path(f"{stem}.plan.json") for name, stem in stems.items()}
    if ask.reference is not None:
        motions[REFERENCE_NAME] = first_frames(read_motion(ask.reference), result.num_frames)
    return Performance(
        speech=read_speech(ask.speech or ""),
        motions=motions,
        plans={name: read_plan(path) for name, path in plans.items() if path.is_file()},
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
        sound, out = speech_in(Path(held), speech), Path(held, "drawn.json")
        return make_plan(Ask(speech=sound, out=out, **_fields(Ask, asked))).plan


def _fields(of: type[Ask], asked: Mapping[str, Any]) -> dict[str, Any]:
    """With files named by text, too.

    Raises:
        RunError: if there is no such field.
    """
    known = {field.name for field in fields(of)}
    for name in asked:
        if name == "recognise_words":
            raise RunError('recognise_words=True is words="recognise" now.')
        if name not in known:
            raise RunError(
                f"There is no {name!r} to ask for; there are {', '.join(sorted(known))}."
            )
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
        asked: further fields of `app.run.videos.export.RenderAsk`, such as ``size``,
            ``views``, ``close_ups``, ``framing``, ``num_stills`` or ``sheet_every``.

    Returns:
        The files that were written.
    """
    out = Path(out)
    with TemporaryDirectory() as held, Bars(is_shown=progress, stays=False) as bars:
        sound = None if speech is None else speech_in(Path(held), speech)
        motions = (motion_in(Path(held), motion),)
        files, _ = render_motion(
            RenderAsk(motions=motions, out=out, speech=sound, **_fields(RenderAsk, asked)),
            bars.take,
        )
    return files
