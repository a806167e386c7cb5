"""The tab of the page that plans and makes a user study."""

from __future__ import annotations

import html
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.config import AppConfig
from app.errors import RunError
from app.page.parts import markup
from app.page.parts.catalogue import Catalogue
from app.page.serving.follow import follow_run, last_share, visitor_sentence, waiting_line
from app.page.serving.jobs import Job, JobBook
from app.page.serving.researcher_part import FILE_NAME, RESEARCHER_ROUTE, Handover
from app.page.serving.visitors import VISITOR_ROUTE, cookie_of, visitor_of
from app.page.tabs.study_form import SEPARATOR, StudyForm, collect_files, plan_text
from app.run.request import VIEWS, OnEvent, Progress, ShouldCancel
from app.study.design.plan import read_plan
from app.study.make.packing import zip_folder
from app.study.make.workspace import Workspace

INTRODUCTION = (
    "Makes a blind study: a web page with videos under random names for your participants, and a "
    "key that only you get. The same as <code>python -m app study export</code>."
)
PROTOCOLS = {
    "Pairs, which is more real? (silent)": "pairwise",
    "Right or wrong speech? (one system at a time)": "matched",
    "Rank all systems on three questions": "ranking",
    "Rate all systems with sliders": "rating",
}
NO_COOKIE = (
    "Your browser keeps no cookie of this page, without which the researcher's part cannot be "
    "kept for you alone; allow cookies and reload the page."
)
MADE = (
    "No leak was found. Host the first download on any web server. The second holds the key: fetch "
    "it now, it is deleted as it is sent, and nobody else can get it."
)
_ASK_FOR_COOKIE = f"() => {{ fetch('.{VISITOR_ROUTE}', {{ method: 'POST' }}); }}"


@dataclass(frozen=True)
class _Results:
    status: gr.HTML
    plan: gr.DownloadButton
    participants: gr.DownloadButton
    researcher: gr.HTML


def build_study_tab(
    page: gr.Blocks, catalogue: Catalogue, config: AppConfig, jobs: JobBook, handover: Handover
) -> None:
    """Lay out the tab inside the current context and wire it."""
    gr.HTML(f'<p class="hint">{INTRODUCTION}</p>')
    with gr.Row(elem_classes="columns"):
        with gr.Column(scale=5, min_width=320):
            materials = _build_materials(catalogue)
        with gr.Column(scale=5, min_width=320):
            settings = _build_settings()
            with gr.Row(elem_classes="actions"):
                start = gr.Button("Make the study", variant="primary", elem_id="study-make")
                write = gr.Button("Plan only", elem_id="study-write", min_width=110)
                cancel = gr.Button(text.CANCEL, elem_id="study-cancel", min_width=110)
            results = _build_results()
    fields = [*materials, *settings]
    maker = _Maker(config, jobs, handover, results)
    outputs = [results.status, results.plan, results.participants, results.researcher]
    write.click(maker.write_plan, fields, outputs, api_name="study_plan", show_progress="hidden")
    start.click(
        maker.make,
        fields,
        outputs,
        api_name="study",
        show_progress="hidden",
        trigger_mode="once",
        concurrency_limit=None,  # JobBook lets them in one by one
    )
    cancel.click(maker.cancel, queue=False, api_visibility="private", show_progress="hidden")
    page.load(None, js=_ASK_FOR_COOKIE)
    page.unload(maker.cancel)


def _build_materials(catalogue: Catalogue) -> list[Any]:
    """What is compared: the first fields of `StudyForm`."""
    title = gr.Textbox("How people move when they talk", label="Title (participants see it)")
    protocol = gr.Radio(list(PROTOCOLS), value=next(iter(PROTOCOLS)), label="Protocol")
    speeches = gr.File(
        label="Speech, one file for each clip",
        file_count="multiple",
        file_types=["audio"],
        type="filepath",
        height=150,
        elem_id="study-speech",
    )
    systems = gr.CheckboxGroup(
        list(catalogue.systems), value=list(catalogue.systems), label="Systems"
    )
    motions = gr.File(
        label=f"Other motion, each file named <system>{SEPARATOR}<clip>.npz (optional)",
        file_count="multiple",
        file_types=[".npz"],
        type="filepath",
        height=150,
    )
    return [title, protocol, speeches, systems, motions]


def _build_settings() -> list[Any]:
    """How it is shown: the other fields of `StudyForm`."""
    with gr.Row(elem_classes="pair"):
        length = gr.Number(10, label="Seconds a video", minimum=0, min_width=100)
        people = gr.Number(28, label="Participants", precision=0, minimum=1, min_width=100)
        seed = gr.Number(0, label="Seed of the order", precision=0, minimum=0, min_width=100)
    views = gr.CheckboxGroup(list(VIEWS), value=["front"], label="Views")
    post_to = gr.Textbox("", label="Address that answers are posted to (optional)")
    return [length, people, seed, views, post_to]


