"""What parts of a tab share that measure something in a run and show it as a figure."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Generator, Mapping, Sequence
from html import escape
from typing import Any, ClassVar

import gradio as gr

from app import text
from app.page.parts import markup
from app.page.parts.asked import Field, Fields, values_of
from app.page.parts.catalogue import Catalogue
from app.page.parts.html_parts import player_part, reveal_on_click, shown, told_part
from app.page.player.player import NOTHING, Showing
from app.page.queue.jobs import Job
from app.page.queue.runner import TabRunner, Updates, last_share
from app.page.results.result_parts import figures_html
from app.page.tabs.services import Services
from app.run.ask import Ask, Event, Grown
from model.generation.family import Use
from model.systems.registry import usual_systems

MEASURING = "Measuring: {share:.0%}"


class FigureRunner(TabRunner):
    """A part of a tab that asks for an experiment, plays what moves in its run, and shows its
    sentences and figure."""

    title: ClassVar[str]
    introduction: ClassVar[str]
    verb: ClassVar[str]
    """On the button that begins."""
    measure: ClassVar[Any]
    """The worker's task."""

    def __init__(self, services: Services, also: Sequence[Callable[..., Any]] = ()) -> None:
        """Lay out the part inside the current context and wire it.

        Args:
            also: other events than a click on which it begins.
        """
        self._services = services
        self.examples = tuple(example.path for example in services.catalogue.examples)
        gr.HTML(f'{markup.heading(self.title)}<p class="hint">{self.introduction}</p>')
        with gr.Row(elem_classes="columns"):
            with gr.Column(scale=4, min_width=320, elem_classes="sheet"):
                self.fields = dict(self.lay_out(services.catalogue))
                with gr.Row(elem_classes="actions"):
                    start = gr.Button(self.verb, variant="primary", elem_id=f"{self.tab}-start")
                    cancel = gr.Button(text.CANCEL, elem_id=f"{self.tab}-cancel", min_width=110)
            with gr.Column(scale=9, min_width=320, elem_classes="results"):
                status = gr.HTML(markup.idle_status(text.READY), elem_id=f"{self.tab}-status")
                self.player = player_part(f"{self.tab}-")
                self.message = told_part(f"{self.tab}-says")
                self.figure = told_part(f"{self.tab}-figures", "figures.js", "mountFigures")
        super().__init__(services.jobs, services.worker, status)
        reveal_on_click(start, status)
        outputs = [status, self.player, self.message, self.figure]
        inputs = [field.part for field in self.fields.values()]
        runs = [self.begins_on(start.click, self.fields, outputs=outputs, api_name=self.tab)]
        runs += [self.begins_on(event, inputs, outputs=outputs) for event in also]
        self.ends_on(cancel, runs, outputs)

    def systems(self, catalogue: Catalogue, use: Use) -> Field:
        """A field of systems, of which those are ticked that are usual for this."""
        ticked = [name for name in usual_systems(use) if name in catalogue.systems]
        choices = catalogue.system_choices
        label, elem_id = "Systems", f"{self.tab}-systems"
        return Field(gr.CheckboxGroup(choices, value=ticked, label=label, elem_id=elem_id), tuple)

    @abstractmethod
    def lay_out(self, catalogue: Catalogue) -> Fields:
        """The fields."""

    @abstractmethod
    def request(self, told: Mapping[str, Any], limits: Mapping[str, Any]) -> Ask:
        """What the fields ask for.

        Args:
            limits: fields of the ask that this page sets.

        Raises:
            RunError: a sentence for the visitor.
        """

    def steps(self, job: Job, values: Sequence[Any]) -> Generator[Updates, None, None]:
        config = self._services.config
        limits = {
            "out": job.folder / "results",
            "weights": config.weights,
            "body": config.body,
            "max_speech_s": config.max_speech_s,
            "is_kept": True,
        }
        asked = self.request(values_of(self.fields, values), limits)
        asked.check()
        yield self.stopped(markup.sentence_status(text.STARTING_SYSTEMS), "")
        address = self._services.media.share(job.folder, job.cookie)
        showing = Showing(asked.out, address, job.folder.name)

        def told(events: list[Event]) -> Updates:
            updates: Updates = {}
            has_grown = any(isinstance(event, Grown) for event in events)
            if has_grown and showing.has_begun and showing.record.is_moving:
                updates[self.player] = showing.value() | {"plays": True}
            share = last_share(events)
            if share is not None:
                updates[self._status] = markup.sentence_status(MEASURING.format(share=share))
            return updates

        yield from self.done(job, type(self).measure, asked, told)
        record = showing.record
        lines = "".join(f"<li>{escape(sentence)}</li>" for sentence in record.notes)
        files = (asked.out / name for name in record.results)
        yield {
            self._status: markup.sentence_status(record.sentence),
            self.player: showing.value() | {"plays": True},
            self.message: shown(f'<ul class="hint">{lines}</ul>'),
            self.figure: shown(figures_html(files, address)),
        }

    def stopped(self, status: str, message: str) -> Updates:
        return {
            self._status: status,
            self.player: NOTHING,
            self.message: shown(message),
            self.figure: shown(""),
        }
