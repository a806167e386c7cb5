"""Services that all tabs share, and runners, which turn a click into updates of the page."""

from __future__ import annotations

import logging
import queue
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import gradio as gr

from app import text
from app.config import AppConfig
from app.errors import Cancelled, RunError, visitor_message
from app.live.sessions import LiveSessions
from app.page.parts import markup
from app.page.parts.catalogue import Catalogue
from app.page.parts.form_values import Fields, with_named_parameters
from app.page.parts.markup import PRIVATE_EVENT, UNQUEUED_EVENT, Updates, update_html
from app.page.results.saved_runs import SavedRuns
from app.page.routes.media import SharedFolders
from app.page.visitors.characters import Characters
from app.page.visitors.job_folders import Job, Jobs
from app.page.visitors.visitors import CHECKS, RUNS, TokenStore, cookie_of, page_session_of
from app.page.worker import Task, Worker
from app.run.callbacks import FolderUpdated, RunCallbacks, RunEvent, StageProgress
from app.run.display import Display
from app.run.requests.convert import accepted_field_names, request_from
from app.run.upload_check import Upload, UploadKind, rejection_reason
from conventions.views import CLOSE_UPS

log = logging.getLogger(__name__)
Request = TypeVar("Request")
PAGE_VIDEO_OPTIONS: dict[str, Any] = {
    "display": Display(has_trail=True),
    "close_ups": CLOSE_UPS,
    "picture_height_px": 640,
}
"""Video options of all runs of the page; the player has every close-up, and shows a selection."""


def request_with_page_settings(
    request_type: type[Request], values: Mapping[str, Any], config: AppConfig, job: Path
) -> Request:
    """Make a request from a form's values and the settings of this page."""
    own = {
        "out": job / "results",
        "weights": config.weights,
        "body": config.body,
        "max_speech_s": config.max_speech_s,
        "figure_formats": ("png",),
    }
    names = accepted_field_names(request_type)
    return request_from(request_type, {key: own[key] for key in own if key in names} | dict(values))


@dataclass(frozen=True)
class Services:
    """Services of one page."""

    config: AppConfig
    catalogue: Catalogue
    jobs: Jobs
    worker: Worker
    """Worker of all runs."""
    video_worker: Worker
    """Worker of videos in the background."""
    upload_worker: Worker
    """Worker that checks uploads, so that no check waits for a run."""
    saved_runs: SavedRuns
    live: LiveSessions
    characters: Characters
    """Characters of visitors."""
    media: SharedFolders = field(default_factory=SharedFolders)
    private_files: TokenStore[Path] = field(default_factory=TokenStore)
    """Folders of researchers' parts that have not been fetched yet."""
    example_player_value: dict[str, Any] | None = None
    """Player's value of the example before the first run."""
    opened_run_tokens: tuple[str, ...] = ()
    """Tokens of the run that the page was started to show."""

    def config_with_character(self, job: Job) -> AppConfig:
        """Return the settings of this page with the visitor's character, if there is one."""
        body = self.characters.link(job.cookie, job.folder) or self.config.body
        return replace(self.config, body=body)

    def file_field(
        self, kind: UploadKind, label: str, file_types: list[str], elem_id: str, **options: Any
    ) -> gr.File:
        """Make a watched file field; ``options`` are those of `gr.File`."""
        field = gr.File(
            label=label, file_types=file_types, type="filepath", elem_id=elem_id, **options
        )
        self.attach_upload_check(field, kind)
        return field

    def attach_upload_check(self, field: gr.Audio | gr.File, kind: UploadKind) -> None:
        """Check files put into a field, and show errors below it; call this right after it."""
        refusal = gr.HTML("", visible=False, elem_id=f"{field.elem_id}-refusal")
        field.change(
            lambda value: update_html(markup.upload_error(self._refusal(kind, value))),
            field,
            refusal,
            **PRIVATE_EVENT,
            concurrency_id=CHECKS,
            concurrency_limit=1,
        )

    def _refusal(self, kind: UploadKind, value: str | list[str] | None) -> str:
        checked_paths = [value] if isinstance(value, str) else value or ()
        paths = [Path(path) for path in dict.fromkeys(checked_paths)]  # without duplicates
        try:
            checked_paths = Upload(kind, paths, self.config.max_speech_s)
            sentence = self.upload_worker.do(rejection_reason, checked_paths) if paths else ""
        except Exception as error:  # the check itself failed or timed out
            log.warning("an upload could not be checked: %s", error)
            return ""
        return visitor_message(RunError(sentence)) if sentence else ""


