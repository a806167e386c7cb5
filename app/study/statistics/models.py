"""Models of the answers: Bradley-Terry strengths, means, and agreement of raters.

Strengths: Davidson (1970) for ties, Davidson and Beaver (1977) for the advantage of one side: with
``x`` the log-strength of the left minus that of the right plus the advantage of the left, the
outcomes left, tie and right are as likely as ``exp(x / 2) : tie : exp(-x / 2)``. That is a
multinomial logit, linear in log-strengths, advantage and ``log(tie)``: the log-likelihood is
concave, and Newton's method finds its one maximum. The prior, a normal with mean 0 and standard
deviation `PRIOR_SD` on each of them, keeps the strength of a system that won everything finite;
with some hundred votes its effect is negligible.

Means: the participant is the unit; their answers over clips are averaged first, because they are
correlated. Intervals resample participants.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Literal

import numpy as np
import pandas as pd
from jaxtyping import Float
from scipy import sparse, stats
from scipy.special import log_softmax

from app.study.statistics.proportions import CONFIDENCE, Limits, ResultEstimate, with_holm

PRIOR_SD = 2.0
"""Prior standard deviation (natural log): a ratio of exp(2 * 2) = 55 is still plausible."""
RESAMPLES = 2000
SEED = 0
"""Fixed seed, so that the same answers give the same report."""
ELO_MEAN, ELO_SCALE = 1000.0, 400.0
"""Mean Elo rating, and the difference at which a system is expected to win ten times of eleven."""
_MAX_ITERATIONS = 200
_LONGEST_STEP = 2.0
_MAX_HALVINGS = 30
_TOLERANCE = 1e-9
_LEAST_SPREAD = 1e-6
"""Difference below which resamples are equal; Newton's method leaves differences of 1e-9."""
ALPHA_DRAWS = 500
"""Number of resamples of judged items for the interval of Krippendorff's alpha."""


def resample_counts(num_participants: int) -> Float[np.ndarray, "B R"]:
    """Return how often each participant is drawn in each resample."""
    rng = np.random.default_rng(SEED)
    shares = np.full(num_participants, 1 / num_participants)
    return rng.multinomial(num_participants, shares, RESAMPLES).astype(float)


def percentile_limits(
    samples: Float[np.ndarray, "B C"], num_participants: int
) -> Float[np.ndarray, "C 2"]:
    """Compute lower and upper limits from estimates of resamples of the participants.

    Percentiles are expanded for few participants (Hesterberg 2015, "What teachers should know about
    the bootstrap", section 5.3): plain ones are too narrow by sqrt((R - 1) / R) and by the
    difference of the normal quantile and Student's. Limits are infinite where resamples cannot
    differ (one participant, or all with the same answers): nothing is then known of how other
    participants vary.
    """
    if num_participants < 2:
        return np.tile([-np.inf, np.inf], (samples.shape[1], 1))
    student = stats.t.ppf((1 - CONFIDENCE) / 2, num_participants - 1)
    tail = stats.norm.cdf(np.sqrt(num_participants / (num_participants - 1)) * student)
    limits = np.quantile(samples, [tail, 1 - tail], axis=0).T
    limits[np.ptp(samples, axis=0) < _LEAST_SPREAD] = -np.inf, np.inf
    return limits


def bootstrap_mean_limits(values: Float[np.ndarray, "R K"]) -> list[Limits]:
    """Compute the limits of the mean of each column over participants."""
    drawn = resample_counts(len(values)) @ values / len(values)
    return [(float(low), float(high)) for low, high in percentile_limits(drawn, len(values))]


