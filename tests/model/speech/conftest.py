"""librosa, to check against."""

from collections.abc import Iterator
from types import ModuleType

import pytest
from numba.core import config


@pytest.fixture(scope="session")
def librosa(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    """The library, with the code that it compiles in a folder of this process alone: tests run
    side by side, and its own folder is not for several processes that begin at once."""
    before = config.CACHE_DIR
    config.CACHE_DIR = str(tmp_path_factory.mktemp("numba"))
    import librosa
    import librosa.core.pitch
    import librosa.filters
    import librosa.onset
    import librosa.util.utils

    yield librosa
    config.CACHE_DIR = before
