"""From the fields of the tab "User study" to a plan, and the runs that write or perform it."""

from __future__ import annotations

import json
import os
import secrets
import shutil
from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.errors import RunError
from app.page.parts import markup
from app.page.parts.asked import Fields, values_of
from app.page.parts.html_parts import shown
from app.page.queue.jobs import Job
from app.page.queue.runner import TabRunner, Updates
from app.page.results.result_parts import saved_link
from app.page.routes.media import PAGE_TYPES, RESEARCHER_FILE, RESEARCHER_ROUTE, Address
from app.page.tabs.services import Services
from app.study.design.plan import read_plan
from app.study.design.trials import make_design, size_of
from app.study.export import ExportRequest, export_planned
from app.study.make.workspace import ExportOptions
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


def plan_text(told: Mapping[str, Any]) -> str:
    """The plan as TOML; files are named relative to it.

    Args:
        told: of the form's fields.

    Raises:
        RunError: if something is missing that only the page can say well.
    """
    clips, length_s = told["speeches"], told["length_s"]
    if not clips:
        raise RunError("There is no speech yet: upload at least one file.")
    if len(clips) + len(told["motions"]) > MAX_FILES:
        raise RunError(f"At most {MAX_FILES} files can be uploaded; use the command line for more.")
    if not length_s:
        raise RunError("The length of the videos is missing: give it in seconds.")
    others, changed = _by_system(told["motions"]), told["changed"]
    unknown = next((name for name in changed if name not in CHANGES), None)
    if unknown is not None:
        raise RunError(f"There is no change {unknown!r}; there are {', '.join(CHANGES)}.")
    count = len(clips) * (len(told["systems"]) + len(others) + len(changed)) * len(told["views"])
    if count * length_s > MAX_VIDEO_S:
        raise RunError(
            f"This study has {count * length_s / 60:.0f} minutes of video; the page makes at "
            f"most {MAX_VIDEO_S / 60:.0f}, so use the command line or plan less."
        )
    lines = [
        f"title = {_text(told['title'] or 'Co-speech motion')}",
        f"protocol = {_text(told['protocol'])}",
        f"participants = {told['participants']}",
        f"seed = {told['seed']}",
        f"views = [{', '.join(_text(view) for view in told['views'])}]",
        f"length_s = {length_s:g}",
    ]
    for name in ("post_to", "return_to", "researchers", "contact", "ethics", "consent"):
        if told[name]:
            lines.append(f"{name} = {_text(told[name])}")
    for clip in clips:
        lines += ["", "[[clips]]", f"name = {_text(clip.stem)}", f"speech = {_text(clip.name)}"]
    for system in told["systems"]:
        lines += ["", "[[systems]]", f"name = {_text(system)}"]
    for name in changed:
        planner = usual_planner()
        lines += ["", "[[systems]]", f"name = {_text(f'{planner} {name}')}"]
        lines += [f"system = {_text(planner)}", f"style = {CHANGES[name]}"]
    for system, motions in others.items():
        lines += ["", "[[systems]]", f"name = {_text(system)}", "[systems.motion]"]
        lines += [f"{_text(clip)} = {_text(path.name)}" for clip, path in motions.items()]
    return "\n".join(lines) + "\n"


def collect_files(uploads: Iterable[Path], folder: Path) -> None:
    """Put uploads beside the plan, under the names that it gives them, without a copy of the
    bytes where the disk is the same.

    Raises:
        RunError: if two uploads have the same name.
    """
    for path in uploads:
        target = folder / path.name
        if target.exists():
            raise RunError(f"Two uploads have the name {target.name}; rename one.")
        try:
            os.link(path, target)
        except OSError:
            shutil.copyfile(path, target)


def _by_system(paths: Iterable[Path]) -> dict[str, dict[str, Path]]:
    systems: dict[str, dict[str, Path]] = {}
    for path in paths:
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
PARTICIPANTS = "For participants: the page and its videos (zip)"
PLAN = "The plan (TOML)"


@dataclass(frozen=True)
class StudyParts:
    """Where the tab shows what comes of it."""

    status: gr.HTML
    made: gr.HTML


