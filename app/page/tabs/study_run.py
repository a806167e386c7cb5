"""From the fields of the tab "User study" to a plan, and the runs that write or perform it."""

from __future__ import annotations

import html
import json
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.errors import RunError, visitor_sentence
from app.page.parts import markup
from app.page.parts.asked import form_of, whole_number
from app.page.parts.html_parts import shown
from app.page.queue.jobs import Job
from app.page.queue.runner import TabRunner, Updates, last_share
from app.page.results.study_preview import StudyPreviews
from app.page.tabs.services import Services
from app.page.visitors.researcher_part import FILE_NAME, RESEARCHER_ROUTE, Handover
from app.page.visitors.visitors import visitor_of
from app.run.output.result_folder import zip_folder
from app.run.requests.request import Event, OnEvent, ShouldCancel
from app.study.design.plan import read_plan
from app.study.design.trials import make_design, size_of
from app.study.export import ExportRequest, export_planned
from app.study.make.workspace import ExportOptions, Workspace
from model.systems.registry import usual_planner

SEPARATOR = "--"
PROTOCOLS = {
    "Pairs, which is more real? (silent)": "pairwise",
    "Right or wrong speech? (one system at a time)": "matched",
    "Rank all systems on three questions": "ranking",
    "Rate all systems with sliders": "rating",
}
CHANGES = {
    "on wrong words": "{ wrong_words = true }",
    "half as many": "{ times = { gestures_per_min = 0.5 } }",
    "smaller": "{ times = { size_m = 0.6 } }",
    "larger": "{ times = { size_m = 1.5 } }",
}
"""What can be done to the gestures of the system that plans, as a style of `model.plan.style`."""
QUESTIONS = {
    "Do words matter?": ("Rank all systems on three questions", ["on wrong words"]),
    "How many gestures?": ("Rate all systems with sliders", ["half as many"]),
    "How large?": ("Rate all systems with sliders", ["smaller", "larger"]),
}
"""Studies ready to be made: a protocol, and changes beside the gestures as planned."""
MAX_FILES = 60
MAX_VIDEO_S = 1800.0
"""Of all videos of a study that the page makes."""


@dataclass(frozen=True)
class StudyForm:
    """What the visitor has filled in, as Gradio hands it over."""

    title: str | None
    protocol: str
    speeches: list[str] | None
    systems: list[str]
    motions: list[str] | None
    """Files named ``<system>--<clip>.npz``."""
    length_s: float | None
    participants: float | None
    seed: float | None
    views: list[str]
    post_to: str | None
    return_to: str | None = None
    changed: list[str] | None = None
    """Of `CHANGES`, each a system of its own."""
    researchers: str | None = None
    contact: str | None = None
    ethics: str | None = None
    consent: str | None = None

    @classmethod
    def of(cls, values: Sequence[Any]) -> StudyForm:
        """From the values of the fields; the page has its own words for the protocols.

        Raises:
            RunError: if a value has another type than its field.
        """
        form = form_of(cls, values)
        return replace(form, protocol=PROTOCOLS.get(form.protocol, form.protocol))


