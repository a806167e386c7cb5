"""Tiny weights for the page."""

from pathlib import Path

import pytest

from tests.model.made import make_weights


@pytest.fixture(scope="session")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_weights(tmp_path_factory.mktemp("weights"))
