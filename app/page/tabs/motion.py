"""Form of the tab "Motion", and its conversion to a request."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.config import AppConfig
from app.errors import RunError
from app.page.parts import markup
from app.page.parts.catalogue import (
    Catalogue,
    default_systems,
    descriptions_by_label,
    example_title,
    guidance_choices,
    labels_by_group,
    tracked_point_choices,
)
from app.page.parts.form_values import Fields
from app.page.parts.markup import UNQUEUED_EVENT, group_choices
from app.page.tabs.runner import PAGE_VIDEO_OPTIONS, Services, request_with_page_settings
from app.run.batch.saved_run import SPEECH_FOLDER
from app.run.batch.speech_batch import ENDINGS
from app.run.requests.parts import DEFAULT_TRACKED_POINT, FIGURE_PANELS, MAX_PAGE_CLIPS, MAX_SAMPLES
from app.run.requests.requests import GenerateRequest
from app.run.upload_check import TOO_MANY_CLIPS
from conventions.names import pluralise, printable, safe_file_stem
from model.speech.transcript import ENDINGS as WORD_ENDINGS
from model.systems.registry import sampler_title

FIGURE_FIELDS = ("figure_panels", "figure_frames", "figure_width")
API_FIELDS = (
    *("speech", "systems", "speaker", "seed", "samples", "steps", "sampler", "post_filter"),
    *("reference", "joint", "start_frame", "transcript", "guidance", "words"),
    *("has_video", "plan", "clips", *FIGURE_FIELDS),
)
"""Order of the form's fields in the API."""
SEED_LIMIT = 2**31 - 1
LAST_FRAME = 10**6
"""Limit of the first frame of a figure; motions are shorter."""
MAX_PAGE_BODIES = 12


def request_from_form(
    values: Mapping[str, Any], folder: Path, catalogue: Catalogue, config: AppConfig
) -> GenerateRequest:
    """Make the request of a form from the result of `parse_form_values`; raises RunError."""
    values = with_default_panels(values)
    speeches = (*filter(None, [values["speech"]]), *values.pop("clips"))
    if not speeches:
        raise RunError(text.NO_SPEECH)
    if len(speeches) > 1:
        _check_clips(speeches, values)
        values["has_video"] = False
    values["speech"] = speeches[0] if len(speeches) == 1 else folder / SPEECH_FOLDER
    if not values["systems"]:
        raise RunError("Select at least one system.")
    # In the catalogue's order, so that rows have the same order in every run; an unknown system is
    # reported by the run.
    order = {name: number for number, name in enumerate(catalogue.systems)}
    systems = tuple(sorted(set(values["systems"]), key=lambda name: (order.get(name, -1), name)))
    count = len(systems) * values["samples"] + (values["reference"] is not None)
    if count > MAX_PAGE_BODIES:
        raise RunError(
            text.TOO_MANY_VIDEOS.format(
                systems=pluralise(len(systems), "system"),
                samples=pluralise(values["samples"], "sample"),
                count=count,
                limit=MAX_PAGE_BODIES,
            )
        )
    steps, named = values["steps"], dict(catalogue.system_choices)
    if isinstance(steps, dict):  # by name, whole or as the form shows it
        steps = {named.get(name, name): count for name, count in steps.items()}
    values |= {"systems": systems, "steps": steps, **PAGE_VIDEO_OPTIONS}
    request = request_with_page_settings(GenerateRequest, values, config, folder)
    request.check()
    return request


def save_form_values(form: Fields, values: Sequence[Any], folder: Path) -> dict[str, Any]:
    """Copy the speech into the run's folder, and return the values of the form for the run's link.

    Other files are omitted.
    """
    sent = dict(zip(form, values, strict=False))
    saved = {
        name: value
        for name, value in sent.items()
        if not isinstance(form[name], gr.File | gr.Audio)
    }
    speech_folder = folder / SPEECH_FOLDER
    speech_folder.mkdir(exist_ok=True)
    speeches = [Path(path) for path in (sent["speech"], *(sent.get("clips") or ())) if path]
    copies = [str(shutil.copyfile(path, speech_folder / path.name)) for path in speeches]
    is_one = len(copies) == 1
    return saved | {"speech": copies[0] if is_one else None, "clips": None if is_one else copies}


