"""Actions on a run in the viewer: editing its gestures, and rendering videos."""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from pathlib import Path
from typing import Annotated, Any

import gradio as gr
from pydantic import BaseModel, Field, ValidationError

from app import text
from app.errors import Cancelled, RunError, visitor_message, without_cli_options
from app.page.parts import markup
from app.page.parts.markup import PRIVATE_EVENT, Updates, update_html
from app.page.results.result_parts import ResultParts, download_link
from app.page.results.saved_runs import SavedRun
from app.page.routes.media import CHARACTER_GONE
from app.page.tabs.runner import Services, TabRunner, last_fraction, stream_updates
from app.page.visitors.job_folders import Job
from app.page.visitors.visitors import page_session_of
from app.run.callbacks import FolderUpdated, RunEvent
from app.run.display import ViewerState
from app.run.output.run_folder import declare_expected_videos, drop_unfinished_edits
from app.run.plan_edits.edits import MAX_PLAN_CHARACTERS, PlanEditRequest, parse_edits
from app.run.requests.parts import VideoOptions
from app.run.requests.requests import RunVideosRequest, ViewerVideoRequest
from app.run.tasks import DRAW_VIDEOS, DRAW_VIEWER_VIDEO, REGENERATE_EDITED
from conventions.rates import FPS

MAX_MESSAGE_CHARACTERS = MAX_PLAN_CHARACTERS + 100_000
"""Maximum length of an edit request (characters)."""
MAX_NAME = 200


class EditMessage(BaseModel):
    """Request of the plan editor, as written by app/page/web/player/editing.js."""

    run: Annotated[str, Field(max_length=MAX_NAME)]
    source_row: Annotated[str, Field(max_length=MAX_NAME)]
    """Name of the row with the plan to edit."""
    edits: Any = None
    """Edits as for `parse_edits`; an empty list only prepares the row for editing."""

    @classmethod
    def parse(cls, message: object) -> EditMessage:
        """Parse the JSON of the plan editor; raises RunError if it is invalid."""
        try:
            json = (
                message
                if isinstance(message, str) and len(message) <= MAX_MESSAGE_CHARACTERS
                else ""
            )
            return cls.model_validate_json(json)
        except ValidationError as error:
            raise RunError(text.EDITS_DAMAGED) from error


class EditRunner(TabRunner):
    """Runner that generates takes of one tab's runs, with messages in the plan editor."""

    tab, shows_errors_in_tab = "takes", False

    def __init__(self, services: Services, parts: ResultParts) -> None:
        super().__init__(services, parts.player)
        self.parts = parts

    def attach_events(self) -> None:
        """Attach runs to the hidden button of the plan editor."""
        self.start_on(
            self.parts.take_start.click,
            [gr.Textbox(visible=False)],  # which the script fills in
            outputs=[self.parts.player],
            js="() => [document.querySelector('#player .lockstep').edits()]",
            show_progress="hidden",
            trigger_mode="multiple",
        )

    def job_updates(self, job: Job, values: Sequence[Any]) -> Generator[Updates, None, None]:
        message = EditMessage.parse(values[0])
        run = self.services.saved_runs.find_editable(message.run, job.cookie)
        if run is None:
            raise RunError(text.EDITS_GONE)
        job.extra_paths.append(run.job.folder)
        run_view = run.view

        def message_update(sentence: str, **how: Any) -> Updates:
            run_view.set_editor_state(sentence, **how)
            return {self.parts.player: run_view.player_value() | {"plays_when_ready": False}}

        def coming(events: list[RunEvent]) -> Updates:
            if not any(isinstance(event, FolderUpdated) for event in events):
                return {}
            number = max(row.edit.take_number for row in run_view.record.rows if row.edit)
            return message_update(text.TAKE_COMING.format(number=number), is_working=True)

        drop_unfinished_edits(run_view.folder)  # left by closed pages
        yield message_update(
            text.TAKE_BEGINS if message.edits else text.EDITOR_BEGINS, is_working=True
        )
        try:
            wanted = PlanEditRequest(
                run=run_view.folder,
                weights=self.services.config.weights,
                source_row=message.source_row,
                edits=parse_edits(message.edits),
                body=self.services.config.body,
            )
            take = yield from self.run_task(job, REGENERATE_EDITED, wanted, coming)
        except Exception as error:
            drop_unfinished_edits(run_view.folder)
            yield message_update(visitor_message(error), is_refused=True)
            return
        if take.suggestions:
            yield message_update(
                without_cli_options(take.notes[0]), is_refused=True, offers=take.suggestions
            )
            return
        done = (
            text.TAKE_DONE.format(number=take.take_number)
            if take.take_number
            else text.EDITOR_READY
        )
        yield message_update(" ".join((done, *take.notes)))

    def stopped_updates(self, status: str, message: str) -> Updates:
        return {self.parts.player: gr.skip()}