def _build_results() -> _Results:
    return _Results(
        status=gr.HTML(markup.sentence_status(text.READY), elem_id="study-status"),
        plan=gr.DownloadButton("The plan (TOML)", visible=False, elem_id="study-plan"),
        participants=gr.DownloadButton(
            "For participants: the page and its videos (zip)",
            variant="primary",
            visible=False,
            elem_id="study-participants",
        ),
        researcher=gr.HTML("", visible=False, elem_id="study-researcher"),
    )


class _Maker:
    """Turns clicks into plans and studies."""

    def __init__(
        self, config: AppConfig, jobs: JobBook, handover: Handover, results: _Results
    ) -> None:
        self._config = config
        self._jobs = jobs
        self._handover = handover
        self._results = results

    def write_plan(self, request: gr.Request, *values: Any) -> dict[Any, Any]:
        """The plan as a file, without making anything.

        Raises:
            gr.Error: with one sentence.
        """
        job = self._jobs.open(visitor_of(request), "study")
        try:
            path = self._write_plan(_form(values), job.folder)
            read_plan(path)
        except Exception as error:
            raise gr.Error(visitor_sentence(error), print_exception=False) from error
        finally:
            self._jobs.close(job)
        return {
            self._results.status: markup.sentence_status("The plan is written."),
            self._results.plan: gr.update(value=str(path), visible=True),
        }

    def make(self, request: gr.Request, *values: Any) -> Iterator[dict[Any, Any]]:
        """Updates of the tab while a study is made.

        Raises:
            gr.Error: with the sentence that the tab shows too.
        """
        status = self._results.status
        job: Job | None = None
        private: Path | None = None
        try:
            cookie = cookie_of(request)
            if not cookie:
                raise RunError(NO_COOKIE)
            job = self._jobs.open(visitor_of(request), "study")
            private = self._handover.private_folder()
            plan_path = self._write_plan(_form(values), private)
            yield self._blank()
            with self._jobs.slot(job) as turn:
                for ahead in turn:
                    yield {status: markup.sentence_status(waiting_line(ahead))}
                for news in follow_run(self._export(plan_path, private), job):
                    if not isinstance(news, list):
                        yield self._made(news, job, cookie)
                    elif (share := last_share(news)) is not None:
                        yield {status: markup.sentence_status(f"Making the videos: {share:.0%}")}
        except Exception as error:
            sentence = visitor_sentence(error)
            yield {status: markup.error_message(sentence)}
            raise gr.Error(sentence, print_exception=False) from error
        finally:
            if private is not None:
                shutil.rmtree(private, ignore_errors=True)
            if job is not None:
                self._jobs.close(job)

    def cancel(self, request: gr.Request) -> None:
        """The visitor has pressed the button, or closed the page."""
        self._jobs.cancel(visitor_of(request), "study")

    def _write_plan(self, form: StudyForm, folder: Path) -> Path:
        path = folder / "plan.toml"
        path.write_text(plan_text(form), "utf-8")
        collect_files(form, folder)
        return path

    def _export(
        self, plan_path: Path, private: Path
    ) -> Callable[[OnEvent, ShouldCancel], Workspace]:
        """The export in the form of a run, so that it can be followed and stopped like one."""
        from app.study.export import ExportOptions, export_study

        options = ExportOptions(self._config.weights, self._config.body)

        def export(on_event: OnEvent, should_cancel: ShouldCancel) -> Workspace:
            return export_study(
                read_plan(plan_path),
                private / "study",
                options,
                on_progress=lambda share: on_event(Progress("video", share)),
                should_cancel=should_cancel,
            )

        return export

    def _made(self, study: Workspace, job: Job, cookie: str) -> dict[Any, Any]:
        """The participants' part goes to Gradio, the researcher's waits in a folder of its own."""
        bundle = zip_folder(study.bundle, job.folder / "participant_bundle.zip")
        made_in = study.private.parents[1]
        plan = Path(shutil.copyfile(made_in / "plan.toml", job.folder / "plan.toml"))
        shutil.copyfile(plan, study.private / "plan.toml")
        archive = zip_folder(study.private, self._handover.private_folder() / FILE_NAME)
        token = self._handover.offer(cookie, archive)
        return {
            self._results.status: markup.sentence_status(MADE),
            self._results.plan: gr.update(value=str(plan), visible=True),
            self._results.participants: gr.update(value=str(bundle), visible=True),
            self._results.researcher: gr.update(value=_fetch_button(token), visible=True),
        }

    def _blank(self) -> dict[Any, Any]:
        hidden = gr.update(visible=False)
        return {
            self._results.status: markup.sentence_status("Starting."),
            self._results.plan: hidden,
            self._results.participants: hidden,
            self._results.researcher: gr.update(value="", visible=False),
        }


def _fetch_button(token: str) -> str:
    return (
        f'<form method="post" action=".{RESEARCHER_ROUTE}">'
        f'<input type="hidden" name="token" value="{html.escape(token)}">'
        '<button type="submit" class="lg secondary">For you alone: key and records (zip, once)'
        "</button></form>"
    )


def _form(values: tuple[Any, ...]) -> StudyForm:
    title, protocol, *rest = values
    return StudyForm(str(title or ""), PROTOCOLS.get(protocol, str(protocol)), *rest)
