"""Whole exports that the tests of studies look at and copy."""

from pathlib import Path

import pytest

from tests.app.study.made_study import CLIPS, SYSTEMS, make_study
from tests.conftest import MadeOnce


@pytest.fixture(scope="session")
def silent_study(made_once: MadeOnce) -> Path:
    """Pairs of twelve videos: enough for an order to be told from chance."""
    return made_once("silent-study", lambda f: make_study(f, SYSTEMS, CLIPS)) / "study"


@pytest.fixture(scope="session")
def spoken_study(made_once: MadeOnce) -> Path:
    """Right and wrong speech."""
    settings = 'protocol = "matched"'
    make = lambda folder: make_study(folder, SYSTEMS[:2], CLIPS[:2], settings)  # noqa: E731
    return made_once("spoken-study", make) / "study"
