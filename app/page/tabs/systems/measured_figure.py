"""What parts of a tab share that measure something in a run and show it as a figure."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from html import escape
from typing import Any

import gradio as gr

from app import text
from app.page.parts import markup
from app.page.parts.asked import Field, Fields, values_of
from app.page.parts.catalogue import Catalogue
from app.page.parts.html_parts import AT_ONCE, in_turn, mount, named_fields, reveal_on_click, shown
from app.page.player.player import Address, browser_addresses
from app.page.queue.jobs import Job
from app.page.queue.runner import TabRunner, Updates, last_share
from app.page.queue.worker import Task
from app.page.results.result_parts import figures_html
from app.page.tabs.services import Services
from app.run.output.run_folder import read_run
from app.run.requests.request import Ask, Event, OnEvent, ShouldCancel

MEASURING = "Measuring: {share:.0%}"


@dataclass(frozen=True)
class FigureParts:
    """Where the figure and what is said of it are shown."""

    status: gr.HTML
    message: gr.HTML
    figure: gr.HTML


@dataclass(frozen=True)
class MeasuringSheet:
    """The fields and buttons of such a part, and where its figure is shown."""

    fields: Fields
    """The systems first."""
    start: gr.Button
    cancel: gr.Button
    parts: FigureParts


def build_measuring_sheet(
    name: str,
    catalogue: Catalogue,
    at_first: tuple[str, ...],
    build_fields: Callable[[], Fields],
    verb: str,
) -> MeasuringSheet:
    """Lay out systems to tick, the part's own fields and its buttons beside the figure.

    Args:
        name: begins the ids.
        at_first: systems that are ticked where they are installed.
        verb: on the button that begins.
    """
    with gr.Row(elem_classes="columns"):
        with gr.Column(scale=4, min_width=320, elem_classes="sheet"):
            systems = gr.CheckboxGroup(
                choices=catalogue.system_choices,
                value=[system for system in at_first if system in catalogue.systems],
                label="Systems",
                elem_id=f"{name}-systems",
            )
            fields = build_fields()
            with gr.Row(elem_classes="actions"):
                start = gr.Button(verb, variant="primary", elem_id=f"{name}-start")
                cancel = gr.Button(text.CANCEL, elem_id=f"{name}-cancel", min_width=110)
        with gr.Column(scale=9, min_width=320, elem_classes="results"):
            parts = _build_figure_parts(name)
    return MeasuringSheet({"systems": Field(systems, tuple), **fields}, start, cancel, parts)


def _build_figure_parts(name: str) -> FigureParts:
    return FigureParts(
        gr.HTML(markup.idle_status(text.READY), elem_id=f"{name}-status"),
        gr.HTML("", visible=False),
        gr.HTML(
            "",
            visible=False,
            js_on_load=mount("figures.js", "mountFigures"),
            apply_default_css=False,
            elem_id=f"{name}-figures",
        ),
    )


class FigureRunner(TabRunner[None]):
    """Asks for a measurement, follows it, and shows its figure."""

    def __init__(
        self,
        services: Services,
        measure: Task[Any, None],
        sheet: MeasuringSheet,
    ) -> None:
        super().__init__(services.jobs, sheet.parts.status)
        self.examples = tuple(example.path for example in services.catalogue.examples)
        self.measure: Task[Any, None] = partial(services.worker.do, measure)
        self.parts, self._sheet = sheet.parts, sheet
        self._config, self._addresses = services.config, services.addresses

    @abstractmethod
    def request(self, told: Mapping[str, Any], limits: Mapping[str, Any]) -> Ask:
        """What the fields ask for.

        Args:
            limits: fields of the ask that this page sets.

        Raises:
            RunError: a sentence for the visitor.
        """

    @contextmanager
    def begin(self, job: Job, cookie: str, values: tuple[Any, ...]) -> Iterator[_Work]:
        limits = {
            "out": job.folder / "results",
            "weights": self._config.weights,
            "max_speech_s": self._config.max_speech_s,
        }
        asked = self.request(values_of(self._sheet.fields, values), limits)
        asked.check()
        yield _Work(self, asked, browser_addresses(self._addresses, cookie))

    def blank(self) -> Updates:
        return self.stopped(markup.sentence_status(text.STARTING_SYSTEMS), "")

    def stopped(self, status: str, message: str) -> Updates:
        return {
            self.parts.status: status,
            self.parts.message: shown(message),
            self.parts.figure: shown(""),
        }

    def wire(self) -> None:
        """Let the buttons begin and end it; the tab's name is that of the API."""
        sheet = self._sheet
        reveal_on_click(sheet.start, self.parts.status)
        outputs = [self.parts.status, self.parts.message, self.parts.figure]
        run = sheet.start.click(
            named_fields(self.run, sheet.fields),
            inputs=[field.part for field in sheet.fields.values()],
            outputs=outputs,
            api_name=self.tab,
            **in_turn(self.parts.status),
        )
        sheet.cancel.click(self.cancel, outputs=outputs, cancels=run, **AT_ONCE)


@dataclass(frozen=True)
class _Work:
    """One measurement."""

    runner: FigureRunner
    asked: Ask
    address: Address

    def run(self, on_event: OnEvent, should_cancel: ShouldCancel) -> None:
        self.runner.measure(self.asked, on_event, should_cancel)

    def progress(self, events: list[Event]) -> Updates:
        share = last_share(events)
        if share is None:
            return {}
        return {self.runner.parts.status: markup.sentence_status(MEASURING.format(share=share))}

    def finished(self, result: None) -> Updates:
        """What the folder says."""
        record = read_run(self.asked.out)
        lines = "".join(f"<li>{escape(sentence)}</li>" for sentence in record.notes)
        files = (self.asked.out / name for name in record.results)
        return {
            self.runner.parts.status: markup.sentence_status(record.sentence),
            self.runner.parts.message: shown(f'<ul class="hint">{lines}</ul>'),
            self.runner.parts.figure: shown(figures_html(files, self.address)),
        }
