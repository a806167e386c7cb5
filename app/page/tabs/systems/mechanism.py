"""The part that opens the tab "Systems": the paper's argument on two bodies, without a network."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gradio as gr

from app.page.parts.asked import Field, Fields, a_file
from app.page.parts.catalogue import Catalogue
from app.page.tabs.services import Services
from app.page.tabs.systems.measured_figure import FigureRunner
from app.run.examples import CLEAN
from app.run.experiments.mechanism import NOISE_RAD, MechanismAsk, show_mechanism

TITLE = "The argument in ten seconds: equal noise on local and on global rotations"
INTRODUCTION = (
    "One motion, two bodies. Every joint is turned at random by the same amount, once against its "
    "parent and once in the world. No network takes part. Look at the fingertips, then move the "
    "slider."
)
NOISE_LABEL = "Noise on every joint, radians about each axis"
MOTION_LABEL = "Motion of your own (optional)"
_ON_OPENING = (
    '() => { import(new URL("web/once.js", document.baseURI))'
    '.then(({ pressOnce }) => pressOnce("mechanism-first")); }'
)


class MechanismRunner(FigureRunner):
    """Moves both bodies for a visitor, and shows what they show."""

    tab, title, introduction, verb = "mechanism", TITLE, INTRODUCTION, "Show both bodies"
    measure = staticmethod(show_mechanism)

    def __init__(self, tab: gr.Tab, services: Services) -> None:
        """
        Args:
            tab: that it opens; both bodies move as soon as that is looked at.
        """
        first = gr.Button(elem_id="mechanism-first", elem_classes="told-elsewhere")
        super().__init__(services, [first.click])
        tab.select(None, js=_ON_OPENING, api_visibility="private")

    def lay_out(self, catalogue: Catalogue) -> Fields:
        noise = gr.Slider(
            *NOISE_RAD, value=MechanismAsk.noise_rad, step=0.005, label=NOISE_LABEL, buttons=[],
            elem_id="mechanism-noise",
        )  # fmt: skip
        motion = gr.File(
            label=MOTION_LABEL,
            file_types=[".npz", ".npy", ".bvh"],
            type="filepath",
            height=110,
        )
        return {"noise": Field(noise), "motion": Field(motion, a_file)}

    def request(self, told: Mapping[str, Any], limits: Mapping[str, Any]) -> MechanismAsk:
        motions = (told["motion"] or CLEAN,)
        return MechanismAsk(motions=motions, noise_rad=told["noise"], has_video=False, **limits)
