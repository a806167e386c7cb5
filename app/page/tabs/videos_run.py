"""Videos of a run that has ended: of what the stage shows, and the standard ones, drawn last."""

from __future__ import annotations

import threading
from collections.abc import Generator, Iterator, Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.errors import CancelledRun, RunError, visitor_sentence
from app.page.parts import markup
from app.page.parts.html_parts import PRIVATE, shown
from app.page.queue.jobs import Job
from app.page.queue.runner import TabRunner, Updates, follow, last_share
from app.page.results.kept_runs import KeptRun
from app.page.results.result_parts import ResultParts, saved_link
from app.page.tabs.services import Services
from app.page.visitors.visitors import visitor_of
from app.run.ask import Ask, Event, Grown, OnEvent, ShouldCancel
from app.run.videos.seen_video import Seen, SeenRequest, draw_seen
from app.run.videos.videos import draw_behind
from conventions.rates import FPS


class SeenRunner(TabRunner):
    """Makes videos of one tab's stage."""

    tab = "seen"

    def __init__(self, services: Services, parts: ResultParts) -> None:
        super().__init__(services.jobs, services.worker, parts.seen)
        self._services = services
        self._parts = parts

    def wire(self, prefix: str = "") -> None:
        """Have the stage's button start it.

        Args:
            prefix: of the ids of the tab's parts, with its hyphen.
        """
        parts = self._parts
        outputs = [parts.seen, parts.seen_cancel]
        run = self.begins_on(
            parts.seen_start.click,
            [gr.Textbox(visible=False)],  # which the script fills in
            outputs=outputs,
            js=f"() => [document.querySelector('#{prefix}player .lockstep').seen()]",
            show_progress_on=parts.status,
        )
        self.ends_on(parts.seen_cancel, run, outputs)

    def steps(self, job: Job, values: Sequence[Any]) -> Generator[Updates, None, None]:
        seen = Seen.read(values[0])
        request = SeenRequest(
            seen,
            tuple(self._file(body.motion, job.cookie, ".npz") for body in seen.bodies),
            out=job.folder / "results",
            speech=self._file(seen.sound, job.cookie, ".wav") if seen.sound else None,
            body=self._services.config.body,
        )
        yield {
            self._parts.seen: shown(line_of(text.SEEN_STARTING)),
            self._parts.seen_cancel: gr.update(visible=True),
        }

        def told(events: list[Event]) -> Updates:
            share = last_share(events)
            if share is None:
                return {}
            return {self._status: shown(line_of(text.SEEN_COMING.format(share=share), share))}

        video = yield from self.done(job, draw_seen, request, told)
        count = len(seen.shown)
        line = text.SEEN_DONE.format(
            bodies="one body" if count == 1 else f"{count} bodies",
            seconds=video.num_frames / FPS,
            megabytes=video.path.stat().st_size / 1e6,
        )
        address = self._services.media.share(job.folder, job.cookie)(video.path)
        link = saved_link(address, video.path.name, text.SEEN_SAVE)
        yield {
            self._parts.seen: shown(line_of(" ".join((line, *video.notes)), more=link)),
            self._parts.seen_cancel: gr.update(visible=False),
        }

    def _file(self, address: str, cookie: str, suffix: str) -> Path:
        """What the page has given an address.

        Raises:
            RunError: if it has not, or it is kept no longer.
        """
        path = self._services.media.at(address, cookie)
        if path is None or path.suffix != suffix:
            raise RunError(text.SEEN_GONE)
        return path

    def stopped(self, status: str, message: str) -> Updates:
        return {
            self._parts.seen: shown(message or status),
            self._parts.seen_cancel: gr.update(visible=False),
        }


def line_of(line: str, share: float | None = None, more: str = "") -> str:
    """One line under the stage.

    Args:
        share: of the work done, where that is known.
        more: HTML behind it.
    """
    bar = "" if share is None else f'<progress value="{share:.3f}" max="1"></progress>'
    return f'<div class="seen-told" role="status"><p>{escape(line)}</p>{bar}{more}</div>'


_PATIENCE_S = 1.0
"""Between two looks at whether the visitor is still there."""


class VideosBehind:
    """Draws what a tab's runs have left to be drawn, one visitor's newest run at a time, while
    nobody waits for a run; it gives way to one by being ended, and begins anew."""

    def __init__(self, services: Services, parts: ResultParts, tab: str) -> None:
        """
        Args:
            tab: that of the videos.
        """
        self._services = services
        self._jobs = services.jobs
        self._parts = parts
        self._tab = tab
        self._wanted: dict[str, tuple[KeptRun, Ask]] = {}
        self._lock = threading.Lock()

    def want(self, visitor: str, run: KeptRun, ask: Ask) -> None:
        """Have a run's videos drawn, as it was asked for, as soon as the page asks."""
        with self._lock:
            there = {who: each for who, each in self._wanted.items() if each[0].is_there}
            self._wanted = {**there, visitor: (run, ask)}  # some left before they asked

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
        parts = self._parts
        run.then(
            self.run,
            outputs=[parts.status, parts.player, parts.downloads],
            **PRIVATE,
            trigger_mode="multiple",
            concurrency_id="videos",
            concurrency_limit=1,
        )

    def run(self, request: gr.Request) -> Iterator[Updates]:
        """Updates of the tab while videos of the visitor's last run are drawn, if it wants any."""
        visitor = visitor_of(request)
        with self._lock:
            wanted = self._wanted.pop(visitor, None)
        if wanted is None:
            yield {self._parts.status: gr.skip()}  # of one that gives nothing Gradio empties all
            return
        run, ask = wanted
        try:
            with self._jobs.opened(visitor, self._tab) as job:
                yield from self._drawn(job, run, ask)
        except CancelledRun:
            return  # another run of the visitor has begun, and shows itself
        except Exception as error:  # whatever it is, the run that has ended stays and says so
            yield self._line(run, text.VIDEOS_FAILED.format(why=visitor_sentence(error)))

    def _drawn(self, job: Job, run: KeptRun, ask: Ask) -> Iterator[Updates]:
        request = replace(ask, motions=(run.showing.folder,), out=job.folder / "drawn")

        def draw(on_event: OnEvent, should_cancel: ShouldCancel) -> None:
            def gives_way() -> bool:
                return should_cancel() or self._jobs.is_anyone_waiting()

            self._services.videos.do(draw_behind, request, on_event, gives_way)

        def told(events: list[Event]) -> Updates:
            updates: Updates = {}
            if any(isinstance(event, Grown) for event in events):
                updates[self._parts.player] = run.showing.value()
            share = last_share(events)
            if share is not None:
                updates |= self._line(run, text.VIDEOS_COMING.format(share=share))
            return updates

        while True:
            while not self._jobs.wait_for_rest(_PATIENCE_S):
                if job.is_cancelled():
                    raise CancelledRun
                yield self._line(run, text.VIDEOS_WAIT)
            try:
                yield from follow(draw, job, told, {self._parts.status: gr.skip()})
                break
            except CancelledRun:
                if job.is_cancelled():
                    raise
        downloads = shown(run.downloads(run.showing))
        yield {self._parts.downloads: downloads, **self._line(run, text.VIDEOS_DONE)}

    def _line(self, run: KeptRun, sentence: str) -> Updates:
        """Beside how the run went."""
        line = markup.sentence_status(f"{run.record.sentence} {sentence}")
        return {self._parts.status: line}
