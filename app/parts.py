"""The parts of the page: what the visitor fills in, and where results appear."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gradio as gr

from app import text, view
from app.catalogue import Catalogue
from app.config import AppConfig
from app.handlers import PAGE_PREVIEWS, PAGE_VIDEOS, SEED_LIMIT

HIDDEN = "hidden"
"""In the page but not seen. What is not visible (False) is not even in the page, and Gradio's 3D
viewer stays empty if it is put there together with its file."""


@dataclass(frozen=True)
class FormParts:
    """The left column."""

    fields: tuple[Any, ...]
    """In the order of `Form`."""
    generate: gr.Button
    cancel: gr.Button


@dataclass(frozen=True)
class ResultParts:
    """The right column, from top to bottom."""

    message: gr.HTML
    status: gr.HTML
    empty: gr.HTML
    videos_part: gr.Column
    pending: gr.HTML
    previews: tuple[gr.Model3D, ...]
    """Of the first rows: the motion in 3D until its video is there."""
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
            *self.previews,
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


def build_form(catalogue: Catalogue, config: AppConfig) -> FormParts:
    """The left column: speech, systems, settings, and the buttons."""
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
    return FormParts(fields, start, cancel)


def build_results() -> ResultParts:
    """The right column; what has nothing to show yet is hidden."""
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
    with gr.Column(visible=HIDDEN) as videos_part:
        gr.HTML(view.heading(text.VIDEOS_HEADING))
        with gr.Row(elem_classes="videos"):
            previews, videos = _build_players()
            pending = gr.HTML("", visible=False, elem_id="pending")
    with gr.Column(visible=False) as downloads_part:
        gr.HTML(view.heading(text.DOWNLOADS_HEADING))
        bundle = gr.DownloadButton(text.ZIP_LABEL, variant="primary", elem_id="bundle")
        files = gr.File(
            label=text.FILES_LABEL, file_count="multiple", interactive=False, elem_id="files"
        )
    return ResultParts(
        message, status, empty, videos_part, pending, previews, videos, comparison_part,
        comparison, figure_part, figure, numbers_part, numbers, downloads_part, bundle, files,
    )  # fmt: skip


def _build_players() -> tuple[tuple[gr.Model3D, ...], tuple[gr.Video, ...]]:
    """For each row a video, and before it, in the same place of the grid, its preview."""
    previews, videos = [], []
    for index in range(PAGE_VIDEOS):
        if index < PAGE_PREVIEWS:
            previews.append(_build_preview(index))
        videos.append(
            gr.Video(
                visible=False, interactive=False, elem_id=f"video-{index}", min_width=240,
                buttons=["download"],
            )
        )  # fmt: skip
    return tuple(previews), tuple(videos)


def _build_preview(index: int) -> gr.Model3D:
    """A viewer that plays the animation of its file by itself."""
    return gr.Model3D(
        visible=HIDDEN,
        interactive=False,
        elem_id=f"preview-{index}",
        min_width=240,
        height=340,
        clear_color=(0.894, 0.902, 0.918, 1.0),  # as behind the videos
        camera_position=(90.0, 84.0, 2.9),  # from the front, near enough for the whole body
    )
