"""Videos of a run that has ended: of what the stage shows, and the standard ones, drawn last."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.errors import CancelledRun, RunError, visitor_sentence
from app.page.parts import markup
from app.page.parts.html_parts import AT_ONCE, PRIVATE, in_turn, shown
from app.page.queue.jobs import Job, Tab
from app.page.queue.runner import TabRunner, Updates, follow, last_share
from app.page.results.kept_runs import KeptRun
from app.page.results.result_parts import ResultParts
from app.page.routes.media import MEDIA_ROUTE, MediaAddresses
from app.page.tabs.services import Services
from app.page.visitors.visitors import visitor_of
from app.run.requests.request import Ask, Event, Grown, OnEvent, ShouldCancel
from app.run.videos.seen_video import Seen, SeenRequest, SeenVideo, draw_seen
from app.run.videos.videos import draw_behind

DrawSeen = Callable[[SeenRequest, OnEvent, ShouldCancel], SeenVideo]
"""As `app.run.videos.seen_video.draw_seen`."""


class SeenRunner(TabRunner[SeenVideo]):
    """Makes videos of one tab's stage."""

    tab = "seen"

    def __init__(self, services: Services, parts: ResultParts) -> None:
        super().__init__(services.jobs, parts.seen)
        self._services = services
        self._parts = parts

    def wire(self, prefix: str = "") -> None:
        """Have the stage's button start it.

        Args:
            prefix: of the ids of the tab's parts, with its hyphen.
        """
        parts = self._parts
        run = parts.seen_start.click(
            self.run,
            inputs=[parts.seen_asked],
            outputs=[parts.seen, parts.seen_cancel],
            js=f"() => [document.querySelector('#{prefix}player .lockstep').seen()]",
            api_visibility="private",
            **in_turn(parts.status),
        )
        outputs = [parts.seen, parts.seen_cancel]
        parts.seen_cancel.click(self.cancel, outputs=outputs, cancels=run, **AT_ONCE)

    @contextmanager
    def begin(self, job: Job, cookie: str, values: tuple[Any, ...]) -> Iterator[_SeenWork]:
        seen = Seen.read(values[0])
        request = SeenRequest(
            seen,
            tuple(self._file(body.motion, cookie, ".npz") for body in seen.bodies),
            out=job.folder / "results",
            speech=self._file(seen.sound, cookie, ".wav") if seen.sound else None,
            body=self._services.config.body,
        )
        draw = partial(self._services.worker.do, draw_seen)
        yield _SeenWork(draw, request, self._parts, self._services.addresses, cookie)

    def _file(self, address: str, cookie: str, suffix: str) -> Path:
        """What the page has given an address.

        Raises:
            RunError: if it has not, or it is kept no longer.
        """
        route, _, token = address.partition("/")
        is_ours = route == MEDIA_ROUTE.strip("/")
        path = self._services.addresses.find(token, cookie) if is_ours else None
        if path is None or path.suffix != suffix:
            raise RunError(text.SEEN_GONE)
        return path

    def blank(self) -> Updates:
        return {
            self._parts.seen: shown(told(text.SEEN_STARTING)),
            self._parts.seen_cancel: gr.update(visible=True),
        }

    def stopped(self, status: str, message: str) -> Updates:
        return {
            self._parts.seen: shown(message or status),
            self._parts.seen_cancel: gr.update(visible=False),
        }


@dataclass
class _SeenWork:
    """One video."""

    draw: DrawSeen
    asked: SeenRequest
    parts: ResultParts
    addresses: MediaAddresses
    cookie: str
    share: float = field(default=0.0)

    def run(self, on_event: OnEvent, should_cancel: ShouldCancel) -> SeenVideo:
        return self.draw(self.asked, on_event, should_cancel)

    def progress(self, events: list[Event]) -> Updates:
        share = last_share(events)
        if share is None:
            return {}
        line = text.SEEN_COMING.format(share=share)
        return {self.parts.seen: shown(told(line, share))}

    def finished(self, result: SeenVideo) -> Updates:
        from conventions.rates import FPS

        count = len(self.asked.seen.shown)
        line = text.SEEN_DONE.format(
            bodies="one body" if count == 1 else f"{count} bodies",
            seconds=result.num_frames / FPS,
            megabytes=result.path.stat().st_size / 1e6,
        )
        address = escape(self.addresses.address(result.path, self.cookie))
        link = f'<a href="{address}" download="{escape(result.path.name)}">{text.SEEN_SAVE}</a>'
        return {
            self.parts.seen: shown(told(" ".join((line, *result.notes)), more=link)),
            self.parts.seen_cancel: gr.update(visible=False),
        }