RequestT = TypeVar("RequestT")
ResultT = TypeVar("ResultT")
_REFRESH_S = 0.25
_SOON_S = 0.05
EventsToUpdates = Callable[[list[RunEvent]], Updates]
"""Function from a batch of events to updates; empty ones leave the tab unchanged."""


def stream_updates(
    do: Callable[[RunCallbacks], ResultT], job: Job, to_updates: EventsToUpdates, unchanged: Updates
) -> Generator[Updates, None, ResultT]:
    """Do a run in a thread, and yield updates several times a second until its end.

    Returns the result, or raises the run's exception. Closing the generator, as Gradio does when
    the visitor has cancelled or gone, cancels the run with its job.
    """
    events: queue.SimpleQueue[RunEvent | None] = queue.SimpleQueue()
    outcome: dict[str, Any] = {}

    def run() -> None:
        try:
            outcome["result"] = do(RunCallbacks(events.put, job.is_cancelled))
        except BaseException as error:
            outcome["error"] = error
        finally:
            events.put(None)

    thread = threading.Thread(target=run, name="run", daemon=True)
    thread.start()
    has_ended = False
    while not has_ended:
        batch, has_ended = _batch(events)
        yield to_updates(batch) or unchanged
    thread.join()
    if "error" in outcome:
        raise outcome["error"]
    return outcome["result"]


def _batch(events: queue.SimpleQueue[RunEvent | None]) -> tuple[list[RunEvent], bool]:
    """Return the events of a quarter of a second, and whether the run has ended."""
    batch: list[RunEvent] = []
    deadline = time.monotonic() + _REFRESH_S
    while (left := deadline - time.monotonic()) > 0:
        try:
            event = events.get(timeout=left)
        except queue.Empty:
            break
        if event is None:
            return batch, True
        batch.append(event)
        if isinstance(event, FolderUpdated):  # the visitor waits for motion
            deadline = min(deadline, time.monotonic() + _SOON_S)
    return batch, False


def last_fraction(events: Sequence[RunEvent]) -> float | None:
    """Return the fraction done of a run with one stage; None without any progress event."""
    shares = [event.fraction for event in events if isinstance(event, StageProgress)]
    return shares[-1] if shares else None


