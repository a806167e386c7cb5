"""How far sets of motion are from the recorded set, as Fréchet distances of our encoder's codes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from conventions.names import REFERENCE_NAME
from model.storage.cards import BUNDLED_WEIGHTS

if TYPE_CHECKING:
    from model.evaluation.frechet import Moments
    from model.motion.motion import Motion
    from model.networks.autoencoder import FrozenEncoder

TITLE = "Distribution: FGD to the recorded set, our encoder"


def moments_of(motion: Motion) -> dict[str, Any]:
    """What is kept of one motion, so that any clips can be put together."""
    from model.evaluation.frechet import Moments, motion_features

    features = motion_features(_encoder(), motion)
    assert features is not None  # it sees no faces
    return Moments.of(features).kept()


def distance_rows(systems: list[str], numbers: list[dict[str, Any]]) -> Iterator[tuple[Any, ...]]:
    """Rows as the other measures have them: of each system, and of each pair. None without a
    recorded set, or where clips are too short (`why_left_out`)."""
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

    generated = list(sets)
    for place, name in enumerate(generated):
        yield (TITLE, "", name, len(numbers), *between(name), *[""] * 4)
        for other in generated[place + 1 :]:
            difference = (other, *between(name, other))
            yield (TITLE, "", name, len(numbers), "", "", "", *difference)


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
    from model.systems.autoencoders.config import FGD_ENCODER

    return load_encoder(BUNDLED_WEIGHTS, FGD_ENCODER)
