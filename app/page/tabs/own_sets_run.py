"""Zips of results on the tab "Your motion": measured as sets, and any clip of them opened."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import gradio as gr

from app.errors import RunError
from app.page.parts import markup
from app.page.parts.html_parts import mount, shown
from app.page.player.player import NOTHING
from app.page.queue.jobs import Job
from app.page.queue.runner import Updates, last_share
from app.page.results.result_parts import ResultParts, figures_html
from app.page.results.sets_shown import KeptSets, number_of, sets_html
from app.page.routes.media import MediaAddresses
from app.run.output.result_folder import zip_files
from app.run.requests.request import Ask, Event, OnEvent, ShouldCancel

if TYPE_CHECKING:
    from app.run.many.sets import Sets

MIXED = "Give zips of results only, or motion files only; a zip is measured as one set."
REFERENCE_TOO = (
    "Where motions come as zips, the {what} comes as a zip as well, named alike by clip."
)
NO_SETS = "A zip goes beside zips: give the motions as zips as well, one for each system."
MEASURING_SETS = "Measuring clips: {share:.0%}"
MEASURED_SETS = "Measured {clips} of {sets}. Any of them opens on the stage."
CLIP_GONE = "These clips are kept no longer; give the zips again."
CLIP_DAMAGED = "What was asked for is no clip of these sets; load the page again."
SETS_ZIP = "Tables and figures as one zip"
MAX_ASKED = 2000

MeasureSets = Callable[[Ask, OnEvent, ShouldCancel], "Sets"]


@dataclass(frozen=True)
class SetsParts:
    """Where sets are shown, and what opens a clip."""

    shown: gr.HTML
    asked: gr.Textbox
    start: gr.Button
    """Pressed by app/page/web/sets.js."""


def build_sets() -> SetsParts:
    """Lay them out; hidden until there are any."""
    part = gr.HTML(
        "",
        visible=False,
        js_on_load=mount("sets.js", "mountSets"),
        apply_default_css=False,
        elem_id="own-sets",
    )
    return SetsParts(
        part,
        gr.Textbox(visible=False),
        gr.Button(elem_classes="clip-start told-elsewhere", elem_id="own-clip-start"),
    )


@dataclass(frozen=True)
class SetsTools:
    """What the tab needs for sets."""

    measure: MeasureSets
    parts: SetsParts
    kept: KeptSets

    @contextmanager
    def work(
        self,
        ask: Ask,
        job: Job,
        cookie: str,
        addresses: MediaAddresses,
        parts: ResultParts,
    ) -> Iterator[SetsWork]:
        """One measuring of them."""
        yield SetsWork(self, ask, job, cookie, addresses, parts)

    def clip_of(self, told: object, cookie: str) -> Clip:
        """What app/page/web/sets.js asks for.

        Raises:
            RunError: where it is none of what this browser has brought.
        """
        try:
            if not isinstance(told, str) or len(told) > MAX_ASKED:
                raise ValueError
            known = json.loads(told)
            token, clip = str(known["sets"]), str(known["clip"])
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise RunError(CLIP_DAMAGED) from error
        kept = self.kept.find(token, cookie)
        if kept is None:
            raise RunError(CLIP_GONE)
        if clip not in kept.sets.told["clips"]:
            raise RunError(CLIP_DAMAGED)
        motions = {name: files[clip] for name, files in kept.sets.clips.items()}
        return Clip(clip, motions, kept.sets.sounds.get(clip), kept.sets.ask)


@dataclass(frozen=True)
class Clip:
    """One clip of all sets."""

    name: str
    motions: dict[str, Path]
    """By set, the reference among them."""
    sound: Path | None
    ask: Ask
    """Of which it is one."""


@dataclass(frozen=True)
class SetsWork:
    """One run over zips."""

    tools: SetsTools
    ask: Ask
    job: Job
    cookie: str
    addresses: MediaAddresses
    parts: ResultParts

    def run(self, on_event: OnEvent, should_cancel: ShouldCancel) -> Sets:
        return self.tools.measure(self.ask, on_event, should_cancel)

    def progress(self, events: list[Event]) -> Updates:
        share = last_share(events)
        if share is None:
            return {}
        line = MEASURING_SETS.format(share=share)
        return {self.parts.status: markup.sentence_status(line)}

    def finished(self, result: Sets) -> Updates:
        kept = self.tools.kept.keep(self.cookie, self.job.folder, result)
        figures = figures_html(result.files, lambda path: self.addresses.address(path, self.cookie))
        bundle = zip_files(result.files, self.job.folder / "own-sets.zip")
        address = escape(self.addresses.address(bundle, self.cookie))
        link = f'<a href="{address}" download="{bundle.name}">{SETS_ZIP}</a>'
        line = MEASURED_SETS.format(
            clips=number_of(len(result.told["clips"]), "clip"),
            sets=number_of(len(result.clips), "set"),
        )
        told = sets_html(kept.token, result.told, list(result.clips), figures, link)
        return {
            self.parts.status: markup.sentence_status(line),
            self.parts.message: shown(markup.notes_folded(list(result.notes))),
            self.parts.player: NOTHING,
            self.tools.parts.shown: shown(told),
        }
