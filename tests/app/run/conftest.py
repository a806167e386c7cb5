"""What runs need that a test folder makes once."""

from pathlib import Path

import pytest

from model.motion.motion import save_motion
from tests.helpers import smooth_motion_example


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    path = tmp_path / "clip.npz"
    save_motion(smooth_motion_example(40), path)
    return path
