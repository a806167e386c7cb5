"""The tab "User study": a study planned and made, and answers turned into a report."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.errors import RunError
from app.page.parts import markup
from app.page.parts.asked import form_of
from app.page.parts.catalogue import Catalogue, default_systems
from app.page.parts.html_parts import (
    AT_ONCE,
    PRIVATE,
    in_turn,
    mount,
    named_fields,
    reveal_on_click,
    shown,
)
from app.page.queue.jobs import Job
from app.page.queue.runner import TabRunner, Updates
from app.page.tabs.motion import fresh_copy
from app.page.tabs.services import Services, UploadCheck
from app.page.tabs.study_run import (
    CHANGES,
    PROTOCOLS,
    QUESTIONS,
    SEPARATOR,
    StudyForm,
    StudyParts,
    StudyRunner,
)
from app.page.visitors.uploads import MAX_FILES
from app.run.requests.request import Event, OnEvent, ShouldCancel
from app.study.analyse import AnalysisRequest, analyse
from app.study.design.plan import wording
from conventions.views import VIEWS
from model.systems.registry import usual_planner

INTRODUCTION = (
    "Makes a blind study: a web page with videos under random names for your participants, and a "
    "key that only you get. The same as <code>python -m app study export</code>."
)


def build_study_tab(services: Services) -> None:
    """Lay out the tab inside the current context and wire it."""
    catalogue = services.catalogue
    gr.HTML(f'<p class="hint">{INTRODUCTION}</p>')
    with gr.Row(elem_classes="columns"):
        with gr.Column(scale=5, min_width=320):
            ready = _build_questions(catalogue)
            materials, changed = _build_materials(catalogue, services.check)
        with gr.Column(scale=5, min_width=320):
            settings = _build_settings()
            told = _build_told()
            with gr.Row(elem_classes="actions"):
                start = gr.Button("Make the study", variant="primary", elem_id="study-make")
                write = gr.Button("Plan only", elem_id="study-write", min_width=110)
                cancel = gr.Button(text.CANCEL, elem_id="study-cancel", min_width=110)
            with gr.Column(elem_classes="results"):
                results = _build_results()
    fields = [*materials, *settings, changed, *told]
    _, protocol, speeches, systems, _ = materials
    for button in ready:
        asked, changes = QUESTIONS[button.value]
        filled = json.dumps([asked, [usual_planner()], changes])
        # By the browser itself: who makes the study right after the click means this one.
        button.click(
            None,
            outputs=[protocol, systems, changed],
            js=f"() => {filled}",
            api_visibility="private",
        )
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
    run = start.click(
        named_fields(runner.run, StudyForm, optional),
        fields,
        results.all,
        api_name="study",
        **in_turn(results.status),
    )
    cancel.click(runner.cancel, outputs=results.all, cancels=run, **AT_ONCE)


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
    """What is compared: the first fields of `StudyForm`, and `StudyForm.changed`."""
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
        list(CHANGES),
        value=[],
        label=text.STUDY_CHANGED,
        info=text.STUDY_CHANGED_HELP.format(system=planner),
        visible=planner in catalogue.systems,
        elem_id="study-changed",
    )
    motions = check.file(
        "motion",
        f"Other motion, each file named <system>{SEPARATOR}<clip>.npz (optional)",
        [".npz", ".npy", ".bvh"],
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


def _build_told() -> list[Any]:
    """What participants read before they begin: the last fields of `StudyForm`."""
    with gr.Accordion("Who asks, contact, ethics, consent", open=False, elem_id="study-told"):
        with gr.Row(elem_classes="pair"):
            researchers = gr.Textbox("", label="Researchers", min_width=140)
            contact = gr.Textbox("", label="Contact (files go there)", min_width=140)
        ethics = gr.Textbox("", label="Ethics approval: board and number")
        consent = gr.Textbox(
            "", label="Consent text", placeholder=wording()["consent"]["text"].strip(), lines=5
        )
    return [researchers, contact, ethics, consent]


def _build_results() -> StudyParts:
    return StudyParts(
        status=gr.HTML(markup.idle_status(text.READY), elem_id="study-status"),
        researcher=gr.HTML(
            "",
            visible=False,
            js_on_load=mount("study_key.js", "mountKey"),
            apply_default_css=False,
            elem_id="study-researcher",
        ),
        preview=gr.HTML("", visible=False, elem_id="study-preview"),
        participants=gr.DownloadButton(
            "For participants: the page and its videos (zip)",
            variant="secondary",
            visible=False,
            elem_id="study-participants",
        ),
        plan=gr.DownloadButton("The plan (TOML)", visible=False, elem_id="study-plan"),
    )


TITLE = "Analyse the answers"
ANALYSIS_INTRODUCTION = (
    "Drop in what participants sent or saved, and the key from the researcher's zip. The same as "
    "<code>python -m app study analyse</code>, which needs no upload. All of it is deleted here "
    "within the hour."
)
NO_ANSWERS = "There are no answers yet: drop in at least one file that a participant saved."
NO_KEY = "The key is missing: drop in key.json from the researcher's zip."
TOO_MANY = "At most {limit} files are analysed here; {count} were given. Use the command line."
ANALYSED = "Analysed. The report stands below; its files are the ones to keep."

Analyse = Callable[[AnalysisRequest, OnEvent, ShouldCancel], tuple[Path, ...]]
"""Answers, key and folder to the files written there, the report first."""


@dataclass(frozen=True)
class AnalysisForm:
    """What the visitor has filled in, as Gradio hands it over."""

    answers: list[str] | None
    key: str | None


@dataclass(frozen=True)
class AnalysisParts:
    """Where the tab shows what comes of it."""

    status: gr.HTML
    message: gr.HTML
    report: gr.HTML
    files: gr.File

    @property
    def all(self) -> list[Any]:
        return [self.status, self.message, self.report, self.files]


def build_analysis(services: Services) -> None:
    """Lay out the part inside the current context and wire it."""
    gr.HTML(f'{markup.heading(TITLE)}<p class="hint">{ANALYSIS_INTRODUCTION}</p>')
    with gr.Row(elem_classes="columns"):
        with gr.Column(scale=4, min_width=320, elem_classes="sheet"):
            answers = gr.File(
                label="Answers (.json)",
                file_count="multiple",
                file_types=[".json"],
                type="filepath",
                height=170,
                elem_id="analysis-answers",
            )
            key = gr.File(
                label="The key: key.json",
                file_types=[".json"],
                type="filepath",
                height=120,
                elem_id="analysis-key",
            )
            with gr.Row(elem_classes="actions"):
                start = gr.Button("Analyse", variant="primary", elem_id="analysis-start")
        with gr.Column(scale=9, min_width=320, elem_classes="results"):
            parts = AnalysisParts(
                gr.HTML(markup.idle_status(text.READY), elem_id="analysis-status"),
                gr.HTML("", visible=False),
                gr.HTML("", visible=False, elem_id="analysis-report"),
                gr.File(
                    label=text.FILES_LABEL,
                    file_count="multiple",
                    interactive=False,
                    visible=False,
                    elem_id="analysis-files",
                ),
            )
    runner = AnalysisRunner(services, parts)
    reveal_on_click(start, parts.status)
    asks = in_turn(parts.status)
    start.click(runner.run, [answers, key], parts.all, api_visibility="private", **asks)


class AnalysisRunner(TabRunner[tuple[Path, ...]]):
    """Analyses answers for a researcher."""

    tab = "analysis"

    def __init__(self, services: Services, parts: AnalysisParts) -> None:
        super().__init__(services.jobs, parts.status)
        self._analyse: Analyse = partial(services.worker.do, analyse)
        self._parts = parts

    @contextmanager
    def begin(self, job: Job, cookie: str, values: tuple[Any, ...]) -> Iterator[_Work]:
        form = form_of(AnalysisForm, values)
        if not form.answers:
            raise RunError(NO_ANSWERS)
        if not form.key:
            raise RunError(NO_KEY)
        if len(form.answers) > MAX_FILES:
            raise RunError(TOO_MANY.format(limit=MAX_FILES, count=len(form.answers)))
        answers = [Path(path) for path in form.answers]
        asked = AnalysisRequest(answers, Path(form.key), job.folder / "results")
        yield _Work(self._analyse, asked, self._parts)

    def blank(self) -> Updates:
        return self.stopped(markup.sentence_status(text.STARTING), "")

    def stopped(self, status: str, message: str) -> Updates:
        parts = self._parts
        return {
            parts.status: status,
            parts.message: shown(message),
            parts.report: shown(""),
            parts.files: gr.update(visible=False),
        }


@dataclass(frozen=True)
class _Work:
    """One analysis."""

    analyse: Analyse
    asked: AnalysisRequest
    parts: AnalysisParts

    def run(self, on_event: OnEvent, should_cancel: ShouldCancel) -> tuple[Path, ...]:
        return self.analyse(self.asked, on_event, should_cancel)

    def progress(self, events: list[Event]) -> Updates:
        return {}

    def finished(self, result: tuple[Path, ...]) -> Updates:
        report, *_ = result
        return {
            self.parts.status: markup.sentence_status(ANALYSED),
            self.parts.report: shown(framed(report.read_text("utf-8"))),
            self.parts.files: gr.update(value=[str(path) for path in result], visible=True),
        }


def framed(report: str) -> str:
    """A report in a frame of its own, where nothing of it can run: names in it may be anyone's."""
    return (
        f'<iframe class="report" sandbox="" title="Report of the study" '
        f'srcdoc="{escape(report, quote=True)}"></iframe>'
    )
