import numpy as np
import pytest

from app.study.statistics.means import Level, krippendorff_alpha

# Krippendorff 2011, "Computing Krippendorff's Alpha-Reliability", example C: four observers.
PUBLISHED = """
1 2 3 3 2 1 4 1 2 . . .
1 2 3 3 2 2 4 1 2 5 . 3
. 3 3 3 2 3 4 2 2 5 1 .
1 2 3 3 2 4 4 1 2 5 1 .
"""


def published_units() -> list[list[float]]:
    columns = zip(*(line.split() for line in PUBLISHED.strip().splitlines()), strict=True)
    return [[float(value) for value in column if value != "."] for column in columns]


@pytest.mark.parametrize(
    ("level", "alpha"), [("nominal", 0.743), ("ordinal", 0.815), ("interval", 0.849)]
)
def test_the_published_example_comes_out(level: Level, alpha: float) -> None:
    assert krippendorff_alpha(published_units(), level) == pytest.approx(alpha, abs=5e-4)


def test_agreement_is_one_chance_is_none_and_contradiction_is_negative() -> None:
    assert krippendorff_alpha([[1, 1, 1], [2, 2, 2]], "nominal") == 1
    rng = np.random.default_rng(0)
    by_chance = rng.integers(0, 3, (400, 5)).astype(float)
    assert krippendorff_alpha(list(by_chance), "ordinal") == pytest.approx(0, abs=0.03)
    assert krippendorff_alpha([[0, 1]] * 10, "nominal") == pytest.approx(-0.9, abs=1e-9)


def test_nothing_to_agree_on_has_no_alpha() -> None:
    assert krippendorff_alpha([[1], [2]], "nominal") is None
    assert krippendorff_alpha([[1, 1], [1, 1]], "interval") is None
    assert krippendorff_alpha([], "ordinal") is None
