"""The part that opens the tab "Systems": the paper's argument on two bodies, without a network."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from html import escape
from typing import Any

import gradio as gr

from app import text
from app.page.parts import markup
from app.page.parts.asked import Field, a_file, values_of
from app.page.parts.html_parts import player_part, reveal_on_click, shown, told_part
from app.page.player.player import NOTHING, Showing
from app.page.queue.jobs import Job
from app.page.queue.runner import TabRunner, Updates
from app.page.results.result_parts import figures_html
from app.page.tabs.services import Services
from app.run.examples import CLEAN
from app.run.experiments.mechanism import DRAWN, NOISE_RAD, MechanismAsk, show_mechanism
from app.run.output.run_folder import file_of
from app.run.requests.request import Event, Grown

TITLE = "The argument in ten seconds: equal noise on local and on global rotations"
INTRODUCTION = (
    "One motion, two bodies. Every joint is turned at random by the same amount, once against its "
    "parent and once in the world. No network takes part. Look at the fingertips, then move the "
    "slider."
)
NOISE_LABEL = "Noise on every joint, radians about each axis"
MOTION_LABEL = "Motion of your own (optional)"
SHOW = "Show both bodies"
_ON_OPENING = (
    '() => { import(new URL("web/once.js", document.baseURI))'
    '.then(({ pressOnce }) => pressOnce("mechanism-first")); }'
)


class MechanismRunner(TabRunner):
    """Moves both bodies for a visitor, and shows what they show."""

    tab = "mechanism"

    def __init__(self, tab: gr.Tab, services: Services) -> None:
        """Lay out the part inside the current context and wire it.

        Args:
            tab: that it opens; both bodies move as soon as that is looked at.
        """
        self._services = services
        gr.HTML(f'{markup.heading(TITLE)}<p class="hint">{INTRODUCTION}</p>')
        with gr.Row(elem_classes="columns"):
            with gr.Column(scale=4, min_width=320, elem_classes="sheet"):
                noise = gr.Slider(
                    *NOISE_RAD, value=MechanismAsk.noise_rad, step=0.005, label=NOISE_LABEL,
                    buttons=[], elem_id="mechanism-noise",
                )  # fmt: skip
                motion = gr.File(
                    label=MOTION_LABEL,
                    file_types=[".npz", ".npy", ".bvh"],
                    type="filepath",
                    height=110,
                )
                with gr.Row(elem_classes="actions"):
                    start = gr.Button(SHOW, variant="primary", elem_id="mechanism-start")
                    cancel = gr.Button(text.CANCEL, elem_id="mechanism-cancel", min_width=110)
            with gr.Column(scale=9, min_width=320, elem_classes="results"):
                status = gr.HTML(markup.idle_status(text.READY), elem_id="mechanism-status")
                self.message = told_part()
                self.player = player_part("mechanism-")
                self.says = told_part("mechanism-says", "figures.js", "mountFigures")
        super().__init__(services.jobs, services.worker, status)
        self._fields = {"noise": Field(noise), "motion": Field(motion, a_file)}
        first = gr.Button(elem_id="mechanism-first", elem_classes="told-elsewhere")
        reveal_on_click(start, status)
        outputs = [status, self.message, self.player, self.says]
        runs = [
            self.begins_on(start.click, self._fields, outputs=outputs, api_name=self.tab),
            self.begins_on(first.click, [noise, motion], outputs=outputs),
        ]
        tab.select(None, js=_ON_OPENING, api_visibility="private")
        self.ends_on(cancel, runs, outputs)

    def steps(self, job: Job, values: Sequence[Any]) -> Generator[Updates, None, None]:
        told, config = values_of(self._fields, values), self._services.config
        asked = MechanismAsk(
            motions=(told["motion"] or CLEAN,),
            out=job.folder / "results",
            body=config.body,
            has_video=False,
            noise_rad=told["noise"],
            is_kept=True,
        )
        asked.check()
        yield self.stopped(markup.sentence_status(text.STARTING), "")
        address = self._services.media.share(job.folder, job.cookie)
        showing = Showing(asked.out, address, job.folder.name)

        def played(line: str) -> Updates:
            value = showing.value() | {"plays": True}
            return {self.player: value, self._status: markup.sentence_status(line)}

        def grown(events: list[Event]) -> Updates:
            if not any(isinstance(event, Grown) for event in events):
                return {}
            line = DRAWN.format(noise=asked.noise_rad)
            return played(line) if showing.record.is_moving else {}

        yield from self.done(job, show_mechanism, asked, grown)
        record = showing.record
        says = "".join(f"<p>{escape(sentence)}</p>" for sentence in record.notes)
        files = (file_of(showing.folder, name) for name in record.files)
        figures = figures_html(filter(None, files), address)
        below = shown(f'<div class="says">{says}</div>{figures}')
        yield {**played(record.sentence), self.says: below}

    def stopped(self, status: str, message: str) -> Updates:
        return {
            self._status: status,
            self.message: shown(message),
            self.player: NOTHING,
            self.says: shown(""),
        }
