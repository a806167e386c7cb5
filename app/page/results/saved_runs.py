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
from fastapi import Request, Response
from fastapi.responses import PlainTextResponse
from fastapi.routing import APIRoute
from starlette.concurrency import run_in_threadpool

from app import text
from app.errors import without_cli_options, without_folders
from app.page.parts import markup
from app.page.parts.markup import Updates, update_html
from app.page.results.result_parts import ResultParts, figures_html, file_list_html
from app.page.results.run_view import RunView, run_views_in
from app.page.results.tables import jerk_bars, jerk_by_clip_html, run_metrics_table, runs_title
from app.page.routes.media import GONE, OnDemandFiles, SharedFolders
from app.page.visitors.job_folders import Job
from app.page.visitors.visitors import TokenStore, is_same_cookie
from app.run.batch.saved_run import copy_run
from app.run.output.run_folder import READABLE_BATCH_TABLES, RunRecord, existing_file

RUN_QUERY_PARAMETER = "run"
"""Query parameter of the page's URL."""
RUN_ROUTE = "/media/run"
"""Route of downloads of a run, followed by its token."""
PLAN_EDITOR_TAB = "generate"
"""Tab with the plan editor."""
_MAX_STEM = 60


@dataclass(eq=False)
class SavedRun:
    """Finished run that can be opened again."""

    job: Job
    view: RunView
    """Player data of the run of one clip, for the browser that started it."""
    form_values: Mapping[str, Any] = field(default_factory=dict)
    """Values of the form that started the run, by field, as far as others may see them."""
    ended_at: float = field(default_factory=time.time)
    token: str = ""
    clips: dict[str, SavedRun] = field(default_factory=dict)
    """All runs by clip, including this one, if a run has several clips; otherwise empty."""

    @property
    def record(self) -> RunRecord:
        return self.view.record

    @property
    def folder(self) -> Path:
        """Folder of the run, or of the runs of all clips."""
        return self.view.folder.parent if self.clips else self.view.folder

    @property
    def title(self) -> str:
        return runs_title([run.record for run in self.clips.values()] or [self.record])

    def updates(
        self, parts: ResultParts, run_view: RunView | None = None, *, plays_when_ready: bool = False
    ) -> Updates:
        """Return the updates of a tab that opens the run, and plays it if asked to."""
        run_view = run_view or self.view
        record, notes = run_view.record, map(without_cli_options, run_view.record.notes)
        is_done, why = record.state == "done", without_folders(record.message)
        failed = "" if is_done else markup.error_message(without_cli_options(why))
        line = record.message if is_done else text.STOPPED
        if self.clips:
            done = [run for run in self.clips.values() if run.record.state == "done"]
            line = text.CLIPS_DONE.format(done=len(done), count=len(self.clips))
        moving = [(clip, run) for clip, run in self.clips.items() if run.record.is_playable]
        choices = [(clip, run.token) for clip, run in moving]
        return {
            **result_updates(run_view, parts),
            parts.clips: update_html(
                jerk_by_clip_html({clip: run.record for clip, run in self.clips.items()})
            ),
            **(
                {parts.verdict: update_html("")} if self.clips else {}
            ),  # that over all clips is above
            parts.clip: gr.update(choices=choices, value=self.token, visible=bool(choices)),
            parts.status: markup.sentence_status(line),
            parts.message: update_html(failed + markup.collapsed_notes(list(notes))),
            parts.player: run_view.player_value() | {"plays_when_ready": plays_when_ready},
            parts.downloads: update_html(self.downloads_html(run_view)),
        }

    def downloads_html(self, run_view: RunView) -> str:
        """Format the links to the zip, the HTML page and single files."""
        files = [run_view.folder / name for name in self.record.files if "/" not in name]
        files += [self.folder / name for name in READABLE_BATCH_TABLES if self.clips]
        listed = file_list_html(filter(Path.is_file, files), run_view.to_url)
        address = f"{RUN_ROUTE.lstrip('/')}/{self.token}"
        zipped = f'href="{address}" download title="{text.SAVE_RUN_HELP}"'
        page = f'href="{address}/page" download title="{text.SAVE_PAGE_HELP}"'
        saved = f"<a class=bundle {zipped}>{text.SAVE_RUN}</a><a {page}>{text.SAVE_PAGE}</a>"
        note = ""
        if missing := self.record.pending_videos:
            videos = {*missing, *(path.name for path in files if path.suffix == ".mp4")}
            lacks = text.VIDEOS_MISSING.format(missing=len(missing), count=len(videos))
            note = f"<p>{lacks}</p>"
        heading = markup.heading("Downloads")
        return f'{heading}<div class="downloads"><p>{saved}</p>{note}{listed}</div>'


