from pathlib import Path

from app import text
from app.page.tabs.motion_run import RunView
from app.run.requests.request import Artefact, Progress


def test_the_line_names_the_stage_at_work() -> None:
    view = RunView()
    assert view.line == text.STARTING
    view.take(Progress("speech", 1.0))
    view.take(Progress("motion", 0.5, "globaldiff/local"))
    assert view.line.startswith(text.STAGE_NAMES["motion"])
    assert view.fractions == {"speech": 1.0, "motion": 0.5} and not view.artefacts


def test_files_are_kept_apart_from_stages() -> None:
    view = RunView()
    artefact = Artefact("video", "globaldiff/local", Path("a.mp4"))
    view.take(artefact)
    assert view.artefacts == [artefact] and not view.fractions
