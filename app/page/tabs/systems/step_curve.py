"""The part of the tab "Systems" that measures quality against time on this machine."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gradio as gr

from app.errors import RunError
from app.page.parts.asked import Field, Fields, a_file
from app.page.parts.catalogue import Catalogue
from app.page.tabs.systems.measured_figure import FigureRunner
from app.run.experiments.step_curve import StepsAsk, measure_step_curve

TITLE = "What steps buy, measured here"
INTRODUCTION = (
    "The same speech with 1, 2, 4, 8 and 25 steps: how the fingertip jerks, how far the motion is "
    "from that of 25 steps, and what a frame costs on the machine that serves this page. The same "
    "as <code>python -m app steps</code>."
)
NO_SYSTEM = "Tick at least one system to measure."
NO_SPEECH = "Upload speech to measure with; this installation has no examples."


class StepCurveRunner(FigureRunner):
    """Measures ticked systems with few and with many steps."""

    tab, verb = "steps", "Measure"
    title, introduction = TITLE, INTRODUCTION
    measure = staticmethod(measure_step_curve)

    def lay_out(self, catalogue: Catalogue) -> Fields:
        systems = self.systems(catalogue, "steps")
        speech = gr.File(
            label="Speech (optional: an example otherwise; ten seconds are used)",
            file_types=["audio"],
            type="filepath",
            height=110,
        )
        return {"systems": systems, "speech": Field(speech, a_file)}

    def request(self, told: Mapping[str, Any], limits: Mapping[str, Any]) -> StepsAsk:
        path = told["speech"] or next(iter(self.examples), None)
        if not told["systems"]:
            raise RunError(NO_SYSTEM)
        if path is None:
            raise RunError(NO_SPEECH)
        return StepsAsk(systems=told["systems"], speech=path, **limits)