def result_updates(run_view: RunView, parts: ResultParts) -> Updates:
    """Return the updates of player, verdict, metrics and figures of a run, finished or not."""
    record = run_view.record
    files = (existing_file(run_view.folder, name) for name in record.files)
    figures = figures_html(filter(None, files), run_view.to_url, record.figure_captions)
    verdict_html = ""
    if (verdict := record.verdict) is not None:
        verdict_html = markup.verdict(verdict.jerk_sentence, verdict.comparison, jerk_bars(record))
    return {
        parts.player: run_view.player_value(),
        parts.figures: update_html(figures),
        parts.verdict: update_html(verdict_html),
        parts.numbers: update_html(run_metrics_table(record) if record.metrics else ""),
    }


class SavedRuns(TokenStore[SavedRun]):
    """Store of finished runs by token."""

    def __init__(self, keep_s: float) -> None:
        super().__init__()
        self._keep_s = keep_s  # same as for files, only for display

    def add_run(
        self, job: Job, run_views: Mapping[str, RunView], form: Mapping[str, Any] | None = None
    ) -> SavedRun:
        """Store a run, or those of several clips by name; return the first with any motion."""
        by_clip = {clip: SavedRun(job, each, form or {}) for clip, each in run_views.items()}
        for run in by_clip.values():
            run.clips = by_clip if len(by_clip) > 1 else {}
            if job.tab == PLAN_EDITOR_TAB and run.view.original_rows_with_input_plan():
                run.view.set_editor_state()
            run.token = self.keep(run, job.folder, None)
        runs = list(by_clip.values())
        return next((run for run in runs if run.record.is_playable), runs[0])

    def find_editable(self, name: str, cookie: str) -> SavedRun | None:
        """Return the run of a name if this browser may edit its plans, or None."""
        runs = [run for run in self.all() if run.view.name == name and run.view.editor_state]
        mine = (run for run in runs if not run.job.cookie or is_same_cookie(run.job.cookie, cookie))
        return next(mine, None)

    def runs_of(self, cookie: str) -> list[SavedRun]:
        """Return a browser's own runs, the newest first, with one for all clips of a run."""
        firsts = [run for run in self.all() if next(iter(run.clips.values()), run) is run]
        mine = [run for run in firsts if is_same_cookie(run.job.cookie, cookie)]
        return sorted(mine, key=lambda run: run.ended_at, reverse=True)

    def links_html(self, cookie: str, *opened: SavedRun) -> str:
        """Format the link of the opened runs and the list of the browser's own; empty without any.

        app/page/web/runs.js copies the link, limits the selection to two, and formats local times.
        """
        mine, jobs = self.runs_of(cookie), [run.job for run in opened]
        items = "".join(_item(run, run.job in jobs, len(mine) > 1) for run in mine)
        if not opened and not items:
            return ""
        link = ""
        if opened:
            minutes = (min(run.ended_at for run in opened) + self._keep_s - time.time()) / 60
            words = "Link to this run" if len(opened) == 1 else text.PAIR_LINK
            link = (
                f'<p class="link"><a href="{escape(url_of_runs(*opened))}">{words}</a>'
                f'<button type="button">Copy link</button>'
                f"<span>{text.RUN_LINK_HELP.format(minutes=max(1, round(minutes)))}</span></p>"
                f"{_comparison_link(opened, mine)}"
            )
        compare = f'<button>{text.COMPARE}</button><span class="how">{text.COMPARE_HELP}</span>'
        listed = (
            f"<details><summary>Your runs ({len(mine)})</summary>"
            f'<form method="get" target="_blank"><ol>{items}</ol>'
            f"{compare if len(mine) > 1 else ''}</form></details>"
        )
        return f'<div class="runs">{link}{listed if items else ""}</div>'


