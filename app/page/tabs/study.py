"""The tab "User study": a study planned and made, and answers turned into a report."""

from __future__ import annotations

import json
from collections.abc import Generator, Sequence
from html import escape
from typing import Any

import gradio as gr

from app import text
from app.errors import RunError
from app.page.parts import markup
from app.page.parts.asked import Field, Fields, a_file, some_files, values_of, whole
from app.page.parts.catalogue import Catalogue, default_systems
from app.page.parts.html_parts import PRIVATE, reveal_on_click, shown, told_part
from app.page.queue.jobs import Job
from app.page.queue.runner import TabRunner, Updates
from app.page.results.result_parts import files_listed
from app.page.tabs.motion import SEED_LIMIT, fresh_copy
from app.page.tabs.services import Services
from app.page.tabs.study_run import (
    CHANGES,
    PROTOCOLS,
    QUESTIONS,
    SEPARATOR,
    PlanRunner,
    StudyParts,
    StudyRunner,
)
from app.page.visitors.uploads import MAX_FILES
from app.study.analyse import AnalysisRequest, analyse
from app.study.design.plan import wording
from conventions.views import VIEWS
from model.systems.registry import usual_planner

INTRODUCTION = (
    "Makes a blind study: a web page with videos under random names for your participants, and a "
    "key that only you get. The same as <code>python -m app study export</code>."
)


def build_study_tab(services: Services) -> Fields:
    """Lay out the tab inside the current context and wire it; returns its form."""
    catalogue = services.catalogue
    gr.HTML(f'<p class="hint">{INTRODUCTION}</p>')
    with gr.Row(elem_classes="columns"):
        with gr.Column(scale=5, min_width=320):
            ready = _build_questions(catalogue)
            fields = _build_materials(services)
        with gr.Column(scale=5, min_width=320):
            fields |= _build_settings()
            with gr.Row(elem_classes="actions"):
                start = gr.Button("Make the study", variant="primary", elem_id="study-make")
                write = gr.Button("Plan only", elem_id="study-write", min_width=110)
                cancel = gr.Button(text.CANCEL, elem_id="study-cancel", min_width=110)
            with gr.Column(elem_classes="results"):
                parts = StudyParts(
                    gr.HTML(markup.idle_status(text.READY), elem_id="study-status"),
                    told_part("study-made", "study_key.js", "mountKey"),
                )
    protocol, speeches, systems, changed = (
        fields[name].part for name in ("protocol", "speeches", "systems", "changed")
    )

    def examples(given: list[str] | None) -> list[str] | None:
        """Where there is no speech yet."""
        folder = services.config.cache_folder / "examples"
        return given or [str(fresh_copy(each.path, folder)) for each in catalogue.examples] or None

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
        button.click(examples, speeches, speeches, **PRIVATE)
    outputs = [parts.status, parts.made]
    only_plan = PlanRunner(services, parts, fields)
    at_once: dict[str, Any] = {"concurrency_id": "plan", "show_progress": "hidden"}
    only_plan.begins_on(write.click, fields, outputs=outputs, api_name="study_plan", **at_once)
    runner = StudyRunner(services, parts, fields)
    reveal_on_click(start, parts.status)
    run = runner.begins_on(start.click, fields, outputs=outputs, api_name="study")
    runner.ends_on(cancel, run, outputs)
    return fields


def _build_questions(catalogue: Catalogue) -> list[gr.Button]:
    """Buttons that fill in a study of the gestures of the system that plans."""
    if usual_planner() not in catalogue.systems:
        return []
    gr.HTML(f'<p class="hint">{text.STUDY_READY}</p>')
    with gr.Row(elem_id="study-ready"):
        return [gr.Button(name, size="sm", min_width=110) for name in QUESTIONS]


