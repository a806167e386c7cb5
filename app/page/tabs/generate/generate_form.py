"""From the fields of the tab "Motion" to the run that they ask for: speech, systems, sampling."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from app import text
from app.config import AppConfig
from app.errors import RunError
from app.page.parts.asked import whole_number
from app.page.parts.catalogue import Catalogue
from app.page.parts.strength import USUAL, strength_of
from app.run.requests.display import Display
from app.run.requests.request import (
    MAX_SAMPLES,
    MAX_STEPS,
    GenerateRequest,
    Steps,
    check_request,
    parse_steps,
    steps_of,
)
from conventions.names import POST_FILTERS, REFERENCE_NAME, SampleName
from conventions.views import CLOSE_UPS

SEED_LIMIT = 2**31 - 1
PAGE_VIDEOS = 12
PAGE_SIZE_PX = 640
"""Height of a body in the player."""


@dataclass(frozen=True)
class Form:
    """What the visitor has filled in, as Gradio hands it over."""

    speech: str | None
    systems: list[str]
    speaker: str | None
    seed: float | None
    samples: float
    steps: str
    sampler: str
    is_smoothed: bool
    reference: str | None
    point: str
    start_frame: float | None
    transcript: str | None
    body_steps: float = 0
    """Of systems that draw the face by steps of its own, as `face_steps`; 0 as usual."""
    face_steps: float = 0
    guidance: float | None = USUAL
    """Strength of the speech."""
    has_words: bool = False
    """Recognised, where there is no transcript."""
    has_videos: bool = True
    """Whether standard videos are drawn behind the stage."""
    plan: str | None = None
    """What the systems that perform plans are to perform."""


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
    start_frame = form.start_frame or 0
    if start_frame != int(start_frame) or start_frame < 0:
        raise RunError(text.BAD_START.format(value=form.start_frame))
    if form.sampler and form.sampler not in catalogue.samplers:
        known = ", ".join(catalogue.samplers)
        raise RunError(f"There is no sampler {form.sampler!r}; there are {known}.")
    samples = whole_number(form.samples, text.SAMPLES_LABEL, 1, MAX_SAMPLES)
    body_steps = whole_number(form.body_steps, text.BODY_STEPS_LABEL, 0, MAX_STEPS)
    face_steps = whole_number(form.face_steps, text.FACE_STEPS_LABEL, 0, MAX_STEPS)
    count = len(systems) * samples + bool(form.reference)
    if count > PAGE_VIDEOS:
        raise RunError(
            text.TOO_MANY_VIDEOS.format(
                systems=_counted(len(systems), "system"),
                samples=_counted(samples, "sample"),
                count=count,
                limit=PAGE_VIDEOS,
            )
        )
    apart = [name for name in systems if name in catalogue.with_face_steps]
    request = GenerateRequest(
        speech=Path(form.speech),
        out=folder / "results",
        weights=config.weights,
        systems=systems,
        speaker=form.speaker,
        seed=int(form.seed),
        samples=samples,
        steps=_steps(form, body_steps, systems, catalogue),
        face_steps=dict.fromkeys(apart, face_steps) if face_steps else None,
        sampler=form.sampler or None,
        guidance=strength_of(form.guidance),
        post_filter=POST_FILTERS[bool(form.is_smoothed)],
        reference=Path(form.reference) if form.reference else None,
        transcript=Path(form.transcript) if form.transcript else None,
        words="recognise" if form.has_words else "none",
        plan=Path(form.plan) if form.plan else None,
        joint=form.point,
        start_frame=int(start_frame),
        body=config.body,
        display=Display(has_trail=True),
        size=PAGE_SIZE_PX,
        close_ups=CLOSE_UPS,  # the player shows those that are wanted
        has_video=form.has_videos,
        has_poses=True,
        has_posters=True,
        max_speech_s=config.max_speech_s,
    )
    check_request(request)
    return request


def kept_values(form: Form, folder: Path) -> dict[str, Any]:
    """What fills the form in again where the run's link is opened: all but files that a run does
    not show. The speech stays in the run's folder, under its own name."""
    values = {field.name: getattr(form, field.name) for field in fields(form)}
    for name in ("speech", "reference", "transcript", "plan"):
        del values[name]
    if form.speech:
        beside = folder / "form"
        beside.mkdir(exist_ok=True)
        speech = beside / Path(form.speech).name
        shutil.copyfile(form.speech, speech)
        values["speech"] = str(speech)
    return values


def _counted(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _steps(form: Form, body_steps: int, systems: tuple[str, ...], catalogue: Catalogue) -> Steps:
    """What is written by name, whole or as the form shows it, then the slider of the systems that
    it is for, then the rest."""
    written = parse_steps(form.steps)
    if isinstance(written, dict):
        whole = dict(catalogue.system_choices)
        written = {whole.get(name, name): count for name, count in written.items()}
    if not body_steps:
        return written
    asked = {name: steps_of(written, name) for name in systems}
    own = written if isinstance(written, Mapping) else {}
    for name in systems:
        if name in catalogue.with_face_steps and name not in own:
            asked[name] = body_steps
    return {name: count for name, count in asked.items() if count is not None}


def row_names(request: GenerateRequest) -> tuple[str, ...]:
    """The videos of a run in the order in which they stand on the page."""
    names = [
        str(SampleName(system, sample))
        for system in request.systems
        for sample in range(1, request.samples + 1)
    ]
    return (*names, REFERENCE_NAME) if request.reference else tuple(names)
