"""How often one thing is preferred to another: share, interval, test, power; persons drawn anew.

Votes of one participant are alike, so a vote is not the unit that chance acts on; a participant is.

- Share: of all votes, a tie counted as half a vote for each. Ties are votes (the participant looked
  and saw no difference); leaving them out would make a rare preference look strong.
- Interval: Clopper-Pearson at the effective number of votes (Korn and Graubard 1998, as the U.S.
  National Center for Health Statistics uses it for clustered samples). It speaks of other
  participants who watch the same clips; `over_clips` of other clips, too.
- Test: exact binomial (sign) test over participants, each counted once for the side that got more
  of their votes. It is exact whatever the dependence within a participant. Barnard's test is for
  two independent groups, and here everybody judges everything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy import optimize, stats

from app.study.statistics.votes import Votes

CONFIDENCE = 0.95
MIN_CLIPS = 6
"""Fewer clips do not tell how much clips differ."""


@dataclass(frozen=True)
class Interval:
    """Confidence limits at `CONFIDENCE`."""

    low: float
    high: float

    def holds(self, value: float) -> bool:
        return self.low <= value <= self.high


@dataclass(frozen=True)
class Share:
    """How often the left of some votes was preferred."""

    wins: int
    ties: int
    losses: int
    share: float
    """(wins + ties / 2) / votes."""
    interval: Interval
    """For other participants and the same clips."""
    over_clips: Interval | None
    """For other participants and other clips; None below `MIN_CLIPS`."""
    as_independent: Interval
    """Plain Clopper-Pearson of wins among decided votes, as if all were independent; only to
    compare with papers that print it."""
    effective_votes: float
    raters_for: int
    """Participants with more votes for the left."""
    raters_against: int
    p: float
    """Exact two-sided sign test over participants."""

    @property
    def votes(self) -> int:
        return self.wins + self.ties + self.losses


def share_of(votes: Votes) -> Share:
    """Share, interval and test of the left side of ``votes`` (see `Votes.between`).

    Raises:
        ValueError: if there are no votes.
    """
    if not len(votes):
        raise ValueError("There are no votes.")
    score = votes.score
    wins, losses = int((score == 1).sum()), int((score == 0).sum())
    share = float(score.mean())
    num_raters = len(np.unique(votes.rater))
    by_rater = _cluster_variance(votes, votes.rater)
    effective = _effective_votes(votes, by_rater, max(1, num_raters - 1))
    raters_for, raters_against = _majorities(votes)
    return Share(
        wins=wins,
        ties=len(score) - wins - losses,
        losses=losses,
        share=share,
        interval=clopper_pearson(share * effective, effective),
        over_clips=_interval_over_clips(votes),
        as_independent=clopper_pearson(wins, wins + losses),
        effective_votes=effective,
        raters_for=raters_for,
        raters_against=raters_against,
        p=sign_test(raters_for, raters_against),
    )


def clopper_pearson(successes: float, trials: float) -> Interval:
    """Exact binomial limits (Clopper and Pearson 1934); both numbers may be fractions."""
    tail = (1 - CONFIDENCE) / 2
    failures = trials - successes
    low = stats.beta.ppf(tail, successes, failures + 1) if successes > 0 else 0.0
    high = stats.beta.ppf(1 - tail, successes + 1, failures) if failures > 0 else 1.0
    return Interval(float(low), float(high))


def sign_test(more: int, fewer: int) -> float:
    """Exact two-sided p that as many would differ by chance; 1 if nobody decided."""
    return float(stats.binomtest(more, more + fewer).pvalue) if more + fewer else 1.0


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's step-down adjusted p (1979), in the order given."""
    adjusted = [0.0] * len(p_values)
    highest = 0.0
    for rank, index in enumerate(np.argsort(p_values, kind="stable")):
        highest = max(highest, min(1.0, (len(p_values) - rank) * p_values[index]))
        adjusted[index] = highest
    return adjusted


def _majorities(votes: Votes) -> tuple[int, int]:
    """Participants with more votes for the left, and with more for the right."""
    lead = np.bincount(votes.rater, weights=votes.score - 0.5)
    return int((lead > 0).sum()), int((lead < 0).sum())


def _cluster_variance(votes: Votes, cluster: Int[np.ndarray, " N"]) -> float:
    """Variance of the share when whole clusters are drawn (ratio estimator, linearised)."""
    sums = np.bincount(cluster, weights=votes.score - votes.score.mean())
    count = len(np.unique(cluster))
    if count < 2:
        return 0.0
    return float(count / (count - 1) * (sums**2).sum() / len(votes) ** 2)


