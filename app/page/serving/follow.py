"""Between the page's values and a run: a form is checked, a run is followed while it goes."""

from __future__ import annotations

import logging
import os
import queue
import secrets
import threading
import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

from app import text
from app.config import AppConfig
from app.errors import CancelledRun, RunError, sentence_of
from app.page.catalogue import Catalogue
from app.page.serving.jobs import Job
from app.run.request import (
    POST_FILTERS,
    REFERENCE_NAME,
    SAMPLERS,
    Artefact,
    Event,
    GenerateRequest,
    GenerateResult,
    OnEvent,
    Progress,
    Sampler,
    ShouldCancel,
    Stage,
    sample_name,
)

log = logging.getLogger(__name__)

Generate = Callable[[GenerateRequest, OnEvent, ShouldCancel], GenerateResult]
Result = TypeVar("Result")
SEED_LIMIT = 2**31 - 1
PAGE_VIDEOS = 12
_REFRESH_S = 0.25


@dataclass(frozen=True)
class Form:
    """What the visitor has filled in, as Gradio hands it over."""

    speech: str | None
    systems: list[str]
    speaker: str | None
    seed: float | None
    samples: float
    steps: float
    sampler: str
    is_smoothed: bool
    reference: str | None
    point: str
    start_frame: float | None
    transcript: str | None


def request_from_form(
    form: Form, folder: Path, catalogue: Catalogue, config: AppConfig
) -> GenerateRequest:
    """The run that a form asks for.

    Raises:
        RunError: a sentence for the visitor when the form asks for something that cannot be.
    """
    if not form.speech:
        raise RunError(text.NO_SPEECH)
    if not form.systems:
        raise RunError(text.NO_SYSTEM)
    # Kept in the catalogue's order, so that rows stand the same way in every run.
    systems = tuple(name for name in catalogue.systems if name in form.systems)
    unknown = sorted(set(form.systems) - set(systems))
    if unknown:
        raise RunError(
            f"There is no system {unknown[0]!r}; the systems are {', '.join(catalogue.systems)}."
        )
    if form.seed is None or form.seed != int(form.seed) or not 0 <= form.seed <= SEED_LIMIT:
        raise RunError(text.BAD_SEED.format(limit=SEED_LIMIT, value=form.seed))
    known: dict[str, Sampler] = {name: name for name in SAMPLERS}
    if form.sampler not in known:
        raise RunError(f"There is no sampler {form.sampler!r}; there are {', '.join(SAMPLERS)}.")
    start_frame = form.start_frame or 0
    if start_frame != int(start_frame) or start_frame < 0:
        raise RunError(text.BAD_START.format(value=form.start_frame))
    samples, steps = int(form.samples), int(form.steps)
    if samples < 1 or steps < 1:
        raise RunError(f"Samples and steps must be at least 1; got {samples} and {steps}.")
    count = len(systems) * samples + bool(form.reference)
    if count > PAGE_VIDEOS:
        raise RunError(
            text.TOO_MANY_VIDEOS.format(
                systems=len(systems), samples=samples, count=count, limit=PAGE_VIDEOS
            )
        )
    return GenerateRequest(
        speech=Path(form.speech),
        out=folder / "results",
        weights=config.weights,
        systems=systems,
        speaker=form.speaker,
        seed=int(form.seed),
        samples=samples,
        steps=steps,
        sampler=known[form.sampler],
        post_filter=POST_FILTERS[bool(form.is_smoothed)],
        reference=Path(form.reference) if form.reference else None,
        transcript=Path(form.transcript) if form.transcript else None,
        joint=form.point,
        start_frame=int(start_frame),
        body=config.body,
        # A licensed body may be looked at in videos; its mesh is not handed to visitors.
        has_previews=config.body is None,
        max_speech_s=config.max_speech_s,
    )


def row_names(request: GenerateRequest) -> tuple[str, ...]:
    """The videos of a run in the order in which they stand on the page."""
    names = [
        sample_name(system, sample)
        for system in request.systems
        for sample in range(1, request.samples + 1)
    ]
    return (*names, REFERENCE_NAME) if request.reference else tuple(names)


@dataclass
class RunView:
    """What the page knows of a run so far."""

    started: float = field(default_factory=time.monotonic)
    fractions: dict[Stage, float] = field(default_factory=dict)
    details: dict[Stage, str] = field(default_factory=dict)
    artefacts: list[Artefact] = field(default_factory=list)

    def take(self, event: Event) -> None:
        if isinstance(event, Artefact):
            self.artefacts.append(event)
        else:
            self.fractions[event.stage] = event.fraction
            self.details[event.stage] = event.detail

    @property
    def seconds(self) -> float:
        return time.monotonic() - self.started

    @property
    def line(self) -> str:
        doing = [stage for stage, fraction in self.fractions.items() if fraction < 1]
        if not doing:
            return text.STARTING
        return f"{text.STAGE_NAMES[doing[-1]]} ({self.seconds:.0f} s so far)"


def follow_run(
    run: Callable[[OnEvent, ShouldCancel], Result], job: Job
) -> Generator[list[Event] | Result, None, None]:
    """Do a run in a thread of its own; give its events in small batches, then its result, which is
    no list.

    Each artefact is linked into the job's folder, so that it stays readable while the run goes
    on, whatever becomes of the run.

    Raises:
        Exception: whatever the run raises, once its thread has ended.
    """
    shown = job.folder / "shown"
    shown.mkdir(mode=0o700, exist_ok=True)
    events: queue.SimpleQueue[Event | None] = queue.SimpleQueue()
    outcome: dict[str, Any] = {}

    def keep(event: Event) -> None:
        if isinstance(event, Artefact):
            link = shown / event.path.name
            link.unlink(missing_ok=True)
            os.link(event.path, link)
            event = replace(event, path=link)
        events.put(event)

    def work() -> None:
        try:
            outcome["result"] = run(keep, job.is_cancelled)
        except BaseException as error:
            outcome["error"] = error
        finally:
            events.put(None)

    thread = threading.Thread(target=work, name="run", daemon=True)
    thread.start()
    try:
        has_ended = False
        while not has_ended:
            batch: list[Event] = []
            deadline = time.monotonic() + _REFRESH_S
            while not has_ended and (left := deadline - time.monotonic()) > 0:
                try:
                    event = events.get(timeout=left)
                except queue.Empty:
                    break
                if event is None:
                    has_ended = True
                else:
                    batch.append(event)
            yield batch
    except GeneratorExit:
        job.cancel()  # the visitor has gone
        raise
    thread.join()
    if "error" in outcome:
        raise outcome["error"]
    yield outcome["result"]


def last_share(events: Sequence[Event]) -> float | None:
    """How far a run of one stage is, as its last news of that says; None without any."""
    shares = [event.fraction for event in events if isinstance(event, Progress)]
    return shares[-1] if shares else None


def visitor_sentence(error: BaseException) -> str:
    """What a visitor is told of an error; faults of the program are logged under a number."""
    if isinstance(error, CancelledRun):
        return text.CANCELLED
    sentence = sentence_of(error)
    if sentence is not None:
        return sentence
    fault_id = secrets.token_hex(4)
    log.error("fault %s", fault_id, exc_info=error)
    return text.FAULT.format(fault_id=fault_id)


def waiting_line(ahead: int) -> str:
    """How many are before this visitor."""
    return text.WAITING_ONE if ahead == 1 else text.WAITING.format(ahead=ahead)
