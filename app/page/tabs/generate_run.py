"""From a visitor's click to a run, and from the run's events to updates of the page."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import gradio as gr

from app import text
from app.config import AppConfig
from app.page.parts import markup
from app.page.parts.catalogue import Catalogue
from app.page.parts.html_parts import shown
from app.page.results.figures_shown import FiguresShown
from app.page.results.measures_table import measures_table
from app.page.results.player import Showing
from app.page.serving.follow import RunView, follow_run, visitor_sentence, waiting_line
from app.page.serving.jobs import Job, JobBook
from app.page.serving.media import MediaDesk
from app.page.serving.visitors import cookie_of, visitor_of
from app.page.tabs.generate import FormParts, ResultParts
from app.page.tabs.generate_form import Form, request_from_form, row_names
from app.run.bundle import zip_files
from app.run.request import Artefact, GenerateRequest, GenerateResult, OnEvent, ShouldCancel
from model.speech.transcript import read_words

Generate = Callable[[GenerateRequest, OnEvent, ShouldCancel], GenerateResult]
Updates = dict[Any, Any]
NOTHING: dict[str, Any] = {}
"""What a player shows before there is anything."""


class Runner:
    """Turns a visitor's click into a run and the run's events into updates of the page."""

    def __init__(
        self,
        generate: Generate,
        catalogue: Catalogue,
        config: AppConfig,
        jobs: JobBook,
        desk: MediaDesk,
        form: FormParts,
        results: ResultParts,
    ) -> None:
        self._generate = generate
        self._catalogue = catalogue
        self._config = config
        self._jobs = jobs
        self._desk = desk
        self._form = form
        self._results = results

    def run(self, request: gr.Request, *values: Any) -> Iterator[Updates]:
        """Updates of the page while a run goes on, for one visitor.

        Raises:
            gr.Error: with the sentence that the page shows too, when the run fails.
        """
        cookie = cookie_of(request)
        job: Job | None = None
        try:
            job = self._jobs.open(visitor_of(request), "generate")
            asked = request_from_form(Form(*values), job.folder, self._catalogue, self._config)
            words = read_words(asked.transcript) if asked.transcript else ()
            yield self._blank()
            with self._jobs.slot(job) as turn:
                for ahead in turn:
                    yield {self._results.status: markup.sentence_status(waiting_line(ahead))}
                run = RunView()
                showing = Showing(asked, row_names(asked), job.folder, self._desk, cookie, words)
                figures = FiguresShown(self._desk, cookie)
                for news in follow_run(partial(self._generate, asked), job):
                    if isinstance(news, GenerateResult):
                        yield self._finished(run, news, job, showing, figures)
                        continue
                    for event in news:
                        run.take(event)
                        if isinstance(event, Artefact):
                            showing.take(event)
                            figures.take(event)
                    yield self._progress(run, showing, figures)
        except Exception as error:
            sentence = visitor_sentence(error)
            yield self._failed(sentence)
            if sentence != text.CANCELLED:
                raise gr.Error(sentence, print_exception=False) from error
        finally:
            if job is not None:
                self._jobs.close(job)

    def cancel(self, request: gr.Request) -> None:
        """The visitor has pressed the button, or closed the page."""
        self._jobs.cancel(visitor_of(request), "generate")

    def _blank(self) -> Updates:
        """Everything of an earlier run away, buttons as they are during a run."""
        parts = self._results
        return {
            parts.message: shown(""),
            parts.status: markup.status(text.STARTING, {}, {}),
            parts.empty: gr.update(visible=False),
            **self._without_results(),
            parts.files: None,
            **self._buttons(is_running=True),
        }

    def _without_results(self) -> Updates:
        parts = self._results
        return {
            parts.player: NOTHING,
            parts.figures: shown(""),
            parts.numbers: shown(""),
            parts.downloads_part: gr.update(visible=False),
        }

    def _buttons(self, is_running: bool) -> Updates:
        return {
            self._form.generate: gr.update(interactive=not is_running),
            self._form.cancel: gr.update(visible=is_running),
        }

    def _progress(self, run: RunView, showing: Showing, figures: FiguresShown) -> Updates:
        parts = self._results
        updates: Updates = {parts.status: markup.status(run.line, run.fractions, run.details)}
        if run.artefacts:
            updates[parts.player] = showing.value()
            updates[parts.figures] = shown(figures.html())
        return updates

    def _finished(
        self,
        run: RunView,
        result: GenerateResult,
        job: Job,
        showing: Showing,
        figures: FiguresShown,
    ) -> Updates:
        parts = self._results
        bundle = zip_files(result.files, job.folder / "co-speech-motion.zip")
        rows = f"{len(result.names)} {'motion' if len(result.names) == 1 else 'motions'}"
        line = text.DONE.format(seconds=run.seconds, rows=rows, frames=result.num_frames)
        return {
            parts.status: markup.status(line, dict.fromkeys(run.fractions, 1.0), {}),
            parts.message: shown(markup.notes_message(result.notes)),
            parts.player: showing.value(is_over=True),
            parts.figures: shown(figures.html(result.diagnostics)),
            parts.numbers: shown(measures_table(result.diagnostics)),
            parts.downloads_part: gr.update(visible=True),
            parts.bundle: gr.update(value=str(bundle)),
            parts.files: [str(file) for file in result.files],
            **self._buttons(is_running=False),
        }

    def _failed(self, sentence: str) -> Updates:
        parts = self._results
        is_cancelled = sentence == text.CANCELLED
        return {
            parts.message: shown("" if is_cancelled else markup.error_message(sentence)),
            parts.status: markup.sentence_status(text.CANCELLED if is_cancelled else text.STOPPED),
            parts.empty: gr.update(visible=True),
            **self._without_results(),
            **self._buttons(is_running=False),
        }
