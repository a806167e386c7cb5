"""Every kind of system with tiny weights, loaded once a process."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from model.systems.globaldiff.config import PRIORFLOW
from model.systems.registry import load_system
from tests.model.made import TINY_BEST, TINY_SYSTEMS, make_weights
from tests.model.systems.asynfusion.made import make_asynfusion
from tests.model.systems.gan.made_generator import make_gan_weights


def make_every_weights(folder: Path) -> None:
    make_weights(folder, {**TINY_SYSTEMS, PRIORFLOW: TINY_BEST})
    make_gan_weights(folder)
    make_asynfusion(folder)


@pytest.fixture(scope="session")
def loaded(made_once) -> Callable[[str], Any]:
    """A system by its name; decomposing a prior takes longer than most tests."""
    folder = made_once("weights-of-every-family", make_every_weights)
    return cache(lambda name: load_system(name, folder))
