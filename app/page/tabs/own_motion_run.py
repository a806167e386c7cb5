"""The runs of the tab "Your motion": from the form to `app.run.diagnose`, and back as updates."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gradio as gr

from app import text
from app.config import AppConfig
from app.errors import RunError, page_sentence
from app.page.parts import markup
from app.page.parts.asked import form_of
from app.page.parts.html_parts import shown
from app.page.player.player import NOTHING, Showing, gravest_of, own_writers, picture_layout
from app.page.queue.in_turn import Updates, Work, last_share
from app.page.queue.jobs import Job
from app.page.queue.runner import TabRunner
from app.page.results.kept_runs import EndedRun, KeptRuns, sha256_of
from app.page.results.result_parts import FiguresShown, ResultParts
from app.page.results.run_file import OpenedRun, SavedRun, is_saved_run, open_run
from app.page.results.settings import settings_of_own
from app.page.routes.media import MediaAddresses
from app.page.tabs.own_sets_run import MIXED, NO_SETS, REFERENCE_TOO, SetsTools, is_zip
from app.page.tabs.services import Services
from app.page.tabs.videos_run import VideosBehind, Wanted
from app.run.many.unpacked import stem_of
from app.run.output.result_folder import zip_files
from app.run.output.telling import share_teller
from app.run.requests.request import (
    MAX_COMPARED,
    Artefact,
    Event,
    OnEvent,
    ShouldCancel,
    read_assumptions,
    read_channel,
)
from app.run.videos.behind import VideosRequest
from app.run.videos.own_videos import OnFile, VideoOptions
from conventions.names import REFERENCE_NAME, printable

if TYPE_CHECKING:
    from app.run.diagnose import DiagnoseRequest, Diagnosis
    from app.run.many.sets import SetsRequest

NO_MOTION = "Choose at least one motion file (.npz, .npy or .bvh), or a zip of many."
MAX_FILES = 24
TOO_MANY = "At most {limit} files are measured at once; {count} were given."
TOO_MANY_SHOWN = "At most {limit} motions are shown beside each other; {count} were chosen."
BAD_START = "The first frame of the figure must be a whole number from 0 on; got {value}."
BAD_FRAMES = "The {what} must be a whole number of frames, or empty; got {value:g}."
MEASURED = "Measured {motions}."
OPENED = "Opened from its file; its {motions} were measured anew."
MEASURING = "Measuring and drawing: {share:.0%}"
MAX_FRAMES = 108_000
"""Of all files of a run, an hour; the command line has no such limit."""
MAX_NAME = 60
"""Characters of a file's name that figures and tables show."""
MAX_NAMED = 3
"""Files that a run's title names."""

VIDEOS = VideoOptions(size=512, has_posters=True)
Diagnose = Callable[["DiagnoseRequest", Callable[[float], None], OnFile], "Diagnosis"]


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

    def to_request(self, out: Path, config: AppConfig) -> DiagnoseRequest:
        """The measuring that the form asks for.

        Raises:
            RunError: with a sentence for the visitor.
        """
        from app.run.diagnose import DiagnoseRequest

        paths = [Path(path) for path in self.motions or ()]
        if not paths:
            raise RunError(NO_MOTION)
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
        return DiagnoseRequest(
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
            is_played=True,
            window=_whole(self.window, "window"),
            overlap=_whole(self.overlap, "overlap") or 0,
            max_frames=MAX_FRAMES,
            told=read_assumptions(self.assume).known(files, *names),
            channel=read_channel(self.channel) if self.channel else None,
        )

    @property
    def saved_run(self) -> Path | None:
        """A run that was saved as a file, which is to be opened again."""
        paths = [Path(path) for path in self.motions or ()]
        return paths[0] if len(paths) == 1 and is_saved_run(paths[0]) else None

    @property
    def has_sets(self) -> bool:
        """Whether zips of clips are to be measured."""
        return any(map(is_zip, self.motions or ()))

    def to_sets(self, out: Path) -> SetsRequest:
        """The measuring of zips that the form asks for.

        Raises:
            RunError: with a sentence for the visitor.
        """
        from app.run.many.sets import SetsRequest

        paths = [Path(path) for path in self.motions or ()]
        if not all(map(is_zip, self.motions or ())):
            raise RunError(MIXED)
        for what, path in (("reference", self.reference), ("speech", self.speech)):
            if path and not is_zip(path):
                raise RunError(REFERENCE_TOO.format(what=what))
        limit = MAX_COMPARED - bool(self.reference)
        if len(paths) > limit:
            raise RunError(TOO_MANY_SHOWN.format(limit=limit, count=len(paths)))
        return SetsRequest(
            tuple(paths),
            display_names([stem_of(path) for path in paths]),
            out,
            Path(self.reference) if self.reference else None,
            Path(self.speech) if self.speech else None,
            read_assumptions(self.assume),
            read_channel(self.channel) if self.channel else None,
        )