def _build_materials(services: Services) -> dict[str, Field]:
    """What is compared."""
    catalogue, planner = services.catalogue, usual_planner()
    title = gr.Textbox("How people move when they talk", label="Title (participants see it)")
    protocol = gr.Radio(list(PROTOCOLS), value=next(iter(PROTOCOLS)), label="Protocol")
    speeches = services.file(
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
    changed = gr.CheckboxGroup(
        list(CHANGES),
        value=[],
        label=text.STUDY_CHANGED,
        info=text.STUDY_CHANGED_HELP.format(system=planner),
        visible=planner in catalogue.systems,
        elem_id="study-changed",
    )
    motions = services.file(
        "motion",
        f"Other motion, each file named <system>{SEPARATOR}<clip>.npz (optional)",
        [".npz", ".npy", ".bvh"],
        "study-motions",
        height=150,
        file_count="multiple",
    )
    return {
        "title": Field(title, str.strip),
        "protocol": Field(protocol, lambda name: PROTOCOLS.get(name or "", name or "")),
        "speeches": Field(speeches, some_files),
        "systems": Field(systems),
        "motions": Field(motions, some_files),
        "changed": Field(changed),
    }


def _build_settings() -> dict[str, Field]:
    """How it is shown, and what participants read before they begin."""
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
    with gr.Accordion("Who asks, contact, ethics, consent", open=False, elem_id="study-told"):
        with gr.Row(elem_classes="pair"):
            researchers = gr.Textbox("", label="Researchers", min_width=140)
            contact = gr.Textbox("", label="Contact (files go there)", min_width=140)
        ethics = gr.Textbox("", label="Ethics approval: board and number")
        consent = gr.Textbox(
            "", label="Consent text", placeholder=wording()["consent"]["text"].strip(), lines=5
        )
    texts = {"post_to": post_to, "return_to": return_to, "researchers": researchers}
    texts |= {"contact": contact, "ethics": ethics, "consent": consent}
    return {
        "length_s": Field(length),
        "participants": Field(people, whole("Participants", 1, 1000)),
        "seed": Field(seed, whole("The seed of the order", 0, SEED_LIMIT, 0)),
        "views": Field(views),
        **{name: Field(part, str.strip) for name, part in texts.items()},
    }


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
            status = gr.HTML(markup.idle_status(text.READY), elem_id="analysis-status")
            report = told_part("analysis-report")
    fields = {"answers": Field(answers, some_files), "key": Field(key, a_file)}
    reveal_on_click(start, status)
    runner = AnalysisRunner(services, fields, status, report)
    runner.begins_on(start.click, [answers, key], outputs=[status, report])


class AnalysisRunner(TabRunner):
    """Analyses answers for a researcher."""

    tab = "analysis"

    def __init__(
        self, services: Services, fields: Fields, status: gr.HTML, report: gr.HTML
    ) -> None:
        super().__init__(services.jobs, services.worker, status)
        self._fields = fields
        self._media = services.media
        self._report = report

    def steps(self, job: Job, values: Sequence[Any]) -> Generator[Updates, None, None]:
        told = values_of(self._fields, values)
        answers, key = told["answers"], told["key"]
        if not answers:
            raise RunError(NO_ANSWERS)
        if not key:
            raise RunError(NO_KEY)
        if len(answers) > MAX_FILES:
            raise RunError(TOO_MANY.format(limit=MAX_FILES, count=len(answers)))
        yield {self._status: markup.sentence_status(text.STARTING), self._report: shown("")}
        asked = AnalysisRequest(list(answers), key, job.folder / "results")
        files = yield from self.done(job, analyse, asked)
        report, *_ = files
        links = files_listed(files, self._media.share(job.folder, job.cookie))
        html = f'{framed(report.read_text("utf-8"))}<div class="downloads">{links}</div>'
        yield {self._status: markup.sentence_status(ANALYSED), self._report: shown(html)}

    def stopped(self, status: str, message: str) -> Updates:
        return {self._status: message or status, self._report: shown("")}


def framed(report: str) -> str:
    """A report in a frame of its own, where nothing of it can run: names in it may be anyone's."""
    return (
        f'<iframe class="report" sandbox="" title="Report of the study" '
        f'srcdoc="{escape(report, quote=True)}"></iframe>'
    )
