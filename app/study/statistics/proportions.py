"""Preference shares: estimate, interval, test and power.

Votes of one participant are correlated, so the participant is the unit of chance, not the vote.

- Share: of all votes, a tie counted as half a vote for each. Ties are votes (the participant looked
  and saw no difference); leaving them out would make a rare preference look strong.
- Interval: Clopper-Pearson at the effective number of votes (Korn and Graubard 1998, as the U.S.
  National Center for Health Statistics uses it for clustered samples). It generalises to other
  participants who watch the same clips; the interval over clips to other clips, too.
- Test: exact binomial (sign) test over participants, each counted once for the side that got more
  of their votes. It is exact whatever the dependence within a participant. Barnard's test is for
  two independent groups, and here everybody judges everything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy import optimize, stats

CONFIDENCE = 0.95
MIN_CLIPS = 6
"""Fewest clips for an interval over clips."""
ALPHA = 0.05
POWER = 0.8

Limits = tuple[float, float]
"""Confidence limits at `CONFIDENCE`."""


@dataclass(frozen=True)
class ResultEstimate:
    """One number of the analysis: a row of ``results.csv``. Shares are 0 to 1."""

    measure: str
    first: str | None = None
    """Name of the first system of a comparison, or of the only system."""
    second: str | None = None
    value: float | None = None
    low: float | None = None
    high: float | None = None
    p: float | None = None
    p_holm: float | None = None
    """P value adjusted over the comparisons of the question."""
    wins: int = 0
    """Votes for the first system; of use only for measures of votes."""
    ties: int = 0
    losses: int = 0
    participants_for: int = 0
    """Participants with more votes for the first system."""
    participants_against: int = 0

    @property
    def num_votes(self) -> int:
        return self.wins + self.ties + self.losses

    @property
    def is_significant(self) -> bool:
        """True if p is below `ALPHA`, after Holm's correction where it applies."""
        p = self.p if self.p_holm is None else self.p_holm
        return p is not None and p < ALPHA

    @property
    def interval_side(self) -> int:
        """Side of chance on which the printed interval lies: 1 above, -1 below, else 0."""
        _, low, high = self.value_and_limits
        # Printed with two digits: in per cent without decimals, differences with two.
        return int(round(low, 2) > self._chance) - int(round(high, 2) < self._chance)

    @property
    def significant_side(self) -> int:
        """Side that is significantly preferred: 1 the first, -1 the second, else 0.

        Test and interval must agree; with votes, more participants must also lean to that side. If
        the interval is unknown, as all answered alike, the test decides.
        """
        value, low, high = self.value_and_limits
        is_finite = np.isfinite(high - low)
        side = self.interval_side if is_finite else int(np.sign(value - self._chance))
        lead = np.sign(self.participants_for - self.participants_against)
        return side if self.is_significant and (not self.num_votes or lead == side) else 0

    @property
    def _chance(self) -> float:
        return 0.5 if self.num_votes else 0.0

    @property
    def value_and_limits(self) -> tuple[float, float, float]:
        """Value, low and high; all must be known."""
        assert self.value is not None and self.low is not None and self.high is not None
        return self.value, self.low, self.high

    def shifted(self, by: float) -> ResultEstimate:
        value, low, high = self.value_and_limits
        return replace(self, value=value + by, low=low + by, high=high + by)

    def with_systems_swapped(self) -> ResultEstimate:
        """Return the same share from the second's side, or the negated difference."""
        whole = 1.0 if self.num_votes else 0.0
        value, low, high = self.value_and_limits
        return replace(
            self,
            first=self.second,
            second=self.first,
            value=whole - value,
            low=whole - high,
            high=whole - low,
            wins=self.losses,
            losses=self.wins,
            participants_for=self.participants_against,
            participants_against=self.participants_for,
        )


def proportion_estimates(
    measure: str,
    votes: pd.DataFrame,
    first: str | None = None,
    second: str | None = None,
    is_tested: bool = True,
) -> list[ResultEstimate]:
    """Compute share, interval and test of ``score``, and the share with two other intervals.

    The others are over clips too, from `MIN_CLIPS` on, and the plain Clopper-Pearson interval of
    decided votes as if independent, only to compare with papers that print it. Empty without votes.
    """
    if not len(votes):
        return []
    score = votes.score
    wins, losses = int((score == 1).sum()), int((score == 0).sum())
    share = float(score.mean())
    lead = (score - 0.5).groupby(votes.rater).sum()
    pro, con = int((lead > 0).sum()), int((lead < 0).sum())
    about = ResultEstimate(measure, first, second, share)
    effective = num_effective_votes(votes)
    low, high = clopper_pearson(share * effective, effective)
    p = sign_test(pro, con) if is_tested else None
    counts = (wins, len(score) - wins - losses, losses, pro, con)
    estimates = [ResultEstimate(measure, first, second, share, low, high, p, None, *counts)]
    if (over_clips := _effective_over_clips(votes)) is not None:
        low, high = clopper_pearson(share * over_clips, over_clips)
        estimates.append(replace(about, measure=f"{measure}_also_over_clips", low=low, high=high))
    if wins + losses:
        low, high = clopper_pearson(wins, wins + losses)
        plain, decided = f"{measure}_of_decided_as_if_independent", wins / (wins + losses)
        estimates.append(replace(about, measure=plain, value=decided, low=low, high=high))
    return estimates