def add_host_run(saved_runs: SavedRuns, path: Path, temp: Path, media: SharedFolders) -> str:
    """Store the host's run (--open) for every visitor; return its token; may raise RunError."""
    folder = copy_run(path, temp)
    run_views = run_views_in(folder, media.share(folder, ""), temp.name)
    is_made = next(iter(run_views.values())).record.kind == "generated"
    job = Job("", PLAN_EDITOR_TAB if is_made else "own_motion", temp)
    return saved_runs.add_run(job, run_views).token


def url_of_runs(*runs: SavedRun) -> str:
    """Return the URL of one run, or of a comparison of two, relative to the page."""
    return "?" + "&".join(f"{RUN_QUERY_PARAMETER}={run.token}" for run in runs)


def _comparison_link(opened: tuple[SavedRun, ...], mine: list[SavedRun]) -> str:
    """Format the link to a comparison with the previous run, of the same speech if possible."""
    (current, *others) = opened
    before = [run for run in mine if run.ended_at < current.ended_at and run.job is not current.job]
    if others or not before:
        return ""
    speech = current.record.speech_sha256
    same_speech = [run for run in before if speech and run.record.speech_sha256 == speech]
    other = (same_speech or before)[0]
    words = text.COMPARE_LAST if same_speech else text.COMPARE_OTHER
    return (
        f'<p><a href="{escape(url_of_runs(other, current))}" target="_blank" '
        f'title="{escape(other.record.title)}">{words}</a></p>'
    )


def _item(run: SavedRun, is_open: bool, has_checkbox: bool) -> str:
    here = ' aria-current="page"' if is_open else ""
    title = escape(run.title)
    tick = (
        f'<input type="checkbox" name="{RUN_QUERY_PARAMETER}" value="{escape(run.token)}" '
        f'aria-label="{text.COMPARE_THIS.format(title=title)}"{" checked" if is_open else ""}>'
    )
    return (
        f"<li>{tick if has_checkbox else ''}"
        f'<time data-at="{run.ended_at:.0f}"></time>'
        f'<a href="{escape(url_of_runs(run))}"{here}>{title}</a></li>'
    )


def download_route(
    saved_runs: SavedRuns,
    exports: OnDemandFiles,
    ending: str,
    task: Callable[..., object],
    path_suffix: str = "",
) -> APIRoute:
    """Make the route that serves finished runs in one file format.

    ``task`` writes the file; its request is the run's folder and the path of the file.
    """

    async def answer(token: str, request: Request) -> Response:
        run = await run_in_threadpool(saved_runs.find, token)
        if run is None:
            return PlainTextResponse(GONE, status_code=404)
        name = await run_in_threadpool(lambda: file_name(run.title, ending))
        return await exports.answer(task, lambda out: (run.folder, out), name, request)

    return APIRoute(f"{RUN_ROUTE}/{{token}}{path_suffix}", answer, methods=["GET"])


def file_name(title: str, ending: str = ".zip") -> str:
    """Make a file name from the title of a run."""
    stem = re.sub(r"[^\w .,+-]+", "-", title).strip(" .-")[:_MAX_STEM]
    return f"{stem or 'run'}{ending}"
