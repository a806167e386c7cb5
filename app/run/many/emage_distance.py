"""How far sets of motion are from the recorded set by EMAGE's encoder, as papers on BEAT2 tell it.

A clip's codes lie beside its record, since sums of their products would be as large. Sets are put
together clip by clip, all draws of the interval at once, so that memory does not grow with clips.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from app.errors import RunError
from conventions.names import REFERENCE_NAME
from model.storage.files import written_atomically

if TYPE_CHECKING:
    from model.evaluation.frechet import Moments
    from model.motion.motion import Motion
    from model.systems.autoencoders.emage import EmageEncoder

TITLE = "Distribution: FGD to the recorded set, EMAGE's encoder"
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
        raise RunError("EMAGE's encoder tells how far a set is from the recorded one; give it, too "
                       "(--reference FOLDER).")  # fmt: skip
    _encoder(weights.absolute())


def codes_path(record: Path) -> Path:
    """Of a clip, beside its record."""
    return record.with_suffix(".emage.npz")


def keep_codes(record: Path, weights: Path, motions: Mapping[str, Motion]) -> None:
    """Leave the codes of one clip's motions beside its record, whole or not at all."""
    from model.systems.autoencoders.emage import emage_codes

    codes = [emage_codes(_encoder(weights), motions[name]) for name in sorted(motions)]
    with written_atomically(codes_path(record)) as temporary:
        np.savez(temporary, *codes)


@dataclass(frozen=True)
class EmageDistances:
    """Of all sets: what the tables say of them, or why they say nothing."""

    rows: tuple[tuple[Any, ...], ...] = ()
    note: str | None = None


def emage_distances(systems: Sequence[str], frames: Mapping[Path, int]) -> EmageDistances:
    """Rows as the other measures have them, of each set and of each pair.

    Args:
        systems: the sets, the recorded one among them.
        frames: of each clip, by the path of its record, which has codes beside it.
    """
    from model.systems.autoencoders.emage import FRAMES_A_CODE, WHOLE_FRAMES

    records = [record for record, count in frames.items() if count >= WHOLE_FRAMES]
    codes = sum(count // WHOLE_FRAMES for count in frames.values()) * WHOLE_FRAMES // FRAMES_A_CODE
    if codes < LEAST_CODES:
        return EmageDistances(note=(
            f"FGD by EMAGE's encoder is left out: all clips together have {codes} codes, one for "
            f"every {FRAMES_A_CODE} frames; at least {LEAST_CODES} are needed."
        ))  # fmt: skip
    recorded = _drawn_moments(sorted(systems).index(REFERENCE_NAME), records)
    sets = {
        name: _distances(recorded, _drawn_moments(sorted(systems).index(name), records))
        for name in systems
        if name != REFERENCE_NAME
    }
    return EmageDistances(tuple(_rows(sets, len(records))))


def _rows(sets: Mapping[str, Float[np.ndarray, " all_draws"]], clips: int) -> Iterator[Any]:
    from model.evaluation.tables import interval_of

    def told(values: Float[np.ndarray, " all_draws"]) -> tuple[float, float, float]:
        found = interval_of(values[0], values[1:].tolist())
        return found.mean, found.low, found.high

    names = list(sets)
    for place, name in enumerate(names):
        yield (TITLE, "", name, clips, *told(sets[name]), *[""] * 4)
        for other in names[place + 1 :]:
            difference = (other, *told(sets[name] - sets[other]))
            yield (TITLE, "", name, clips, "", "", "", *difference)


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
def _encoder(weights: Path) -> EmageEncoder:
    """Read once by each process that measures."""
    from model.systems.autoencoders.emage import load_emage_encoder

    return load_emage_encoder(weights)