def plan_text(form: StudyForm) -> str:
    """The plan as TOML; files are named relative to it.

    Raises:
        RunError: if something is missing that only the page can say well.
    """
    if not form.speeches:
        raise RunError("There is no speech yet: upload at least one file.")
    if len(form.speeches) + len(form.motions or []) > MAX_FILES:
        raise RunError(f"At most {MAX_FILES} files can be uploaded; use the command line for more.")
    if not form.length_s:
        raise RunError("The length of the videos is missing: give it in seconds.")
    clips = [Path(path) for path in form.speeches]
    others = _by_system(form.motions or [])
    changed = form.changed or []
    unknown = next((name for name in changed if name not in CHANGES), None)
    if unknown is not None:
        raise RunError(f"There is no change {unknown!r}; there are {', '.join(CHANGES)}.")
    count = len(clips) * (len(form.systems) + len(others) + len(changed)) * len(form.views)
    if count * form.length_s > MAX_VIDEO_S:
        raise RunError(
            f"This study has {count * form.length_s / 60:.0f} minutes of video; the page makes at "
            f"most {MAX_VIDEO_S / 60:.0f}, so use the command line or plan less."
        )
    lines = [
        f"title = {_text((form.title or '').strip() or 'Co-speech motion')}",
        f"protocol = {_text(form.protocol)}",
        f"participants = {whole_number(form.participants or 0, 'Participants', 1, 1000)}",
        f"seed = {whole_number(form.seed or 0, 'The seed of the order', 0, 2**31 - 1)}",
        f"views = [{', '.join(_text(view) for view in form.views)}]",
        f"length_s = {float(form.length_s):g}",
    ]
    for name in ("post_to", "return_to", "researchers", "contact", "ethics", "consent"):
        if told := (getattr(form, name) or "").strip():
            lines.append(f"{name} = {_text(told)}")
    for clip in clips:
        lines += ["", "[[clips]]", f"name = {_text(clip.stem)}", f"speech = {_text(clip.name)}"]
    for system in form.systems:
        lines += ["", "[[systems]]", f"name = {_text(system)}"]
    for name in changed:
        planner = usual_planner()
        lines += ["", "[[systems]]", f"name = {_text(f'{planner} {name}')}"]
        lines += [f"system = {_text(planner)}", f"style = {CHANGES[name]}"]
    for system, motions in others.items():
        lines += ["", "[[systems]]", f"name = {_text(system)}", "[systems.motion]"]
        lines += [f"{_text(clip)} = {_text(path.name)}" for clip, path in motions.items()]
    return "\n".join(lines) + "\n"


def collect_files(form: StudyForm, folder: Path) -> None:
    """Put the uploads beside the plan, under the names that it gives them, without a copy of the
    bytes where the disk is the same.

    Raises:
        RunError: if two uploads have the same name.
    """
    for path in (*(form.speeches or []), *(form.motions or [])):
        target = folder / Path(path).name
        if target.exists():
            raise RunError(f"Two uploads have the name {target.name}; rename one.")
        try:
            os.link(path, target)
        except OSError:
            shutil.copyfile(path, target)


def _by_system(paths: list[str]) -> dict[str, dict[str, Path]]:
    systems: dict[str, dict[str, Path]] = {}
    for path in map(Path, paths):
        system, separator, clip = path.stem.partition(SEPARATOR)
        if not (system and separator and clip):
            raise RunError(
                f"The motion file {path.name} must be named <system>{SEPARATOR}<clip>.npz, with "
                "the name of a speech file as the clip."
            )
        systems.setdefault(system, {})[clip] = path
    return systems


def _text(value: str) -> str:
    """A TOML string; JSON's escapes are among TOML's."""
    return json.dumps(value, ensure_ascii=True).replace("\x7f", "\\u007f")


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


Export = Callable[[ExportRequest, OnEvent, ShouldCancel], Workspace]


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
        with self._jobs.opened(visitor_of(request), self.tab) as job:
            try:
                path, size = _write_plan(StudyForm.of(values), job.folder)
            except Exception as error:
                raise gr.Error(visitor_sentence(error), print_exception=False) from error
        return {
            self._parts.status: markup.sentence_status(f"The plan is written. {size}"),
            self._parts.plan: gr.update(value=str(path), visible=True),
        }

    @contextmanager
    def begin(self, job: Job, cookie: str, values: tuple[Any, ...]) -> Iterator[_Work]:
        if not cookie:
            raise RunError(NO_COOKIE)
        services = self._services
        private = services.handover.private_folder()
        try:
            form = StudyForm.of(values)
            plan_path, size = _write_plan(form, private)
            collect_files(form, private)
            options = ExportOptions(services.config.weights, services.config.body)
            export = partial(services.worker.do, export_planned)
            yield _Work(
                *(export, plan_path, size, options, job, cookie),
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
        asked = ExportRequest(self.plan_path, out, self.options)
        return self.export(asked, on_event, should_cancel)

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
