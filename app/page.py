"""The page: layout and wiring. It knows neither torch nor GL, only a callable that does a run."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import gradio as gr

from app import text, view
from app.bundle import zip_files
from app.catalogue import Catalogue
from app.config import AppConfig
from app.handlers import (
    PAGE_VIDEOS,
    SEED_LIMIT,
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
from app.request import Artefact, GenerateResult

log = logging.getLogger(__name__)
Updates = dict[Any, Any]


def build_app(
    generate: Generate, catalogue: Catalogue, config: AppConfig, jobs: JobBook
) -> gr.Blocks:
    """The whole page around ``generate``, which a test may replace by a function of its own."""
    with gr.Blocks(
        title=text.TITLE,
        analytics_enabled=False,
        fill_width=True,
        delete_cache=(600, int(config.keep_results_s)),
    ) as page:
        gr.HTML(view.header(catalogue.trained_on))
        with gr.Row(elem_classes="columns"):
            with gr.Column(scale=4, min_width=320, elem_classes="sheet"):
                form = _build_form(catalogue, config)
            with gr.Column(scale=9, min_width=320, elem_classes="results"):
                results = _build_results()
        _wire(page, form, results, _Runner(generate, catalogue, config, jobs, form, results))
    return page


@dataclass(frozen=True)
class _FormParts:
    fields: tuple[Any, ...]
    """In the order of `Form`."""
    generate: gr.Button
    cancel: gr.Button


@dataclass(frozen=True)
class _ResultParts:
    message: gr.HTML
    status: gr.HTML
    empty: gr.HTML
    videos_part: gr.Column
    pending: gr.HTML
    videos: tuple[gr.Video, ...]
    comparison_part: gr.Column
    comparison: gr.Video
    figure_part: gr.Column
    figure: gr.Image
    numbers_part: gr.Column
    numbers: gr.HTML
    downloads_part: gr.Column
    bundle: gr.DownloadButton
    files: gr.File

    @property
    def all(self) -> list[Any]:
        return [
            self.message,
            self.status,
            self.empty,
            self.videos_part,
            self.pending,
            *self.videos,
            self.comparison_part,
            self.comparison,
            self.figure_part,
            self.figure,
            self.numbers_part,
            self.numbers,
            self.downloads_part,
            self.bundle,
            self.files,
        ]


def _build_form(catalogue: Catalogue, config: AppConfig) -> _FormParts:
    gr.HTML(view.step(1, text.STEP_SPEECH))
    speech = gr.Audio(
        label=text.SPEECH_LABEL,
        sources=["upload", "microphone"],
        type="filepath",
        elem_id="speech",
        waveform_options=gr.WaveformOptions(
            waveform_color="#9fb3c8", waveform_progress_color="#0f6d8c"
        ),
        buttons=[],
    )
    limits = text.SPEECH_HELP.format(
        min_s=config.min_speech_s, max_min=round(config.max_speech_s / 60, 1)
    )
    gr.HTML(f'<p class="hint">{limits}</p>')
    if catalogue.examples:
        gr.Examples(
            examples=[[str(example.path)] for example in catalogue.examples],
            example_labels=[example.label for example in catalogue.examples],
            inputs=[speech],
            label=text.EXAMPLES_LABEL,
            elem_id="examples",
            api_visibility="private",
        )
    gr.HTML(view.step(2, text.STEP_SYSTEMS))
    systems = gr.CheckboxGroup(
        choices=list(catalogue.systems),
        value=list(catalogue.systems),
        label=text.SYSTEMS_LABEL,
        info=text.SYSTEMS_HELP,
        elem_id="systems",
    )
    gr.HTML(view.step(3, text.STEP_SETTINGS))
    with gr.Row(elem_classes="pair"):
        speaker = gr.Dropdown(
            choices=list(catalogue.speakers),
            value=catalogue.speakers[0] if catalogue.speakers else None,
            label=text.SPEAKER_LABEL,
            min_width=120,
        )
        seed = gr.Number(
            value=0, precision=0, minimum=0, maximum=SEED_LIMIT, label=text.SEED_LABEL,
            min_width=100,
        )  # fmt: skip
    samples = gr.Slider(
        1, 4, value=1, step=1, label=text.SAMPLES_LABEL, info=text.SAMPLES_HELP, buttons=[]
    )
    is_smoothed = gr.Checkbox(False, label=text.FILTER_LABEL, info=text.FILTER_HELP)
    with gr.Accordion(text.ADVANCED_LABEL, open=False):
        steps = gr.Slider(1, 50, value=10, step=1, label=text.STEPS_LABEL, buttons=[])
        sampler = gr.Dropdown(
            choices=[(shown, name) for name, shown in text.SAMPLER_NAMES.items()],
            value="euler",
            label=text.SAMPLER_LABEL,
        )
        reference = gr.File(
            label=text.REFERENCE_LABEL,
            file_types=[".npz"],
            type="filepath",
            height=150,
            elem_id="reference",
        )
    with gr.Row(elem_classes="actions"):
        start = gr.Button(text.GENERATE, variant="primary", size="lg", elem_id="generate")
        cancel = gr.Button(
            text.CANCEL, variant="secondary", size="lg", visible=False, elem_id="cancel", scale=0
        )
    fields = (speech, systems, speaker, seed, samples, steps, sampler, is_smoothed, reference)
    return _FormParts(fields, start, cancel)


def _build_results() -> _ResultParts:
    message = gr.HTML("", visible=False, elem_id="message")
    status = gr.HTML(view.sentence_status(text.READY), elem_id="status")
    empty = gr.HTML(view.empty_state(), elem_id="empty")
    with gr.Column(visible=False) as comparison_part:
        gr.HTML(view.heading(text.COMPARISON_HEADING, text.COMPARISON_HELP))
        comparison = gr.Video(
            label=text.COMPARISON_HEADING, show_label=False, interactive=False,
            elem_id="comparison", buttons=["download"],
        )  # fmt: skip
    with gr.Column(visible=False) as figure_part:
        gr.HTML(view.heading(text.FIGURE_HEADING, text.FIGURE_HELP))
        figure = gr.Image(
            label=text.FIGURE_HEADING, show_label=False, interactive=False, type="filepath",
            elem_id="figure", buttons=["download", "fullscreen"],
        )  # fmt: skip
    with gr.Column(visible=False) as numbers_part:
        gr.HTML(view.heading(text.NUMBERS_HEADING, text.NUMBERS_HELP))
        numbers = gr.HTML("", elem_id="numbers")
    with gr.Column(visible=False) as videos_part:
        gr.HTML(view.heading(text.VIDEOS_HEADING))
        with gr.Row(elem_classes="videos"):
            videos = tuple(
                gr.Video(
                    visible=False, interactive=False, elem_id=f"video-{i}", min_width=240,
                    buttons=["download"],
                )
                for i in range(PAGE_VIDEOS)
            )  # fmt: skip
            pending = gr.HTML("", visible=False, elem_id="pending")
    with gr.Column(visible=False) as downloads_part:
        gr.HTML(view.heading(text.DOWNLOADS_HEADING))
        bundle = gr.DownloadButton(text.ZIP_LABEL, variant="primary", elem_id="bundle")
        files = gr.File(
            label=text.FILES_LABEL, file_count="multiple", interactive=False, elem_id="files"
        )
    return _ResultParts(
        message, status, empty, videos_part, pending, videos, comparison_part, comparison,
        figure_part, figure, numbers_part, numbers, downloads_part, bundle, files,
    )  # fmt: skip


class _Runner:
    """Turns a visitor's click into a run and the run's events into updates of the page."""

    def __init__(
        self,
        generate: Generate,
        catalogue: Catalogue,
        config: AppConfig,
        jobs: JobBook,
        form: _FormParts,
        results: _ResultParts,
    ) -> None:
        self._generate = generate
        self._catalogue = catalogue
        self._config = config
        self._jobs = jobs
        self._form = form
        self._results = results

    def run(self, request: gr.Request, *values: Any) -> Iterator[Updates]:
        visitor = request.session_hash or "api"
        job: Job | None = None
        try:
            self._jobs.sweep(self._config.keep_results_s)
            job = self._jobs.open(visitor)
            asked = request_from_form(Form(*values), job.folder, self._catalogue, self._config)
            yield self._blank()
            with self._jobs.slot(job) as turn:
                for ahead in turn:
                    yield {self._results.status: view.sentence_status(waiting_line(ahead))}
                run = RunView()
                for news in follow_run(self._generate, asked, job):
                    if isinstance(news, GenerateResult):
                        yield self._finished(run, news, job)
                    else:
                        for event in news:
                            run.take(event)
                        arrived = [event for event in news if isinstance(event, Artefact)]
                        yield self._progress(run, arrived, row_names(asked))
        except GeneratorExit:
            raise
        except BaseException as error:
            sentence = visitor_sentence(error)
            yield self._failed(sentence)
            if sentence != text.CANCELLED:
                raise gr.Error(sentence, print_exception=False) from error
        finally:
            if job is not None:
                self._jobs.close(visitor, job)

    def cancel(self, request: gr.Request) -> None:
        self._jobs.cancel(request.session_hash or "api")

    def leave(self, request: gr.Request) -> None:
        """The visitor has closed the page."""
        self._jobs.cancel(request.session_hash or "api")

    def _blank(self) -> Updates:
        """Everything of an earlier run away, buttons as they are during a run."""
        parts = self._results
        return {
            parts.message: _shown(""),
            parts.status: view.status(text.STARTING, {}, {}),
            parts.empty: gr.update(visible=False),
            **self._without_results(),
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
            *(parts.videos_part, parts.comparison_part, parts.figure_part),
            *(parts.numbers_part, parts.downloads_part),
        )
        return {part: gr.update(visible=False) for part in hidden}

    def _buttons(self, is_running: bool) -> Updates:
        return {
            self._form.generate: gr.update(interactive=not is_running),
            self._form.cancel: gr.update(visible=is_running),
        }

    def _progress(self, run: RunView, arrived: Sequence[Artefact], names: Sequence[str]) -> Updates:
        parts = self._results
        updates: Updates = {parts.status: view.status(run.line, run.fractions, run.details)}
        if "video" in run.fractions:
            updates[parts.videos_part] = gr.update(visible=True)
            done = {each.name for each in run.artefacts if each.kind == "video"}
            updates[parts.pending] = _shown(view.pending([n for n in names if n not in done]))
        for artefact in arrived:
            shown = str(artefact.path)
            if artefact.kind == "video" and artefact.name in names:
                video = parts.videos[names.index(artefact.name)]
                updates[video] = gr.update(value=shown, label=artefact.name, visible=True)
            elif artefact.kind == "comparison":
                updates[parts.comparison] = shown
                updates[parts.comparison_part] = gr.update(visible=True)
            elif artefact.kind == "figure" and artefact.path.suffix == ".png":
                updates[parts.figure] = shown
                updates[parts.figure_part] = gr.update(visible=True)
        return updates

    def _finished(self, run: RunView, result: GenerateResult, job: Job) -> Updates:
        parts = self._results
        bundle = zip_files(result.files, job.folder / "co-speech-motion.zip")
        rows = f"{len(result.names)} {'motion' if len(result.names) == 1 else 'motions'}"
        line = text.DONE.format(seconds=run.seconds, rows=rows, frames=result.num_frames)
        return {
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
            **self._without_results(),
            **self._buttons(is_running=False),
        }


def _shown(html: str) -> Any:
    """An update of an HTML part that takes no room while it is empty."""
    return gr.update(value=html, visible=bool(html))


def _wire(page: gr.Blocks, form: _FormParts, results: _ResultParts, runner: _Runner) -> None:
    form.generate.click(
        runner.run,
        inputs=list(form.fields),
        outputs=[*results.all, form.generate, form.cancel],
        api_name="generate",
        show_progress="hidden",
        trigger_mode="once",
        concurrency_limit=None,  # JobBook lets them in one by one and tells each its place
    )
    form.cancel.click(runner.cancel, queue=False, api_visibility="private", show_progress="hidden")
    page.unload(runner.leave)