class TabRunner(ABC):
    """Runner of a tab's tasks, each a queued click that becomes a run with updates of the tab."""

    tab: ClassVar[str]
    shows_errors_in_tab: ClassVar[bool] = True
    """True if the tab itself shows the reason for a failure."""
    survives_disconnect: ClassVar[bool] = False
    """True if a run is listed among the visitor's runs, and continues when its page disconnects."""

    def __init__(self, services: Services, status: gr.HTML) -> None:
        self.services = services
        self.status = status
        self._unfinished: set[str] = set()
        """Visitors with an unfinished run in their tab."""

    def start_on(
        self, event: Callable[..., Any], fields: Fields | Sequence[Any], **how: Any
    ) -> Any:
        """Attach queued runs to an event, such as ``button.click``, and return Gradio's dependency.

        ``fields`` are those of a form that is also part of the API, or components.
        """
        run: Any = self.run
        if isinstance(fields, Mapping):
            run, fields = with_named_parameters(run, fields), [*fields.values()]
        if "api_name" not in how:
            how["api_visibility"] = "private"
        # Runs of all visitors are queued; the status shows the place in the queue. Another click of
        # the same button is ignored.
        usual = {"show_progress": "minimal", "show_progress_on": self.status}
        usual |= {"trigger_mode": "once", "concurrency_id": RUNS}
        return event(run, fields, **{**usual, **how})

    def cancel_on(self, button: gr.Button, runs: Any, outputs: Sequence[Any]) -> Any:
        """Cancel runs with a button, and return Gradio's dependency."""
        return button.click(self.cancel, outputs=outputs, cancels=runs, **UNQUEUED_EVENT)

    def start_and_cancel_on(
        self,
        start: gr.Button,
        cancel: gr.Button,
        fields: Fields | Sequence[Any],
        outputs: Sequence[Any],
        **how: Any,
    ) -> None:
        """Attach runs to two buttons, of which the second is visible only during a run."""
        start.click(lambda: gr.update(visible=True), outputs=cancel, **UNQUEUED_EVENT)
        run = self.start_on(start.click, fields, outputs=outputs, **how)
        for ended in (run, self.cancel_on(cancel, run, outputs)):
            ended.then(lambda: gr.update(visible=False), outputs=cancel, **UNQUEUED_EVENT)

    def run(self, request: gr.Request, *values: Any) -> Iterator[Updates]:
        """Yield updates of the tab during the run of one visitor.

        Raises:
            gr.Error: if the run fails, with the sentence that the tab shows too.
        """
        cookie, page_session = cookie_of(request), page_session_of(request)
        jobs = self.services.jobs
        try:
            with (
                jobs.open_job(
                    page_session,
                    self.tab,
                    cookie,
                    values,
                    owner=jobs.quota.owner_of(request),
                    survives_disconnect=self.survives_disconnect and bool(cookie),
                ) as job,
                closing(self.job_updates(job, values)) as steps,
            ):
                blank = next(steps)
                self._unfinished.add(page_session)
                yield blank
                for update in steps:
                    if job.is_cancelled():
                        raise Cancelled  # drop the pending update
                    yield update
            self._unfinished.discard(page_session)
        except Cancelled:
            self._unfinished.discard(page_session)
            yield self.stopped_updates(markup.sentence_status(text.CANCELLED), "")
        except Exception as error:
            self._unfinished.discard(page_session)
            sentence = visitor_message(error)
            yield self.stopped_updates(
                markup.sentence_status(text.STOPPED), markup.error_message(sentence)
            )
            # Otherwise only for API clients, as the tab shows it already.
            visible = not self.shows_errors_in_tab
            raise gr.Error(sentence, visible=visible, print_exception=False) from error

    def cancel(self, request: gr.Request) -> Updates:
        """Cancel the visitor's run; Gradio takes it out of the queue, or closes the generator."""
        page_session = page_session_of(request)
        self.services.jobs.cancel(page_session, self.tab)
        if page_session not in self._unfinished:
            return self.idle_updates()
        self._unfinished.discard(page_session)
        return self.stopped_updates(markup.sentence_status(text.CANCELLED), "")

    def idle_updates(self) -> Updates:
        """Return the updates of a tab after cancelling a run before its start."""
        return {self.status: gr.skip()}

    @abstractmethod
    def job_updates(self, job: Job, values: Sequence[Any]) -> Generator[Updates, None, None]:
        """Yield the updates of a run, the first as it starts; raises RunError before that."""

    @abstractmethod
    def stopped_updates(self, status: str, message: str) -> Updates:
        """Return the updates after a cancelled or failed run, with status and message as HTML."""

    def run_task(
        self,
        job: Job,
        task: Task[RequestT, ResultT],
        request: RequestT,
        to_updates: EventsToUpdates | str = "",
    ) -> Generator[Updates, None, ResultT]:
        """Run a task in the worker; ``to_updates`` may be the status as text with a ``percent``."""
        return self.run_with_updates(
            job, partial(self.services.worker.do, task, request), to_updates
        )

    def run_with_updates(
        self, job: Job, do: Callable[[RunCallbacks], ResultT], to_updates: EventsToUpdates | str
    ) -> Generator[Updates, None, ResultT]:
        def line(events: list[RunEvent]) -> Updates:
            share = last_fraction(events) if to_updates else None
            if share is None:
                return {}
            sentence = str(to_updates).format(percent=100 * share)
            return {self.status: markup.sentence_status(sentence)}

        function = line if isinstance(to_updates, str) else to_updates
        return stream_updates(do, job, function, {self.status: gr.skip()})
