"""What a study of this size can see: power of the exact sign test."""

from __future__ import annotations

from scipy import optimize, stats

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
