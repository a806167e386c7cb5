"""The runs of the tab "Your motion": from the form to `app.run.given`, and back as updates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.config import AppConfig
from app.errors import RunError
from app.page.parts import markup
from app.page.parts.asked import form_of
from app.page.parts.html_parts import shown
from app.page.player.player import NOTHING
from app.page.queue.jobs import Job
from app.page.queue.runner import TabRunner, Updates, Work
from app.page.results.result_parts import ResultParts
from app.page.tabs.motion_run import RunWork, showing_of
from app.page.tabs.own_sets_run import MIXED, NO_SETS, REFERENCE_TOO, SetsTools, is_zip
from app.page.tabs.services import Services
from app.page.tabs.videos_run import VideosBehind
from app.run.many.opened import is_one_run
from app.run.many.unpacked import stem_of
from app.run.requests.display import Display
from app.run.requests.request import MAX_COMPARED, Ask, read_assumptions, read_channel
from conventions.names import REFERENCE_NAME, printable
from conventions.views import CLOSE_UPS

NO_MOTION = "Choose at least one motion file (.npz, .npy or .bvh), or a zip of many."
MAX_FILES = 24
TOO_MANY = "At most {limit} files are measured at once; {count} were given."
TOO_MANY_SHOWN = "At most {limit} motions are shown beside each other; {count} were chosen."
BAD_START = "The first frame of the figure must be a whole number from 0 on; got {value}."
BAD_FRAMES = "The {what} must be a whole number of frames, or empty; got {value:g}."
SEEN: dict[str, Any] = {"size": 512, "display": Display(has_trail=True), "close_ups": CLOSE_UPS}
"""How given motion is shown; the player frames bodies alike."""
MAX_FRAMES = 108_000
"""Of all files of a run, an hour; the command line has no such limit."""
MAX_NAME = 60
"""Characters of a file's name that figures and tables show."""


@dataclass(frozen=True)
class OwnMotionForm:
    """What the visitor has filled in, as Gradio hands it over."""

    motions: list[str] | None
    reference: str | None
    speech: str | None
    point: str
    start_frame: float | None
    window: float | None = None
    overlap: float | None = None
    shown: list[str] | None = None
    """Names of those that figures and videos show, where there are more than fit."""
    has_videos: bool = True
    transcript: str | None = None
    has_words: bool = False
    """Recognised, where there is no transcript."""
    assume: str = ""
    """How files are to be read, as `--assume` takes it."""
    channel: str = ""
    """Of the speech, as `--channel` takes it; nothing mixes all."""

    def to_ask(self, out: Path, config: AppConfig) -> Ask:
        """The measuring that the form asks for.

        Raises:
            RunError: with a sentence for the visitor.
        """
        paths = [Path(path) for path in self.motions or ()]
        if not paths:
            raise RunError(NO_MOTION)
        if self.is_run:
            return asked_of({"run": paths[0]}, None, out, config)
        if len(paths) > MAX_FILES:
            raise RunError(TOO_MANY.format(limit=MAX_FILES, count=len(paths)))
        limit = MAX_COMPARED - bool(self.reference)
        if self.shown and len(self.shown) > limit:
            raise RunError(TOO_MANY_SHOWN.format(limit=limit, count=len(self.shown)))
        if any(map(is_zip, (*map(str, paths), self.reference, self.speech))):
            raise RunError(NO_SETS)
        start = self.start_frame or 0
        if start < 0 or start != int(start):
            raise RunError(BAD_START.format(value=self.start_frame))
        names = display_names([path.stem for path in paths])
        reference = Path(self.reference) if self.reference else None
        files = [*paths, *filter(None, [reference])]
        return Ask(
            **SEEN,
            motions=tuple(paths),
            out=out,
            names=names,
            reference=reference,
            speech=Path(self.speech) if self.speech else None,
            transcript=Path(self.transcript) if self.transcript else None,
            words="recognise" if self.has_words else "none",
            shown=tuple(self.shown or ()) if len(paths) > limit else (),
            joint=self.point,
            start_frame=int(start),
            body=config.body,
            weights=config.weights,
            has_video=self.has_videos,
            window=_whole(self.window, "window"),
            overlap=_whole(self.overlap, "overlap") or 0,
            max_frames=MAX_FRAMES,
            told=read_assumptions(self.assume).known(files, *names),
            channel=read_channel(self.channel) if self.channel else None,
        )

    @property
    def is_run(self) -> bool:
        """Whether it is the folder of a run, zipped, that is to be shown again."""
        return is_one_run([Path(path) for path in self.motions or ()])

    @property
    def has_sets(self) -> bool:
        """Whether zips of clips are to be measured."""
        return any(map(is_zip, self.motions or ())) and not self.is_run

    def to_sets(self, out: Path) -> Ask:
        """The measuring of zips that the form asks for.

        Raises:
            RunError: with a sentence for the visitor.
        """
        paths = [Path(path) for path in self.motions or ()]
        if not all(map(is_zip, self.motions or ())):
            raise RunError(MIXED)
        for what, path in (("reference", self.reference), ("speech", self.speech)):
            if path and not is_zip(path):
                raise RunError(REFERENCE_TOO.format(what=what))
        limit = MAX_COMPARED - bool(self.reference)
        if len(paths) > limit:
            raise RunError(TOO_MANY_SHOWN.format(limit=limit, count=len(paths)))
        return Ask(
            motions=tuple(paths),
            names=display_names([stem_of(path) for path in paths]),
            out=out,
            reference=Path(self.reference) if self.reference else None,
            speech=Path(self.speech) if self.speech else None,
            told=read_assumptions(self.assume),
            channel=read_channel(self.channel) if self.channel else None,
        )


