"""The runs of the tab "User study": a plan written, or a study made and kept for its maker."""

from __future__ import annotations

import html
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gradio as gr

from app import text
from app.errors import RunError, visitor_sentence
from app.page.parts import markup
from app.page.parts.html_parts import shown
from app.page.queue.follow import last_share
from app.page.queue.in_turn import Updates
from app.page.queue.jobs import Job
from app.page.queue.runner import TabRunner
from app.page.results.study_preview import StudyPreviews
from app.page.tabs.services import Services
from app.page.tabs.study.study_form import StudyForm, collect_files, plan_text
from app.page.visitors.researcher_part import FILE_NAME, RESEARCHER_ROUTE, Handover
from app.page.visitors.visitors import address_of, visitor_of
from app.run.output.result_folder import zip_folder
from app.run.requests.request import Event, OnEvent, ShouldCancel
from app.study.design.plan import read_plan
from app.study.design.size import size_of
from app.study.design.trials import make_design
from app.study.make.workspace import Workspace

if TYPE_CHECKING:
    from app.study.export import ExportOptions

NO_COOKIE = (
    "Your browser keeps no cookie of this page, without which the researcher's part cannot be "
    "kept for you alone; allow cookies and reload the page."
)
MADE = "The study is made, and no leak was found. Fetch the key, look at the page, then host it."
KEY_TITLE = "First: the key, for you alone"
KEY_HELP = (
    "Without it nobody can tell which video is which, you neither: answers could never be "
    "analysed. It is deleted here as it is sent, and after {minutes} minutes in any case. Keep it "
    "away from participants."
)
KEY_BUTTON = "Fetch key and records (zip, once)"
KEY_FETCHED = "It went to this browser's downloads: see that researcher_only.zip is there."
PREVIEW = "Preview as participant"
PREVIEW_HELP = "In a new tab; nothing is sent."


Export = Callable[[Path, Path, "ExportOptions", OnEvent, ShouldCancel], Workspace]


@dataclass(frozen=True)
class StudyParts:
    """Where the tab shows what comes of it."""

    status: gr.HTML
    researcher: gr.HTML
    preview: gr.HTML
    participants: gr.DownloadButton
    plan: gr.DownloadButton

    @property
    def all(self) -> list[Any]:
        return [self.status, self.researcher, self.preview, self.participants, self.plan]


class StudyRunner(TabRunner[Workspace]):
    """Writes plans and makes studies."""

    tab = "study"

    def __init__(self, services: Services, parts: StudyParts) -> None:
        super().__init__(services.jobs, parts.status)
        self._services = services
        self._parts = parts

    def write_plan(self, request: gr.Request, *values: Any) -> Updates:
        """The plan as a file, without making anything.

        Raises:
            gr.Error: with one sentence.
        """
        job = self._jobs.open(visitor_of(request), self.tab, address_of(request))
        try:
            path, size = _write_plan(StudyForm.of(values), job.folder)
        except Exception as error:
            raise gr.Error(visitor_sentence(error), print_exception=False) from error
        finally:
            self._jobs.close(job)
        return {
            self._parts.status: markup.sentence_status(f"The plan is written. {size}"),
            self._parts.plan: gr.update(value=str(path), visible=True),
        }

    @contextmanager
    def begin(self, job: Job, cookie: str, values: tuple[Any, ...]) -> Iterator[_Work]:
        from app.study.export import ExportOptions  # brings torch: only once it is needed

        if not cookie:
            raise RunError(NO_COOKIE)
        services = self._services
        private = services.handover.private_folder()
        try:
            form = StudyForm.of(values)
            plan_path, size = _write_plan(form, private)
            collect_files(form, private)
            options = ExportOptions(services.config.weights, services.config.body)
            yield _Work(
                *(services.processes.export_study, plan_path, size, options, job, cookie),
                *(services.handover, services.previews, self._parts),
                services.config.keep_results_s,
            )
        finally:
            shutil.rmtree(private, ignore_errors=True)

    def blank(self) -> Updates:
        hidden = gr.update(visible=False)
        return {
            self._parts.status: markup.sentence_status(text.STARTING),
            self._parts.plan: hidden,
            self._parts.participants: hidden,
            self._parts.researcher: shown(""),
            self._parts.preview: shown(""),
        }

    def stopped(self, status: str, message: str) -> Updates:
        return {self._parts.status: message or status}


@dataclass(frozen=True)
class _Work:
    """One study that is made, in a folder that is removed at the end."""

    export: Export
    plan_path: Path
    """In that folder."""
    size: str
    """What it asks of participants."""
    options: ExportOptions
    job: Job
    cookie: str
    handover: Handover
    previews: StudyPreviews
    parts: StudyParts
    keep_s: float

    def run(self, on_event: OnEvent, should_cancel: ShouldCancel) -> Workspace:
        out = self.plan_path.parent / "study"
        return self.export(self.plan_path, out, self.options, on_event, should_cancel)

    def progress(self, events: list[Event]) -> Updates:
        share = last_share(events)
        if share is None:
            return {}
        return {self.parts.status: markup.sentence_status(f"Making the videos: {share:.0%}")}

    def finished(self, result: Workspace) -> Updates:
        """The participants' part goes to Gradio, the researcher's waits in a folder of its own."""
        folder = self.job.folder
        bundle = zip_folder(result.bundle, folder / "participant_bundle.zip")
        plan = Path(shutil.copyfile(self.plan_path, folder / "plan.toml"))
        shutil.copyfile(plan, result.private / "plan.toml")
        archive = zip_folder(result.private, self.handover.private_folder() / FILE_NAME)
        token = self.handover.offer(self.cookie, archive)
        address = self.previews.address(
            shutil.copytree(result.bundle, folder / "bundle"), self.cookie
        )
        return {
            self.parts.status: markup.sentence_status(f"{MADE} {self.size}"),
            self.parts.plan: gr.update(value=str(plan), visible=True),
            self.parts.participants: gr.update(value=str(bundle), visible=True),
            self.parts.researcher: shown(_key(token, self.keep_s)),
            self.parts.preview: shown(_preview(address)),
        }


def _write_plan(form: StudyForm, folder: Path) -> tuple[Path, str]:
    """The plan, and what it asks of participants.

    Raises:
        RunError: if no study can be made from it.
    """
    path = folder / "plan.toml"
    path.write_text(plan_text(form), "utf-8")
    plan = read_plan(path)
    return path, size_of(plan, make_design(plan)).sentence()


def _key(token: str, keep_s: float) -> str:
    """What must not be overlooked, before anything that can be hosted."""
    return (
        f'<div class="key" role="note"><h3>{KEY_TITLE}</h3>'
        f"<p>{KEY_HELP.format(minutes=round(keep_s / 60))}</p>"
        f'<form method="post" action=".{RESEARCHER_ROUTE}">'
        f'<input type="hidden" name="token" value="{html.escape(token)}">'
        f'<button type="submit" class="lg primary">{KEY_BUTTON}</button></form>'
        f'<p class="done">{KEY_FETCHED}</p></div>'
    )


def _preview(address: str) -> str:
    return (
        f'<p class="study-preview"><a href="{html.escape(address)}" target="_blank" rel="noopener">'
        f"{PREVIEW}</a><span>{PREVIEW_HELP}</span></p>"
    )
