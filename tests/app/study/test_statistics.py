"""Numbers from votes: against closed forms, published examples and slow independent searches."""

import json
from typing import Any

import numpy as np
import pytest
from scipy import optimize, stats

from app.errors import RunError
from app.study.simulate import ALIKE, davidson
from app.study.statistics.bradley_terry import PRIOR_SD, fit_strengths
from app.study.statistics.jitter_join import join_jitter, read_jitter
from app.study.statistics.means import compare_means, krippendorff_alpha
from app.study.statistics.preference import (
    POWER,
    clopper_pearson,
    holm,
    share_of,
    sign_test,
    smallest_share_detected,
)
from app.study.statistics.votes import Values, Votes, joined, pair_votes, ranks, ratings
from tests.app.study.made import STRENGTHS, made_key, made_participants, made_votes

# Krippendorff 2011, "Computing Krippendorff's Alpha-Reliability", example C: four observers.
PUBLISHED = """
1 2 3 3 2 1 4 1 2 . . .
1 2 3 3 2 2 4 1 2 5 . 3
. 3 3 3 2 3 4 2 2 5 1 .
1 2 3 3 2 4 4 1 2 5 1 .
"""
CLIPS = ("a", "b", "c", "d")
SYSTEMS = ("smooth", "rough", "reference")


def test_the_published_example_of_alpha_comes_out():
    for level, alpha in [("nominal", 0.743), ("ordinal", 0.815), ("interval", 0.849)]:
        columns = zip(*(line.split() for line in PUBLISHED.strip().splitlines()), strict=True)
        units = [[float(value) for value in column if value != "."] for column in columns]
        assert krippendorff_alpha(units, level) == pytest.approx(alpha, abs=5e-4)


def test_alpha_of_agreement_is_one_of_chance_none_and_of_contradiction_negative():
    assert krippendorff_alpha([[1, 1, 1], [2, 2, 2]], "nominal") == 1
    by_chance = np.random.default_rng(0).integers(0, 3, (400, 5)).astype(float)
    assert krippendorff_alpha(list(by_chance), "ordinal") == pytest.approx(0, abs=0.03)
    assert krippendorff_alpha([[0, 1]] * 10, "nominal") == pytest.approx(-0.9, abs=1e-9)
    for units in ([[1], [2]], [[1, 1], [1, 1]], []):  # nothing to agree on
        assert krippendorff_alpha(units, "interval") is None


def repeated(counts: dict[tuple[int, int, float], int]) -> Votes:
    """Votes from (left, right, score) -> how many; every one by another rater."""
    rows = [row for row, count in counts.items() for _ in range(count)]
    return made_votes([(rater, *row) for rater, row in enumerate(rows)])


def slow_maximum(votes: Votes, num_systems: int) -> np.ndarray:
    """Davidson's posterior written out vote by vote and searched without derivatives' help."""

    def loss(beta: np.ndarray) -> float:
        strength = np.exp(beta[:num_systems])
        side, tie = np.exp(beta[num_systems]), np.exp(beta[num_systems + 1])
        total = (beta**2).sum() / (2 * PRIOR_SD**2)
        for left, right, score in zip(votes.left, votes.right, votes.score, strict=True):
            first, second = strength[left] * side, strength[right]
            both = tie * np.sqrt(first * second)
            chance = {1.0: first, 0.5: both, 0.0: second}[score] / (first + second + both)
            total -= np.log(chance)
        return float(total)

    return optimize.minimize(loss, np.zeros(num_systems + 2), method="BFGS").x


def test_two_systems_are_as_far_apart_as_their_log_odds():
    found = fit_strengths(repeated({(0, 1, 1.0): 300, (0, 1, 0.0): 100}), 2, has_sides=False)
    gap, interval = found.differences[0, 1]
    assert gap == pytest.approx(np.log(3), abs=0.01)
    assert found.log_strength.sum() == pytest.approx(0, abs=1e-8)
    standard_error = np.sqrt(1 / 300 + 1 / 100)
    assert interval.high - interval.low == pytest.approx(2 * 1.96 * standard_error, rel=0.08)


