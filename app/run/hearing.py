"""Does it hear? Several speeches with several noise seeds, and what each of the two decides."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from app.config import BUNDLED_WEIGHTS
from app.errors import RunError
from app.run.models import get_system
from app.run.request import file_stem
from app.run.result_folder import ResultFolder
from renderer.figures.style import MAX_SYSTEMS

if TYPE_CHECKING:
    from model.measures.hearing import Decided, Grid
    from model.motion.motion import Motion

MAX_SPEECHES, MAX_SEEDS = 8, 8
MAX_S = 60.0
"""Of each speech; the rest is not heard."""
_NAMED = re.compile(r"(?:(?P<system>.+?)__)?(?P<speech>.+?)__(?P<seed>\d{1,9})\.npz")


@dataclass(frozen=True)
class HearingRequest:
    """What is compared: motions that are generated here, or those of a folder."""

    out: Path
    speeches: tuple[Path, ...] = ()
    """Two or more; none where ``motions`` are given."""
    systems: tuple[str, ...] = ()
    seeds: int = 2
    """Noise seeds, from 0 on."""
    speaker: str | None = None
    guidance: float | None = None
    motions: Path | None = None
    """A folder of anyone's motion: ``[SYSTEM__]SPEECH__SEED.npz``."""
    weights: Path = BUNDLED_WEIGHTS
    max_speech_s: float = 600.0

    def __post_init__(self) -> None:
        if self.motions is not None:
            if self.speeches or self.systems:
                raise RunError("Give speeches and systems, or a folder of motions; not both.")
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
        if not 1 <= len(self.systems) <= MAX_SYSTEMS:
            raise RunError(
                f"One to {MAX_SYSTEMS} systems are compared at once; got {len(self.systems)}."
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


@dataclass(frozen=True)
class Hearing:
    """What was measured, and its files."""

    systems: tuple[Heard, ...]
    files: tuple[Path, ...]

    def sentences(self) -> tuple[str, ...]:
        """What the numbers say of each system's arms, for a person."""
        return tuple(
            f"{heard.system}: speech decides {_percent(heard.parts['arms'].by_speech)} of the arms'"
            f" speed and chance {_percent(heard.parts['arms'].by_noise)}; with the same noise and"
            f" other speech their rotations correlate {heard.arm_rotations_same_noise:.2f}."
            for heard in self.systems
        )


def measure_hearing(
    request: HearingRequest, on_progress: Callable[[float], None] = lambda share: None
) -> Hearing:
    """Generate each speech with each seed, or read what is in the folder; write numbers, the
    figure, and what was generated.

    Args:
        on_progress: told the share done before each motion; what it raises ends the work.

    Raises:
        RunError, SpeechError, MotionError, UnknownNameError, CheckpointError, WriteError: with a
            sentence.
    """
    from model.motion.motion import save_motion

    with ResultFolder(request.out) as folder:
        if request.motions is not None:
            grids, strengths = _read(request.motions), {}
        else:
            grids, strengths = _generated(request, on_progress)
            for system, grid in grids.items():
                for (speech, seed), motion in grid.items():
                    name = f"{file_stem(system)}__{speech}__{seed}.npz"
                    save_motion(motion, folder.path(name))
        on_progress(1.0)
        heard = tuple(_heard(system, grid, strengths.get(system)) for system, grid in grids.items())
        _write_numbers(heard, folder)
        _draw(heard, grids, folder)
        return Hearing(heard, folder.publish())


def _generated(
    request: HearingRequest, on_progress: Callable[[float], None]
) -> tuple[dict[str, Grid], dict[str, float]]:
    from model.generation.windows import GenerateOptions, generate_motion
    from model.speech.audio import SAMPLE_RATE, SpeechLimits, load_speech

    limits = SpeechLimits(max_s=request.max_speech_s)
    speeches = {path.stem: load_speech(path, limits) for path in request.speeches}
    systems = [get_system(name, request.weights) for name in dict.fromkeys(request.systems)]
    wanted = len(systems) * len(speeches) * request.seeds
    grids: dict[str, Grid] = {}
    strengths: dict[str, float] = {}
    for system in systems:
        grid: dict[tuple[str, int], Motion] = {}
        strength = None if system.guidance is None else request.guidance
        strengths[system.name] = system.strength(strength)
        for stem, whole in speeches.items():
            speech = replace(whole, waveform=whole.waveform[: int(MAX_S * SAMPLE_RATE)])
            for seed in range(request.seeds):
                on_progress((len(grids) * len(speeches) * request.seeds + len(grid)) / wanted)
                options = GenerateOptions(
                    request.speaker or next(iter(system.speakers)), seed=seed, guidance=strength
                )
                (grid[stem, seed],) = generate_motion(system, speech, options)
        grids[system.name] = grid
    return grids, strengths


def _read(folder: Path) -> dict[str, Grid]:
    """Motions of a folder, by what their names say."""
    from model.motion.motion import load_motion

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
        grid[named["speech"], int(named["seed"])] = load_motion(path)
    if not 1 <= len(grids) <= MAX_SYSTEMS:
        raise RunError(f"{folder} must hold 1 to {MAX_SYSTEMS} systems; found {len(grids)}.")
    return dict(grids)


def _heard(system: str, grid: Grid, guidance: float | None) -> Heard:
    from model.measures.hearing import arm_rotations_same_noise, decided

    try:
        parts = decided(grid)
    except ValueError as error:
        raise RunError(f"{system}: {error}") from error
    return Heard(system, guidance, parts, arm_rotations_same_noise(grid))


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
    from renderer.figures.hearing import HearingRow, hearing_figure

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