def _check_clips(speeches: Sequence[Path], values: Mapping[str, Any]) -> None:
    """Check several speeches, and that no field is set that needs a single one; raises RunError."""
    if len(speeches) > MAX_PAGE_CLIPS:
        raise RunError(TOO_MANY_CLIPS.format(limit=MAX_PAGE_CLIPS, count=len(speeches)))
    if any(values[name] is not None for name in ("reference", "transcript", "plan")):
        raise RunError(text.OF_ONE_CLIP)
    names = [safe_file_stem(path.stem) for path in speeches]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise RunError(f"Two clips are called {twice!r}; rename one of the files.")
    other = next((path.name for path in speeches if path.suffix.lower() not in ENDINGS), None)
    if other is not None:
        raise RunError(text.CLIP_OTHER.format(name=printable(other), known=", ".join(ENDINGS)))


@dataclass(frozen=True)
class FormParts:
    """Fields of a form by field of `GenerateRequest`, and its buttons."""

    fields: Fields
    start: gr.Button
    cancel: gr.Button


def build_form(services: Services) -> FormParts:
    """Lay out the form: speech, systems, settings and buttons."""
    catalogue, config = services.catalogue, services.config
    of: dict[str, Any] = {}
    gr.HTML(markup.step_heading(1, "Generate from your speech"))
    of["speech"] = gr.Audio(
        label="Speech",
        sources=["upload", "microphone"],
        type="filepath",
        elem_id="speech",
        waveform_options=gr.WaveformOptions(
            waveform_color="#9fb3c8", waveform_progress_color="#0f6d8c"
        ),
        buttons=[],
    )
    services.attach_upload_check(of["speech"], "speech")
    limits = text.SPEECH_HELP.format(
        min_s=config.min_speech_s, max_min=round(config.max_speech_s / 60, 1)
    )
    gr.HTML(f'<p class="hint">{limits}</p>')
    if catalogue.examples:
        _offer_examples(catalogue.examples, of["speech"], config.cache_folder / "examples")
    with gr.Accordion(text.CLIPS_LABEL, open=False, elem_id="several-fold"):
        help_text = text.CLIPS_HELP.format(
            count=MAX_PAGE_CLIPS,
            max_min=round(config.max_speech_s / 60, 1),
            size=config.max_upload_size.upper().replace("MB", " MB"),
        )
        gr.HTML(f'<p class="hint">{help_text}</p>')
        of["clips"] = services.file_field(
            "clips", text.CLIPS_LABEL, ["audio"], "several", file_count="multiple"
        )
    gr.HTML(markup.step_heading(2, "Systems"))
    of["systems"] = gr.CheckboxGroup(
        choices=catalogue.system_choices,
        value=default_systems(catalogue.systems),
        label="Systems to compare",
        info="All systems use the same noise seed. They are described in the “Systems” tab.",
        elem_id="systems",
    )
    about, groups = descriptions_by_label(catalogue.systems), labels_by_group(catalogue.systems)
    group_choices("systems", about, groups)
    gr.HTML(markup.step_heading(3, "Settings"))
    with gr.Row(elem_classes="pair"):
        of["speaker"] = gr.Dropdown(
            choices=list(catalogue.speakers),
            value=catalogue.speakers[0] if catalogue.speakers else None,
            label="Speaker style",
            info="Gesture style of one speaker of the training data; it need not match the voice "
            "in the audio. The bundled weights were trained on invented speakers.",
            min_width=120,
        )
        of["seed"] = gr.Number(
            value=0,
            minimum=0,
            maximum=SEED_LIMIT,
            label=text.SEED_LABEL,
            info="The same speech file, options and seed give the same motion.",
            min_width=100,
        )
    of["samples"] = gr.Slider(
        minimum=1,
        maximum=MAX_SAMPLES,
        value=1,
        step=1,
        label=text.SAMPLES_LABEL,
        info=(
            "Several samples show how much the result varies by chance. Each starts from its own "
            "noise."
        ),
        buttons=[],
    )
    of["guidance"] = gr.Dropdown(
        choices=guidance_choices(1.0, 1.5, 2.0, 2.5, 3.0, 4.0),
        value="",
        label=text.GUIDANCE_LABEL,
        info=text.GUIDANCE_HELP,
        elem_id="guidance",
    )
    of["post_filter"] = gr.Checkbox(False, label=text.FILTER_LABEL, info=text.FILTER_HELP)
    of["has_video"] = gr.Checkbox(
        True, label=text.VIDEOS_LABEL, info=text.VIDEOS_HELP, elem_id="has-videos"
    )
    with gr.Accordion(text.ADVANCED_LABEL, open=False):
        of["steps"] = gr.Textbox(
            "",
            label="Sampler steps",
            info=(
                "Empty: the default of each system. A number applies to all systems; full=20, "
                "local=5 sets only the systems full and local."
            ),
            placeholder=catalogue.default_steps_text,
            max_lines=1,
            elem_id="steps",
        )
        of["sampler"] = gr.Dropdown(
            choices=[
                ("default of each system", ""),
                *((sampler_title(name), name) for name in catalogue.samplers),
            ],
            value="",
            label="Sampler",
            info=(
                "Numerical method of sampling. Keep the default unless you want to compare "
                "samplers."
            ),
        )
        of["reference"] = services.file_field(
            "reference", text.REFERENCE_LABEL, [".npz", ".npy", ".bvh"], "reference"
        )
        of["transcript"] = services.file_field(
            "transcript", text.TRANSCRIPT_LABEL, list(WORD_ENDINGS), "transcript"
        )
        of["plan"] = services.file_field(
            "plan", text.PLAN_LABEL, [".json", ".TextGrid", ".eaf"], "plan"
        )
        of["words"] = gr.Checkbox(
            False, label=text.WORDS_LABEL, info=text.WORDS_HELP, elem_id="recognise-words"
        )
        of["joint"] = gr.Dropdown(
            choices=tracked_point_choices(), value=DEFAULT_TRACKED_POINT, label=text.POINT_LABEL
        )
        of |= figure_fields("start-frame")
    with gr.Row(elem_classes="actions"):
        start = gr.Button(text.GENERATE, variant="primary", size="lg", elem_id="generate")
        cancel = gr.Button(
            text.CANCEL, variant="secondary", size="lg", visible=False, elem_id="cancel", scale=0
        )
    return FormParts({name: of[name] for name in API_FIELDS}, start, cancel)


