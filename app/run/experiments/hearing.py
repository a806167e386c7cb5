"""Does it hear? Several speeches with several noise seeds, what each decides, and videos of it.

Under the sound of one speech, the two bodies that were made of it should fit and the two others
should not; where a system is deaf, the bodies of one seed move alike instead.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from app.errors import RunError
from app.flags import written
from app.run.body_motion import in_register
from app.run.followed_point import choose_tip_source
from app.run.made import options_of
from app.run.models import get_body, get_system
from app.run.output.result_folder import ResultFolder
from app.run.output.telling import share_teller
from app.run.requests.display import Display
from app.run.requests.request import Ask, OnEvent, ShouldCancel
from app.run.videos.videos import VideoOptions, draw_videos, jobs_of
from conventions.names import file_stem, short_names
from renderer.figures.style import MAX_SYSTEMS

if TYPE_CHECKING:
    from model.evaluation.speakers import OfSpeaker
    from model.measures.hearing import Decided, Grid
    from model.motion.motion import Motion
    from model.speech.audio import Speech

SHOWN_S = 20.0
SIZE_PX = 480
EACH_WAY = 2
"""Speeches and seeds that are shown."""


def draw_hearing_videos(
    grids: Mapping[str, Grid],
    speeches: Mapping[str, Speech],
    folder: ResultFolder,
    on_share: Callable[[float], None],
) -> None:
    """``SYSTEM__SPEECH.mp4`` for each system and each of the first two speeches, of which it has
    the sound.

    Args:
        grids: by system, motions by speech and seed.
        on_share: told the share of all frames done; what it raises ends the work.

    Raises:
        BodyError, GLError, VideoError: see `app.run.videos.videos.draw_videos`.
    """
    from conventions.rates import FPS, SAMPLE_RATE
    from model.motion.motion import first_frames
    from model.speech.audio import write_wav
    from renderer.video.compose import compose_videos

    names = list(speeches)[:EACH_WAY]
    seconds = min(SHOWN_S, *(speeches[name].duration_s for name in names))
    drawn = folder.scratch("bodies")
    drawn.mkdir()
    shown, files = {}, {}
    for system, grid in grids.items():
        for (speech, seed), motion in grid.items():
            if speech in names and seed < EACH_WAY:
                name = f"{file_stem(system)}__{speech}__{seed}"
                part = first_frames(motion, min(motion.num_frames, round(seconds * FPS)))
                shown[name] = in_register(part)
                files[system, speech, seed] = drawn / f"{name}.mp4"
    body = get_body(None)
    jobs = jobs_of(
        *(shown, VideoOptions(Display(), SIZE_PX, "knees", ()), body, None),
        *(choose_tip_source(body, None), lambda name, _: drawn / f"{name}.mp4"),
    )
    draw_videos(jobs, on_share)
    for sounding in names:
        sound = drawn / f"{sounding}.wav"
        write_wav(sound, speeches[sounding].waveform[: round(seconds * SAMPLE_RATE)])
        for system in grids:
            own = {key: path for key, path in files.items() if key[0] == system}
            labels = [f"{speech}, seed {seed}" for _, speech, seed in own]
            out = folder.path(f"{file_stem(system)}__{sounding}.mp4")
            compose_videos(list(own.values()), labels, out, sound)


MAX_SPEECHES, MAX_SEEDS = 8, 8
MAX_S = 60.0
"""Of each speech; the rest is not heard."""
_GENERATED_BEFORE_VIDEOS = 0.3
"""Share of the work."""
_NAMED = re.compile(r"(?:(?P<system>.+?)__)?(?P<speech>.+?)__(?P<seed>\d{1,9})\.npz")


def _two_names(written: str) -> tuple[str, str]:
    calm, comma, lively = written.partition(",")
    if not (calm and comma and lively) or calm == lively:
        raise RunError(f"it takes two names, CALM,LIVELY; got {written!r}.")
    return calm, lively


TwoSpeakers = Annotated[
    tuple[str, str] | None, written(_two_names, "CALM,LIVELY", "none", ",".join)
]


@dataclass(frozen=True, kw_only=True)
class HearingAsk:
    """A run of which speech and noise vary; or of motions, a folder of anyone's:
    ``[SYSTEM__]SPEECH__SEED.npz``."""

    ask: Ask
    """Has videos of the first two speeches and seeds, under the sound of either."""
    speeches: tuple[Path, ...] = ()
    """Two or more; none where motions are given."""
    seeds: int = 2
    """Noise seeds, from 0 on."""
    speakers: TwoSpeakers = None
    """Two whose manner is compared on the first speech, too, such as hana,june."""

    def __post_init__(self) -> None:
        count = len(self.ask.systems)
        if self.ask.motions:
            if self.speeches or count:
                raise RunError("Give speeches and systems, or a folder of motions; not both.")
            if self.speakers or self.ask.has_video:
                raise RunError("A folder of motions tells no speakers and no sound to draw with.")
            return
        if not 2 <= len(self.speeches) <= MAX_SPEECHES:
            raise RunError(
                f"Two to {MAX_SPEECHES} speeches are compared; got {len(self.speeches)}."
            )
        stems = [path.stem for path in self.speeches]
        if len(set(stems)) < len(stems):
            raise RunError("Two of the speeches have one name; rename one of the files.")
        if not 2 <= self.seeds <= MAX_SEEDS:
            raise RunError(f"Noise seeds must be 2 to {MAX_SEEDS}; got {self.seeds}.")
        if not 1 <= count <= MAX_SYSTEMS:
            raise RunError(f"One to {MAX_SYSTEMS} systems are compared at once; got {count}.")


@dataclass(frozen=True)
class Compared:
    """What was found of two speakers under one speech."""

    calm: str
    lively: str
    manner: OfSpeaker
    calm_over_lively: float
    """Speed of the wrists."""

    def sentence(self) -> str:
        """For a person."""
        return (
            f"Of {self.calm} and {self.lively}, the speaker decides"
            f" {_percent(self.manner.by_speaker)} of the arms' speed; with the same noise and"
            f" speech their rotations correlate {self.manner.arm_rotations_same_noise:.2f}, and"
            f" {self.calm}'s wrists move {self.calm_over_lively:.2f} times as fast."
        )


@dataclass(frozen=True)
class Heard:
    """What was found of one system."""

    system: str
    guidance: float | None
    """With which it heard its speech; None where that is not known."""
    parts: Mapping[str, Decided]
    """By part of the body."""
    arm_rotations_same_noise: float
    """Correlation of arm rotations between other speeches with the same noise."""
    compared: Compared | None = None
    """None where no speakers were asked for."""

    def sentence(self) -> str:
        """What the numbers say of the arms, for a person."""
        arms = self.parts["arms"]
        is_more = arms.by_speech > arms.by_noise
        hears = (
            "It hears: speech decides more" if is_more else "It hears little: speech decides less"
        )
        told = (
            f"{self.system}: speech decides {_percent(arms.by_speech)} of the arms' speed and"
            f" chance {_percent(arms.by_noise)}; with the same noise and other speech their"
            f" rotations correlate {self.arm_rotations_same_noise:.2f}."
            f" {hears} than chance."
        )
        return told if self.compared is None else f"{told} {self.compared.sentence()}"


@dataclass(frozen=True)
class Hearing:
    """What was measured, and its files."""

    systems: tuple[Heard, ...]
    files: tuple[Path, ...]

    def sentences(self) -> tuple[str, ...]:
        """What the numbers say of each system, for a person."""
        labels = short_names(heard.system for heard in self.systems)
        return tuple(replace(each, system=labels[each.system]).sentence() for each in self.systems)


def measure_hearing(
    asked: HearingAsk,
    on_event: OnEvent = lambda event: None,
    should_cancel: ShouldCancel = lambda: False,
) -> Hearing:
    """Generate each speech with each seed, or read what is in the folder; write numbers, the
    figure, and what was generated.

    Raises:
        CancelledRun: when ``should_cancel`` said so.
        RunError, SpeechError, MotionError, UnknownNameError, CheckpointError, WriteError: with a
            sentence.
    """
    from model.motion.motion import save_motion

    on_progress = share_teller("numbers", on_event, should_cancel)
    generated = _GENERATED_BEFORE_VIDEOS if asked.ask.has_video else 1.0
    with ResultFolder(asked.ask.out) as folder:
        if asked.ask.motions:
            (given,) = asked.ask.motions
            of_system = {name: _Made(grid) for name, grid in _read(given).items()}
        else:
            speeches = _speeches(asked)
            of_system = _generated(asked, speeches, lambda share: on_progress(generated * share))
            for system, made in of_system.items():
                for (speech, seed), motion in made.grid.items():
                    name = f"{file_stem(system)}__{speech}__{seed}.npz"
                    save_motion(motion, folder.path(name))
            if asked.ask.has_video:
                draw_hearing_videos(
                    {system: made.grid for system, made in of_system.items()},
                    speeches,
                    folder,
                    lambda share: on_progress(generated + (1 - generated) * share),
                )
        on_progress(1.0)
        heard = tuple(_heard(system, made, asked.speakers) for system, made in of_system.items())
        _write_numbers(heard, folder)
        _draw(heard, {system: made.grid for system, made in of_system.items()}, folder)
        return Hearing(heard, folder.publish())


@dataclass(frozen=True)
class _Made:
    """Motions of one system."""

    grid: Grid
    guidance: float | None = None
    by_speaker: Grid = field(default_factory=dict)
    """Of the first speech, by speaker and seed."""


def _speeches(asked: HearingAsk) -> dict[str, Speech]:
    """By name; no more of each than is heard."""
    from conventions.rates import SAMPLE_RATE
    from model.speech.audio import SpeechLimits, load_speech

    limits = SpeechLimits(max_s=asked.ask.max_speech_s)
    whole = {path.stem: load_speech(path, limits) for path in asked.speeches}
    heard = int(MAX_S * SAMPLE_RATE)
    return {
        name: replace(speech, waveform=speech.waveform[:heard]) for name, speech in whole.items()
    }


def _generated(
    asked: HearingAsk,
    speeches: Mapping[str, Speech],
    on_progress: Callable[[float], None],
) -> dict[str, _Made]:
    from model.generation.windows import generate_motion

    ask = asked.ask
    systems = [get_system(name, ask.weights) for name in dict.fromkeys(ask.systems)]
    seeds = range(asked.seeds)
    of_system: dict[str, _Made] = {}
    first = next(iter(speeches))
    grid_keys = [(name, seed) for name in speeches for seed in seeds]
    speaker_keys = [(speaker, seed) for speaker in asked.speakers or () for seed in seeds]
    wanted = len(systems) * (len(grid_keys) + len(speaker_keys))
    done = 0
    for system in systems:
        own = options_of(ask, system)
        wishes = [(name, own.speaker, seed) for name, seed in grid_keys]
        wishes += [(first, speaker, seed) for speaker, seed in speaker_keys]
        moved: list[Motion] = []
        for name, speaker, seed in wishes:
            on_progress(done / wanted)
            done += 1
            options = replace(own, speaker=speaker, seed=seed)
            moved += generate_motion(system, speeches[name], options)
        of_system[system.name] = _Made(
            dict(zip(grid_keys, moved, strict=False)),
            own.guidance,
            dict(zip(speaker_keys, moved[len(grid_keys) :], strict=True)),
        )
    return of_system


def _read(folder: Path) -> dict[str, Grid]:
    """Motions of a folder, by what their names say."""
    from model.formats.read import read_any_motion

    if not folder.is_dir():
        raise RunError(f"{folder} is no folder; name one with files SYSTEM__SPEECH__SEED.npz.")
    grids: dict[str, dict[tuple[str, int], Motion]] = {}
    for path in sorted(folder.glob("*.npz")):
        named = _NAMED.fullmatch(path.name)
        if named is None:
            raise RunError(
                f"{path.name} must be called SYSTEM__SPEECH__SEED.npz or SPEECH__SEED.npz, with two"
                " underscores between, so that it is known what it was made of."
            )
        grid = grids.setdefault(named["system"] or folder.name, {})
        grid[named["speech"], int(named["seed"])] = read_any_motion(path).motion
    if not 1 <= len(grids) <= MAX_SYSTEMS:
        raise RunError(f"{folder} must hold 1 to {MAX_SYSTEMS} systems; found {len(grids)}.")
    return dict(grids)


def _heard(system: str, made: _Made, speakers: tuple[str, str] | None) -> Heard:
    from model.measures.hearing import arm_rotations_same_noise, decided

    try:
        parts = decided(made.grid)
        compared = None if speakers is None else _compared(made.by_speaker, *speakers)
    except ValueError as error:
        raise RunError(f"{system}: {error}") from error
    return Heard(system, made.guidance, parts, arm_rotations_same_noise(made.grid), compared)


def _compared(motions: Grid, calm: str, lively: str) -> Compared:
    from model.evaluation.speakers import calm_over_lively, manner_of

    own = ([motion for (who, _), motion in motions.items() if who == s] for s in (calm, lively))
    return Compared(calm, lively, manner_of(motions), calm_over_lively(*own))


def _write_numbers(heard: tuple[Heard, ...], folder: ResultFolder) -> None:
    from model.storage.harmless import csv_text

    told = {
        each.system: {
            "guidance": each.guidance,
            "arm_rotations_same_noise": each.arm_rotations_same_noise,
            "parts": {
                part: asdict(found) | {"by_speech": found.by_speech, "by_noise": found.by_noise}
                for part, found in each.parts.items()
            },
        }
        | ({} if each.compared is None else {"speakers": asdict(each.compared)})
        for each in heard
    }
    folder.path("hearing.json").write_text(json.dumps(told, indent=1) + "\n")
    columns = ("same_speech", "same_noise", "neither", "by_speech", "by_noise")
    rows: list[list[object]] = [["system", "part", *columns]]
    rows += [
        [each.system, part, *(getattr(found, column) for column in columns)]
        for each in heard
        for part, found in each.parts.items()
    ]
    folder.path("hearing.csv").write_text(csv_text(rows), newline="")


def _draw(heard: tuple[Heard, ...], grids: Mapping[str, Grid], folder: ResultFolder) -> None:
    from model.measures.hearing import arm_speed
    from renderer.figures.curves import HearingRow, hearing_figure

    rows = [
        HearingRow(
            each.system,
            {key: arm_speed(motion) for key, motion in grids[each.system].items()},
            {part: (found.by_speech, found.by_noise) for part, found in each.parts.items()},
        )
        for each in heard
    ]
    for file in hearing_figure(rows, folder.path("hearing.png").with_suffix("")):
        folder.path(file.name)


def _percent(share: float) -> str:
    return f"{min(max(share, 0.0), 1.0):.0%}"
