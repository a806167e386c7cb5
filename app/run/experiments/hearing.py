"""Does it hear? Several speeches with several noise seeds, and what each decides.

Where a system is deaf, the bodies of one seed move alike, whatever the speech.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import Any

from app.errors import RunError
from app.run.ask import OnEvent, ShouldCancel
from app.run.made import options_of
from app.run.models import get_system
from app.run.output.run_folder import RunRecord
from app.run.run_writer import RunWriter, writing_run
from app.run.tasks import HearingAsk
from conventions.names import file_stem, short_names
from conventions.rates import SAMPLE_RATE
from model.evaluation.judges import calm_over_lively, manner_of
from model.formats.read import read_any_motion
from model.generation.base import System
from model.generation.windows import generate_motion
from model.measures.hearing import Decided, Grid, arm_rotations_same_noise, arm_speed, decided
from model.motion.motion import Motion, save_motion
from model.speech.audio import Speech, SpeechLimits, load_speech
from renderer.figures.curves import HEARING, HearingRow, draw_hearing
from renderer.figures.style import MAX_SYSTEMS

MAX_S = 60.0
"""Of each speech; the rest is not heard."""
COMPARED = "Compared {count} system{s}."
_NAMED = re.compile(r"(?:(?P<system>.+?)__)?(?P<speech>.+?)__(?P<seed>\d{1,9})\.npz")
_COLUMNS = ("same_speech", "same_noise", "neither", "by_speech", "by_noise")


@dataclass(frozen=True)
class _Made:
    """Motions of one system, by speech and seed."""

    grid: Grid
    guidance: float | None = None
    """With which it heard its speech; None where that is not known."""
    by_speaker: Grid = field(default_factory=dict)
    """Of the first speech, by speaker and seed."""


def measure_hearing(
    ask: HearingAsk,
    on_event: OnEvent = lambda event: None,
    should_cancel: ShouldCancel = lambda: False,
) -> None:
    """Generate each speech with each seed, or read what is in the folder; leave numbers, the
    figure, what the numbers say as notes, and what was generated.

    Raises:
        Cancelled: when ``should_cancel`` said so.
        RunError, SpeechError, MotionError, UnknownNameError, CheckpointError, WriteError: with a
            sentence.
    """
    ask.check()
    record = RunRecord(kind="given" if ask.is_of_motions else "generated", point=ask.joint)
    with writing_run(ask.out, record, on_event, should_cancel) as run:
        if ask.is_of_motions:
            of_system = {name: _Made(grid) for name, grid in _read(ask.speeches[0]).items()}
        else:
            of_system = _generated(ask, _speeches(ask), run.share("numbers"))
            for system, made in of_system.items():
                for (speech, seed), motion in made.grid.items():
                    path = run.folder.path(f"{file_stem(system)}__{speech}__{seed}.npz")
                    save_motion(motion, path)
                    run.file(path)
        run.share("numbers")(1.0)
        told = {system: _numbers(system, made, ask.speakers) for system, made in of_system.items()}
        labels = short_names(told)
        run.note(*(_sentence(labels[system], numbers) for system, numbers in told.items()))
        table = [
            (system, part, *shares.values())
            for system, numbers in told.items()
            for part, shares in numbers["parts"].items()
        ]
        run.table("hearing", told, [("system", "part", *_COLUMNS), *table])
        _draw(told, of_system, run)
        run.finish(COMPARED.format(count=len(told), s="s" if len(told) > 1 else ""))


def _speeches(ask: HearingAsk) -> dict[str, Speech]:
    """By name; no more of each than is heard."""
    limits = SpeechLimits(max_s=ask.max_speech_s)
    whole = {path.stem: load_speech(path, limits) for path in ask.speeches}
    heard = int(MAX_S * SAMPLE_RATE)
    return {
        name: replace(speech, waveform=speech.waveform[:heard]) for name, speech in whole.items()
    }


def _generated(
    ask: HearingAsk, speeches: Mapping[str, Speech], on_share: Callable[[float], None]
) -> dict[str, _Made]:
    systems = [get_system(name, ask.weights) for name in dict.fromkeys(ask.systems)]
    first, seeds, speakers = next(iter(speeches)), range(ask.seeds), ask.speakers or ()
    wanted = len(systems) * len(seeds) * (len(speeches) + len(speakers))
    done = count()

    def moved(system: System, speech: str, **asked: Any) -> Motion:
        on_share(next(done) / wanted)
        options = options_of(ask, system, **asked)
        (motion,) = generate_motion(system, speeches[speech], options)
        return motion

    return {
        system.name: _Made(
            {(name, seed): moved(system, name, seed=seed) for name in speeches for seed in seeds},
            options_of(ask, system).guidance,
            {
                (speaker, seed): moved(system, first, speaker=speaker, seed=seed)
                for speaker in speakers
                for seed in seeds
            },
        )
        for system in systems
    }


def _read(folder: Path) -> dict[str, Grid]:
    """Motions of a folder, by what their names say."""
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


def _numbers(system: str, made: _Made, speakers: tuple[str, str] | None) -> dict[str, Any]:
    """Of one system, as ``hearing.json`` has them."""

    def shares(found: Decided) -> dict[str, float]:
        return {column: getattr(found, column) for column in _COLUMNS}

    try:
        told = {
            "guidance": made.guidance,
            "arm_rotations_same_noise": arm_rotations_same_noise(made.grid),
            "parts": {part: shares(found) for part, found in decided(made.grid).items()},
        }
        if speakers is None:
            return told
        calm, lively = (
            [motion for (who, _), motion in made.by_speaker.items() if who == speaker]
            for speaker in speakers
        )
        compared = {
            "calm": speakers[0],
            "lively": speakers[1],
            "manner": manner_of(made.by_speaker),
            "calm_over_lively": calm_over_lively(calm, lively),
        }
    except ValueError as error:
        raise RunError(f"{system}: {error}") from error
    return {**told, "speakers": compared}


def _sentence(system: str, numbers: Mapping[str, Any]) -> str:
    """What the numbers say of the arms, for a person."""
    arms = numbers["parts"]["arms"]
    is_more = arms["by_speech"] > arms["by_noise"]
    hears = "It hears: speech decides more" if is_more else "It hears little: speech decides less"
    told = (
        f"{system}: speech decides {_percent(arms['by_speech'])} of the arms' speed and"
        f" chance {_percent(arms['by_noise'])}; with the same noise and other speech their"
        f" rotations correlate {numbers['arm_rotations_same_noise']:.2f}."
    )
    if "speakers" not in numbers:
        return f"{told} {hears} than chance."
    both = numbers["speakers"]
    calm, manner = both["calm"], both["manner"]
    return (
        f"{told} Of {calm} and {both['lively']}, the speaker decides"
        f" {_percent(manner['by_speaker'])} of the arms' speed; with the same noise and"
        f" speech their rotations correlate {manner['arm_rotations_same_noise']:.2f}, and"
        f" {calm}'s wrists move {both['calm_over_lively']:.2f} times as fast. {hears} than chance."
    )


def _draw(
    told: Mapping[str, Mapping[str, Any]], of_system: Mapping[str, _Made], run: RunWriter
) -> None:
    rows = [
        HearingRow(
            system,
            {key: arm_speed(motion) for key, motion in of_system[system].grid.items()},
            {
                part: (shares["by_speech"], shares["by_noise"])
                for part, shares in numbers["parts"].items()
            },
        )
        for system, numbers in told.items()
    ]
    run.figure("hearing", lambda: draw_hearing(rows), HEARING)


def _percent(share: float) -> str:
    return f"{min(max(share, 0.0), 1.0):.0%}"
