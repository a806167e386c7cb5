"""What several tests of the corpus look at, made once."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tools.corpus import build

CLIP_S, TWO_CLIPS_H = 8.0, 16 / 3600
"""Clips of seconds in place of a minute."""


@pytest.fixture(scope="session")
def flite() -> None:
    """Skip where the speech program is not installed."""
    if shutil.which("flite") is None or shutil.which("t2p") is None:
        pytest.skip("flite is not installed (apt-get install flite)")


@pytest.fixture(scope="session")
def corpus(flite: None, made_once: Callable[..., Path]) -> Path:
    """Two clips of seed 3."""

    def make(folder: Path) -> None:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(build, "CLIP_S", CLIP_S)
            build.build_corpus(folder / "corpus", TWO_CLIPS_H, seed=3, workers=1)

    return made_once("flite-corpus", make) / "corpus"
