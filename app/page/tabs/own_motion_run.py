"""Motion that a visitor brings: from the form to the measures of `app.run.diagnose`, and back."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gradio as gr

from app import text
from app.config import AppConfig
from app.errors import CancelledRun, RunError
from app.page.parts import markup
from app.page.parts.html_parts import shown
from app.page.results.figures_shown import FiguresShown
from app.page.results.measures_table import measures_table
from app.page.serving.follow import follow_run, last_share, visitor_sentence, waiting_line
from app.page.serving.jobs import Job, JobBook
from app.page.serving.media import MediaDesk
from app.page.serving.visitors import cookie_of, visitor_of
from app.run.bundle import zip_files
from app.run.request import MAX_COMPARED, Artefact, OnEvent, Progress, ShouldCancel

if TYPE_CHECKING:
    from app.run.diagnose import DiagnoseRequest, Diagnosis

NO_MOTION = "Choose at least one motion file (BEAT2 .npz)."
TOO_MANY = "At most {limit} motions are compared at once; {count} were chosen."
BAD_START = "The first frame of the figure must be a whole number from 0 on; got {value}."
MEASURED = "Measured {motions}."
MEASURING = "Measuring: {share:.0%}"
MAX_NAME = 60
"""Characters of a file's name that figures and tables show."""

Diagnose = Callable[["DiagnoseRequest", Callable[[float], None]], "Diagnosis"]
Updates = dict[Any, Any]


@dataclass(frozen=True)
class OwnMotionParts:
    """Where the tab shows what comes of it."""

    status: gr.HTML
    message: gr.HTML
    figures: gr.HTML
    numbers: gr.HTML
    downloads: gr.Column
    bundle: gr.DownloadButton
    files: gr.File

    @property
    def all(self) -> list[Any]:
        return [getattr(self, name) for name in self.__dataclass_fields__]


@dataclass(frozen=True)
class OwnMotionForm:
    """What the visitor has filled in, as Gradio hands it over."""

    motions: list[str] | None
    reference: str | None
    speech: str | None
    point: str
    start_frame: float | None

    def to_request(self, out: Path, config: AppConfig) -> DiagnoseRequest:
        """The measuring that the form asks for.

        Raises:
            RunError: with a sentence for the visitor.
        """
        from app.run.diagnose import DiagnoseRequest

        paths = [Path(path) for path in self.motions or ()]
        if not paths:
            raise RunError(NO_MOTION)
        limit = MAX_COMPARED - bool(self.reference)
        if len(paths) > limit:
            raise RunError(TOO_MANY.format(limit=limit, count=len(paths)))
        start = self.start_frame or 0
        if start < 0 or start != int(start):
            raise RunError(BAD_START.format(value=self.start_frame))
        return DiagnoseRequest(
            motions=tuple(paths),
            out=out,
            names=display_names([path.stem for path in paths]),
            reference=Path(self.reference) if self.reference else None,
            speech=Path(self.speech) if self.speech else None,
            joint=self.point,
            start_frame=int(start),
            body=config.body,
        )


def display_names(stems: Sequence[str]) -> tuple[str, ...]:
    """Each file's stem, cut short; of equal ones the later are numbered."""
    names: list[str] = []
    for stem in stems:
        name = stem[:MAX_NAME] or "motion"
        number = 2
        unique = name
        while unique in names:
            unique = f"{name} ({number})"
            number += 1
        names.append(unique)
    return tuple(names)


class OwnMotionRunner:
    """Turns a click into a run of the measuring, and the run into updates of the tab."""

    def __init__(
        self,
        diagnose: Diagnose,
        config: AppConfig,
        jobs: JobBook,
        desk: MediaDesk,
        parts: OwnMotionParts,
    ) -> None:
        self._diagnose = diagnose
        self._config = config
        self._jobs = jobs
        self._desk = desk
        self._parts = parts

    def run(self, request: gr.Request, *values: Any) -> Iterator[Updates]:
        """Updates of the tab while motions are measured, for one visitor.

        Raises:
            gr.Error: with the sentence that the tab shows too.
        """
        cookie = cookie_of(request)
        job: Job | None = None
        try:
            job = self._jobs.open(visitor_of(request), "own_motion")
            asked = OwnMotionForm(*values).to_request(job.folder / "results", self._config)
            yield {**self._without_results(), self._parts.message: shown("")}
            with self._jobs.slot(job) as turn:
                for ahead in turn:
                    yield {self._parts.status: markup.sentence_status(waiting_line(ahead))}
                for news in follow_run(self._as_run(asked), job):
                    if not isinstance(news, list):
                        yield self._finished(news, job, cookie)
                    elif job.is_cancelled():
                        yield {self._parts.status: markup.sentence_status(text.STOPPING)}
                    elif (share := last_share(news)) is not None:
                        line = MEASURING.format(share=share)
                        yield {self._parts.status: markup.sentence_status(line)}
        except Exception as error:
            sentence = visitor_sentence(error)
            yield self._failed(sentence)
            if sentence != text.CANCELLED:
                raise gr.Error(sentence, print_exception=False) from error
        finally:
            if job is not None:
                self._jobs.close(job)

    def cancel(self, request: gr.Request) -> None:
        """The visitor has pressed the button, or closed the page."""
        self._jobs.cancel(visitor_of(request), "own_motion")

    def _as_run(self, asked: DiagnoseRequest) -> Callable[[OnEvent, ShouldCancel], Diagnosis]:
        """The measuring in the form of a run, so that it can be followed and stopped like one."""

        def run(on_event: OnEvent, should_cancel: ShouldCancel) -> Diagnosis:
            def on_progress(share: float) -> None:
                if should_cancel():
                    raise CancelledRun
                on_event(Progress("numbers", share))

            return self._diagnose(asked, on_progress)

        return run

    def _finished(self, found: Diagnosis, job: Job, cookie: str) -> Updates:
        parts = self._parts
        figures = FiguresShown(self._desk, cookie)
        for path in found.files:
            if path.suffix in (".png", ".svg", ".pdf"):
                figures.take(Artefact("figure", path.stem, path))
        bundle = zip_files(found.files, job.folder / "own-motion.zip")
        count = len(found.diagnostics["systems"])
        line = MEASURED.format(motions=f"{count} motion{'s' if count > 1 else ''}")
        return {
            parts.status: markup.sentence_status(line),
            parts.message: shown(markup.notes_message(found.notes)),
            parts.figures: shown(figures.html(found.diagnostics)),
            parts.numbers: shown(measures_table(found.diagnostics)),
            parts.downloads: gr.update(visible=True),
            parts.bundle: gr.update(value=str(bundle)),
            parts.files: [str(path) for path in found.files],
        }

    def _failed(self, sentence: str) -> Updates:
        is_cancelled = sentence == text.CANCELLED
        return {
            **self._without_results(),
            self._parts.status: markup.sentence_status(sentence if is_cancelled else text.STOPPED),
            self._parts.message: shown("" if is_cancelled else markup.error_message(sentence)),
        }

    def _without_results(self) -> Updates:
        return {
            self._parts.status: markup.sentence_status(text.STARTING),
            self._parts.figures: shown(""),
            self._parts.numbers: shown(""),
            self._parts.downloads: gr.update(visible=False),
        }