def rows_of(request: DiagnoseRequest) -> tuple[str, ...]:
    """The videos of a run in the order in which they stand on the page."""
    limit = MAX_COMPARED - (request.reference is not None)
    names = request.shown or request.names[:limit]
    return (*names, REFERENCE_NAME) if request.reference else tuple(names)


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
        if form.saved_run is not None:
            opened = open_run(form.saved_run, job.folder / "opened")
            yield self._opened(opened, job, cookie)
            return
        if form.has_sets:
            asked = form.to_sets(out)
            addresses = self._services.addresses
            with self._sets.work(asked, job, cookie, addresses, self._parts) as work:
                yield work
            return
        request = form.to_request(out, self._services.config)
        yield self._work(request, job, cookie, _title(request), has_videos=form.has_videos)

    def _opened(self, opened: OpenedRun, job: Job, cookie: str) -> _Work:
        """A saved run, under its own name and with its words; measured anew."""
        told = opened.told
        config = self._services.config
        asked = asked_of(opened.motions, opened.speech, job.folder / "results", config)
        asked = replace(asked, joint=told.joint)
        work = self._work(asked, job, cookie, printable(told.title), has_videos=False)
        for name, path in opened.plans.items():
            work.showing.take(Artefact("plan", name, path))
        return replace(work, opened=told)

    def _work(
        self, asked: DiagnoseRequest, job: Job, cookie: str, title: str, *, has_videos: bool
    ) -> _Work:
        addresses, weights = self._services.addresses, self._services.config.weights
        showing = _showing(asked, job, addresses, cookie, weights)
        showing.is_drawn = has_videos
        return _Work(
            title=title,
            diagnose=self._services.processes.diagnose,
            asked=asked,
            job=job,
            cookie=cookie,
            figures=FiguresShown(addresses, cookie),
            showing=showing,
            parts=self._parts,
            kept=self._services.kept,
            videos=self._videos if has_videos else None,
        )

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
        told = clip.asked.told.known(asked.motions, *asked.names)
        asked = replace(asked, told=told, channel=clip.asked.channel)
        title = f"{clip.name} of {', '.join(asked.names)}"
        yield self._work(asked, job, cookie, title, has_videos=False)

    def _without_results(self) -> Updates:
        return {
            part: update
            for part, update in super()._without_results().items()
            if part is not self._sets.parts.shown
        }


def asked_of(
    files: Mapping[str, Path], speech: Path | None, out: Path, config: AppConfig
) -> DiagnoseRequest:
    """The measuring of motions that have names already, the reference among them."""
    from app.run.diagnose import DiagnoseRequest

    motions = {name: path for name, path in files.items() if name != REFERENCE_NAME}
    return DiagnoseRequest(
        motions=tuple(motions.values()),
        out=out,
        names=tuple(motions),
        reference=files.get(REFERENCE_NAME),
        speech=speech,
        body=config.body,
        is_played=True,
        max_frames=MAX_FRAMES,
    )


