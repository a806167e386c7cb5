"""How far sets of motion are from the recorded set: by our encoder's codes, and by EMAGE's.

A clip's codes lie beside its record, since sums of their products would be as large. Sets are put
together clip by clip, all draws of the interval at once, so that memory does not grow with clips.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.errors import RunError
from conventions.names import REFERENCE_NAME
from model.storage.cards import BUNDLED_WEIGHTS
from model.storage.files import written_atomically

if TYPE_CHECKING:
    from model.evaluation.frechet import Moments
    from model.motion.motion import Motion
    from model.networks.autoencoder import FrozenEncoder
    from model.systems.helpers.emage import EmageEncoder

TITLE = "Distribution: FGD to the recorded set, our encoder"


def moments_of(motion: Motion) -> dict[str, Any]:
    """What is kept of one motion, so that any clips can be put together."""
    from model.evaluation.frechet import Moments, motion_features

    features = motion_features(_encoder(), motion)
    assert features is not None  # it sees no faces
    return Moments.of(features).kept()


def distance_rows(systems: list[str], numbers: list[dict[str, Any]]) -> Iterator[tuple[Any, ...]]:
    """As `_rows`; none without a recorded set, or where clips are too short (`why_left_out`)."""
    if REFERENCE_NAME in systems and not why_left_out(numbers):
        yield from _rows(TITLE, systems, len(numbers), lambda name: _clips_of(name, numbers))


def _rows(
    title: str,
    systems: Sequence[str],
    num_clips: int,
    clips: Callable[[str], Iterator[Moments]],
    offset: float = 0.0,
) -> Iterator[tuple[Any, ...]]:
    """As the other measures have them: of each system, and of each pair.

    Args:
        clips: of a set, one after the other.
        offset: of `distance_of`.
    """
    from model.evaluation.frechet import distance_of
    from model.evaluation.tables import interval_of

    recorded = _drawn(clips(REFERENCE_NAME), num_clips)
    apart = {
        name: np.array([
            distance_of(real, made, offset)
            for real, made in zip(recorded, _drawn(clips(name), num_clips), strict=True)
        ])
        for name in systems
        if name != REFERENCE_NAME
    }  # fmt: skip

    def told(values: np.ndarray) -> tuple[float, float, float]:
        found = interval_of(values[0], values[1:])
        return found.mean, found.low, found.high

    names = list(apart)
    for place, name in enumerate(names):
        yield (title, "", name, num_clips, *told(apart[name]), *[""] * 4)
        for other in names[place + 1 :]:
            difference = told(apart[name] - apart[other])
            yield (title, "", name, num_clips, "", "", "", other, *difference)


def _drawn(clips: Iterator[Moments], num_clips: int) -> list[Moments]:
    """Of all clips, and then of those of each draw."""
    from model.evaluation.frechet import Moments
    from model.evaluation.tables import drawn_clips

    drawn = [np.bincount(each, minlength=num_clips) for each in drawn_clips(num_clips, DRAWS)]
    times = np.array([np.ones(num_clips), *drawn])
    sums: Any = 0.0
    dim = 0
    for start in range(0, num_clips, _CLIPS_AT_ONCE):
        rows = []
        for clip in islice(clips, _CLIPS_AT_ONCE):
            upper = np.triu_indices(len(clip.total))
            rows.append(np.concatenate([[clip.count], clip.total, clip.products[upper]]))
            dim = len(clip.total)
        sums = sums + times[:, start : start + _CLIPS_AT_ONCE] @ np.array(rows)
    keys = ("count", "total", "products")
    parts = [(round(row[0]), *np.split(row[1:], [dim])) for row in sums]
    return [Moments.of_kept(dict(zip(keys, part, strict=True))) for part in parts]


def why_left_out(numbers: list[dict[str, Any]]) -> str | None:
    """A sentence where the recorded set, and so each of as many frames, is too short to tell of."""
    if not all(REFERENCE_NAME in each["systems"] for each in numbers):
        return None
    from model.evaluation.frechet import Moments

    recorded = Moments.sum(list(_clips_of(REFERENCE_NAME, numbers)))
    if recorded.tells:
        return None
    return (
        f"FGD is left out: all clips together have {recorded.count} codes, one for every 8 frames; "
        f"more than {len(recorded.total)} are needed."
    )


def _clips_of(name: str, numbers: list[dict[str, Any]]) -> Iterator[Moments]:
    from model.evaluation.frechet import Moments

    return (Moments.of_kept(each["systems"][name]["codes"]) for each in numbers)


@cache
def _encoder() -> FrozenEncoder:
    """Read once by each process that measures."""
    from model.networks.autoencoder import load_encoder
    from model.systems.helpers.config import FGD_ENCODER

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
    from model.systems.helpers.emage import emage_codes

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
    from model.evaluation.frechet import Moments
    from model.systems.helpers.emage import FRAMES_A_CODE, ROOT_OFFSET, WHOLE_FRAMES

    records = [record for record, count in frames.items() if count >= WHOLE_FRAMES]
    codes = sum(count // WHOLE_FRAMES for count in frames.values()) * WHOLE_FRAMES // FRAMES_A_CODE
    if codes < LEAST_CODES:
        return EmageDistances(
            note=(
                f"FGD by EMAGE's encoder is left out: all clips together have {codes} codes, one "
                f"for every {FRAMES_A_CODE} frames; at least {LEAST_CODES} are needed."
            )
        )

    def clips(name: str) -> Iterator[Moments]:
        place = sorted(systems).index(name)
        for record in records:
            with np.load(codes_path(record), allow_pickle=False) as file:
                yield Moments.of(file[f"arr_{place}"].astype(np.float64))

    return EmageDistances(tuple(_rows(EMAGE_TITLE, systems, len(records), clips, ROOT_OFFSET)))


@cache
def _emage_encoder(weights: Path) -> EmageEncoder:
    """Read once by each process that measures."""
    from model.systems.helpers.emage import load_emage_encoder

    return load_emage_encoder(weights)
