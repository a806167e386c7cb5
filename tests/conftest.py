"""Settings for every test."""

import os
from collections.abc import Iterator

import pytest
import torch
from threadpoolctl import threadpool_limits

# Of this process and of all that it starts, workers of pytest-xdist among them: threads of several
# that wait for each other on the same cores make small matrices many times slower.
os.environ["OPENBLAS_NUM_THREADS"] = "1"
threadpool_limits(1, user_api="blas")


@pytest.fixture(autouse=True)
def _fixed_seed_and_one_thread() -> Iterator[None]:
    """Tests repeat exactly and do not fight over cores."""
    torch.manual_seed(0)
    torch.set_num_threads(1)
    yield
