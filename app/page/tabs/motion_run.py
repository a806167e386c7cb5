"""Runs of the tab "Motion" as updates of the page, and the opening of the page."""

from __future__ import annotations

import shutil
import time
from abc import abstractmethod
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import gradio as gr

from app import text
from app.errors import Cancelled, visitor_message
from app.page.parts import markup
from app.page.parts.form_values import Fields, parse_form_values
from app.page.parts.markup import UNQUEUED_EVENT, Updates, scroll_to_on_click, update_html
from app.page.results.result_parts import ResultParts
from app.page.results.run_comparison import comparison_updates
from app.page.results.run_view import EMPTY_PLAYER_VALUE, run_views_in
from app.page.results.saved_runs import RUN_QUERY_PARAMETER, SavedRun, result_updates
from app.page.results.tables import jerk_by_clip_html
from app.page.tabs.motion import FormParts, request_from_form, save_form_values
from app.page.tabs.runner import Services, TabRunner
from app.page.tabs.stage import BackgroundVideos
from app.page.visitors.job_folders import Job
from app.page.visitors.visitors import cookie_of, is_same_cookie, page_session_of
from app.run.batch.saved_run import UNPACKED_ZIP_FOLDER, run_page_request
from app.run.callbacks import FolderUpdated, RunCallbacks, RunEvent, RunStage, StageProgress
from app.run.output.run_folder import mark_run_failed
from app.run.requests.convert import replace_fields
from app.run.requests.requests import AnyRun, GenerateRequest

STAGES_WITHOUT_VIDEO: tuple[RunStage, ...] = ("speech", "motion", "numbers", "figure")
"""Stages that a run shows; videos are rendered in the background."""


@dataclass
class RunProgress:
    """Progress of a run by stage, formatted as a status line with bars."""

    stages: Sequence[RunStage] = STAGES_WITHOUT_VIDEO
    started: float = field(default_factory=time.monotonic)
    fractions: dict[RunStage, float] = field(default_factory=dict)
    details: dict[RunStage, str] = field(default_factory=dict)
    clips_text: str = ""
    """Number of clips, if there are several."""

    def updated_html(self, events: Sequence[RunEvent]) -> str:
        """Update the progress with events, and format it as HTML."""
        for event in events:
            if isinstance(event, StageProgress):
                self.clips_text = event.clips_text
                self.fractions[event.stage] = event.fraction
                self.details[event.stage] = event.detail
        return markup.run_status(self.line, self.fractions, self.details, self.stages)

    @property
    def line(self) -> str:
        if not self.fractions:
            return text.STARTING_SYSTEMS
        doing = [stage for stage, fraction in self.fractions.items() if fraction < 1]
        stage = (doing or list(self.fractions))[-1]  # between two stages, the previous one
        seconds = time.monotonic() - self.started
        of_clip = f"{self.clips_text}: " if self.clips_text else ""
        return f"{of_clip}{text.STAGE_NAMES[stage]} ({seconds:.0f} s so far)"


