"""Numbers from votes: against closed forms, published examples and slow independent searches."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import optimize, stats

from app.errors import RunError
from app.study.design.key import StudyKey
from app.study.report.report import format_interval
from app.study.simulate import UNIFORM_RATERS
from app.study.statistics.answers import TIE, Participant
from app.study.statistics.models import (
    PRIOR_SD,
    alpha_estimate,
    elo_estimates,
    fit_strengths,
    krippendorff_alpha,
    mean_estimates,
    strengths_and_elo,
)
from app.study.statistics.proportions import (
    POWER,
    ResultEstimate,
    clopper_pearson,
    detectable_share,
    holm,
    num_effective_votes,
    proportion_estimates,
    sign_test,
)
from app.study.statistics.results import analyse_participants, read_jerk, smoother_chosen_estimates
from app.study.statistics.votes import rank_and_rating_table, votes_between, votes_of
from tests.app.study.made import STRENGTHS, made_key, made_participants, made_votes

# Krippendorff 2011, "Computing Krippendorff's Alpha-Reliability", example C: four observers.
PUBLISHED = """
1 2 3 3 2 1 4 1 2 . . .
1 2 3 3 2 2 4 1 2 5 . 3
. 3 3 3 2 3 4 2 2 5 1 .
1 2 3 3 2 4 4 1 2 5 1 .
"""


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


AB = ("a", "b")


def repeated(counts: dict[tuple[str, str, float], int]) -> pd.DataFrame:
    """Votes from (left, right, score) -> how many; every one by another rater."""
    rows = [row for row, count in counts.items() for _ in range(count)]
    return made_votes([(rater, *row) for rater, row in enumerate(rows)])


def slow_maximum(votes: pd.DataFrame, systems: list[str]) -> np.ndarray:
    """Davidson's posterior written out vote by vote and searched without derivatives' help."""

    def loss(beta: np.ndarray) -> float:
        strength = dict(zip(systems, np.exp(beta), strict=False))
        side, tie = np.exp(beta[-2]), np.exp(beta[-1])
        total = (beta**2).sum() / (2 * PRIOR_SD**2)
        for left, right, score in zip(votes.left, votes.right, votes.score, strict=True):
            first, second = strength[left] * side, strength[right]
            both = tie * np.sqrt(first * second)
            chance = {1.0: first, 0.5: both, 0.0: second}[score] / (first + second + both)
            total -= np.log(chance)
        return float(total)

    return optimize.minimize(loss, np.zeros(len(systems) + 2), method="BFGS").x


def one(numbers: list[ResultEstimate], measure: str, *names: str) -> ResultEstimate:
    """The only number of that measure and these systems."""
    (found,) = (
        n for n in numbers if n.measure == measure and (n.first, n.second)[: len(names)] == names
    )
    return found


def width(number: ResultEstimate) -> float:
    assert number.low is not None and number.high is not None
    return number.high - number.low


def test_two_systems_are_as_far_apart_as_their_log_odds_and_elo_has_them_at_its_scale():
    votes = repeated({("a", "b", 1.0): 300, ("a", "b", 0.0): 100})
    gap = one(strengths_and_elo(votes, AB, has_sides=False), "log_strength_gap", "a", "b")
    assert gap.value == pytest.approx(np.log(3), abs=0.01)
    assert width(gap) == pytest.approx(2 * 1.96 * np.sqrt(1 / 300 + 1 / 100), rel=0.08)
    assert fit_strengths(votes, AB, has_sides=False).parameters.sum() == pytest.approx(0, abs=1e-8)
    # Ties are half a win for each, clear preferences count twice: 240 and 80 come to 3 to 1.
    mixed = repeated({("a", "b", 1.0): 140, ("b", "a", 0.5): 40, ("b", "a", 1.0): 60})
    mixed.loc[mixed.score.index[:80], "weight"] = 2.0
    for votes_of_elo in (votes, mixed):
        high, low = elo_estimates(votes_of_elo, AB)
        assert high.value is not None and low.value is not None
        assert high.value - low.value == pytest.approx(400 * np.log10(3), abs=2)
        assert high.value + low.value == pytest.approx(2000)


def test_the_maximum_is_that_of_an_independent_slow_search():
    rng = np.random.default_rng(3)
    rows, names = [], ["a", "b", "c"]
    for rater in range(12):
        for _ in range(8):
            left, right = rng.choice(names, 2, replace=False)
            rows.append((rater, str(left), str(right), float(rng.choice([0, 0.5, 1]))))
    votes = made_votes(rows)
    found = fit_strengths(votes, names, has_sides=True).parameters
    assert found == pytest.approx(slow_maximum(votes, names), abs=1e-4)


def test_known_strengths_come_back_from_pairs_and_from_rankings():
    key = made_key(num_clips=10)
    votes = votes_of(made_participants(key, 200, UNIFORM_RATERS), key, "realism")
    *found, side, log_tie = fit_strengths(votes, key.systems, has_sides=True).parameters
    given = np.array([STRENGTHS[name] for name in key.systems])
    assert found == pytest.approx(given - given.mean(), abs=0.1)
    assert np.exp(log_tie) == pytest.approx(UNIFORM_RATERS.tie_parameter, abs=0.05)
    assert side == pytest.approx(UNIFORM_RATERS.left_advantage, abs=0.08)
    key = made_key("ranking", num_clips=10)
    votes = votes_of(made_participants(key, 200, UNIFORM_RATERS), key, "realism")
    found = fit_strengths(votes, key.systems, has_sides=False).parameters
    assert len(found) == 3 and found[1] - found[2] == pytest.approx(1.8, abs=0.15)


def test_a_system_that_wins_everything_stays_finite():
    votes = repeated({("a", "b", 1.0): 30})
    gap = one(strengths_and_elo(votes, AB, has_sides=False), "log_strength_gap")
    assert gap.value is not None and 2 < gap.value < 8
    assert (
        format_interval(gap) == "unknown"
    )  # nobody differs, so nothing is known of how others would


def test_participants_are_drawn_whole():
    once = [(rater, "a", "b", float(rater < 14)) for rater in range(20)]
    single, tenfold = (
        one(strengths_and_elo(made_votes(rows), AB, has_sides=False), "log_strength_gap")
        for rows in (once, once * 10)
    )
    # With less weight of the prior the interval may even grow; it must not shrink by sqrt(10).
    assert width(tenfold) >= width(single)


def table_of(values: np.ndarray) -> pd.DataFrame:
    """Values from (R, C, K)."""
    rater, clip, system = np.indices(values.shape)
    columns = {"rater": rater, "clip": clip, "system": system, "value": values}
    return pd.DataFrame({name: column.ravel() for name, column in columns.items()})


def test_means_and_tests_are_over_participants():
    table = np.random.default_rng(0).normal([0.0, 0.6, 0.1], 1, (16, 5, 3))
    count, found = mean_estimates(table_of(table), range(3), "mean")
    means = table.mean(1)
    assert count == 16
    assert [n.value for n in found[:3]] == pytest.approx(list(means.mean(0)))
    assert found[-1].p == pytest.approx(stats.friedmanchisquare(*means.T).pvalue)
    gaps = found[3:6]
    assert gaps[0].p == pytest.approx(stats.wilcoxon(means[:, 0] - means[:, 1]).pvalue)
    assert min(g.p_holm for g in gaps) == pytest.approx(3 * min(g.p for g in gaps))


def test_the_bootstrap_interval_is_about_students():
    table = np.random.default_rng(1).normal(50, 10, (28, 1, 2))
    _, found = mean_estimates(table_of(table), range(2), "mean")
    half = stats.t.ppf(0.975, 27) * table[:, 0, 0].std(ddof=1) / np.sqrt(28)
    assert width(found[0]) == pytest.approx(2 * half, rel=0.08)
    assert found[-1].p is None


def test_equal_systems_are_not_told_apart_and_who_did_not_judge_all_has_no_mean():
    _, found = mean_estimates(table_of(np.full((6, 2, 3), 2.0)), range(3), "mean")
    assert [n.p for n in found[3:]] == [1.0] * 4
    values = table_of(np.arange(12.0).reshape(2, 2, 3))
    rows = ~((values.rater == 1) & (values.system == 2))
    count, found = mean_estimates(values[rows], range(3), "mean")
    assert (count, [n.value for n in found[:3]]) == (1, [1.5, 2.5, 3.5])
    assert mean_estimates(values[:0], range(3), "mean") == (0, [])


def test_places_and_ratings_follow_the_blind_ids():
    for protocol in ("ranking", "rating"):
        key = made_key(protocol)
        people = made_participants(key, 1)
        answer = next(each for each in people[0].answers if each.trial == "clip2/0")
        found = rank_and_rating_table(people, key, "realism")
        rows = found[found["clip"] == "clip2"]
        seen = {f"clip2-{name}": v for name, v in zip(rows.system, rows.value, strict=True)}
        is_ranking = protocol == "ranking"
        assert (sorted(seen, key=seen.__getitem__) if is_ranking else seen) == answer.value


def test_clopper_pearson_is_the_exact_binomial_interval():
    for successes, trials in ((0, 10), (3, 10), (10, 10), (140, 280)):
        exact = stats.binomtest(successes, trials).proportion_ci(method="exact")
        assert clopper_pearson(successes, trials) == pytest.approx(
            (exact.low, exact.high), abs=1e-12
        )


def test_holm_multiplies_by_the_hypotheses_left_and_never_falls():
    # Smallest first: 4 * 0.005, 3 * 0.01, 2 * 0.03 (raised by nothing), then 0.04 held at 0.06.
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.7]) == [1.0, 1.0]
    assert holm([]) == []


def test_the_share_found_has_the_power_claimed():
    for count, alpha in [(6, 0.05), (28, 0.05), (28, 0.05 / 6), (280, 0.05)]:
        share = detectable_share(count, alpha)
        assert share is not None
        power = sum(
            stats.binom.pmf(k, count, share)
            for k in range(count + 1)
            if stats.binomtest(k, count).pvalue <= alpha
        )
        assert power == pytest.approx(POWER, abs=1e-6)
    assert detectable_share(5) is detectable_share(0) is None


def test_ties_are_half_a_vote_for_each():
    rows = [(0, "a", "b", 1.0), (1, "a", "b", 0.5), (2, "a", "b", 0.5), (3, "a", "b", 0.0)]
    found, *_ = proportion_estimates("share", made_votes(rows))
    assert (found.wins, found.ties, found.losses, found.value) == (1, 2, 1, 0.5)
    assert (found.participants_for, found.participants_against) == (1, 1)


def test_one_vote_each_is_the_plain_interval_but_for_the_last_vote():
    score = [1.0] * 40 + [0.0] * 24
    found, plain = proportion_estimates(
        "share", made_votes([(rater, "a", "b", score[rater]) for rater in range(64)])
    )
    # The sample variance divides by 63: one vote fewer than there are.
    assert (found.low, found.high) == pytest.approx(clopper_pearson(40 / 64 * 63, 63))
    assert (plain.low, plain.high) == clopper_pearson(40, 64)


def test_raters_who_repeat_themselves_count_once():
    once = [(rater, "a", "b", float(rater < 14)) for rater in range(20)]
    tenfold, plain = proportion_estimates("share", made_votes(once * 10))
    assert (tenfold.value, tenfold.num_votes) == (0.7, 200)
    assert num_effective_votes(made_votes(once * 10)) < 20  # no repetition makes 20 people more
    assert width(tenfold) > 2.8 * width(plain)
    assert tenfold.p == proportion_estimates("share", made_votes(once))[0].p == sign_test(14, 6)
    unanimous = [(rater, "a", "b", 1.0) for rater in range(8)] * 5
    found, *_ = proportion_estimates("share", made_votes(unanimous))
    assert (found.low, found.high) == clopper_pearson(8, 8) and found.high == 1.0


def test_the_effective_number_matches_a_simulated_variance():
    # Beta-binomial raters: 30 people with 12 votes each, chance drawn per person.
    rng = np.random.default_rng(0)
    shares, effective = [], []
    for _ in range(400):
        chance = rng.beta(3, 2, 30)
        score = (rng.random((12, 30)) < chance).astype(float)
        votes = pd.DataFrame({"rater": np.tile(np.arange(30), 12), "score": score.ravel()})
        shares.append(score.mean())
        effective.append(num_effective_votes(votes))
    true = 0.6 * 0.4 / np.var(shares)
    few = (stats.t.ppf(0.975, 359) / stats.t.ppf(0.975, 29)) ** 2
    assert np.median(effective) == pytest.approx(true * few, rel=0.15)
    assert true < 0.4 * 360


def test_clips_that_differ_widen_the_interval_over_clips():
    rows = [(rater, "a", "b", float(clip < 3)) for clip in range(6) for rater in range(20)]
    votes = made_votes(rows).assign(clip=np.repeat(np.arange(6), 20))
    same, over_clips, _ = proportion_estimates("share", votes)
    assert width(over_clips) > 0.8 and width(same) < 0.2
    assert len(proportion_estimates("share", votes[votes["clip"] < 5])) == 2


def test_between_turns_rows_around_and_no_votes_have_no_share():
    votes = made_votes(
        [(0, "c", "b", 1.0), (0, "b", "c", 1.0), (1, "c", "b", 0.5), (0, "a", "b", 1.0)]
    )
    turned = votes_between(votes, "b", "c")
    assert turned.score.tolist() == [0.0, 1.0, 0.5]
    assert (turned.left == "b").all() and (turned.right == "c").all()
    assert proportion_estimates("share", votes_between(votes, "a", "c")) == []
    found, other = (
        proportion_estimates("share", votes_between(votes, *p), *p)[0] for p in ("bc", "cb")
    )
    assert found.with_systems_swapped().value_and_limits == pytest.approx(other.value_and_limits)


def test_jerk_is_read_by_clip_and_system(tmp_path):
    key = made_key(num_clips=2)
    with pytest.raises(RunError, match=r"clip0/diagnostics.json for each clip"):
        read_jerk(tmp_path, key)
    for clip, smooth, reference in (
        ("clip0", 10, {"raw": {"tip_jerk_m_s3": 5}}),
        ("clip1", None, None),
    ):
        jerk = {"local": smooth, "global": 30}
        systems = {name: {"raw": {"tip_jerk_m_s3": value}} for name, value in jerk.items()}
        (tmp_path / clip).mkdir()
        told = json.dumps({"systems": systems, "reference": reference})
        (tmp_path / clip / "diagnostics.json").write_text(told)
    both = {("clip0", "local"): 10, ("clip0", "global"): 30, ("clip1", "global"): 30}
    assert read_jerk(tmp_path, key) == both
    recorded = replace(key, systems=(*key.systems, "reference"))
    assert read_jerk(tmp_path, recorded) == both | {("clip0", "reference"): 5}
    for damaged in ("{", "[]", '{"systems": {"local": {"raw": 3}}, "reference": null}'):
        (tmp_path / "clip1" / "diagnostics.json").write_text(damaged)
        with pytest.raises(RunError, match=r"clip1/diagnostics\.json is not a valid"):
            read_jerk(tmp_path, key)


def test_votes_are_split_by_reason_and_turned_to_the_smoother():
    jitter = {("x", "a"): 10.0, ("x", "b"): 30.0}
    because = [(0, "a", "b", 1.0), (1, "b", "a", 0.0), (2, "b", "a", 1.0)]
    votes = pd.concat(
        [
            made_votes(because, "x", is_smooth=True),
            made_votes([(3, "a", "b", 0.0), (4, "a", "b", 0.5)], "x"),
            made_votes([(3, "a", "b", 1.0)], "y", is_smooth=True),  # that clip is not measured
        ],
        ignore_index=True,
    )
    numbers = smoother_chosen_estimates(votes, jitter)
    named = one(numbers, "smoother_chosen_naming_smoothness")
    other = one(numbers, "smoother_chosen_otherwise")
    assert (named.wins, named.losses, other.wins, other.losses) == (2, 1, 0, 1)
    votes = made_votes([(0, "a", "b", 1.0)], "x")
    for rough in ({}, {("x", "b"): 1.0}):  # not measured, and equal
        assert smoother_chosen_estimates(votes, {("x", "a"): 1.0} | rough) == []


def seen_from_two_views(key: StudyKey) -> StudyKey:
    """Each trial once more, of videos from the side."""
    videos = {f"{name}@side": replace(video, view="side") for name, video in key.videos.items()}
    trials = {
        f"{name}@side": replace(trial, videos=tuple(f"{video}@side" for video in trial.videos))
        for name, trial in key.trials.items()
        if trial.expected is None
    }
    lists = {number: (*names, *trials) for number, names in key.lists.items()}
    return replace(key, videos=key.videos | videos, trials=key.trials | trials, lists=lists)


@pytest.mark.parametrize("protocol", ["pairwise", "rating"])
def test_two_views_of_a_clip_are_two_votes_of_one_rater_and_no_agreement(protocol: Any) -> None:
    """Raters who agree with themselves from view to view, and with nobody else."""
    once = made_key(protocol, num_clips=20)
    key = seen_from_two_views(once)
    people = made_participants(once, 4)
    rng = np.random.default_rng(0)

    def on_both(one: Participant) -> Participant:
        judged = [each for each in one.answers if once.trials[each.trial].expected is None]
        answers = []
        for answer in judged:
            shown = answer.videos
            if protocol == "pairwise":
                value: Any = (shown[0], TIE, shown[1])[rng.integers(3)]
                side = TIE if value == TIE else f"{value}@side"
            else:
                value = {video: int(rng.integers(101)) for video in shown}
                side = {f"{video}@side": rating for video, rating in value.items()}
            again = tuple(f"{video}@side" for video in shown)
            answers.append(replace(answer, value=value))
            answers.append(replace(answer, trial=f"{answer.trial}@side", videos=again, value=side))
        return replace(one, answers=tuple(answers))

    (result,) = analyse_participants([on_both(one) for one in people], key)
    alpha = result.find_estimate(f"krippendorff_alpha_{result.measurement_level}")
    assert result.num_shared_items == 2 * 20 * 3
    assert abs(alpha.value) < 0.1 and alpha.low < 0 < alpha.high


def test_resamples_that_cannot_differ_give_no_interval() -> None:
    """Three participants, each of whom finds each of two systems better once."""
    votes = made_votes([(rater, "a", "b", score) for rater in range(3) for score in (1.0, 0.0)])
    numbers = strengths_and_elo(votes, AB, has_sides=True)
    assert one(numbers, "elo", "a").value == pytest.approx(1000)
    of_means = mean_estimates(table_of(np.full((3, 2, 2), 5.0)), range(2), "mean")[1]
    alike = (
        krippendorff_alpha([[1, 1], [2, 2]], "nominal"),
        alpha_estimate([[1, 1], [2, 2]], "nominal"),
    )
    assert alike[0] == alike[1].value == 1
    known = [number for number in (*numbers, *of_means, alike[1]) if number.low is not None]
    assert len(known) == 2 + 1 + 1 + 2 + 2 + 1 + 1
    for number in known:
        assert not np.isfinite(number.value_and_limits[1:]).any()
        assert format_interval(number) == "unknown" and number.significant_side == 0