def _showing(
    asked: DiagnoseRequest, job: Job, addresses: MediaAddresses, cookie: str, weights: Path
) -> Showing:
    names = rows_of(asked)
    return Showing(
        *(names, names),
        picture_layout("front", VIDEOS.size, VIDEOS.close_ups, VIDEOS.framing),
        own_writers(asked, job.folder, weights),
        *(job.folder, addresses, cookie),
    )


@dataclass(frozen=True)
class _Work:
    """One run of the measuring."""

    title: str
    diagnose: Diagnose
    asked: DiagnoseRequest
    job: Job
    cookie: str
    figures: FiguresShown
    showing: Showing
    parts: ResultParts
    kept: KeptRuns
    videos: VideosBehind | None
    """None where no videos are wanted."""
    opened: SavedRun | None = None
    """What is known of a run that was saved."""

    def run(self, on_event: OnEvent, should_cancel: ShouldCancel) -> Diagnosis:
        on_progress = share_teller("numbers", on_event, should_cancel)
        return self.diagnose(self.asked, on_progress, on_event)

    def progress(self, events: list[Event]) -> Updates:
        updates: Updates = {}
        for event in events:
            if isinstance(event, Artefact):
                self.showing.take(event)
                updates[self.parts.player] = self.showing.value()
        share = last_share(events)
        if share is not None:
            updates[self.parts.status] = markup.sentence_status(MEASURING.format(share=share))
        return updates

    def finished(self, result: Diagnosis) -> Updates:
        ended = self._ended(result)
        kept = self.kept.keep(self.job, self.cookie, ended)
        runs = {self.parts.runs: shown(self.kept.html(self.cookie, kept))}
        if self.videos is not None:
            speech = self.showing.sound() if self.asked.speech else None
            wanted = VideosRequest(
                *(self.showing.drawn(), self.job.folder, speech, self.asked.joint, self.asked.body),
                VIDEOS,
            )
            self.videos.want(self.job.visitor, Wanted(kept, wanted))
        return {**ended.updates(self.parts, begins=True), **runs}

    def _ended(self, result: Diagnosis) -> EndedRun:
        self.figures.take_files(result.files)
        if self.opened is None:
            self.showing.add_words(result.said)
        else:
            self.showing.tell_words(self.opened.said)
        self.showing.findings = gravest_of(result.diagnostics.findings)
        self.showing.assumed = _assumed(self.asked, result.diagnostics.assumed)
        count, saved = len(result.diagnostics.systems), self.opened
        motions = f"{count} motion{'s' if count > 1 else ''}"
        line = MEASURED.format(motions=motions)
        return EndedRun(
            title=self.title,
            settings=settings_of_own(self.asked) if saved is None else saved.settings,
            speech_sha256=sha256_of(self.asked.speech) if saved is None else saved.speech_sha256,
            line=line if saved is None else OPENED.format(motions=motions),
            notes=result.notes,
            verdict="",
            diagnostics=result.diagnostics,
            showing=self.showing,
            figures=self.figures,
            bundle=zip_files(result.files, self.job.folder / "own-motion.zip"),
            files=result.files,
        )


def _assumed(asked: DiagnoseRequest, assumed: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """What chips are told: by motion the kind of its file, as `Told` has it, and its reading."""
    files = dict(zip(asked.names, asked.motions, strict=True))
    files |= {REFERENCE_NAME: asked.reference} if asked.reference else {}
    return {
        name: {
            "kind": f"*{files[name].suffix.lower()}",
            "read": [{**each, "why": page_sentence(each["why"])} for each in read],
        }
        for name, read in assumed.items()
    }


def _title(asked: DiagnoseRequest) -> str:
    beside = f" beside {asked.reference.stem}" if asked.reference else ""
    more = len(asked.names) - MAX_NAMED
    others = f" and {more} more" if more > 0 else ""
    return f"{', '.join(asked.names[:MAX_NAMED])}{others}{beside}"