@dataclass(frozen=True)
class StrengthFit:
    """Fitted parameters (P) and those of resamples.

    Log-strengths that sum to 0, then the advantage of the left if votes have sides, then log(tie)
    if there are ties.
    """

    parameters: Float[np.ndarray, " P"]
    resampled_parameters: Float[np.ndarray, "B P"]
    num_raters: int
    has_ties: bool

    def contrast(
        self, measure: str, coefficients: dict[int, float], *systems: str
    ) -> ResultEstimate:
        """Return the sum of parameters with coefficients by index, and its interval."""
        each = np.zeros(len(self.parameters))
        each[list(coefficients)] = list(coefficients.values())
        ((low, high),) = percentile_limits(
            (self.resampled_parameters @ each)[:, None], self.num_raters
        )
        return ResultEstimate(
            measure, *systems, value=float(self.parameters @ each), low=low, high=high
        )


def fit_strengths(
    votes: pd.DataFrame, systems: Sequence[str], has_sides: bool, splits_ties: bool = False
) -> StrengthFit:
    """Fit log-strengths to votes.

    Votes from rankings have no sides. A split tie counts as half a win for each, as in Elo ratings.
    """
    sides = np.stack(
        [pd.Index(systems).get_indexer(votes[side].to_list()) for side in ("left", "right")]
    )
    match_ups, match_up = np.unique(sides, axis=1, return_inverse=True)
    score = votes.score.to_numpy()
    has_ties = bool((score == 0.5).any()) and not splits_ties
    if splits_ties:
        outcomes = np.stack([score, 1 - score], axis=1) * votes.weight.to_numpy()[:, None]
    else:
        outcomes = np.stack([score == 1, score == 0, score == 0.5][: 2 + has_ties], axis=1)
    rater = pd.factorize(votes.rater, sort=True)[0]
    num_raters = int(rater.max()) + 1
    counts = np.zeros((num_raters, match_ups.shape[1], outcomes.shape[1]))  # (R, M, O)
    np.add.at(counts, (rater, match_up.ravel()), outcomes.astype(float))

    num_systems = len(systems)
    design = np.zeros((*counts.shape[1:], num_systems + has_sides + has_ties))  # (M, O, P)
    rows = np.arange(len(design))
    for side, sign in zip(match_ups, (0.5, -0.5), strict=True):
        design[rows, 0, side], design[rows, 1, side] = sign, -sign
    if has_sides:
        design[:, 0, num_systems], design[:, 1, num_systems] = 0.5, -0.5
    if has_ties:
        design[:, 2, -1] = 1
    best = _maximum(design, counts.sum(0, keepdims=True), np.zeros(design.shape[2]))[0]
    drawn = np.einsum("br,rmo->bmo", resample_counts(num_raters), counts, optimize=True)
    return StrengthFit(best, _maximum(design, drawn, best), num_raters, has_ties)


def _maximum(
    design: Float[np.ndarray, "M O P"],
    counts: Float[np.ndarray, "B M O"],
    start: Float[np.ndarray, " P"],
) -> Float[np.ndarray, "B P"]:
    """Compute the maximum-likelihood parameters of B tables of counts by Newton's method.

    A step is halved until the penalised log-likelihood rises: whole steps can go back and forth
    over the maximum for ever, where a few counts all agree.
    """
    beta = np.tile(start, (len(counts), 1))
    votes = counts.sum(2)
    squares = np.einsum("mop,moq->mopq", design, design)
    height, log_shares = _log_likelihood(design, counts, beta)
    for _ in range(_MAX_ITERATIONS):
        expected = votes[..., None] * np.exp(log_shares)  # (B, M, O)
        gradient = np.einsum("bmo,mop->bp", counts - expected, design, optimize=True)
        gradient -= beta / PRIOR_SD**2
        # Minus the second derivative: covariance of the design, plus the prior's precision.
        second = np.einsum("bmo,mopq->bpq", expected, squares, optimize=True)
        mean = np.einsum("bmo,mop->bmp", expected, design, optimize=True)
        scaled = mean / np.maximum(votes, 1)[..., None]
        second -= np.einsum("bmp,bmq->bpq", mean, scaled, optimize=True)
        second += np.eye(design.shape[2]) / PRIOR_SD**2
        step = np.linalg.solve(second, gradient[..., None])[..., 0]
        length = np.abs(step).max(1, keepdims=True)
        step *= np.minimum(1, _LONGEST_STEP / np.maximum(length, _TOLERANCE))
        if length.max() < _TOLERANCE:
            return beta + step
        # Newton's step points upwards; near the maximum rounding may hide the rise.
        for _ in range(_MAX_HALVINGS):
            new_height, new_log_shares = _log_likelihood(design, counts, beta + step)
            falls = new_height < height - _TOLERANCE * np.abs(height)
            if not falls.any():
                break
            step[falls] /= 2
        beta, height, log_shares = beta + step, new_height, new_log_shares
    raise AssertionError(
        "Newton's method did not converge, although the log-likelihood is concave."
    )


