"""What trainings of these tests do without."""

from collections.abc import Iterator

import pytest

from model.training import targets


@pytest.fixture(scope="session", autouse=True)
def _priors_of_few_windows() -> Iterator[None]:
    """A prior is fitted in a tenth of a second, and as well as tests need."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(targets, "PRIOR_BATCHES", 1)
        patch.setattr(targets, "PRIOR_BATCH_SIZE", 64)
        yield
