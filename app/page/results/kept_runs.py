"""Finished runs that any browser can open by a link.

The link holds 256 random bits. Whoever has it can open and save the run, as a zip of its folder or
as an HTML page; the list of a browser's own runs needs the page's cookie.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

import gradio as gr
from fastapi import Response
from fastapi.responses import PlainTextResponse
from fastapi.routing import APIRoute
from starlette.concurrency import run_in_threadpool

from app import text
from app.errors import page_message, without_folders
from app.page.parts import markup
from app.page.parts.markup import Updates, shown
from app.page.results.player import Showing, showings_in
from app.page.results.result_parts import ResultParts, figures_html, files_listed
from app.page.results.tables import clips_html, jerk_bars, measures_table, title_of
from app.page.routes.media import GONE, MadeFiles, Media
from app.page.visitors.files import Job
from app.page.visitors.visitors import Kept, is_same
from app.run.batch.saved_run import copy_run
from app.run.output.run_folder import TABLES, RunRecord, file_of

PARAMETER = "run"
"""Query parameter of the page's URL."""
RUN_ROUTE = "/media/run"
"""Route of downloads of a run, followed by its token."""
EDITED = "generate"
"""Tab with the plan editor."""
_MAX_STEM = 60


@dataclass(eq=False)
class KeptRun:
    """Finished run that can be opened again."""

    job: Job
    showing: Showing
    """Player data for the browser that started the run."""
    form: Mapping[str, Any] = field(default_factory=dict)
    """Values of the form that started the run, by field, as far as others may see them."""
    ended: float = field(default_factory=time.time)
    token: str = ""
    clips: dict[str, KeptRun] = field(default_factory=dict)
    """All runs by clip, including this one, if a run has several clips; otherwise empty."""

    @property
    def record(self) -> RunRecord:
        return self.showing.record

    @property
    def folder(self) -> Path:
        """Folder of the run, or of the runs of all clips."""
        return self.showing.folder.parent if self.clips else self.showing.folder

    @property
    def title(self) -> str:
        return title_of([run.record for run in self.clips.values()] or [self.record])

    def updates(
        self, parts: ResultParts, showing: Showing | None = None, *, begins: bool = False
    ) -> Updates:
        """Return the updates of a tab that opens the run; with ``begins``, it plays at once."""
        showing = showing or self.showing
        record, notes = showing.record, map(page_message, showing.record.notes)
        is_done, why = record.state == "done", without_folders(record.sentence)
        failed = "" if is_done else markup.error_message(page_message(why))
        line = record.sentence if is_done else text.STOPPED
        if self.clips:
            done = [run for run in self.clips.values() if run.record.state == "done"]
            line = text.CLIPS_DONE.format(done=len(done), count=len(self.clips))
        moving = [(clip, run) for clip, run in self.clips.items() if run.record.has_motion]
        choices = [(clip, run.token) for clip, run in moving]
        return {
            **told_so_far(showing, parts),
            parts.clips: shown(clips_html({clip: run.record for clip, run in self.clips.items()})),
            **({parts.verdict: shown("")} if self.clips else {}),  # that over all clips is above
            parts.clip: gr.update(choices=choices, value=self.token, visible=bool(choices)),
            parts.status: markup.sentence_status(line),
            parts.message: shown(failed + markup.notes_folded(list(notes))),
            parts.player: showing.value() | {"begins": begins},
            parts.downloads: shown(self.downloads(showing)),
        }

    def downloads(self, showing: Showing) -> str:
        """Format the links to the zip, the HTML page and single files."""
        files = [showing.folder / name for name in self.record.files if "/" not in name]
        files += [self.folder / name for name in TABLES if self.clips]
        listed = files_listed(filter(Path.is_file, files), showing.address)
        address = f"{RUN_ROUTE.lstrip('/')}/{self.token}"
        zipped = f'href="{address}" download title="{text.SAVE_RUN_HELP}"'
        alone = f'href="{address}/page" download title="{text.SAVE_PAGE_HELP}"'
        saved = f"<a class=bundle {zipped}>{text.SAVE_RUN}</a><a {alone}>{text.SAVE_PAGE}</a>"
        told = ""
        if missing := self.record.missing:
            videos = {*missing, *(path.name for path in files if path.suffix == ".mp4")}
            lacks = text.VIDEOS_MISSING.format(missing=len(missing), count=len(videos))
            told = f"<p>{lacks}</p>"
        heading = markup.heading("Downloads")
        return f'{heading}<div class="downloads"><p>{saved}</p>{told}{listed}</div>'


def told_so_far(showing: Showing, parts: ResultParts) -> Updates:
    """Return the updates of player, verdict, metrics and figures of a run, finished or not."""
    record = showing.record
    files = (file_of(showing.folder, name) for name in record.files)
    figures = figures_html(filter(None, files), showing.address, record.says)
    told = record.verdict
    verdict = (
        "" if told is None else markup.verdict(told.numbers, told.judgement, jerk_bars(record))
    )
    return {
        parts.player: showing.value(),
        parts.figures: shown(figures),
        parts.verdict: shown(verdict),
        parts.numbers: shown(measures_table(record) if record.numbers else ""),
    }