def told(line: str, share: float | None = None, more: str = "") -> str:
    """One line under the stage.

    Args:
        share: of the work done, where that is known.
        more: HTML behind it.
    """
    bar = "" if share is None else f'<progress value="{share:.3f}" max="1"></progress>'
    return f'<div class="seen-told" role="status"><p>{escape(line)}</p>{bar}{more}</div>'


@dataclass(frozen=True)
class Wanted:
    """What is to be drawn of a run, and what was said when that had ended."""

    kept: KeptRun
    ask: Ask
    """Of that."""


_PATIENCE_S = 1.0
"""Between two looks at whether the visitor is still there."""


class VideosBehind:
    """Draws what a tab's runs have left to be drawn, one visitor's newest run at a time, while
    nobody waits for a run; it gives way to one by being ended, and begins anew."""

    def __init__(self, services: Services, parts: ResultParts, tab: Tab) -> None:
        """
        Args:
            tab: that of the videos.
        """
        self._services = services
        self._jobs = services.jobs
        self._parts = parts
        self._tab: Tab = tab
        self._wanted: dict[str, Wanted] = {}
        self._lock = threading.Lock()

    def want(self, visitor: str, wanted: Wanted) -> None:
        """Have these drawn as soon as the page asks."""
        with self._lock:
            there = {who: each for who, each in self._wanted.items() if each.kept.is_there}
            self._wanted = {**there, visitor: wanted}  # some left before they asked

    def give_up(self, visitor: str) -> None:
        """Another run begins: nobody wants the videos of the one before any more."""
        with self._lock:
            self._wanted.pop(visitor, None)
        self._jobs.cancel(visitor, self._tab)

    def left(self, request: gr.Request) -> None:
        """The visitor has closed the page."""
        self.give_up(visitor_of(request))

    def follow(self, run: Any) -> None:
        """Draw after each run of a button's, whose event is ``run``."""
        run.then(
            self.run,
            outputs=self._outputs,
            **PRIVATE,
            trigger_mode="multiple",
            concurrency_id="videos",
            concurrency_limit=1,
        )

    @property
    def _outputs(self) -> list[Any]:
        parts = self._parts
        return [parts.status, parts.player, parts.downloads_part, parts.bundle, parts.files]

    def run(self, request: gr.Request) -> Iterator[Updates]:
        """Updates of the tab while videos of the visitor's last run are drawn, if it wants any."""
        visitor = visitor_of(request)
        with self._lock:
            wanted = self._wanted.pop(visitor, None)
        if wanted is None:
            yield {self._parts.status: gr.skip()}  # of one that gives nothing Gradio empties all
            return
        try:
            with self._jobs.opened(visitor, self._tab) as job:
                yield from self._drawn(job, wanted)
        except CancelledRun:
            return  # another run of the visitor has begun, and shows itself
        except Exception as error:  # whatever it is, the run that has ended stays and says so
            sentence = text.VIDEOS_FAILED.format(why=visitor_sentence(error))
            yield {self._parts.status: _line(wanted, sentence)}

    def _drawn(self, job: Job, wanted: Wanted) -> Iterator[Updates]:
        run, out = wanted.kept.showing.folder, job.folder / "drawn"
        request = replace(wanted.ask, motions=(run,), out=out)
        work = _StandardWork(self._services, wanted, request, self._parts)
        while True:
            while not self._jobs.wait_for_rest(_PATIENCE_S):
                if job.is_cancelled():
                    raise CancelledRun
                yield {self._parts.status: _line(wanted, text.VIDEOS_WAIT)}
            try:
                yield from follow(work, job, {self._parts.status: gr.skip()})
                return
            except CancelledRun:
                if job.is_cancelled():
                    raise


@dataclass(frozen=True)
class _StandardWork:
    """The videos of one run."""

    services: Services
    wanted: Wanted
    request: Ask
    parts: ResultParts

    def run(self, on_event: OnEvent, should_cancel: ShouldCancel) -> None:
        jobs = self.services.jobs

        def gives_way() -> bool:
            return should_cancel() or jobs.is_anyone_waiting()

        self.services.videos.do(draw_behind, self.request, on_event, gives_way)

    def progress(self, events: list[Event]) -> Updates:
        updates: Updates = {}
        if any(isinstance(event, Grown) for event in events):
            updates[self.parts.player] = self.wanted.kept.showing.value()
        share = last_share(events)
        if share is not None:
            updates[self.parts.status] = _line(self.wanted, text.VIDEOS_COMING.format(share=share))
        return updates

    def finished(self, result: None) -> Updates:
        return {
            **self.wanted.kept.downloads(self.parts),
            self.parts.status: _line(self.wanted, text.VIDEOS_DONE),
        }


def _line(wanted: Wanted, sentence: str) -> str:
    return markup.sentence_status(f"{wanted.kept.record.sentence} {sentence}")
