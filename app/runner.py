"""From a visitor's click to a run, and from the run's events to updates of the page."""

from __future__ import annotations

import secrets
from collections.abc import Iterator, Sequence
from typing import Any

import gradio as gr

from app import text, view
from app.bundle import zip_files
from app.catalogue import Catalogue
from app.config import AppConfig
from app.handlers import (
    Form,
    Generate,
    RunView,
    follow_run,
    request_from_form,
    row_names,
    visitor_sentence,
    waiting_line,
)
from app.jobs import Job, JobBook
from app.parts import HIDDEN, FormParts, ResultParts
from app.request import Artefact, GenerateResult

Updates = dict[Any, Any]


class Runner:
    """Turns a visitor's click into a run and the run's events into updates of the page."""

    def __init__(
        self,
        generate: Generate,
        catalogue: Catalogue,
        config: AppConfig,
        jobs: JobBook,
        form: FormParts,
        results: ResultParts,
    ) -> None:
        self._generate = generate
        self._catalogue = catalogue
        self._config = config
        self._jobs = jobs
        self._form = form
        self._results = results

    def run(self, request: gr.Request, *values: Any) -> Iterator[Updates]:
        """Updates of the page while a run goes on, for one visitor.

        Raises:
            gr.Error: with the sentence that the page shows too, when the run fails.
        """
        visitor = _visitor(request)
        job: Job | None = None
        try:
            job = self._jobs.open(visitor)
            asked = request_from_form(Form(*values), job.folder, self._catalogue, self._config)
            yield self._blank()
            with self._jobs.slot(job) as turn:
                for ahead in turn:
                    yield {self._results.status: view.sentence_status(waiting_line(ahead))}
                run = RunView()
                for news in follow_run(self._generate, asked, job):
                    if isinstance(news, GenerateResult):
                        yield self._finished(run, news, job, row_names(asked))
                    else:
                        for event in news:
                            run.take(event)
                        arrived = [event for event in news if isinstance(event, Artefact)]
                        yield self._progress(run, arrived, row_names(asked))
        except Exception as error:
            sentence = visitor_sentence(error)
            yield self._failed(sentence)
            if sentence != text.CANCELLED:
                raise gr.Error(sentence, print_exception=False) from error
        finally:
            if job is not None:
                self._jobs.close(visitor, job)

    def cancel(self, request: gr.Request) -> None:
        """The visitor has pressed the button, or closed the page."""
        self._jobs.cancel(_visitor(request))

    def _blank(self) -> Updates:
        """Everything of an earlier run away, buttons as they are during a run."""
        parts = self._results
        return {
            parts.message: _shown(""),
            parts.status: view.status(text.STARTING, {}, {}),
            parts.empty: gr.update(visible=False),
            **self._without_results(),
            **_without(*parts.previews),
            **{video: gr.update(visible=False, value=None) for video in parts.videos},
            parts.comparison: None,
            parts.figure: None,
            parts.numbers: "",
            parts.files: None,
            **self._buttons(is_running=True),
        }

    def _without_results(self) -> Updates:
        parts = self._results
        hidden = (
            *(parts.comparison_part, parts.figure_part),
            *(parts.numbers_part, parts.downloads_part),
        )
        return {
            parts.videos_part: gr.update(visible=HIDDEN),
            **{part: gr.update(visible=False) for part in hidden},
        }

    def _buttons(self, is_running: bool) -> Updates:
        return {
            self._form.generate: gr.update(interactive=not is_running),
            self._form.cancel: gr.update(visible=is_running),
        }

    def _progress(self, run: RunView, arrived: Sequence[Artefact], names: Sequence[str]) -> Updates:
        parts = self._results
        updates: Updates = {parts.status: view.status(run.line, run.fractions, run.details)}
        if run.artefacts:
            updates[parts.videos_part] = gr.update(visible=True)
            waiting = [name for name in names if not self._is_seen(name, run, names)]
            updates[parts.pending] = _shown(view.pending(waiting))
        for artefact in arrived:
            updates |= self._arrival(artefact, names)
        return updates

    def _arrival(self, artefact: Artefact, names: Sequence[str]) -> Updates:
        """Show a file that has just become whole."""
        parts = self._results
        shown = str(artefact.path)
        preview = self._preview_of(artefact.name, names)
        if artefact.kind == "preview" and preview is not None:
            label = text.PREVIEW_LABEL.format(name=artefact.name)
            return {preview: gr.update(value=shown, label=label, visible=True)}
        if artefact.kind == "video" and artefact.name in names:
            video = parts.videos[names.index(artefact.name)]
            update = {video: gr.update(value=shown, label=artefact.name, visible=True)}
            return update | (_without(preview) if preview is not None else {})
        if artefact.kind == "comparison":
            return {parts.comparison: shown, parts.comparison_part: gr.update(visible=True)}
        if artefact.kind == "figure" and artefact.path.suffix == ".png":
            return {parts.figure: shown, parts.figure_part: gr.update(visible=True)}
        return {}

    def _is_seen(self, name: str, run: RunView, names: Sequence[str]) -> bool:
        """Whether a row has its video already, or a preview of it."""
        kinds = {each.kind for each in run.artefacts if each.name == name}
        return "video" in kinds or (
            "preview" in kinds and self._preview_of(name, names) is not None
        )

    def _preview_of(self, name: str, names: Sequence[str]) -> gr.Model3D | None:
        """Where a row is shown in 3D for as long as its video is being drawn."""
        return dict(zip(names, self._results.previews, strict=False)).get(name)

    def _finished(
        self, run: RunView, result: GenerateResult, job: Job, names: Sequence[str]
    ) -> Updates:
        """The end of a run, with every video once more: a browser that is busy with a preview can
        miss the news that its video is there."""
        parts = self._results
        again: Updates = {}
        for artefact in run.artefacts:
            if artefact.kind == "video":
                again |= self._arrival(artefact, names)
        bundle = zip_files(result.files, job.folder / "co-speech-motion.zip")
        rows = f"{len(result.names)} {'motion' if len(result.names) == 1 else 'motions'}"
        line = text.DONE.format(seconds=run.seconds, rows=rows, frames=result.num_frames)
        return {
            **again,
            parts.status: view.status(line, dict.fromkeys(run.fractions, 1.0), {}),
            parts.message: _shown(view.notes_message(result.notes)),
            parts.pending: _shown(""),
            parts.numbers: view.numbers_table(result.diagnostics),
            parts.numbers_part: gr.update(visible=True),
            parts.downloads_part: gr.update(visible=True),
            parts.bundle: gr.update(value=str(bundle)),
            parts.files: [str(file) for file in result.files],
            **self._buttons(is_running=False),
        }

    def _failed(self, sentence: str) -> Updates:
        parts = self._results
        is_cancelled = sentence == text.CANCELLED
        return {
            parts.message: _shown("" if is_cancelled else view.error_message(sentence)),
            parts.status: view.sentence_status(text.CANCELLED if is_cancelled else text.STOPPED),
            parts.empty: gr.update(visible=True),
            **_without(*parts.previews),
            **self._without_results(),
            **self._buttons(is_running=False),
        }


def _visitor(request: gr.Request) -> str:
    """Gradio's name for one open page; a caller without one is a visitor of its own."""
    return request.session_hash or secrets.token_hex(8)


def _without(*previews: gr.Model3D) -> Updates:
    """Updates that hide previews and end what they play."""
    return {preview: gr.update(visible=HIDDEN, value=None) for preview in previews}


def _shown(html: str) -> Any:
    """An update of an HTML part that takes no room while it is empty."""
    return gr.update(value=html, visible=bool(html))