def _effective_votes(votes: Votes, variance: float, freedom: float) -> float:
    """Number of independent yes/no votes that would tell as much (Korn and Graubard 1998).

    The ratio of t quantiles widens for a variance that few clusters estimate. There are never more
    than if all votes were independent: a smaller variance is nearly always luck. Where all votes
    are the same, or one participant gave them all, nothing is known of how they vary, and each
    participant counts as one vote.
    """
    num_raters = len(np.unique(votes.rater))
    of_one = float(votes.score.var())
    if of_one == 0 or num_raters < 2:
        return float(num_raters)
    share = float(votes.score.mean())
    independent = share * (1 - share) * len(votes) / of_one
    if variance <= 0:
        return independent
    upper = (1 + CONFIDENCE) / 2
    few = stats.t.ppf(upper, len(votes) - 1) / stats.t.ppf(upper, freedom)
    return min(independent, float(share * (1 - share) / variance * few**2))


def _interval_over_clips(votes: Votes) -> Interval | None:
    """Participants and clips both drawn anew: two-way clustered variance (Cameron et al. 2011).

    The few clips only weaken the part of the variance that they add (Satterthwaite 1946).
    """
    num_clips, num_raters = len(np.unique(votes.clip)), len(np.unique(votes.rater))
    if num_clips < MIN_CLIPS or num_raters < 2:
        return None
    by_rater = _cluster_variance(votes, votes.rater)
    both = votes.rater * (int(votes.clip.max()) + 1) + votes.clip
    cell = np.unique(both, return_inverse=True)[1]
    of_clips = _cluster_variance(votes, votes.clip) - _cluster_variance(votes, cell)
    added = max(0.0, of_clips)
    parts = by_rater**2 / (num_raters - 1) + added**2 / (num_clips - 1)
    variance = by_rater + added
    freedom = variance**2 / parts if parts > 0 else num_raters - 1
    effective = _effective_votes(votes, variance, freedom)
    share = float(votes.score.mean())
    return clopper_pearson(share * effective, effective)


ALPHA = 0.05
POWER = 0.8


def smallest_share_detected(count: int, alpha: float = ALPHA) -> float | None:
    """The share that so many independent yes/no votes tell from one half with `POWER`.

    Exact: the rejection region of the two-sided binomial test at ``alpha``.

    Returns:
        A share of 0.5 to 1; None if even unanimous votes would not reach ``alpha``.
    """
    tail = int(stats.binom.ppf(alpha / 2, count, 0.5)) - 1
    while stats.binom.cdf(tail + 1, count, 0.5) <= alpha / 2:
        tail += 1
    if tail < 0:
        return None

    def power(share: float) -> float:
        return float(
            stats.binom.cdf(tail, count, share) + stats.binom.sf(count - tail - 1, count, share)
        )

    return float(optimize.root_scalar(lambda share: power(share) - POWER, bracket=(0.5, 1.0)).root)


RESAMPLES = 2000
SEED = 0
"""Fixed, so that the same answers give the same report."""


def participant_weights(num_participants: int) -> Float[np.ndarray, "B R"]:
    """How often each participant is drawn in each resample."""
    rng = np.random.default_rng(SEED)
    even = np.full(num_participants, 1 / num_participants)
    return rng.multinomial(num_participants, even, RESAMPLES).astype(float)


def percentile_intervals(
    samples: Float[np.ndarray, "B C"], num_participants: int
) -> Float[np.ndarray, "2 C"]:
    """Lower and upper limits from resampled estimates.

    Percentiles are expanded for few participants (Hesterberg 2015, "What teachers should know
    about the bootstrap", section 5.3): plain ones are too narrow by sqrt((R - 1) / R) and by what
    the normal quantile falls short of Student's.
    """
    if num_participants < 2:
        return np.stack([np.full(samples.shape[1:], -np.inf), np.full(samples.shape[1:], np.inf)])
    freedom = num_participants - 1
    student = stats.t.ppf((1 - CONFIDENCE) / 2, freedom)
    tail = stats.norm.cdf(np.sqrt(num_participants / freedom) * student)
    return np.quantile(samples, [tail, 1 - tail], axis=0)


def mean_intervals(values: Float[np.ndarray, "R K"]) -> list[Interval]:
    """An interval for the mean of each column over participants."""
    weights = participant_weights(len(values))
    low, high = percentile_intervals(weights @ values / len(values), len(values))
    return [Interval(float(a), float(b)) for a, b in zip(low, high, strict=True)]