def test_ties_and_sides_meet_their_likelihood_equations():
    counts = {(0, 1, 1.0): 400, (0, 1, 0.5): 200, (0, 1, 0.0): 100}
    counts |= {(1, 0, 1.0): 200, (1, 0, 0.5): 200, (1, 0, 0.0): 200}
    found = fit_strengths(repeated(counts), 2, has_sides=True)
    gap, side = found.differences[0, 1][0], found.left_advantage
    assert side is not None
    straight = 700 * davidson(gap + side, found.tie)
    turned = 600 * davidson(-gap + side, found.tie)
    # Seen minus expected totals are what the prior takes: parameter / variance.
    prior = 1 / PRIOR_SD**2
    ties = 400 - straight[1] - turned[1]
    lefts = (300 - (straight[0] - straight[2]) - (turned[0] - turned[2])) / 2
    wins = (300 - (straight[0] - straight[2]) + (turned[0] - turned[2])) / 2
    assert ties == pytest.approx(prior * np.log(found.tie), abs=1e-4)
    assert lefts == pytest.approx(prior * side, abs=1e-4)
    assert wins == pytest.approx(prior * found.log_strength[0], abs=1e-4)


def test_the_maximum_is_that_of_an_independent_slow_search():
    rng = np.random.default_rng(3)
    rows = []
    for rater in range(12):
        for _ in range(8):
            left, right = rng.choice(3, 2, replace=False)
            rows.append((rater, int(left), int(right), float(rng.choice([0, 0.5, 1]))))
    votes = made_votes(rows)
    slow = slow_maximum(votes, 3)
    found = fit_strengths(votes, 3, has_sides=True)
    assert found.log_strength == pytest.approx(slow[:3], abs=1e-4)
    assert found.left_advantage == pytest.approx(slow[3], abs=1e-4)
    assert found.tie == pytest.approx(np.exp(slow[4]), abs=1e-4)


def test_known_strengths_come_back_from_pairs_and_from_rankings():
    key = made_key(num_clips=10)
    votes = pair_votes(made_participants(key, 200, ALIKE), key, "realism")
    found = fit_strengths(votes, 3, has_sides=True)
    given = np.array([STRENGTHS[name] for name in key.systems])
    assert found.log_strength == pytest.approx(given - given.mean(), abs=0.1)
    assert found.tie == pytest.approx(ALIKE.tie, abs=0.05)
    assert found.left_advantage == pytest.approx(ALIKE.left_advantage, abs=0.08)
    key = made_key("ranking", num_clips=10)
    votes = pair_votes(made_participants(key, 200, ALIKE), key, "realism")
    found = fit_strengths(votes, 3, has_sides=False)
    assert found.differences[1, 2][0] == pytest.approx(1.8, abs=0.15)
    assert (found.tie, found.left_advantage) == (0, None)


def test_a_system_that_wins_everything_stays_finite():
    found = fit_strengths(repeated({(0, 1, 1.0): 30}), 2, has_sides=False)
    gap, interval = found.differences[0, 1]
    assert 2 < gap < 8 and np.isfinite([interval.low, interval.high]).all()


def test_participants_are_drawn_whole():
    once = [(rater, 0, 1, float(rater < 14)) for rater in range(20)]
    single = fit_strengths(made_votes(once), 2, has_sides=False).differences[0, 1][1]
    tenfold = fit_strengths(made_votes(once * 10), 2, has_sides=False).differences[0, 1][1]
    # With less weight of the prior the interval may even grow; it must not shrink by sqrt(10).
    assert tenfold.high - tenfold.low >= single.high - single.low


def values_of(table: np.ndarray) -> Values:
    """Values from (R, C, K)."""
    rater, clip, system = np.indices(table.shape)
    return Values(rater.ravel(), clip.ravel(), system.ravel(), table.ravel().astype(float))


def test_means_and_tests_are_over_participants():
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


def test_the_bootstrap_interval_is_about_students():
    table = np.random.default_rng(1).normal(50, 10, (28, 1, 2))
    found = compare_means(values_of(table), 2)
    assert found is not None
    half = stats.t.ppf(0.975, 27) * table[:, 0, 0].std(ddof=1) / np.sqrt(28)
    width = found.intervals[0].high - found.intervals[0].low
    assert width == pytest.approx(2 * half, rel=0.08)
    assert found.friedman_p is None


def test_equal_systems_are_not_told_apart_and_who_did_not_judge_all_has_no_mean():
    found = compare_means(values_of(np.full((6, 2, 3), 2.0)), 3)
    assert found is not None and found.friedman_p == 1.0
    assert [pair.p for pair in found.pairs] == [1.0, 1.0, 1.0]
    values = values_of(np.arange(12.0).reshape(2, 2, 3))
    rows = ~((values.rater == 1) & (values.system == 2))
    found = compare_means(Values(*(column[rows] for column in vars(values).values())), 3)
    assert found is not None and found.num_raters == 1
    assert found.mean == pytest.approx([1.5, 2.5, 3.5])
    assert compare_means(Values(*(c[:0] for c in vars(values).values())), 3) is None


