"""Clips that several corpus tests look at, made once."""

import shutil

import pytest

from tools.corpus.clip import Clip, make_clip
from tools.corpus.people.rig import open_body_rig
from tools.corpus.people.speaker import SPEAKERS

LIVELY, CALM = "ewan", "hana"


@pytest.fixture(scope="session")
def flite() -> None:
    """Skip where the speech program is not installed."""
    if shutil.which("flite") is None or shutil.which("t2p") is None:
        pytest.skip("flite is not installed (apt-get install flite)")


@pytest.fixture(scope="session")
def clips(flite: None) -> dict[str, Clip]:
    """Half a minute of a lively, a calm and a left-handed speaker."""
    named = {s.name: s for s in SPEAKERS}
    return {
        name: make_clip(open_body_rig(), named[name], "train", 30.0, [7, named[name].number])
        for name in (LIVELY, CALM, "gus")
    }
