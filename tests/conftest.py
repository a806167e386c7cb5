"""Settings for every test."""

from collections.abc import Iterator

import pytest
import torch


@pytest.fixture(autouse=True)
def _fixed_seed_and_one_thread() -> Iterator[None]:
    """Tests repeat exactly and do not fight over cores."""
    torch.manual_seed(0)
    torch.set_num_threads(1)
    yield
