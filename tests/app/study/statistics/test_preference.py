import numpy as np
import pytest
from scipy import stats

from app.study.statistics.preference import clopper_pearson, holm, share_of, sign_test
from tests.app.study.made import made_votes


def test_clopper_pearson_is_the_exact_binomial_interval() -> None:
    for successes, trials in ((0, 10), (3, 10), (10, 10), (140, 280)):
        exact = stats.binomtest(successes, trials).proportion_ci(method="exact")
        ours = clopper_pearson(successes, trials)
        assert (ours.low, ours.high) == pytest.approx((exact.low, exact.high), abs=1e-12)
    assert clopper_pearson(0, 10).high == pytest.approx(1 - 0.025**0.1)


def test_holm_multiplies_by_the_hypotheses_left_and_never_falls() -> None:
    # Smallest first: 4 * 0.005, 3 * 0.01, 2 * 0.03 (raised by nothing), then 0.04 held at 0.06.
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.7]) == [1.0, 1.0]
    assert holm([]) == []


def test_sign_test_doubles_the_tail() -> None:
    assert sign_test(6, 0) == pytest.approx(2 / 2**6)
    assert sign_test(0, 0) == 1.0
    assert sign_test(3, 3) == 1.0


def test_ties_are_half_a_vote_for_each() -> None:
    found = share_of(made_votes([(0, 0, 1, 1.0), (1, 0, 1, 0.5), (2, 0, 1, 0.5), (3, 0, 1, 0.0)]))
    assert (found.wins, found.ties, found.losses, found.share) == (1, 2, 1, 0.5)
    assert (found.raters_for, found.raters_against) == (1, 1)


def test_one_vote_each_is_the_plain_interval_but_for_the_last_vote() -> None:
    score = [1.0] * 40 + [0.0] * 24
    found = share_of(made_votes([(rater, 0, 1, score[rater]) for rater in range(64)]))
    # The sample variance divides by 63: one vote fewer than there are.
    assert found.effective_votes == pytest.approx(63)
    assert found.interval == clopper_pearson(40 / 64 * 63, 63)
    assert found.as_independent == clopper_pearson(40, 64)


def test_raters_who_repeat_themselves_count_once() -> None:
    once = [(rater, 0, 1, float(rater < 14)) for rater in range(20)]
    tenfold = share_of(made_votes(once * 10))
    assert tenfold.share == 0.7
    assert tenfold.votes == 200
    # No repetition makes 20 people more than 20.
    assert tenfold.effective_votes < 20
    width = tenfold.interval.high - tenfold.interval.low
    plain = tenfold.as_independent.high - tenfold.as_independent.low
    assert width > 2.8 * plain
    assert tenfold.p == share_of(made_votes(once)).p == sign_test(14, 6)


def test_unanimous_raters_are_as_many_votes_as_they_are_people() -> None:
    found = share_of(made_votes([(rater, 0, 1, 1.0) for rater in range(8)] * 5))
    assert found.interval == clopper_pearson(8, 8)
    assert found.interval.high == 1.0


def test_the_effective_number_matches_a_simulated_variance() -> None:
    # Beta-binomial raters: 30 people with 12 votes each, chance drawn per person.
    rng = np.random.default_rng(0)
    shares, effective = [], []
    for _ in range(400):
        chance = rng.beta(3, 2, 30)
        score = (rng.random((12, 30)) < chance).astype(float)
        rows = [(rater, 0, 1, score[i, rater]) for i in range(12) for rater in range(30)]
        found = share_of(made_votes(rows))
        shares.append(found.share)
        effective.append(found.effective_votes)
    true = 0.6 * 0.4 / np.var(shares)
    few = (stats.t.ppf(0.975, 359) / stats.t.ppf(0.975, 29)) ** 2
    assert np.median(effective) == pytest.approx(true * few, rel=0.15)
    assert true < 0.4 * 360


def test_clips_that_differ_widen_the_interval_over_clips() -> None:
    rows, clips = [], []
    for clip in range(6):
        for rater in range(20):
            rows.append((rater, 0, 1, float(clip < 3)))
            clips.append(clip)
    votes = made_votes(rows)
    votes.clip[:] = clips
    found = share_of(votes)
    assert found.over_clips is not None
    assert found.over_clips.high - found.over_clips.low > 0.8
    assert found.interval.high - found.interval.low < 0.2
    assert share_of(votes[votes.clip < 5]).over_clips is None


def test_no_votes_are_an_error() -> None:
    votes = made_votes([(0, 0, 1, 1.0)])
    with pytest.raises(ValueError, match="no votes"):
        share_of(votes.between(0, 2))


def test_between_turns_rows_around() -> None:
    votes = made_votes([(0, 2, 1, 1.0), (0, 1, 2, 1.0), (1, 2, 1, 0.5), (0, 0, 1, 1.0)])
    turned = votes.between(1, 2)
    assert turned.score.tolist() == [0.0, 1.0, 0.5]
    assert (turned.left == 1).all() and (turned.right == 2).all()


def test_two_raters_who_happen_to_agree_are_no_more_than_their_votes() -> None:
    for second in (6, 7):
        score = [[1.0] * 6 + [0.0] * 4, [1.0] * second + [0.0] * (10 - second)]
        rows = [(rater, 0, 1, score[rater][i]) for rater in range(2) for i in range(10)]
        found = share_of(made_votes(rows))
        assert found.effective_votes <= 20
        assert found.interval.high - found.interval.low > 0.4
