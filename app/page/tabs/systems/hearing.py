"""The part of the tab "Systems" that shows what speech decides of a motion, and what chance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gradio as gr

from app import text
from app.errors import RunError
from app.page.parts.asked import Field, Fields, a_file
from app.page.parts.catalogue import USUAL, Catalogue, strength_choices, strength_of
from app.page.tabs.systems.measured_figure import FigureRunner
from app.run.experiments.hearing import HearingAsk, measure_hearing
from model.storage.cards import CALM_AND_LIVELY

TITLE = "Does it hear?"
INTRODUCTION = (
    "Two speeches by two noise seeds, four motions of each system: where it hears, motions of one "
    "speech rise and fall together; where it is deaf, those of one seed. The same as <code>python "
    "-m app hearing</code>, which takes anyone's motion too."
)
NO_SYSTEM = "Tick at least one system to compare."
NO_SPEECH = "Upload two speeches to compare; this installation has fewer than two examples."


class HearingRunner(FigureRunner):
    """Compares two speeches by two seeds."""

    tab, verb = "hearing", "Compare"
    title, introduction = TITLE, INTRODUCTION
    measure = staticmethod(measure_hearing)

    def lay_out(self, catalogue: Catalogue) -> Fields:
        systems = self.systems(catalogue, "hearing-tab")
        with gr.Row(elem_classes="pair"):
            speeches = [
                gr.File(
                    label=f"Speech {letter} (optional: an example otherwise)",
                    file_types=["audio"],
                    type="filepath",
                    height=110,
                    min_width=140,
                )
                for letter in "AB"
            ]
        strength = gr.Radio(
            strength_choices((1.0, 2.0, 3.0)),
            value=USUAL,
            label=text.GUIDANCE_LABEL,
            elem_id="hearing-strength",
        )
        calm, lively = CALM_AND_LIVELY
        speakers = gr.Checkbox(
            label=f"Compare {calm} and {lively}, too",
            info="A calm speaker and a lively one, with the first speech and the same seeds.",
            elem_id="hearing-speakers",
        )
        return {
            "systems": systems,
            "first": Field(speeches[0], a_file),
            "second": Field(speeches[1], a_file),
            "guidance": Field(strength, strength_of),
            "speakers": Field(speakers, lambda is_on: CALM_AND_LIVELY if is_on else None),
        }

    def request(self, told: Mapping[str, Any], limits: Mapping[str, Any]) -> HearingAsk:
        if not told["systems"]:
            raise RunError(NO_SYSTEM)
        given = [path for path in (told["first"], told["second"]) if path is not None]
        missing = 2 - len(given)
        spare = [path for path in self.examples if path.stem not in {p.stem for p in given}]
        if len(spare) < missing:
            raise RunError(NO_SPEECH)
        asked = {name: told[name] for name in ("systems", "guidance", "speakers")}
        return HearingAsk(speeches=(*given, *spare[:missing]), **asked, **limits)
