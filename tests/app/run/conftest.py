"""What runs need that a test folder makes once."""

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from model.motion.motion import save_motion
from tests.helpers import smooth_motion_example


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    path = tmp_path / "clip.npz"
    save_motion(smooth_motion_example(40), path)
    return path


@pytest.fixture
def drawing_children() -> Callable[[], list[str]]:
    """Command lines of the processes that draw for this one."""

    def found() -> list[str]:
        command = ["ps", "-ww", "--ppid", str(os.getpid()), "-o", "stat=,args="]
        told = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        return [
            line
            for line in told.splitlines()
            if "renderer.video.workers" in line and not line.startswith("Z")
        ]

    return found
