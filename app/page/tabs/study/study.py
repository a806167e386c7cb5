"""The tab of the page that plans and makes a user study."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.page.parts import markup
from app.page.parts.catalogue import Catalogue, default_systems
from app.page.parts.html_parts import mount, reveal_on_click
from app.page.parts.listeners import AT_ONCE, IN_TURN, PRIVATE
from app.page.parts.named_fields import named_fields
from app.page.tabs.generate.generate import fresh_copy
from app.page.tabs.services import Services
from app.page.tabs.study.study_form import CHANGES, PROTOCOLS, QUESTIONS, SEPARATOR, StudyForm
from app.page.tabs.study.study_run import StudyParts, StudyRunner
from app.page.tabs.upload_check import UploadCheck
from app.page.visitors.visitors import VISITOR_ROUTE
from conventions.views import VIEWS
from model.systems.registry import usual_planner

INTRODUCTION = (
    "Makes a blind study: a web page with videos under random names for your participants, and a "
    "key that only you get. The same as <code>python -m app study export</code>."
)
_ASK_FOR_COOKIE = f"() => {{ fetch('.{VISITOR_ROUTE}', {{ method: 'POST' }}); }}"


def build_study_tab(page: gr.Blocks, services: Services) -> None:
    """Lay out the tab inside the current context and wire it."""
    catalogue = services.catalogue
    gr.HTML(f'<p class="hint">{INTRODUCTION}</p>')
    with gr.Row(elem_classes="columns"):
        with gr.Column(scale=5, min_width=320):
            ready = _build_questions(catalogue)
            materials, changed = _build_materials(catalogue, services.check)
        with gr.Column(scale=5, min_width=320):
            settings = _build_settings()
            with gr.Row(elem_classes="actions"):
                start = gr.Button("Make the study", variant="primary", elem_id="study-make")
                write = gr.Button("Plan only", elem_id="study-write", min_width=110)
                cancel = gr.Button(text.CANCEL, elem_id="study-cancel", min_width=110)
            with gr.Column(elem_classes="results"):
                results = _build_results()
    fields = [*materials, *settings, changed]
    _, protocol, speeches, systems, _ = materials
    for button in ready:
        asked, changes = QUESTIONS[button.value]
        filled = json.dumps([asked, [usual_planner()], changes])
        # By the browser itself: who makes the study right after the click means this one.
        button.click(
            None, outputs=[protocol, systems, changed], js=f"() => {filled}",
            api_visibility="private",
        )  # fmt: skip
        button.click(
            _SpeechOrExamples(catalogue, services.config.cache_folder / "examples").given,
            speeches,
            speeches,
            **PRIVATE,
        )
    runner = StudyRunner(services, results)
    optional = ("speeches", "motions")
    write.click(
        named_fields(runner.write_plan, StudyForm, optional),
        fields,
        results.all,
        api_name="study_plan",
        show_progress="hidden",
    )
    reveal_on_click(start, results.status)
    start.click(
        named_fields(runner.run, StudyForm, optional),
        fields,
        results.all,
        api_name="study",
        **IN_TURN,
    )
    cancel.click(runner.cancel, **AT_ONCE)
    page.load(None, js=_ASK_FOR_COOKIE)
    page.unload(runner.cancel)


@dataclass(frozen=True)
class _SpeechOrExamples:
    """Speech of a study that is ready to be made."""

    catalogue: Catalogue
    folder: Path
    """Of copies of the examples."""

    def given(self, speeches: list[str] | None) -> list[str] | None:
        """The examples where none is there yet."""
        examples = self.catalogue.examples
        return speeches or [str(fresh_copy(each.path, self.folder)) for each in examples] or None


def _build_questions(catalogue: Catalogue) -> list[gr.Button]:
    """Buttons that fill in a study of the gestures of the system that plans."""
    if usual_planner() not in catalogue.systems:
        return []
    gr.HTML(f'<p class="hint">{text.STUDY_READY}</p>')
    with gr.Row(elem_id="study-ready"):
        return [gr.Button(name, size="sm", min_width=110) for name in QUESTIONS]


def _build_materials(
    catalogue: Catalogue, check: UploadCheck
) -> tuple[list[Any], gr.CheckboxGroup]:
    """What is compared: the first fields of `StudyForm`, and its last."""
    title = gr.Textbox("How people move when they talk", label="Title (participants see it)")
    protocol = gr.Radio(list(PROTOCOLS), value=next(iter(PROTOCOLS)), label="Protocol")
    speeches = check.file(
        "speech",
        "Speech, one file for each clip",
        ["audio"],
        "study-speech",
        height=150,
        file_count="multiple",
    )
    systems = gr.CheckboxGroup(
        catalogue.system_choices,
        value=default_systems(catalogue.systems),
        label="Systems",
        info=text.STUDY_SYSTEMS_HELP,
    )
    planner = usual_planner()
    changed = gr.CheckboxGroup(
        list(CHANGES), value=[], label=text.STUDY_CHANGED,
        info=text.STUDY_CHANGED_HELP.format(system=planner), visible=planner in catalogue.systems,
        elem_id="study-changed",
    )  # fmt: skip
    motions = check.file(
        "motion",
        f"Other motion, each file named <system>{SEPARATOR}<clip>.npz (optional)",
        [".npz"],
        "study-motions",
        height=150,
        file_count="multiple",
    )
    return [title, protocol, speeches, systems, motions], changed


def _build_settings() -> list[Any]:
    """How it is shown: the other fields of `StudyForm`."""
    with gr.Row(elem_classes="pair"):
        length = gr.Number(10, label="Seconds a video", minimum=0, min_width=100)
        people = gr.Number(28, label="Participants", minimum=1, min_width=100)
        seed = gr.Number(0, label="Seed of the order", minimum=0, min_width=100)
    views = gr.CheckboxGroup(
        [(text.VIEW_NAMES[view], view) for view in VIEWS], value=["front"], label="Views"
    )
    post_to = gr.Textbox("", label="Address that answers are posted to (optional)")
    return_to = gr.Textbox(
        "",
        label="Completion link (optional)",
        info="Participants go there at the end, for example Prolific's or SONA's link with its "
        "code.",
    )
    return [length, people, seed, views, post_to, return_to]


def _build_results() -> StudyParts:
    return StudyParts(
        status=gr.HTML(markup.idle_status(text.READY), elem_id="study-status"),
        researcher=gr.HTML(
            "", visible=False, js_on_load=mount("study_key.js", "mountKey"),
            apply_default_css=False, elem_id="study-researcher",
        ),
        preview=gr.HTML("", visible=False, elem_id="study-preview"),
        participants=gr.DownloadButton(
            "For participants: the page and its videos (zip)",
            variant="secondary",
            visible=False,
            elem_id="study-participants",
        ),
        plan=gr.DownloadButton("The plan (TOML)", visible=False, elem_id="study-plan"),
    )  # fmt: skip
