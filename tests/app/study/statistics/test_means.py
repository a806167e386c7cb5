import numpy as np
import pytest
from scipy import stats

from app.study.statistics.means import compare_means
from app.study.statistics.votes import Values, ranks, ratings
from tests.app.study.made import made_key, made_participants


def values_of(table: np.ndarray) -> Values:
    """Values from (R, C, K)."""
    rater, clip, system = np.indices(table.shape)
    return Values(rater.ravel(), clip.ravel(), system.ravel(), table.ravel().astype(float))


def test_means_and_tests_are_over_participants() -> None:
    rng = np.random.default_rng(0)
    table = rng.normal([0.0, 0.6, 0.1], 1, (16, 5, 3))
    found = compare_means(values_of(table), 3)
    assert found is not None
    means = table.mean(1)
    assert found.mean == pytest.approx(means.mean(0))
    assert found.friedman_p == pytest.approx(stats.friedmanchisquare(*means.T).pvalue)
    assert found.pairs[0].p == pytest.approx(stats.wilcoxon(means[:, 0] - means[:, 1]).pvalue)
    smallest = min(pair.p for pair in found.pairs)
    assert min(pair.p_holm for pair in found.pairs) == pytest.approx(3 * smallest)


def test_the_bootstrap_interval_is_about_students() -> None:
    table = np.random.default_rng(1).normal(50, 10, (28, 1, 2))
    found = compare_means(values_of(table), 2)
    assert found is not None
    half = stats.t.ppf(0.975, 27) * table[:, 0, 0].std(ddof=1) / np.sqrt(28)
    width = found.intervals[0].high - found.intervals[0].low
    assert width == pytest.approx(2 * half, rel=0.08)
    assert found.friedman_p is None


def test_equal_systems_are_not_told_apart() -> None:
    found = compare_means(values_of(np.full((6, 2, 3), 2.0)), 3)
    assert found is not None
    assert found.friedman_p == 1.0
    assert [pair.p for pair in found.pairs] == [1.0, 1.0, 1.0]


def test_who_did_not_judge_every_system_has_no_mean() -> None:
    values = values_of(np.arange(12.0).reshape(2, 2, 3))
    rows = ~((values.rater == 1) & (values.system == 2))
    partial = Values(*(column[rows] for column in vars(values).values()))
    found = compare_means(partial, 3)
    assert found is not None
    assert found.num_raters == 1
    assert found.mean == pytest.approx([1.5, 2.5, 3.5])
    assert compare_means(Values(*(c[:0] for c in vars(values).values())), 3) is None


def test_places_and_ratings_follow_the_blind_ids() -> None:
    key = made_key("ranking")
    (one,) = made_participants(key, 1)
    answer = next(answer for answer in one.answers if answer.trial == "clip2/0")
    found = ranks([one], key, "realism")
    rows = found.clip == 2
    place = {key.systems[s]: v for s, v in zip(found.system[rows], found.value[rows], strict=True)}
    assert [f"clip2-{name}" for name in sorted(place, key=place.__getitem__)] == answer.value

    key = made_key("rating")
    (one,) = made_participants(key, 1)
    answer = next(answer for answer in one.answers if answer.trial == "clip1/0")
    found = ratings([one], key, "realism")
    rows = found.clip == 1
    for system, value in zip(found.system[rows], found.value[rows], strict=True):
        assert answer.value[f"clip1-{key.systems[system]}"] == value