class MotionRunner(TabRunner):
    """Runner of generated or imported motion, with results in a tab."""

    survives_disconnect = True

    def __init__(self, services: Services, form: FormParts, parts: ResultParts) -> None:
        super().__init__(services, parts.status)
        self.videos = BackgroundVideos(services, parts, self.tab)
        self.form = form
        self.parts = parts
        self.outputs: list[Any] = [*parts.all, form.start, form.cancel]
        self._waiting: set[str] = set()
        """Visitors with a click and no started run."""

    def attach_events(
        self,
        page: gr.Blocks,
        fields: Fields | Sequence[Any],
        also: Sequence[Callable[..., Any]] = (),
        **how: Any,
    ) -> None:
        """Attach runs to the form's buttons, and to other events."""
        form = self.form
        scroll_to_on_click(form.start, self.status)
        # Listeners of a click run in order: this one before the run.
        waits = [self.status, form.start, form.cancel]
        form.start.click(self.waiting_updates, outputs=waits, **UNQUEUED_EVENT)
        # The button is enabled while figures are drawn; its next run is queued behind them.
        begun = [self.start_after(form.start.click, fields, trigger_mode="multiple", **how)]
        begun[0].failure(
            self.reset_updates_on_failure, outputs=waits, **UNQUEUED_EVENT
        )  # also if the queue is full
        begun += [self.start_after(event, [*form.fields.values()]) for event in also]
        self.cancel_on(form.cancel, begun, self.outputs)
        page.unload(self.videos.on_page_closed)

    def start_after(self, event: Any, fields: Fields | Sequence[Any], **how: Any) -> Any:
        """Attach a run to an event, followed by the rendering of videos in the background."""
        run = self.start_on(event, fields, outputs=self.outputs, **how)
        self.videos.attach_to(run)
        return run

    @abstractmethod
    def make_request(self, job: Job, values: Sequence[Any]) -> AnyRun:
        """Return the request of a form; raises RunError if it is invalid."""

    def run(self, request: gr.Request, *values: Any) -> Iterator[Updates]:
        self._waiting.discard(page_session_of(request))
        yield from super().run(request, *values)

    def job_updates(self, job: Job, values: Sequence[Any]) -> Generator[Updates, None, None]:
        request = self.make_request(job, values)
        self.videos.cancel_videos(job.page_session)
        fields = self.form.fields
        form = save_form_values(fields, values, job.folder) if "speech" in fields else {}
        yield self.start_updates()
        yield from self.perform(job, request, form)

    def perform(
        self, job: Job, request: AnyRun, form: Mapping[str, Any]
    ) -> Generator[Updates, None, None]:
        """Run a request, and yield updates; a failed run is shown if it has left any motion.

        Raises:
            Exception: from a run that has left nothing.
        """
        services, parts = self.services, self.parts
        to_url = services.media.share(job.folder, job.cookie)
        run_views = partial(
            run_views_in, request.output.out, to_url, job.folder.name, request.output.has_video
        )
        line = RunProgress(
            [
                each
                for each in STAGES_WITHOUT_VIDEO
                if isinstance(request, GenerateRequest) or each != "motion"
            ]
        )
        so_far: Updates = {}

        def updates_of(events: list[RunEvent]) -> Updates:
            updates: Updates = {parts.status: line.updated_html(events)}
            if any(isinstance(event, FolderUpdated) for event in events):
                begun = run_views()
                moving = [each for each in begun.values() if each.record.is_playable]
                updates |= result_updates(moving[0], parts) if moving else {}
                records = {clip: each.record for clip, each in begun.items()}
                updates[parts.clips] = update_html(jerk_by_clip_html(records))
                if len(records) > 1:
                    updates[parts.verdict] = update_html("")
                if [*records] == [""] and records[""].metrics:  # figures do not need the form
                    updates[self.form.start] = gr.update(interactive=True)
            new = {part: each for part, each in updates.items() if so_far.get(part) != each}
            so_far.update(new)
            return new

        try:
            without_video = replace_fields(request, has_video=False, is_incremental=True)

            def do(callbacks: RunCallbacks) -> None:
                try:
                    services.worker.do(run_page_request, without_video, callbacks)
                finally:  # after the end of its process, maybe later than that of the generator
                    opened = request.output.out.with_name(UNPACKED_ZIP_FOLDER)
                    shutil.rmtree(opened, ignore_errors=True)

            yield from self.run_with_updates(job, do, updates_of)
        except Cancelled:
            raise
        except Exception as error:
            begun, sentence = run_views().values(), visitor_message(error)
            undone = [each.folder for each in begun if each.record.state != "done"]
            has_left = [mark_run_failed(folder, sentence) for folder in undone]
            if not any(has_left) and len(undone) == len(begun):
                raise
        saved = services.saved_runs.add_run(job, run_views(), form)
        if request.output.has_video and saved.record.state == "done" and not saved.clips:
            self.videos.request_videos(saved, request.video)
        yield {
            **saved.updates(parts, plays_when_ready=True),
            parts.runs: update_html(services.saved_runs.links_html(job.cookie, saved)),
            **self.button_updates(is_running=job.page_session in self._waiting),
        }

    def start_updates(self) -> Updates:
        return {
            **self.stopped_updates(markup.sentence_status(text.STARTING_SYSTEMS), ""),
            self.parts.runs: update_html(""),
            **self.button_updates(is_running=True),
        }

    def stopped_updates(self, status: str, message: str) -> Updates:
        return {
            **self._without_results(),
            self.parts.status: status,
            self.parts.message: update_html(message),
            **self.button_updates(is_running=False),
        }

    def _without_results(self) -> Updates:
        parts = self.parts
        outputs = (parts.clips, parts.verdict, parts.viewer_video, parts.figures, parts.numbers)
        hidden = {parts.player: EMPTY_PLAYER_VALUE, parts.clip: gr.update(visible=False)}
        return {**hidden, **{part: update_html("") for part in (*outputs, parts.downloads)}}

    def waiting_updates(self, request: gr.Request) -> Updates:
        """Show that the run waits for its turn."""
        self._waiting.add(page_session_of(request))
        line = markup.sentence_status("Waiting in the queue.")
        return {self.status: line, **self.button_updates(is_running=True)}

    def reset_updates_on_failure(self, request: gr.Request) -> Updates:
        """Release the buttons after a failed run, and the status if the queue was full."""
        page_session = page_session_of(request)
        if page_session not in self._waiting:
            return self.button_updates(is_running=False)
        self._waiting.discard(page_session)
        return self.idle_updates()

    def cancel(self, request: gr.Request) -> Updates:
        self._waiting.discard(page_session_of(request))
        return super().cancel(request)

    def idle_updates(self) -> Updates:
        ready = markup.idle_status(text.READY)
        return {self.status: ready, **self.button_updates(is_running=False)}

    def button_updates(self, is_running: bool) -> Updates:
        return {
            self.form.start: gr.update(interactive=not is_running),
            self.form.cancel: gr.update(visible=is_running),
        }


