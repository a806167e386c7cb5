"""The form of the tab "Motion": what the visitor fills in."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.page.parts import markup
from app.page.parts.catalogue import (
    Example,
    about_systems,
    default_systems,
    point_choices,
    two_steps_help,
)
from app.page.parts.html_parts import tell_chips
from app.page.parts.listeners import AT_ONCE, PRIVATE
from app.page.parts.strength import USUAL, strength_choices
from app.page.tabs.generate.generate_form import SEED_LIMIT
from app.page.tabs.services import Services
from app.run.followed_point import TIP
from app.run.requests.request import MAX_SAMPLES
from model.systems.registry import sampler_title


@dataclass(frozen=True)
class FormParts:
    """The left column."""

    fields: tuple[Any, ...]
    """In the order of `Form`."""
    generate: gr.Button
    cancel: gr.Button


def build_form(services: Services) -> FormParts:
    """The left column: speech, systems, settings, and the buttons."""
    catalogue, config, check = services.catalogue, services.config, services.check
    gr.HTML(markup.step(1, text.STEP_SPEECH))
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
    check.watch(speech, "speech")
    limits = text.SPEECH_HELP.format(
        min_s=config.min_speech_s, max_min=round(config.max_speech_s / 60, 1)
    )
    gr.HTML(f'<p class="hint">{limits}</p>')
    if catalogue.examples:
        _offer_examples(catalogue.examples, speech, config.cache_folder / "examples")
    gr.HTML(markup.step(2, text.STEP_SYSTEMS))
    systems = gr.CheckboxGroup(
        choices=catalogue.system_choices,
        value=default_systems(catalogue.systems),
        label=text.SYSTEMS_LABEL,
        info=text.SYSTEMS_HELP,
        elem_id="systems",
    )
    tell_chips("systems", about_systems(catalogue.systems))
    gr.HTML(markup.step(3, text.STEP_SETTINGS))
    with gr.Row(elem_classes="pair"):
        speaker = gr.Dropdown(
            choices=list(catalogue.speakers),
            value=catalogue.speakers[0] if catalogue.speakers else None,
            label=text.SPEAKER_LABEL,
            info=text.SPEAKER_HELP,
            min_width=120,
        )
        seed = gr.Number(
            value=0, minimum=0, maximum=SEED_LIMIT, label=text.SEED_LABEL,
            info=text.SEED_HELP, min_width=100,
        )  # fmt: skip
    samples = gr.Slider(
        *(1, MAX_SAMPLES), value=1, step=1, label=text.SAMPLES_LABEL, info=text.SAMPLES_HELP,
        buttons=[],
    )  # fmt: skip
    guidance = gr.Dropdown(
        choices=strength_choices((1.0, 1.5, 2.0, 2.5, 3.0, 4.0)),
        value=USUAL,
        label=text.GUIDANCE_LABEL,
        info=text.GUIDANCE_HELP,
        elem_id="guidance",
    )
    with gr.Column(visible=False, elem_id="two-steps") as two_steps:
        body_steps, face_steps = (
            gr.Slider(0, 50, value=0, step=1, label=label, info=help_, buttons=[])
            for label, help_ in (
                (text.BODY_STEPS_LABEL, two_steps_help(catalogue.with_face_steps)),
                (text.FACE_STEPS_LABEL, None),
            )
        )
    systems.change(
        lambda ticked: gr.update(visible=any(name in catalogue.with_face_steps for name in ticked)),
        systems,
        two_steps,
        **PRIVATE,
    )
    is_smoothed = gr.Checkbox(False, label=text.FILTER_LABEL, info=text.FILTER_HELP)
    has_videos = gr.Checkbox(
        True, label=text.VIDEOS_LABEL, info=text.VIDEOS_HELP, elem_id="has-videos"
    )
    with gr.Accordion(text.ADVANCED_LABEL, open=False):
        steps = gr.Textbox(
            "", label=text.STEPS_LABEL, info=text.STEPS_HELP, placeholder=catalogue.usual_steps,
            max_lines=1, elem_id="steps",
        )  # fmt: skip
        sampler = gr.Dropdown(
            choices=[
                (text.USUAL_SAMPLER, ""),
                *((sampler_title(name), name) for name in catalogue.samplers),
            ],
            value="",
            label=text.SAMPLER_LABEL,
            info=text.SAMPLER_HELP,
        )
        reference = check.file("reference", text.REFERENCE_LABEL, [".npz"], "reference", height=150)
        transcript = check.file(
            "transcript", text.TRANSCRIPT_LABEL, [".TextGrid", ".txt"], "transcript", height=150
        )
        plan = check.file(
            "plan", text.PLAN_LABEL, [".json", ".TextGrid", ".eaf"], "plan", height=150
        )
        has_words = gr.Checkbox(
            False, label=text.WORDS_LABEL, info=text.WORDS_HELP, elem_id="recognise-words"
        )
        point = gr.Dropdown(choices=point_choices(), value=TIP, label=text.POINT_LABEL)
        start_frame = gr.Number(value=0, minimum=0, label=text.START_LABEL, elem_id="start-frame")
    reason = check.reason()
    with gr.Row(elem_classes="actions"):
        start = gr.Button(text.GENERATE, variant="primary", size="lg", elem_id="generate")
        cancel = gr.Button(
            text.CANCEL, variant="secondary", size="lg", visible=False, elem_id="cancel", scale=0
        )
    check.guard(start, reason)
    fields = (
        *(speech, systems, speaker, seed, samples, steps, sampler, is_smoothed, reference),
        *(point, start_frame, transcript, body_steps, face_steps),
        *(guidance, has_words, has_videos, plan),
    )
    return FormParts(fields, start, cancel)


def _offer_examples(examples: Sequence[Example], speech: gr.Audio, folder: Path) -> None:
    """Buttons that fill in the speech. Not `gr.Examples`, whose copies are made once, at the start,
    and are swept like any upload."""
    labels = [example.label for example in examples]
    offered = gr.Dataset(
        components=[gr.Textbox(visible=False)],
        samples=[[label] for label in labels],
        label=text.EXAMPLES_LABEL,
        type="index",
        elem_id="examples",
    )
    offered.click(
        lambda index: str(fresh_copy(examples[index].path, folder)), offered, speech, **AT_ONCE
    )


def fresh_copy(path: Path, folder: Path) -> Path:
    """A copy that is as new as an upload would be, and is kept for as long."""
    folder.mkdir(parents=True, exist_ok=True)
    copy = folder / path.name
    partial = copy.with_name(f".{secrets.token_hex(8)}.partial")
    shutil.copyfile(path, partial)
    os.replace(partial, copy)
    return copy
