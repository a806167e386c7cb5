"""Bradley-Terry strengths with ties and an order effect, under a weak prior.

Davidson (1970) for ties, Davidson and Beaver (1977) for the advantage of one side: with ``x`` the
log-strength of the left minus that of the right plus the advantage of the left, the outcomes left,
tie and right are as likely as ``exp(x / 2) : tie : exp(-x / 2)``. That is a multinomial logit,
linear in log-strengths, advantage and ``log(tie)``: the log-likelihood is concave, and Newton's
method finds its one maximum.

The prior, a normal with mean 0 and standard deviation `PRIOR_SD` on each of them, keeps a system
that won everything finite; beside some hundred votes it is not felt.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Float

from app.study.statistics.preference import Interval, participant_weights, percentile_intervals
from app.study.statistics.votes import Votes

PRIOR_SD = 2.0
"""In natural-log units: a strength ratio of exp(2 * 2) = 55 is still plausible before any vote."""

_MAX_ITERATIONS = 200
_LONGEST_STEP = 2.0
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Strengths:
    """Log-strengths that sum to 0, and what they imply."""

    log_strength: Float[np.ndarray, " K"]
    intervals: tuple[Interval, ...]
    differences: dict[tuple[int, int], tuple[float, Interval]]
    """Log-strength of the first minus that of the second system."""
    tie: float
    """Davidson's tie parameter; 0 without ties."""
    left_advantage: float | None
    """Added to the log-strength of what stands on the left; None where nothing has a side."""
    left_interval: Interval | None


def fit_strengths(votes: Votes, num_systems: int, has_sides: bool) -> Strengths:
    """Strengths with bootstrap intervals over participants.

    Args:
        has_sides: whether left and right were seen as such (not in votes that rankings imply).
    """
    model = _Model(votes, num_systems, has_sides)
    best = model.fit(model.counts.sum(0, keepdims=True))[0]
    num_raters = len(model.counts)
    drawn = np.einsum("br,rmo->bmo", participant_weights(num_raters), model.counts, optimize=True)
    samples = model.fit(drawn, start=best)
    low, high = percentile_intervals(samples, num_raters)
    pairs = list(combinations(range(num_systems), 2))
    gaps = np.stack([samples[:, a] - samples[:, b] for a, b in pairs], axis=1)
    gap_low, gap_high = percentile_intervals(gaps, num_raters)
    side = model.side_column
    return Strengths(
        log_strength=best[:num_systems],
        intervals=tuple(Interval(float(low[k]), float(high[k])) for k in range(num_systems)),
        differences={
            (a, b): (float(best[a] - best[b]), Interval(float(gap_low[i]), float(gap_high[i])))
            for i, (a, b) in enumerate(pairs)
        },
        tie=float(np.exp(best[-1])) if model.has_ties else 0.0,
        left_advantage=None if side is None else float(best[side]),
        left_interval=None if side is None else Interval(float(low[side]), float(high[side])),
    )


class _Model:
    """The logit's design for the match-ups that occurred, and its maximum a posteriori.

    Parameters (P): K log-strengths, then the advantage of the left if sides are seen, then
    log(tie) if there are ties. Outcomes (O): left, right and, if there are any, tie.
    """

    def __init__(self, votes: Votes, num_systems: int, has_sides: bool) -> None:
        self.has_ties = bool((votes.score == 0.5).any())
        self.side_column = num_systems if has_sides else None
        self._num_systems = num_systems
        match_ups, match_up = np.unique(
            np.stack([votes.left, votes.right]), axis=1, return_inverse=True
        )
        outcome = np.where(votes.score == 1, 0, np.where(votes.score == 0, 1, 2))
        rater = np.unique(votes.rater, return_inverse=True)[1]
        num_outcomes = 3 if self.has_ties else 2
        self.counts = np.zeros((int(rater.max()) + 1, match_ups.shape[1], num_outcomes))
        """(R, M, O)"""
        np.add.at(self.counts, (rater, match_up.ravel(), outcome), 1)

        design = np.zeros(
            (match_ups.shape[1], num_outcomes, num_systems + has_sides + self.has_ties)
        )
        for row, (left, right) in enumerate(match_ups.T):
            design[row, 0, left] = design[row, 1, right] = 0.5
            design[row, 1, left] = design[row, 0, right] = -0.5
        if has_sides:
            design[:, 0, num_systems], design[:, 1, num_systems] = 0.5, -0.5
        if self.has_ties:
            design[:, 2, -1] = 1
        self._design = design

    def fit(
        self, counts: Float[np.ndarray, "B M O"], start: Float[np.ndarray, " P"] | None = None
    ) -> Float[np.ndarray, "B P"]:
        """Newton's method on all B tables of counts at once; log-strengths sum to 0."""
        design = self._design
        num_parameters = design.shape[2]
        first = np.zeros(num_parameters) if start is None else start
        beta = np.tile(first, (len(counts), 1))
        votes = counts.sum(2)
        for _ in range(_MAX_ITERATIONS):
            logits = np.einsum("mop,bp->bmo", design, beta, optimize=True)
            weights = np.exp(logits - logits.max(2, keepdims=True))
            expected = votes[..., None] * weights / weights.sum(2, keepdims=True)  # (B, M, O)
            gradient = np.einsum("bmo,mop->bp", counts - expected, design, optimize=True)
            gradient -= beta / PRIOR_SD**2
            step = np.linalg.solve(self._information(expected, votes), gradient[..., None])[..., 0]
            length = np.abs(step).max(1, keepdims=True)
            beta += step * np.minimum(1, _LONGEST_STEP / np.maximum(length, _TOLERANCE))
            if length.max() < _TOLERANCE:
                break
        else:
            raise AssertionError("Newton's method did not converge on a concave likelihood.")
        return beta

    def _information(
        self, expected: Float[np.ndarray, "B M O"], votes: Float[np.ndarray, "B M"]
    ) -> Float[np.ndarray, "B P P"]:
        """Minus the second derivative: covariance of the design, plus the prior's precision."""
        design = self._design
        squares = np.einsum("mop,moq->mopq", design, design)
        second = np.einsum("bmo,mopq->bpq", expected, squares, optimize=True)
        mean = np.einsum("bmo,mop->bmp", expected, design, optimize=True)
        scaled = mean / np.maximum(votes, 1)[..., None]
        second -= np.einsum("bmp,bmq->bpq", mean, scaled, optimize=True)
        return second + np.eye(design.shape[2]) / PRIOR_SD**2