class StudyRunner(TabRunner):
    """Makes studies."""

    tab = "study"

    def __init__(self, services: Services, parts: StudyParts, fields: Fields) -> None:
        super().__init__(services.jobs, services.worker, parts.status)
        self._services = services
        self._parts = parts
        self._fields = fields

    def steps(self, job: Job, values: Sequence[Any]) -> Generator[Updates, None, None]:
        told = values_of(self._fields, values)
        plan, size = _write_plan(told, job.folder)
        yield {
            self._status: markup.sentence_status(text.STARTING),
            self._parts.made: shown(""),
        }
        address = self._services.media.share(job.folder, job.cookie)
        yield from self._made(job, told, plan, size, address)

    def _made(
        self, job: Job, told: Mapping[str, Any], plan: Path, size: str, address: Address
    ) -> Generator[Updates, None, None]:
        """The participants' part lies with the job, the researcher's in a folder of its own, as all
        does that it is made of."""
        if not job.cookie:
            raise RunError(NO_COOKIE)
        services, config = self._services, self._services.config
        work, waiting = (config.private_folder / secrets.token_hex(16) for _ in "ab")
        job.beside += [work, waiting]
        try:
            for folder in (work, waiting):
                folder.mkdir(parents=True, mode=0o700)
            plan = Path(shutil.copyfile(plan, work / plan.name))
            collect_files((*told["speeches"], *told["motions"]), work)
            bundle, key = job.folder / "participant_bundle.zip", waiting / RESEARCHER_FILE
            options = ExportOptions(config.weights, config.body)
            asked = ExportRequest(plan, work / "study", options, (bundle, key))
            line = "Making the videos: {share:.0%}"
            study = yield from self.done(job, export_planned, asked, line)
            pages = Path(shutil.move(study.bundle, job.folder / "bundle"))
        except BaseException:
            shutil.rmtree(waiting, ignore_errors=True)
            raise
        finally:
            shutil.rmtree(work, ignore_errors=True)
        token = services.private.keep(waiting, waiting, job.cookie)
        look = services.media.share(pages, job.cookie, PAGE_TYPES)(pages / "index.html")
        files = (
            _link("study-participants", address(bundle), bundle.name, PARTICIPANTS),
            _link("study-plan", address(job.folder / plan.name), plan.name, PLAN),
        )
        made = f"{_key(token, config.keep_results_s)}{_preview(f'{look}&preview')}{''.join(files)}"
        yield {
            self._status: markup.sentence_status(f"{MADE} {size}"),
            self._parts.made: shown(f'<div class="downloads">{made}</div>'),
        }

    def stopped(self, status: str, message: str) -> Updates:
        return {self._status: message or status}


class PlanRunner(StudyRunner):
    """Writes the plan alone, without making anything."""

    def _made(
        self, job: Job, told: Mapping[str, Any], plan: Path, size: str, address: Address
    ) -> Generator[Updates, None, None]:
        link = _link("study-plan", address(plan), plan.name, PLAN)
        yield {
            self._status: markup.sentence_status(f"The plan is written. {size}"),
            self._parts.made: shown(f'<div class="downloads">{link}</div>'),
        }


def _write_plan(told: Mapping[str, Any], folder: Path) -> tuple[Path, str]:
    """The plan, and what it asks of participants.

    Raises:
        RunError: if no study can be made from it.
    """
    path = folder / "plan.toml"
    path.write_text(plan_text(told), "utf-8")
    plan = read_plan(path)
    return path, size_of(plan, make_design(plan)).sentence()


def _link(elem_id: str, url: str, name: str, words: str) -> str:
    link = saved_link(url, name, words)
    return f'<p id="{elem_id}">{link}</p>'


def _key(token: str, keep_s: float) -> str:
    """What must not be overlooked, before anything that can be hosted."""
    return (
        f'<div class="key" role="note" id="study-researcher"><h3>{KEY_TITLE}</h3>'
        f"<p>{KEY_HELP.format(minutes=round(keep_s / 60))}</p>"
        f'<form method="post" action=".{RESEARCHER_ROUTE}/{token}">'
        f'<button type="submit" class="lg primary">{KEY_BUTTON}</button></form>'
        f'<p class="done">{KEY_FETCHED}</p></div>'
    )


def _preview(address: str) -> str:
    return (
        f'<p class="study-preview"><a href="{escape(address)}" target="_blank" rel="noopener">'
        f"{PREVIEW}</a><span>{PREVIEW_HELP}</span></p>"
    )
