"""What is drawn of a run, before anything is drawn."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app.run.examples import CLEAN
from app.run.followed_point import choose_tip_source
from app.run.output.result_folder import ResultFolder
from app.run.output.telling import Reporter
from app.run.requests.request import GenerateRequest
from app.run.videos import comparison
from app.run.videos.comparison import Row, draw_all
from conventions.names import REFERENCE_NAME
from model.motion.motion import load_motion
from renderer.body.body import load_body
from tests.app.run.videos.test_own_videos import moved


class _Drawing(Exception):
    """Begins now."""


def test_all_bodies_of_a_run_are_in_register(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A reference that was recorded elsewhere stands where the systems stand, as large as they."""
    jobs: dict[str, Any] = {}

    def begin(given: dict[str, Any], **options: Any) -> None:
        jobs.update(given)
        raise _Drawing

    monkeypatch.setattr(comparison, "draw_videos", begin)
    body = load_body()
    motion = load_motion(CLEAN).part(slice(40))
    elsewhere = moved(motion, 120.0)
    rows = [Row("a", motion, motion), Row(REFERENCE_NAME, elsewhere, elsewhere)]
    request = GenerateRequest(tmp_path / "s.wav", tmp_path / "out", tmp_path)
    inputs: Any = SimpleNamespace(body=body, wav=tmp_path / "s.wav")
    reporter = Reporter(lambda event: None, lambda: False)
    with pytest.raises(_Drawing), ResultFolder(tmp_path / "out") as folder:
        draw_all(request, inputs, rows, choose_tip_source(body, None), folder, reporter)
    mine, theirs = (
        body.joint_positions(jobs[f"{name}.mp4"].motion) for name in ("a", REFERENCE_NAME)
    )
    np.testing.assert_allclose(theirs, mine, atol=1e-4)
    assert np.abs(np.median(mine[:, 0, [0, 2]], axis=0)).max() < 1e-4
    assert jobs["a.mp4"].stage == jobs[f"{REFERENCE_NAME}.mp4"].stage