def test_places_and_ratings_follow_the_blind_ids():
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


def test_clopper_pearson_is_the_exact_binomial_interval():
    for successes, trials in ((0, 10), (3, 10), (10, 10), (140, 280)):
        exact = stats.binomtest(successes, trials).proportion_ci(method="exact")
        ours = clopper_pearson(successes, trials)
        assert (ours.low, ours.high) == pytest.approx((exact.low, exact.high), abs=1e-12)


def test_holm_multiplies_by_the_hypotheses_left_and_never_falls():
    # Smallest first: 4 * 0.005, 3 * 0.01, 2 * 0.03 (raised by nothing), then 0.04 held at 0.06.
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.7]) == [1.0, 1.0]
    assert holm([]) == []


def test_sign_test_doubles_the_tail():
    assert sign_test(6, 0) == pytest.approx(2 / 2**6)
    assert sign_test(0, 0) == 1.0
    assert sign_test(3, 3) == 1.0


def test_the_share_found_has_the_power_claimed():
    for count, alpha in [(6, 0.05), (28, 0.05), (28, 0.05 / 6), (280, 0.05)]:
        share = smallest_share_detected(count, alpha)
        assert share is not None
        power = sum(
            stats.binom.pmf(k, count, share)
            for k in range(count + 1)
            if stats.binomtest(k, count).pvalue <= alpha
        )
        assert power == pytest.approx(POWER, abs=1e-6)


def test_five_people_can_never_be_significant():
    assert smallest_share_detected(5) is None
    assert smallest_share_detected(0) is None


def test_ties_are_half_a_vote_for_each():
    found = share_of(made_votes([(0, 0, 1, 1.0), (1, 0, 1, 0.5), (2, 0, 1, 0.5), (3, 0, 1, 0.0)]))
    assert (found.wins, found.ties, found.losses, found.share) == (1, 2, 1, 0.5)
    assert (found.raters_for, found.raters_against) == (1, 1)


def test_one_vote_each_is_the_plain_interval_but_for_the_last_vote():
    score = [1.0] * 40 + [0.0] * 24
    found = share_of(made_votes([(rater, 0, 1, score[rater]) for rater in range(64)]))
    # The sample variance divides by 63: one vote fewer than there are.
    assert found.effective_votes == pytest.approx(63)
    assert found.interval == clopper_pearson(40 / 64 * 63, 63)
    assert found.as_independent == clopper_pearson(40, 64)


def test_raters_who_repeat_themselves_count_once():
    once = [(rater, 0, 1, float(rater < 14)) for rater in range(20)]
    tenfold = share_of(made_votes(once * 10))
    assert (tenfold.share, tenfold.votes) == (0.7, 200)
    assert tenfold.effective_votes < 20  # no repetition makes 20 people more than 20
    width = tenfold.interval.high - tenfold.interval.low
    assert width > 2.8 * (tenfold.as_independent.high - tenfold.as_independent.low)
    assert tenfold.p == share_of(made_votes(once)).p == sign_test(14, 6)
    unanimous = share_of(made_votes([(rater, 0, 1, 1.0) for rater in range(8)] * 5))
    assert unanimous.interval == clopper_pearson(8, 8) and unanimous.interval.high == 1.0


def test_the_effective_number_matches_a_simulated_variance():
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


def test_clips_that_differ_widen_the_interval_over_clips():
    rows = [(rater, 0, 1, float(clip < 3)) for clip in range(6) for rater in range(20)]
    votes = made_votes(rows)
    votes.clip[:] = np.repeat(np.arange(6), 20)
    found = share_of(votes)
    assert found.over_clips is not None
    assert found.over_clips.high - found.over_clips.low > 0.8
    assert found.interval.high - found.interval.low < 0.2
    assert share_of(votes[votes.clip < 5]).over_clips is None


def test_between_turns_rows_around_and_no_votes_are_an_error():
    votes = made_votes([(0, 2, 1, 1.0), (0, 1, 2, 1.0), (1, 2, 1, 0.5), (0, 0, 1, 1.0)])
    turned = votes.between(1, 2)
    assert turned.score.tolist() == [0.0, 1.0, 0.5]
    assert (turned.left == 1).all() and (turned.right == 2).all()
    with pytest.raises(ValueError, match="no votes"):
        share_of(votes.between(0, 2))