def figure_fields(elem_id: str | None = None) -> dict[str, Any]:
    of: dict[str, Any] = {}
    of["figure_panels"] = gr.CheckboxGroup(
        choices=[(f"{letter} {what}", letter) for letter, what in FIGURE_PANELS.items()],
        value=list(FIGURE_PANELS),
        label="Panels of the fingertip figure (Figure 6 of the GlobalDiff paper)",
    )
    with gr.Row(elem_classes="pair"):
        of["start_frame"] = gr.Number(
            0, minimum=0, maximum=LAST_FRAME, label="First frame", elem_id=elem_id
        )
        of["figure_frames"] = gr.Textbox(
            "", label="Snapshot frames", placeholder="every 50", max_lines=1
        )
    of["figure_width"] = gr.Radio(
        choices=[("85 mm", "85mm"), ("174 mm", "174mm")], value="174mm", label="Print width"
    )
    return of


def with_default_panels(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return a form's values, with all panels of Figure 6 if none is ticked."""
    return {**values, "figure_panels": values["figure_panels"] or tuple(FIGURE_PANELS)}


def _offer_examples(examples: Sequence[Path], speech: gr.Audio, folder: Path) -> None:
    """Lay out buttons that fill in an example as speech.

    Unlike the copies of `gr.Examples`, which are made once at the start and are then deleted as old
    uploads, each click makes a new one.
    """
    offered = gr.Dataset(
        components=[gr.Textbox(visible=False)],
        samples=[[example_title(path)] for path in examples],
        label="Or choose an example (synthetic voice)",
        type="index",
        elem_id="examples",
    )

    def copy_example(index: object) -> str:
        if type(index) is not int or not 0 <= index < len(examples):
            raise RunError("There is no such example. Please reload the page.")
        return str(copy_as_upload(examples[index], folder))

    offered.click(copy_example, offered, speech, **UNQUEUED_EVENT)


def copy_as_upload(path: Path, folder: Path) -> Path:
    """Copy a file, so that its age is that of an upload, and return the copy."""
    folder.mkdir(parents=True, exist_ok=True)
    copy = folder / path.name
    partial = copy.with_name(f".{secrets.token_hex(8)}.partial")
    shutil.copyfile(path, partial)
    os.replace(partial, copy)
    return copy