class ViewerVideoRunner(TabRunner):
    """Runner that renders videos of one tab's viewer."""

    tab = "seen"

    def __init__(self, services: Services, parts: ResultParts) -> None:
        super().__init__(services, parts.viewer_video)
        self.parts = parts

    def attach_events(self, prefix: str = "") -> None:
        """Attach runs to the viewer's hidden button; ``prefix`` is that of the element ids."""
        parts = self.parts
        outputs = [parts.viewer_video, parts.viewer_video_cancel]
        run = self.start_on(
            parts.viewer_video_start.click,
            [gr.Textbox(visible=False)],  # which the script fills in
            outputs=outputs,
            js=f"() => [document.querySelector('#{prefix}player .lockstep').viewState()]",
            show_progress_on=parts.status,
        )
        self.cancel_on(parts.viewer_video_cancel, run, outputs)

    def job_updates(self, job: Job, values: Sequence[Any]) -> Generator[Updates, None, None]:
        viewer = ViewerState.parse(values[0])
        sound, body = viewer.sound_url, self.services.config.body
        if viewer.has_character:
            body = self.services.characters.link(job.cookie, job.folder)
            if body is None:
                raise RunError(CHARACTER_GONE)
        request = ViewerVideoRequest(
            viewer=viewer,
            motions=tuple(
                self._file(each.motion_url, job.cookie, ".npz") for each in viewer.bodies
            ),
            out=job.folder / "results",
            speech=self._file(sound, job.cookie, ".wav") if sound else None,
            body=body,
        )
        yield {
            self.parts.viewer_video: update_html(status_line(text.VIEWER_VIDEO_STARTING)),
            self.parts.viewer_video_cancel: gr.update(visible=True),
        }

        def updates_of(events: list[RunEvent]) -> Updates:
            share = last_fraction(events)
            if share is None:
                return {}
            return {
                self.status: update_html(
                    status_line(text.VIEWER_VIDEO_PROGRESS.format(percent=100 * share), share)
                )
            }

        video = yield from self.run_task(job, DRAW_VIEWER_VIDEO, request, updates_of)
        count = len(viewer.visible)
        line = text.VIEWER_VIDEO_DONE.format(
            bodies="one body" if count == 1 else f"{count} bodies",
            seconds=video.num_frames / FPS,
            megabytes=video.path.stat().st_size / 1e6,
        )
        address = self.services.media.share(job.folder, job.cookie)(video.path)
        link = download_link(address, video.path.name, "Save the video")
        yield {
            self.parts.viewer_video: update_html(
                status_line(" ".join((line, *video.notes)), more=link)
            ),
            self.parts.viewer_video_cancel: gr.update(visible=False),
        }

    def _file(self, address: str, cookie: str, suffix: str) -> Path:
        """Return the file of a URL; raises RunError if it no longer exists."""
        path = self.services.media.file_of_url(address, cookie)
        if path is None or path.suffix != suffix:
            raise RunError(text.VIEWER_VIDEO_GONE)
        return path

    def stopped_updates(self, status: str, message: str) -> Updates:
        return {
            self.parts.viewer_video: update_html(message or status),
            self.parts.viewer_video_cancel: gr.update(visible=False),
        }


def status_line(line: str, share: float | None = None, more: str = "") -> str:
    """Format a status line below the viewer, with a progress bar and further HTML."""
    bar = "" if share is None else f'<progress value="{share:.3f}" max="1"></progress>'
    return f'<div class="seen-told" role="status"><p>{escape(line)}</p>{bar}{more}</div>'


