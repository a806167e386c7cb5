"""The runs of the tab "Your motion": from the form to `app.run.given`, and back as updates."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import gradio as gr

from app.config import AppConfig
from app.errors import RunError
from app.page.parts import markup
from app.page.parts.asked import values_of
from app.page.parts.html_parts import shown
from app.page.queue.jobs import Job
from app.page.queue.runner import Updates
from app.page.results.result_parts import ResultParts, figures_html, files_listed
from app.page.results.sets_shown import clip_choices, number_of, sets_html
from app.page.tabs.motion import FormParts
from app.page.tabs.motion_run import RunRunner
from app.page.tabs.services import Services
from app.page.visitors.kept import Kept
from app.run.ask import MAX_COMPARED, Ask
from app.run.display import Display
from app.run.many.motions import Sets, measure_sets
from app.run.many.opened import is_one_run
from app.run.many.unpacked import is_packed, stem_of
from app.run.upload_check import FileKind, kind_of
from conventions.names import REFERENCE_NAME, printable
from conventions.views import CLOSE_UPS

ONE_EACH: Mapping[FileKind, str] = {"sounds": "speech", "transcript": "words"}
"""Of which one goes with all motions."""
ONE_FILE = "One file of {what} goes with all motions; {count} were given."
NO_REFERENCE = "There is no motion {name!r} among the files; choose the recorded one anew."
NO_MOTION = "Choose at least one motion file (.npz, .npy or .bvh), or a zip of many."
MIXED = "Give zips of results only, or motion files only; a zip is measured as one set."
REFERENCE_TOO = (
    "Where motions come as zips, the {what} comes as a zip as well, named alike by clip."
)
NO_SETS = "A zip goes beside zips: give the motions as zips as well, one for each system."
MEASURING_SETS = "Measuring clips: {share:.0%}"
MEASURED_SETS = "Measured {clips} of {sets}. Any of them opens on the stage."
CLIP_GONE = "These clips are kept no longer; give the zips again."
CLIP_DAMAGED = "What was asked for is no clip of these sets; load the page again."
SetsParts = tuple[gr.HTML, gr.Dropdown]
"""Where sets are shown, and which of their clips is opened."""
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


class OwnMotionRunner(RunRunner):
    """Measures motion files that a visitor brings, or zips of many."""

    tab = "own_motion"

    def __init__(
        self, services: Services, form: FormParts, parts: ResultParts, of_sets: SetsParts
    ) -> None:
        super().__init__(services, form, parts)
        self._of_sets = of_sets
        self.outputs += of_sets
        self.sets: Kept[Sets] = Kept()

    def asked(self, job: Job, values: Sequence[Any]) -> Ask:
        told = values_of(self._form.fields, values)
        return own_ask(told, job.folder / "results", self._services.config)

    def perform(
        self, job: Job, ask: Ask, form: Mapping[str, Any]
    ) -> Generator[Updates, None, None]:
        if not has_sets(ask.motions):
            yield from super().perform(job, ask, form)
            return
        found = yield from self.done(job, measure_sets, ask, MEASURING_SETS)
        address = self._services.media.share(job.folder, job.cookie)
        token = self.sets.keep(found, job.folder, job.cookie or None)
        figures, files = figures_html(found.files, address), files_listed(found.files, address)
        choices = [(label, f"{token}/{clip}") for label, clip in clip_choices(found.told)]
        line = MEASURED_SETS.format(
            clips=number_of(len(choices), "clip"), sets=number_of(len(found.clips), "set")
        )
        told, clip = self._of_sets
        yield {
            self._status: markup.sentence_status(line),
            self._parts.message: shown(markup.notes_folded(list(found.notes))),
            told: shown(sets_html(found.told, list(found.clips), figures, files)),
            clip: gr.update(choices=choices, value=None, visible=True),
            **self._buttons(is_running=False),
        }

    def _without_results(self) -> Updates:
        told, clip = self._of_sets
        return {**super()._without_results(), told: shown(""), clip: gr.update(visible=False)}


class ClipRunner(RunRunner):
    """Opens a clip of measured sets: a run like any other, under the sets that stay."""

    tab = "own_motion"

    def __init__(
        self, services: Services, form: FormParts, parts: ResultParts, of: OwnMotionRunner
    ) -> None:
        """
        Args:
            of: has measured the sets.
        """
        super().__init__(services, form, parts)
        self._sets, self.videos = of.sets, of.videos

    def asked(self, job: Job, values: Sequence[Any]) -> Ask:
        token, _, clip = str(values[0] if values else "").partition("/")
        sets, config = self._sets.find(token, job.cookie), self._services.config
        if sets is None:
            raise RunError(CLIP_GONE)
        if clip not in sets.told["clips"]:
            raise RunError(CLIP_DAMAGED)
        motions = {name: files[clip] for name, files in sets.clips.items()}
        asked = asked_of(motions, sets.sounds.get(clip), job.folder / "results", config)
        told = sets.ask.told.known(asked.motions, *asked.names)
        title = f"{clip} of {', '.join(asked.names)}"
        return replace(asked, told=told, channel=sets.ask.channel, title=title)


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
