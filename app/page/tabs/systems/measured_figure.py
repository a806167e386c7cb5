"""What parts of a tab share that measure something in a run and show it as a figure."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Generator, Mapping, Sequence
from html import escape
from typing import Any, ClassVar

import gradio as gr

from app import text
from app.page.parts import markup
from app.page.parts.asked import Field, Fields, values_of
from app.page.parts.html_parts import reveal_on_click, shown, told_part
from app.page.queue.jobs import Job
from app.page.queue.runner import TabRunner, Updates
from app.page.results.result_parts import figures_html
from app.page.tabs.services import Services
from app.run.output.run_folder import read_run
from app.run.requests.request import Ask
from model.generation.family import Use
from model.systems.registry import usual_systems

MEASURING = "Measuring: {share:.0%}"


class FigureRunner(TabRunner):
    """Lays out systems to tick and the part's own fields beside the figure, asks for a measurement,
    follows it, and shows its figure."""

    title: ClassVar[str]
    introduction: ClassVar[str]
    usual: ClassVar[Use]
    """Whose usual systems are ticked at first."""
    verb: ClassVar[str]
    """On the button that begins."""
    measure: ClassVar[Any]
    """The worker's task."""

    def __init__(self, services: Services) -> None:
        self._services = services
        self.examples = tuple(example.path for example in services.catalogue.examples)
        gr.HTML(f'{markup.heading(self.title)}<p class="hint">{self.introduction}</p>')
        installed = services.catalogue.systems
        with gr.Row(elem_classes="columns"):
            with gr.Column(scale=4, min_width=320, elem_classes="sheet"):
                systems = gr.CheckboxGroup(
                    choices=services.catalogue.system_choices,
                    value=[name for name in usual_systems(self.usual) if name in installed],
                    label="Systems",
                    elem_id=f"{self.tab}-systems",
                )
                self.fields = {"systems": Field(systems, tuple), **self.more_fields()}
                with gr.Row(elem_classes="actions"):
                    start = gr.Button(self.verb, variant="primary", elem_id=f"{self.tab}-start")
                    cancel = gr.Button(text.CANCEL, elem_id=f"{self.tab}-cancel", min_width=110)
            with gr.Column(scale=9, min_width=320, elem_classes="results"):
                status = gr.HTML(markup.idle_status(text.READY), elem_id=f"{self.tab}-status")
                self.message = told_part()
                self.figure = told_part(f"{self.tab}-figures", "figures.js", "mountFigures")
        super().__init__(services.jobs, services.worker, status)
        reveal_on_click(start, status)
        outputs = [status, self.message, self.figure]
        run = self.begins_on(start.click, self.fields, outputs=outputs, api_name=self.tab)
        self.ends_on(cancel, run, outputs)

    @abstractmethod
    def more_fields(self) -> Fields:
        """Lay them out."""

    @abstractmethod
    def request(self, told: Mapping[str, Any], limits: Mapping[str, Any]) -> Ask:
        """What the fields ask for.

        Args:
            limits: fields of the ask that this page sets.

        Raises:
            RunError: a sentence for the visitor.
        """

    def steps(self, job: Job, values: Sequence[Any]) -> Generator[Updates, None, None]:
        limits = {
            "out": job.folder / "results",
            "weights": self._services.config.weights,
            "max_speech_s": self._services.config.max_speech_s,
        }
        asked = self.request(values_of(self.fields, values), limits)
        asked.check()
        yield self.stopped(markup.sentence_status(text.STARTING_SYSTEMS), "")
        yield from self.done(job, type(self).measure, asked, MEASURING)
        record = read_run(asked.out)
        lines = "".join(f"<li>{escape(sentence)}</li>" for sentence in record.notes)
        files = (asked.out / name for name in record.results)
        address = self._services.media.share(job.folder, job.cookie)
        yield {
            self._status: markup.sentence_status(record.sentence),
            self.message: shown(f'<ul class="hint">{lines}</ul>'),
            self.figure: shown(figures_html(files, address)),
        }

    def stopped(self, status: str, message: str) -> Updates:
        return {self._status: status, self.message: shown(message), self.figure: shown("")}
