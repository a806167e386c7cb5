"""The part that measures what steps buy: what it asks for, and what it then shows."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gradio as gr
import pytest

from app.errors import RunError
from app.page.tabs.systems.measured_figure import FigureParts
from app.page.tabs.systems.step_curve import StepCurveRunner
from app.run.experiments.step_curve import StepCurve, StepCurveRequest, StepPoint
from tests.app.fakes import catalogue_of, made_services

VISITOR = SimpleNamespace(session_hash="visitor", cookies={})
EXAMPLE = Path("/examples/a.wav")

Runs = Callable[..., list[dict[Any, Any]]]


@pytest.fixture
def runs(tmp_path: Path) -> Runs:
    def run(measure: Any, *values: Any, example: Path | None = EXAMPLE) -> list[dict[Any, Any]]:
        with gr.Blocks():
            parts = FigureParts(gr.HTML(), gr.HTML(), gr.HTML())
        names = {getattr(parts, name): name for name in parts.__dataclass_fields__}
        runner = StepCurveRunner(
            made_services(tmp_path, catalogue=catalogue_of(*((example,) if example else ()))),
            measure,
            parts,
        )
        updates = []
        try:
            for update in runner.run(VISITOR, *values):  # type: ignore[arg-type]
                updates.append({names[part]: value for part, value in update.items()})
        except gr.Error as error:
            updates.append({"error": str(error.message)})
        return updates

    return run


def test_the_plot_of_what_was_measured_is_shown(runs: Runs) -> None:
    asked: list[StepCurveRequest] = []

    def measure(request: StepCurveRequest, on_progress: Callable[[float], None]) -> StepCurve:
        asked.append(request)
        on_progress(0.5)
        request.out.mkdir()
        (request.out / "steps.png").write_bytes(b"0")
        return StepCurve(
            (StepPoint("gan/5", 1, None, 0.5, 100.0, 0.0),), (request.out / "steps.png",)
        )

    updates = runs(measure, ["gan/5"], "/up/s.wav")
    assert any("50%" in str(update.get("status")) for update in updates)
    assert "Measured 1 motions." in updates[-1]["status"]
    assert updates[-1]["figure"]["visible"] and "<img" in updates[-1]["figure"]["value"]
    assert (asked[0].systems, asked[0].speech) == (("gan/5",), Path("/up/s.wav"))

    runs(measure, ["gan/5"], None)
    assert asked[1].speech == EXAMPLE


def test_what_is_missing_is_said(runs: Runs) -> None:
    def measure(request: StepCurveRequest, on_progress: Callable[[float], None]) -> StepCurve:
        raise RunError("never asked")

    assert runs(measure, [], "/up/s.wav")[-1] == {"error": "Tick at least one system to measure."}
    assert "no examples" in runs(measure, ["gan/5"], None, example=None)[-1]["error"]
    assert "One to 6 systems" in runs(measure, list("abcdefg"), None)[-1]["error"]