def _whole(value: float | None, what: str) -> int | None:
    """A number of frames, or None where none is given.

    Raises:
        RunError: if it is no whole number from 0 on.
    """
    if not value:
        return None
    if value < 0 or value != int(value):
        raise RunError(BAD_FRAMES.format(what=what, value=value))
    return int(value)


def display_names(stems: Sequence[str]) -> tuple[str, ...]:
    """Each file's stem, cut short; of equal ones the later are numbered."""
    names: list[str] = []
    for stem in stems:
        name = printable(stem)[:MAX_NAME] or "motion"
        number = 2
        unique = name
        while unique in names:
            unique = f"{name} ({number})"
            number += 1
        names.append(unique)
    return tuple(names)


class OwnMotionRunner(TabRunner[Any]):
    """Measures motion files that a visitor brings, or zips of many."""

    tab = "own_motion"

    def __init__(
        self, services: Services, parts: ResultParts, videos: VideosBehind, sets: SetsTools
    ) -> None:
        super().__init__(services.jobs, parts.status)
        self._services = services
        self._videos = videos
        self._sets = sets
        self._parts = parts

    @contextmanager
    def begin(self, job: Job, cookie: str, values: tuple[Any, ...]) -> Iterator[Work[Any]]:
        form = form_of(OwnMotionForm, values)
        out = job.folder / "results"
        self._videos.give_up(job.visitor)
        if form.has_sets:
            asked = form.to_sets(out)
            addresses = self._services.addresses
            with self._sets.work(asked, job, cookie, addresses, self._parts) as work:
                yield work
            return
        yield self._work(form.to_ask(out, self._services.config), job, cookie)

    def _work(self, ask: Ask, job: Job, cookie: str) -> RunWork:
        showing = showing_of(job, self._services.addresses, cookie, is_drawn=ask.has_video)
        return RunWork(ask, self._services, self._videos, self._parts, job, cookie, showing)

    def blank(self) -> Updates:
        return {
            **self._without_results(),
            self._parts.status: markup.sentence_status(text.STARTING),
            self._parts.message: shown(""),
            self._parts.runs: shown(""),
        }

    def stopped(self, status: str, message: str) -> Updates:
        return {
            **self._without_results(),
            self._parts.status: status,
            self._parts.message: shown(message),
        }

    def _without_results(self) -> Updates:
        return {
            self._sets.parts.shown: shown(""),
            self._parts.player: NOTHING,
            self._parts.seen: shown(""),
            self._parts.figures: shown(""),
            self._parts.numbers: shown(""),
            self._parts.downloads_part: gr.update(visible=False),
        }


class ClipRunner(OwnMotionRunner):
    """Opens a clip of measured sets: a run like any other, under the sets that stay."""

    @contextmanager
    def begin(self, job: Job, cookie: str, values: tuple[Any, ...]) -> Iterator[Work[Any]]:
        clip = self._sets.clip_of(values[0] if values else None, cookie)
        self._videos.give_up(job.visitor)
        config = self._services.config
        asked = asked_of(clip.motions, clip.sound, job.folder / "results", config)
        told = clip.ask.told.known(asked.motions, *asked.names)
        title = f"{clip.name} of {', '.join(asked.names)}"
        asked = replace(asked, told=told, channel=clip.ask.channel, title=title)
        yield self._work(asked, job, cookie)

    def _without_results(self) -> Updates:
        return {
            part: update
            for part, update in super()._without_results().items()
            if part is not self._sets.parts.shown
        }


def asked_of(files: Mapping[str, Path], speech: Path | None, out: Path, config: AppConfig) -> Ask:
    """The measuring of motions that have names already, the reference among them."""
    motions = {name: path for name, path in files.items() if name != REFERENCE_NAME}
    return Ask(
        **SEEN,
        motions=tuple(motions.values()),
        out=out,
        names=tuple(motions),
        reference=files.get(REFERENCE_NAME),
        speech=speech,
        body=config.body,
        weights=config.weights,
        max_frames=MAX_FRAMES,
    )
