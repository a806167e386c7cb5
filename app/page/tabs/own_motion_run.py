"""The runs of the tab "Your motion": from the form to `app.run.given`, and back as updates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.config import AppConfig
from app.errors import RunError
from app.page.parts import markup
from app.page.parts.asked import Fields, values_of
from app.page.parts.html_parts import shown
from app.page.player.player import NOTHING
from app.page.queue.jobs import Job
from app.page.queue.runner import TabRunner, Updates, Work
from app.page.results.result_parts import ResultParts
from app.page.tabs.motion_run import RunWork, showing_of
from app.page.tabs.own_sets_run import MIXED, NO_SETS, REFERENCE_TOO, SetsTools
from app.page.tabs.services import Services
from app.page.tabs.videos_run import VideosBehind
from app.run.many.opened import is_one_run
from app.run.many.unpacked import is_packed, stem_of
from app.run.requests.display import Display
from app.run.requests.request import MAX_COMPARED, Ask
from app.run.requests.upload_check import FileKind, kind_of
from conventions.names import REFERENCE_NAME, printable
from conventions.views import CLOSE_UPS

ONE_EACH: Mapping[FileKind, str] = {"sounds": "speech", "transcript": "words"}
"""Of which one goes with all motions."""
ONE_FILE = "One file of {what} goes with all motions; {count} were given."
NO_REFERENCE = "There is no motion {name!r} among the files; choose the recorded one anew."
NO_MOTION = "Choose at least one motion file (.npz, .npy or .bvh), or a zip of many."
MAX_FILES = 24
TOO_MANY = "At most {limit} files are measured at once; {count} were given."
TOO_MANY_SHOWN = "At most {limit} motions are shown beside each other; {count} were chosen."
SEEN: dict[str, Any] = {"size": 512, "display": Display(has_trail=True), "close_ups": CLOSE_UPS}
"""How given motion is shown; the player frames bodies alike."""
MAX_FRAMES = 108_000
"""Of all files of a run, an hour; the command line has no such limit."""
MAX_NAME = 60
"""Characters of a file's name that figures and tables show."""


def own_ask(told: Mapping[str, Any], out: Path, config: AppConfig) -> Ask:
    """The measuring that a form asks for, of files or of zips.

    Args:
        told: as `values_of` gives it.

    Raises:
        RunError: with a sentence for the visitor.
    """
    told = {**told, **as_they_are(told["motions"], told["reference"])}
    motions, reference, speech = told["motions"], told["reference"], told["speech"]
    if not motions:
        raise RunError(NO_MOTION)
    if is_one_run(motions):
        return asked_of({"run": motions[0]}, None, out, config)
    limit = MAX_COMPARED - (reference is not None)
    if has_sets(motions):
        _check_sets(motions, reference, speech, limit)
        beside = ("motions", "names", "reference", "speech", "told", "channel")
        return Ask(out=out, **{name: told[name] for name in beside})
    if len(motions) > MAX_FILES:
        raise RunError(TOO_MANY.format(limit=MAX_FILES, count=len(motions)))
    names = told["names"]
    chosen = tuple(name for name in told["shown"] if name in names)
    if len(chosen) > limit:
        raise RunError(TOO_MANY_SHOWN.format(limit=limit, count=len(chosen)))
    files = [*motions, *filter(None, [reference])]
    if any(map(is_packed, [*files, *filter(None, [speech])])):
        raise RunError(NO_SETS)
    own = {
        "shown": chosen if len(motions) > limit else (),
        "told": told["told"].known(files, *names),
    }
    return Ask(
        **SEEN,
        **{**told, **own},
        out=out,
        body=config.body,
        weights=config.weights,
        max_frames=MAX_FRAMES,
    )


def as_they_are(files: Sequence[Path], recorded: str | None) -> dict[str, Any]:
    """What of an ask some files are, as is seen from them.

    Args:
        recorded: the name of a motion among them that is the reference.

    Raises:
        RunError: where there is no such, or more than one speech or text.
    """
    by_kind: dict[FileKind, list[Path]] = {"motions": [], "sounds": [], "transcript": []}
    for path in files:
        by_kind[kind_of(path)].append(path)
    for kind, what in ONE_EACH.items():
        if len(by_kind[kind]) > 1:
            raise RunError(ONE_FILE.format(what=what, count=len(by_kind[kind])))
    names = display_names([stem_of(path) for path in by_kind["motions"]])
    motions = dict(zip(names, by_kind["motions"], strict=True))
    if recorded and recorded not in motions:
        raise RunError(NO_REFERENCE.format(name=printable(recorded)))
    reference = motions.pop(recorded) if recorded else None
    speech, transcript = (next(iter(by_kind[kind]), None) for kind in ONE_EACH)
    return {
        "motions": tuple(motions.values()),
        "names": tuple(motions),
        "reference": reference,
        "speech": speech,
        "transcript": transcript,
    }


def has_sets(motions: Sequence[Path]) -> bool:
    """Whether zips of clips are to be measured."""
    return any(map(is_packed, motions)) and not is_one_run(motions)


def _check_sets(
    motions: Sequence[Path], reference: Path | None, speech: Path | None, limit: int
) -> None:
    if not all(map(is_packed, motions)):
        raise RunError(MIXED)
    for what, path in (("reference", reference), ("speech", speech)):
        if path is not None and not is_packed(path):
            raise RunError(REFERENCE_TOO.format(what=what))
    if len(motions) > limit:
        raise RunError(TOO_MANY_SHOWN.format(limit=limit, count=len(motions)))


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
        self,
        services: Services,
        parts: ResultParts,
        videos: VideosBehind,
        sets: SetsTools,
        fields: Fields,
    ) -> None:
        super().__init__(services.jobs, parts.status)
        self._fields = fields
        self._services = services
        self._videos = videos
        self._sets = sets
        self._parts = parts

    @contextmanager
    def begin(self, job: Job, cookie: str, values: tuple[Any, ...]) -> Iterator[Work[Any]]:
        ask = own_ask(
            values_of(self._fields, values), job.folder / "results", self._services.config
        )
        self._videos.give_up(job.visitor)
        if not has_sets(ask.motions):
            yield self._work(ask, job, cookie)
            return
        addresses = self._services.addresses
        with self._sets.work(ask, job, cookie, addresses, self._parts) as work:
            yield work

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