class GenerateRunner(MotionRunner):
    """Runner that generates motion for a visitor's speech."""

    tab = "generate"

    def make_request(self, job: Job, values: Sequence[Any]) -> AnyRun:
        services = self.services
        form_values = parse_form_values(GenerateRequest, self.form.fields, values)
        return request_from_form(
            form_values, job.folder, services.catalogue, services.config_with_character(job)
        )


class PageLoader:
    """Updates of a page that opens, with the run of a link or a comparison."""

    def __init__(
        self, services: Services, tabs: gr.Tabs, places: Mapping[str, ResultParts], form: Fields
    ) -> None:
        """Configure the updates.

        Args:
            places: result components by tab; runs of other tabs are shown in the first.
            form: fields of the first tab, filled in with the values of an opened run.
        """
        self.services = services
        self._saved_runs = services.saved_runs
        self._tabs = tabs
        self._places = places
        self.form = form

    @property
    def outputs(self) -> list[Any]:
        parts = [part for parts in self._places.values() for part in parts.all]
        return [self._tabs, *parts, *self.form.values()]

    def on_load(self, request: gr.Request) -> Updates:
        cookie = cookie_of(request)
        listed = self._saved_runs.links_html(cookie)  # but an update each: Gradio modifies them
        updates: Updates = {parts.runs: update_html(listed) for parts in self._places.values()}
        tokens = (
            request.query_params.getlist(RUN_QUERY_PARAMETER)[:2] or self.services.opened_run_tokens
        )
        runs = [run for run in map(self._saved_runs.find, tokens) if run is not None]
        if len(runs) == 2 and runs[0] != runs[1]:
            return {**updates, **self._pair_opened(runs, cookie)}
        if runs and len(tokens) == len(runs):
            return {**updates, **self._run_opened(runs[0], cookie)}
        parts = next(iter(self._places.values()))
        if tokens:
            gone = text.RUN_GONE.format(minutes=round(self.services.config.result_lifetime_s / 60))
            updates[parts.message] = update_html(markup.note(gone))
        return updates

    def _pair_opened(self, runs: Sequence[SavedRun], cookie: str) -> Updates:
        parts = next(iter(self._places.values()))
        a, b = sorted(runs, key=lambda run: run.ended_at)
        return {
            **comparison_updates(a, b, parts, self.services.media, cookie),
            parts.runs: update_html(self._saved_runs.links_html(cookie, a, b)),
        }

    def attach_clip_choice(self, parts: ResultParts) -> None:
        """Attach the selection of another clip of an opened run."""

        def choose(token: str, request: gr.Request) -> Updates:
            run = self._saved_runs.find(token)
            return (
                self._open_run(run, parts, cookie_of(request)) if run else {parts.clip: gr.skip()}
            )

        parts.clip.input(choose, parts.clip, parts.all, **UNQUEUED_EVENT)

    def _run_opened(self, run: SavedRun, cookie: str) -> Updates:
        tab = run.job.tab if run.job.tab in self._places else next(iter(self._places))
        return {
            **self._open_run(run, self._places[tab], cookie),
            **{self.form[name]: gr.update(value=sent) for name, sent in run.form_values.items()},
            self._tabs: gr.Tabs(selected=tab),
        }

    def _open_run(self, run: SavedRun, parts: ResultParts, cookie: str) -> Updates:
        run_view = run.view
        is_own = is_same_cookie(run.job.cookie, cookie)
        if run.job.page_session and not is_own:  # without one: public
            run_view = run_view.read_only_copy(self.services.media.share(run.folder, cookie))
        return {
            **run.updates(parts, run_view),
            parts.runs: update_html(self._saved_runs.links_html(cookie, run)),
        }