@dataclass
class RemainingTime:
    """Estimator of the remaining time from the rate since the first progress.

    The time before, such as the start of a process, is not evidence of the rate.
    """

    first: tuple[float, float] | None = None
    """Fraction and time (s) of the first progress."""

    def suffix(self, share: float, now: float) -> str:
        """Return the estimate at a share (0 to 1) and time (s) as text; empty below a tenth."""
        if self.first is None and share > 0.0:
            self.first = share, now
        done, began = self.first or (share, now)
        if share - done < 0.1 or now <= began:
            return ""
        seconds = (now - began) * (1.0 - share) / (share - done)
        if seconds >= 100.0:
            return f", ready in about {seconds / 60.0:.0f} min"
        return f", ready in about {5 * max(1, round(seconds / 5.0))} s"


class BackgroundVideos:
    """Background rendering, with low priority, of the videos of each visitor's newest run."""

    def __init__(self, services: Services, parts: ResultParts, tab: str) -> None:
        self.services = services
        self.parts = parts
        self._tab = f"{tab} videos"
        self._wanted: dict[str, tuple[SavedRun, VideoOptions]] = {}

    def request_videos(self, run: SavedRun, video: VideoOptions) -> None:
        """Request the videos of a run, which start with the next event of its visitor's page."""
        declare_expected_videos(run.view.folder, video.views)
        wanted = {who: each for who, each in self._wanted.items() if each[0].folder.exists()}
        self._wanted = wanted | {run.job.page_session: (run, video)}

    def cancel_videos(self, page_session: str) -> None:
        """Cancel the videos of a visitor's previous run."""
        self._wanted.pop(page_session, None)
        self.services.jobs.cancel(page_session, self._tab)

    def on_page_closed(self, request: gr.Request) -> None:
        """Cancel the videos when the visitor has closed the page."""
        self.cancel_videos(page_session_of(request))

    def attach_to(self, run: Any) -> None:
        """Attach the rendering of videos to the end of each run of an event."""
        parts = self.parts
        run.then(
            self.run,
            outputs=[parts.status, parts.player, parts.downloads],
            **PRIVATE_EVENT,
            trigger_mode="multiple",
            concurrency_id="videos",
            concurrency_limit=1,
        )

    def run(self, request: gr.Request) -> Iterator[Updates]:
        """Yield updates while requested videos of the visitor's last run are rendered."""
        page_session = page_session_of(request)
        wanted = self._wanted.pop(page_session, None)
        if wanted is None:
            yield {self.parts.status: gr.skip()}  # without any update, Gradio clears all outputs
            return
        run, video = wanted
        try:
            jobs = self.services.jobs
            with jobs.open_job(page_session, self._tab, owner=jobs.quota.owner_of(request)) as job:
                job.extra_paths.append(run.job.folder)  # the videos are added to it
                yield from self._drawn(job, run, video)
        except Cancelled:
            return  # replaced by another run of the visitor
        except Exception as error:  # the finished run stays, with the error
            yield self._line(run, f"The videos could not be rendered: {visitor_message(error)}")

    def _drawn(self, job: Job, run: SavedRun, video: VideoOptions) -> Iterator[Updates]:
        remaining = RemainingTime()

        def updates_of(events: list[RunEvent]) -> Updates:
            updates: Updates = {}
            if any(isinstance(event, FolderUpdated) for event in events):
                updates[self.parts.player] = run.view.player_value()
                updates[self.parts.downloads] = update_html(run.downloads_html(run.view))
            share = last_fraction(events)
            if share is not None:
                when = remaining.suffix(share, time.monotonic())
                drawn = f"Rendering videos in the background: {100 * share:.0f} %{when}."
                updates |= self._line(run, drawn)
            return updates

        request = RunVideosRequest(run=run.view.folder, out=job.folder / "drawn", video=video)
        do = partial(self.services.video_worker.do, DRAW_VIDEOS, request)
        yield from stream_updates(do, job, updates_of, {self.parts.status: gr.skip()})
        downloads = update_html(run.downloads_html(run.view))
        yield {self.parts.downloads: downloads, **self._line(run, text.VIDEOS_DONE)}

    def _line(self, run: SavedRun, sentence: str) -> Updates:
        """Append a sentence to the run's final status message."""
        line = markup.sentence_status(f"{run.record.message} {sentence}")
        return {self.parts.status: line}