def _log_likelihood(
    design: Float[np.ndarray, "M O P"],
    counts: Float[np.ndarray, "B M O"],
    beta: Float[np.ndarray, "B P"],
) -> tuple[Float[np.ndarray, " B"], Float[np.ndarray, "B M O"]]:
    """Compute the penalised log-likelihood of each table, and the log-shares of its outcomes."""
    log_shares = log_softmax(np.einsum("mop,bp->bmo", design, beta, optimize=True), axis=2)
    height = np.einsum("bmo,bmo->b", counts, log_shares, optimize=True)
    return height - (beta**2).sum(1) / (2 * PRIOR_SD**2), log_shares


def strengths_and_elo(
    votes: pd.DataFrame, systems: Sequence[str], has_sides: bool
) -> list[ResultEstimate]:
    """Compute log-strengths, their differences, tie parameter, left advantage and Elo ratings."""
    fit = fit_strengths(votes, systems, has_sides)
    estimates = [fit.contrast("log_strength", {i: 1.0}, name) for i, name in enumerate(systems)]
    estimates += [
        fit.contrast("log_strength_gap", {a: 1.0, b: -1.0}, systems[a], systems[b])
        for a, b in combinations(range(len(systems)), 2)
    ]
    estimates.append(
        ResultEstimate("tie_parameter", value=math.exp(fit.parameters[-1]) if fit.has_ties else 0.0)
    )
    if has_sides:
        estimates.append(fit.contrast("left_advantage", {len(systems): 1.0}))
    return estimates + elo_estimates(votes, systems)


def elo_estimates(votes: pd.DataFrame, systems: Sequence[str]) -> list[ResultEstimate]:
    """Compute Elo ratings as on leaderboards: ties half, no sides, clear preferences twice."""
    fit = fit_strengths(votes, systems, has_sides=False, splits_ties=True)
    scale = ELO_SCALE / math.log(10)
    estimates = [fit.contrast("elo", {i: scale}, name) for i, name in enumerate(systems)]
    return [one.shifted(ELO_MEAN) for one in estimates]


def mean_estimates(
    values: pd.DataFrame, systems: Sequence[str], measure: str
) -> tuple[int, list[ResultEstimate]]:
    """Compute means, differences and tests over the participants that judged every system.

    Tests are Friedman's and, for pairs, Wilcoxon's signed-rank test. Also returns the number of
    these participants; no numbers if it is 0.
    """
    table = values.pivot_table(index="rater", columns="system", values="value", aggfunc="mean")
    means = table.reindex(columns=list(systems)).dropna().to_numpy()  # (R, K)
    if not len(means):
        return 0, []
    estimates = [
        ResultEstimate(measure, name, None, float(value), *limits)
        for name, value, limits in zip(
            systems, means.mean(0), bootstrap_mean_limits(means), strict=True
        )
    ]
    pairs = list(combinations(range(len(systems)), 2))
    gaps = (
        np.stack([means[:, a] - means[:, b] for a, b in pairs], axis=1) if pairs else means[:, :0]
    )
    tested = [
        ResultEstimate(
            f"{measure}_gap", systems[a], systems[b], float(gap.mean()), *limits, p=_paired_p(gap)
        )
        for (a, b), gap, limits in zip(pairs, gaps.T, bootstrap_mean_limits(gaps), strict=True)
    ]
    friedman = ResultEstimate("friedman", p=_friedman_p(means))
    return len(means), [*estimates, *with_holm(tested), friedman]


