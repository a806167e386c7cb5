"""Plans of every kind, drawn by hypothesis."""

from itertools import pairwise

from hypothesis import strategies as st

from model.plan.plan import (
    PHASES,
    SIDES,
    Blink,
    Brow,
    Gaze,
    GesturePlan,
    HandPhase,
    Nod,
    Planted,
    Smile,
    Stand,
)

NAMES = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), max_size=12)


def _times(most: int) -> st.SearchStrategy[list[float]]:
    """Rising, 20 ms apart at least."""
    steps = st.lists(st.integers(20, 900), max_size=most)
    return steps.map(lambda gaps: [sum(gaps[: k + 1]) / 1000 for k in range(len(gaps))])


def _numbers(least: float, most: float) -> st.SearchStrategy[float]:
    return st.floats(least, most).map(lambda number: round(number, 4))


@st.composite
def plans(draw: st.DrawFn) -> GesturePlan:
    """Times in whole milliseconds and numbers of four decimals, which every file can hold."""

    def spans(most: int) -> list[tuple[float, float]]:
        times = draw(_times(2 * most))
        pairs = list(zip(times[::2], times[1::2], strict=False))
        is_tight = draw(st.booleans())
        return [(a, c) for (a, _), (c, _) in pairwise(pairs)] if is_tight else pairs

    def hand() -> tuple[HandPhase, ...]:
        return tuple(
            HandPhase(a, b, draw(st.sampled_from(PHASES)),
                      (draw(_numbers(-1, 1)), draw(_numbers(-1, 1)), draw(_numbers(-1, 1))),
                      draw(NAMES), draw(NAMES))
            for a, b in spans(5)
        )  # fmt: skip

    return GesturePlan(
        duration_s=draw(_numbers(0.5, 20)),
        left=hand(),
        right=hand(),
        nods=tuple(Nod(at, draw(_numbers(0, 9))) for at in draw(_times(3))),
        looks=tuple(
            Gaze(a, b, draw(_numbers(-30, 30)), draw(_numbers(-9, 9))) for a, b in spans(3)
        ),
        brows=tuple(Brow(at, draw(_numbers(-1, 1))) for at in draw(_times(3))),
        smiles=tuple(Smile(a, b, draw(_numbers(0, 1))) for a, b in spans(2)),
        blinks=tuple(Blink(at) for at in draw(_times(3))),
        stands=tuple(Stand(a, b, draw(st.sampled_from(["left", "both"]))) for a, b in spans(2)),
        planted=tuple(Planted(a, b, side) for side in SIDES for a, b in spans(2)),
    )