def test_two_raters_who_happen_to_agree_are_no_more_than_their_votes():
    for second in (6, 7):
        score = [[1.0] * 6 + [0.0] * 4, [1.0] * second + [0.0] * (10 - second)]
        rows = [(rater, 0, 1, score[rater][i]) for rater in range(2) for i in range(10)]
        found = share_of(made_votes(rows))
        assert found.effective_votes <= 20
        assert found.interval.high - found.interval.low > 0.4


def diagnostics(smooth: float | None, rough: float, reference: float | None = None) -> dict:
    def measures(jerk: float | None) -> dict[str, Any]:
        return {"raw": {"tip_jerk_m_s3": jerk}, "savgol": {"tip_jerk_m_s3": 1.0}}

    return {
        "systems": {"smooth": measures(smooth), "rough": measures(rough)},
        "reference": None if reference is None else measures(reference),
    }


def votes_on(clip: int, *rows: tuple[int, int, int, float], because: bool = False) -> Votes:
    votes = made_votes(list(rows), clip)
    votes.because_smooth[:] = because
    return votes


def test_jerk_is_read_from_both_places_and_the_recording_by_its_name(tmp_path):
    with pytest.raises(RunError, match=r"expected a/diagnostics.json or a.json there"):
        read_jitter(tmp_path, CLIPS, SYSTEMS)
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "diagnostics.json").write_text(json.dumps(diagnostics(10, 30, 5)))
    (tmp_path / "b.json").write_text(json.dumps(diagnostics(None, 40)))
    first = {("a", "smooth"): 10, ("a", "rough"): 30, ("a", "reference"): 5}
    assert read_jitter(tmp_path, CLIPS, SYSTEMS) == first | {("b", "rough"): 40}
    with pytest.raises(RunError, match="No diagnostics"):  # a name is no way out
        read_jitter(tmp_path / "a", ("../b", "."), SYSTEMS)
    (tmp_path / "b.json").write_text('{"systems": {"smooth": {"raw": 3}}}')
    with pytest.raises(RunError, match="`raw` must be an object"):
        read_jitter(tmp_path, CLIPS, SYSTEMS)


def test_votes_are_split_by_reason_and_turned_to_the_smoother():
    jitter = {("a", "smooth"): 10.0, ("a", "rough"): 30.0}
    votes = joined(
        [
            votes_on(0, (0, 0, 1, 1.0), (1, 1, 0, 0.0), (2, 1, 0, 1.0), because=True),
            votes_on(0, (3, 0, 1, 0.0), (4, 0, 1, 0.5)),
            votes_on(1, (3, 0, 1, 1.0), because=True),  # that clip is not measured
        ]
    )
    found = join_jitter(votes, jitter, CLIPS, SYSTEMS)
    assert found is not None
    assert found.because_smooth is not None and found.other_reasons is not None
    assert (found.because_smooth.wins, found.because_smooth.losses) == (2, 1)
    assert (found.other_reasons.wins, found.other_reasons.losses) == (0, 1)
    (point,) = found.points
    assert (point.clip, point.smoother, point.rougher) == ("a", "smooth", "rough")
    assert (point.jerk_ratio, point.share, point.because_smooth) == (3.0, 0.5, 3)
    assert found.correlation is None


def test_correlation_says_whether_more_jitter_costs_more_votes():
    jitter = {(clip, "smooth"): 10.0 for clip in CLIPS}
    jitter |= {(clip, "rough"): 20.0 + 10 * i for i, clip in enumerate(CLIPS)}
    for sign in (1, -1):
        groups = []
        for clip in range(4):
            wins = 2 + sign * clip if sign > 0 else 8 - clip
            groups.append(votes_on(clip, *[(r, 0, 1, float(r < wins)) for r in range(10)]))
        found = join_jitter(joined(groups), jitter, CLIPS, SYSTEMS)
        assert found is not None
        assert found.correlation == pytest.approx(sign)


def test_without_a_measured_pair_there_is_nothing_to_join():
    votes = made_votes([(0, 0, 1, 1.0)])
    for rough in ({}, {("a", "rough"): 1.0}):  # not measured, and equal
        assert join_jitter(votes, {("a", "smooth"): 1.0} | rough, CLIPS, SYSTEMS) is None