def with_holm(estimates: Sequence[ResultEstimate]) -> list[ResultEstimate]:
    """Add p values adjusted over all estimates with a p value."""
    adjusted = iter(holm([estimate.p for estimate in estimates if estimate.p is not None]))
    return [
        replace(estimate, p_holm=None if estimate.p is None else next(adjusted))
        for estimate in estimates
    ]


def clopper_pearson(successes: float, trials: float) -> Limits:
    """Compute exact binomial limits (Clopper and Pearson 1934); both numbers may be fractions."""
    tail = (1 - CONFIDENCE) / 2
    failures = trials - successes
    low = stats.beta.ppf(tail, successes, failures + 1) if successes > 0 else 0.0
    high = stats.beta.ppf(1 - tail, successes + 1, failures) if failures > 0 else 1.0
    return float(low), float(high)


def sign_test(wins: int, losses: int) -> float:
    """Compute the exact two-sided p of a sign test; 1 without decided participants."""
    return float(stats.binomtest(wins, wins + losses).pvalue) if wins + losses else 1.0


def holm(p_values: Sequence[float]) -> list[float]:
    """Compute Holm's step-down adjusted p values (1979), in the order of the input."""
    adjusted = [0.0] * len(p_values)
    highest = 0.0
    for rank, index in enumerate(np.argsort(p_values, kind="stable")):
        highest = max(highest, min(1.0, (len(p_values) - rank) * p_values[index]))
        adjusted[index] = highest
    return adjusted


def num_effective_votes(
    votes: pd.DataFrame, variance: float | None = None, degrees_of_freedom: float | None = None
) -> float:
    """Compute the number of independent yes/no votes with the same information.

    Korn and Graubard 1998. The ratio of t quantiles widens for a variance that few clusters
    estimate. The result never exceeds the number if all votes were independent: a smaller variance
    is nearly always luck. Where all votes are the same, or one participant gave them all, their
    variance is unknown, and each participant counts as one vote. By default the variance of the
    share is that between participants.
    """
    score, num_raters = votes.score, votes.rater.nunique()
    of_one, share = float(score.var(ddof=0)), float(score.mean())
    if of_one == 0 or num_raters < 2:
        return float(num_raters)
    if variance is None:
        variance, degrees_of_freedom = _cluster_variance(votes, ["rater"]), num_raters - 1
    independent = share * (1 - share) * len(votes) / of_one
    if variance <= 0:
        return independent
    upper = (1 + CONFIDENCE) / 2
    few = stats.t.ppf(upper, len(votes) - 1) / stats.t.ppf(upper, degrees_of_freedom)
    return min(independent, float(share * (1 - share) / variance * few**2))


def _cluster_variance(votes: pd.DataFrame, by: list[str]) -> float:
    """Compute the share's variance over clusters (ratio estimator, linearised)."""
    apart = votes.score - votes.score.mean()
    sums = apart.groupby([votes[name] for name in by]).sum()
    count = len(sums)
    return float(count / (count - 1) * (sums**2).sum() / len(votes) ** 2) if count > 1 else 0.0


def _effective_over_clips(votes: pd.DataFrame) -> float | None:
    """Compute effective votes with participants and clips resampled; None for too few.

    Two-way clustered variance (Cameron et al. 2011). The few clips only weaken the part of the
    variance that they add (Satterthwaite 1946).
    """
    num_clips, num_raters = len(votes["clip"].unique()), len(votes.rater.unique())
    if num_clips < MIN_CLIPS or num_raters < 2:
        return None
    by_rater = _cluster_variance(votes, ["rater"])
    both = _cluster_variance(votes, ["rater", "clip"])
    added = max(0.0, _cluster_variance(votes, ["clip"]) - both)
    parts = by_rater**2 / (num_raters - 1) + added**2 / (num_clips - 1)
    variance = by_rater + added
    degrees_of_freedom = variance**2 / parts if parts > 0 else num_raters - 1
    return num_effective_votes(votes, variance, degrees_of_freedom)


def detectable_share(num_independent_votes: int, alpha: float = ALPHA) -> float | None:
    """Compute the smallest share that independent votes distinguish from 1/2 at `POWER`.

    Exact: the rejection region of the two-sided binomial test at ``alpha``. It is 0.5 to 1; None if
    even unanimous votes would not reach ``alpha``.
    """
    tail = int(stats.binom.ppf(alpha / 2, num_independent_votes, 0.5)) - 1
    while stats.binom.cdf(tail + 1, num_independent_votes, 0.5) <= alpha / 2:
        tail += 1
    if tail < 0:
        return None

    def lacks(share: float) -> float:
        low = stats.binom.cdf(tail, num_independent_votes, share)
        power = low + stats.binom.sf(num_independent_votes - tail - 1, num_independent_votes, share)
        return float(power) - POWER

    return float(optimize.root_scalar(lacks, bracket=(0.5, 1.0)).root)