def _paired_p(gap: Float[np.ndarray, " R"]) -> float:
    gap = np.round(gap, 9)  # means of equal ranks may differ in their last bit
    return float(stats.wilcoxon(gap).pvalue) if gap.any() else 1.0  # pyright: ignore


def _friedman_p(means: Float[np.ndarray, "R K"]) -> float | None:
    """Compute p that all systems are equal; None with fewer than 3 systems or 2 participants."""
    if means.shape[1] < 3 or len(means) < 2:
        return None
    rounded = np.round(means, 9)
    if (rounded == rounded[:, :1]).all():
        return 1.0
    return float(stats.friedmanchisquare(*rounded.T).pvalue)  # pyright: ignore


Level = Literal["nominal", "ordinal", "interval"]


def krippendorff_alpha(units: Iterable[Sequence[float]], level: Level) -> float | None:
    """Compute Krippendorff's alpha from coincidences.

    Krippendorff 2011, "Computing Krippendorff's Alpha-Reliability".

    Args:
        units: values of each judged item, in any order; raters may be missing.
        level: level of measurement of the values: names, an order, or numbers.

    Returns:
        None if no unit has two values, or all values are the same, so that alpha is undefined.
    """
    values, by_unit = _coincidences(units)
    return _alpha(np.asarray(by_unit.sum(axis=0)), values, level)


def alpha_estimate(units: Iterable[Sequence[float]], level: Level) -> ResultEstimate:
    """Compute alpha with its interval over resampled items."""
    values, by_unit = _coincidences(units)
    count = by_unit.shape[0]
    measure = f"krippendorff_alpha_{level}"
    alpha = _alpha(np.asarray(by_unit.sum(axis=0)), values, level)
    if alpha is None:
        return ResultEstimate(measure)
    drawn = (_alpha(draw @ by_unit, values, level) for draw in resample_counts(count)[:ALPHA_DRAWS])
    unit_values = np.array([[one] for one in drawn if one is not None])
    ((low, high),) = percentile_limits(unit_values, count if len(unit_values) == ALPHA_DRAWS else 1)
    return ResultEstimate(measure, value=alpha, low=low, high=high)


def _coincidences(units: Iterable[Sequence[float]]) -> tuple[Float[np.ndarray, " V"], Any]:
    """Return the distinct values (V), and their coincidences per unit (sparse, U x V * V)."""
    pairable = [np.asarray(unit, dtype=float) for unit in units if len(unit) >= 2]
    if not pairable:
        return np.empty(0), sparse.csr_matrix((0, 0))
    values, codes = np.unique(np.concatenate(pairable), return_inverse=True)
    ends = np.cumsum([len(unit) for unit in pairable])
    rows = []
    for unit in np.split(codes, ends[:-1]):
        counts = np.bincount(unit, minlength=len(values)).astype(float)
        pairs = (np.outer(counts, counts) - np.diag(counts)) / (len(unit) - 1)
        rows.append(sparse.csr_matrix(pairs.reshape(1, -1)))
    return values, sparse.vstack(rows, format="csr")


def _alpha(
    coincidences: Float[np.ndarray, ...], values: Float[np.ndarray, " V"], level: Level
) -> float | None:
    coincidences = coincidences.reshape(len(values), len(values))
    totals = coincidences.sum(1)
    if level == "nominal":
        difference = 1 - np.eye(len(values))
    elif level == "interval":
        difference = np.subtract.outer(values, values) ** 2
    else:  # sum of the totals from one value to the other, both ends counted half
        middle = np.cumsum(totals) - totals / 2
        difference = np.subtract.outer(middle, middle) ** 2
    expected = totals @ difference @ totals
    if expected == 0:
        return None
    return float(1 - (totals.sum() - 1) * (coincidences * difference).sum() / expected)
