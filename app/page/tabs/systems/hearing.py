"""The part of the tab "Systems" that shows what speech decides of a motion, and what chance."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.errors import RunError
from app.page.parts import markup
from app.page.parts.asked import form_of
from app.page.parts.catalogue import USUAL, strength_choices, strength_of
from app.page.tabs.services import Services
from app.page.tabs.systems.measured_figure import FigureRunner, build_measuring_sheet
from app.run.experiments.hearing import Hearing, HearingAsk, measure_hearing
from model.storage.cards import CALM_AND_LIVELY
from model.systems.registry import usual_systems

TITLE = "Does it hear?"
INTRODUCTION = (
    "Two speeches by two noise seeds, four motions of each system: where it hears, motions of one "
    "speech rise and fall together; where it is deaf, those of one seed. The same as <code>python "
    "-m app hearing</code>, which takes anyone's motion too."
)
COMPARED = "Compared two speeches by two seeds, of {systems}."
NO_SYSTEM = "Tick at least one system to compare."
NO_SPEECH = "Upload two speeches to compare; this installation has fewer than two examples."


def build_hearing(services: Services) -> None:
    """Lay out the part inside the current context and wire it."""
    gr.HTML(f'{markup.heading(TITLE)}<p class="hint">{INTRODUCTION}</p>')
    sheet = build_measuring_sheet(
        "hearing", services.catalogue, usual_systems("hearing-tab"), _build_fields, "Compare"
    )
    HearingRunner(services, measure_hearing, sheet.parts).wire(sheet)


def _build_fields() -> list[Any]:
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
    return [*speeches, strength, speakers]


@dataclass(frozen=True)
class HearingForm:
    """What the visitor has filled in, as Gradio hands it over."""

    systems: list[str]
    first: str | None
    second: str | None
    strength: float
    has_speakers: bool


class HearingRunner(FigureRunner[HearingAsk, Hearing]):
    """Compares two speeches by two seeds."""

    tab = "hearing"
    form = HearingForm
    optional = ("first", "second")

    def request(self, values: tuple[Any, ...], out: Path) -> HearingAsk:
        """See `FigureRunner.request`."""
        form = form_of(HearingForm, values)
        if not form.systems:
            raise RunError(NO_SYSTEM)
        given = [Path(path) for path in (form.first, form.second) if path]
        missing = 2 - len(given)
        spare = [path for path in self.examples if path.stem not in {p.stem for p in given}]
        if len(spare) < missing:
            raise RunError(NO_SPEECH)
        return HearingAsk(
            ask=self.ask(form.systems, out, guidance=strength_of(form.strength)),
            speeches=(*given, *spare[:missing]),
            speakers=CALM_AND_LIVELY if form.has_speakers else None,
        )

    def told(self, found: Hearing) -> str:
        """See `FigureRunner.told`."""
        count = len(found.systems)
        return COMPARED.format(systems=f"{count} system{'s' if count > 1 else ''}")