class KeptRuns(Kept[KeptRun]):
    """Store of finished runs by token."""

    def __init__(self, keep_s: float) -> None:
        super().__init__()
        self._keep_s = keep_s  # same as for files, only for display

    def keep_run(
        self, job: Job, showings: Mapping[str, Showing], form: Mapping[str, Any] | None = None
    ) -> KeptRun:
        """Store a run, or those of several clips by name; return the first with any motion."""
        kept = {clip: KeptRun(job, each, form or {}) for clip, each in showings.items()}
        for run in kept.values():
            run.clips = kept if len(kept) > 1 else {}
            if job.tab == EDITED and run.showing.performed():
                run.showing.say()
            run.token = self.keep(run, job.folder, None)
        runs = list(kept.values())
        return next((run for run in runs if run.record.has_motion), runs[0])

    def edited(self, name: str, cookie: str) -> KeptRun | None:
        """Return the run of a name if this browser may edit its plans, or None."""
        runs = [run for run in self.all() if run.showing.name == name and run.showing.editing]
        mine = (run for run in runs if not run.job.cookie or is_same(run.job.cookie, cookie))
        return next(mine, None)

    def of(self, cookie: str) -> list[KeptRun]:
        """Return a browser's own runs, the newest first, with one for all clips of a run."""
        firsts = [run for run in self.all() if next(iter(run.clips.values()), run) is run]
        mine = [run for run in firsts if is_same(run.job.cookie, cookie)]
        return sorted(mine, key=lambda run: run.ended, reverse=True)

    def html(self, cookie: str, *opened: KeptRun) -> str:
        """Format the link of the opened runs and the list of the browser's own; empty without any.

        app/page/web/runs.js copies the link, limits the selection to two, and formats local times.
        """
        mine, jobs = self.of(cookie), [run.job for run in opened]
        items = "".join(_item(run, run.job in jobs, len(mine) > 1) for run in mine)
        if not opened and not items:
            return ""
        link = ""
        if opened:
            minutes = (min(run.ended for run in opened) + self._keep_s - time.time()) / 60
            words = "Link to this run" if len(opened) == 1 else text.PAIR_LINK
            link = (
                f'<p class="link"><a href="{escape(address_of(*opened))}">{words}</a>'
                f'<button type="button">Copy link</button>'
                f"<span>{text.RUN_KEPT.format(minutes=max(1, round(minutes)))}</span></p>"
                f"{_beside(opened, mine)}"
            )
        compare = f'<button>{text.COMPARE}</button><span class="how">{text.COMPARE_HELP}</span>'
        listed = (
            f"<details><summary>Your runs ({len(mine)})</summary>"
            f'<form method="get" target="_blank"><ol>{items}</ol>'
            f"{compare if len(mine) > 1 else ''}</form></details>"
        )
        return f'<div class="runs">{link}{listed if items else ""}</div>'


def keep_own(kept: KeptRuns, path: Path, temp: Path, media: Media) -> str:
    """Store a run named by the page's owner for every visitor, and return its token.

    Args:
        path: folder of the run, or its zip.

    Raises:
        RunError: if there is no run.
    """
    folder = copy_run(path, temp)
    showings = showings_in(folder, media.share(folder, ""), temp.name)
    is_made = next(iter(showings.values())).record.kind == "generated"
    job = Job("", EDITED if is_made else "own_motion", temp)
    return kept.keep_run(job, showings).token


def address_of(*runs: KeptRun) -> str:
    """Return the URL of one run, or of a comparison of two, relative to the page."""
    return "?" + "&".join(f"{PARAMETER}={run.token}" for run in runs)


def _beside(opened: tuple[KeptRun, ...], mine: list[KeptRun]) -> str:
    """Format the link to a comparison with the previous run, of the same speech if possible."""
    (shown, *others) = opened
    before = [run for run in mine if run.ended < shown.ended and run.job is not shown.job]
    if others or not before:
        return ""
    speech = shown.record.speech_sha256
    alike = [run for run in before if speech and run.record.speech_sha256 == speech]
    other = (alike or before)[0]
    words = text.COMPARE_LAST if alike else text.COMPARE_OTHER
    return (
        f'<p><a href="{escape(address_of(other, shown))}" target="_blank" '
        f'title="{escape(other.record.title)}">{words}</a></p>'
    )


def _item(run: KeptRun, is_shown: bool, has_checkbox: bool) -> str:
    here = ' aria-current="page"' if is_shown else ""
    title = escape(run.title)
    tick = (
        f'<input type="checkbox" name="{PARAMETER}" value="{escape(run.token)}" '
        f'aria-label="{text.COMPARE_THIS.format(title=title)}"{" checked" if is_shown else ""}>'
    )
    return (
        f"<li>{tick if has_checkbox else ''}"
        f'<time data-at="{run.ended:.0f}"></time>'
        f'<a href="{escape(address_of(run))}"{here}>{title}</a></li>'
    )


def saving_route(
    kept: KeptRuns, made: MadeFiles, ending: str, task: Callable[..., object], below: str = ""
) -> APIRoute:
    """Make the route that serves finished runs in one file format.

    Args:
        task: writes the file; its request is the run's folder and the path of the file.
    """

    async def answer(token: str) -> Response:
        run = await run_in_threadpool(kept.find, token)
        if run is None:
            return PlainTextResponse(GONE, status_code=404)
        name = await run_in_threadpool(lambda: file_name(run.title, ending))
        return await made.answer(task, lambda out: (run.folder, out), name)

    return APIRoute(f"{RUN_ROUTE}/{{token}}{below}", answer, methods=["GET"])


def file_name(title: str, ending: str = ".zip") -> str:
    """Make a file name from the title of a run."""
    stem = re.sub(r"[^\w .,+-]+", "-", title).strip(" .-")[:_MAX_STEM]
    return f"{stem or 'run'}{ending}"
