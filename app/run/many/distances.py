"""How far sets of motion are from the recorded set: by our encoder's codes, and by EMAGE's.

A clip's codes lie beside its record, since sums of their products would be as large. Sets are put
together clip by clip, all draws of the interval at once, so that memory does not grow with clips.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from app.errors import RunError
from conventions.names import REFERENCE_NAME
from model.storage.cards import BUNDLED_WEIGHTS
from model.storage.files import written_atomically

if TYPE_CHECKING:
    from model.evaluation.frechet import Moments
    from model.motion.motion import Motion
    from model.networks.autoencoder import FrozenEncoder
    from model.systems.autoencoders.emage import EmageEncoder

TITLE = "Distribution: FGD to the recorded set, our encoder"


def moments_of(motion: Motion) -> dict[str, Any]:
    """What is kept of one motion, so that any clips can be put together."""
    from model.evaluation.frechet import Moments, motion_features

    features = motion_features(_encoder(), motion)
    assert features is not None  # it sees no faces
    return Moments.of(features).kept()


def distance_rows(systems: list[str], numbers: list[dict[str, Any]]) -> Iterator[tuple[Any, ...]]:
    """As `_rows`; none without a recorded set, or where clips are too short (`why_left_out`)."""
    from model.evaluation.tables import bootstrap_of

    if REFERENCE_NAME not in systems or why_left_out(numbers):
        return
    sets = {name: _clips_of(name, numbers) for name in systems}
    recorded = sets.pop(REFERENCE_NAME)

    def between(*names: str) -> tuple[float, float, float]:
        """Of a system, or of the first less the second, over clips drawn with replacement."""
        found = bootstrap_of(
            _statistic(recorded, [sets[name] for name in names]), len(numbers), 200
        )
        return found.mean, found.low, found.high

    yield from _rows(TITLE, list(sets), len(numbers), between)


def _rows(
    title: str, names: list[str], clips: int, between: Callable[..., tuple[float, float, float]]
) -> Iterator[tuple[Any, ...]]:
    """As the other measures have them: of each system, and of each pair."""
    for place, name in enumerate(names):
        yield (title, "", name, clips, *between(name), *[""] * 4)
        for other in names[place + 1 :]:
            yield (title, "", name, clips, "", "", "", other, *between(name, other))


def why_left_out(numbers: list[dict[str, Any]]) -> str | None:
    """A sentence where the recorded set, and so each of as many frames, is too short to tell of."""
    if not all(REFERENCE_NAME in each["systems"] for each in numbers):
        return None
    from model.evaluation.frechet import Moments

    recorded = Moments.sum(_clips_of(REFERENCE_NAME, numbers))
    if recorded.tells:
        return None
    return (
        f"FGD is left out: all clips together have {recorded.count} codes, one for every 8 frames; "
        f"more than {len(recorded.total)} are needed."
    )


def _clips_of(name: str, numbers: list[dict[str, Any]]) -> list[Moments]:
    from model.evaluation.frechet import Moments

    return [Moments.of_kept(each["systems"][name]["codes"]) for each in numbers]


def _statistic(recorded: list[Moments], sets: list[list[Moments]]) -> Callable[[Any], float]:
    from model.evaluation.frechet import Moments, distance_of

    def drawn(clips: Sequence[Moments], index: Any) -> Moments:
        return Moments.sum([clips[i] for i in index])

    def statistic(index: Any) -> float:
        real = drawn(recorded, index)
        found = [distance_of(real, drawn(clips, index)) for clips in sets]
        return found[0] - found[1] if len(found) == 2 else found[0]

    return statistic


@cache
def _encoder() -> FrozenEncoder:
    """Read once by each process that measures."""
    from model.networks.autoencoder import load_encoder
    from model.systems.autoencoders import FGD_ENCODER

    return load_encoder(BUNDLED_WEIGHTS, FGD_ENCODER)


EMAGE_TITLE = "Distribution: FGD to the recorded set, EMAGE's encoder"
DRAWS = 200
LEAST_CODES = 241
"""One more than a code has numbers, so that a covariance has full rank."""
_CLIPS_AT_ONCE = 50


def check_weights(weights: Path | None, reference: Path | None) -> None:
    """See before anything is measured that the file is EMAGE's and of use.

    Raises:
        RunError: without a recorded set.
        CheckpointError: for any other file.
    """
    if weights is None:
        return
    if reference is None:
        raise RunError(
            "EMAGE's encoder tells how far a set is from the recorded one; give it, too "
            "(--reference FOLDER)."
        )
    _emage_encoder(weights.absolute())


def codes_path(record: Path) -> Path:
    """Of a clip, beside its record."""
    return record.with_suffix(".emage.npz")


def keep_codes(record: Path, weights: Path, motions: Mapping[str, Sequence[Motion]]) -> None:
    """Leave the codes of one clip's motions beside its record, whole or not at all; of each system
    those of all samples."""
    from model.systems.autoencoders.emage import emage_codes

    encoder = _emage_encoder(weights)
    codes = [
        np.concatenate([emage_codes(encoder, motion) for motion in motions[name]])
        for name in sorted(motions)
    ]
    with written_atomically(codes_path(record)) as temporary:
        np.savez(temporary, *codes)


@dataclass(frozen=True)
class EmageDistances:
    """Of all sets: what the tables say of them, or why they say nothing."""

    rows: tuple[tuple[Any, ...], ...] = ()
    note: str | None = None


def emage_distances(systems: Sequence[str], frames: Mapping[Path, int]) -> EmageDistances:
    """As `_rows`.

    Args:
        systems: the sets, the recorded one among them.
        frames: of each clip, by the path of its record, which has codes beside it.
    """
    from model.evaluation.tables import interval_of
    from model.systems.autoencoders.emage import FRAMES_A_CODE, WHOLE_FRAMES

    records = [record for record, count in frames.items() if count >= WHOLE_FRAMES]
    codes = sum(count // WHOLE_FRAMES for count in frames.values()) * WHOLE_FRAMES // FRAMES_A_CODE
    if codes < LEAST_CODES:
        return EmageDistances(
            note=(
                f"FGD by EMAGE's encoder is left out: all clips together have {codes} codes, one "
                f"for every {FRAMES_A_CODE} frames; at least {LEAST_CODES} are needed."
            )
        )
    recorded = _drawn_moments(sorted(systems).index(REFERENCE_NAME), records)
    sets = {
        name: _distances(recorded, _drawn_moments(sorted(systems).index(name), records))
        for name in systems
        if name != REFERENCE_NAME
    }

    def between(name: str, *other: str) -> tuple[float, float, float]:
        values = sets[name] - (sets[other[0]] if other else 0.0)
        found = interval_of(values[0], values[1:].tolist())
        return found.mean, found.low, found.high

    return EmageDistances(tuple(_rows(EMAGE_TITLE, list(sets), len(records), between)))


def _distances(recorded: list[Moments], made: list[Moments]) -> Float[np.ndarray, " all_draws"]:
    from model.evaluation.frechet import distance_of
    from model.systems.autoencoders.emage import ROOT_OFFSET

    pairs = zip(recorded, made, strict=True)
    return np.array([distance_of(real, each, ROOT_OFFSET) for real, each in pairs])


def _drawn_moments(index: int, records: Sequence[Path]) -> list[Moments]:
    """Of all clips, and then of the clips of each draw; of one set, by its place in the files."""
    from model.evaluation.frechet import Moments
    from model.evaluation.tables import drawn_clips
    from model.systems.autoencoders.emage import CODE_DIM

    drawn = [np.bincount(each, minlength=len(records)) for each in drawn_clips(len(records), DRAWS)]
    times = np.array([np.ones(len(records)), *drawn])
    upper = np.triu_indices(CODE_DIM)
    sums = np.zeros((len(times), 1 + CODE_DIM + len(upper[0])))
    for start in range(0, len(records), _CLIPS_AT_ONCE):
        rows = []
        for record in records[start : start + _CLIPS_AT_ONCE]:
            with np.load(codes_path(record), allow_pickle=False) as file:
                clip = Moments.of(file[f"arr_{index}"].astype(np.float64))
            rows.append(np.concatenate([[clip.count], clip.total, clip.products[upper]]))
        sums += times[:, start : start + _CLIPS_AT_ONCE] @ np.array(rows)
    keys = ("count", "total", "products")
    parts = [(int(row[0]), *np.split(row[1:], [CODE_DIM])) for row in sums]
    return [Moments.of_kept(dict(zip(keys, part, strict=True))) for part in parts]


@cache
def _emage_encoder(weights: Path) -> EmageEncoder:
    """Read once by each process that measures."""
    from model.systems.autoencoders.emage import load_emage_encoder

    return load_emage_encoder(weights)
