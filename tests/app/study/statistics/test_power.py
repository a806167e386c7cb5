import pytest
from scipy import stats

from app.study.statistics.preference import POWER, smallest_share_detected


@pytest.mark.parametrize(("count", "alpha"), [(6, 0.05), (28, 0.05), (28, 0.05 / 6), (280, 0.05)])
def test_the_share_found_has_the_power_claimed(count: int, alpha: float) -> None:
    share = smallest_share_detected(count, alpha)
    assert share is not None
    power = sum(
        stats.binom.pmf(k, count, share)
        for k in range(count + 1)
        if stats.binomtest(k, count).pvalue <= alpha
    )
    assert power == pytest.approx(POWER, abs=1e-6)


def test_five_people_can_never_be_significant() -> None:
    assert smallest_share_detected(5) is None
    assert smallest_share_detected(0) is None
