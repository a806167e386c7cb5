"""Zips of results on the tab "Your motion": measured as sets, and any clip of them opened."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import gradio as gr

from app.errors import RunError
from app.page.parts import markup
from app.page.parts.html_parts import shown
from app.page.queue.runner import Updates
from app.page.results.result_parts import ResultParts, figures_html, files_listed
from app.page.results.sets_shown import clip_choices, number_of, sets_html
from app.page.routes.media import Address
from app.page.visitors.kept import Kept
from app.run.many.sets import Sets
from app.run.requests.request import Ask

MIXED = "Give zips of results only, or motion files only; a zip is measured as one set."
REFERENCE_TOO = (
    "Where motions come as zips, the {what} comes as a zip as well, named alike by clip."
)
NO_SETS = "A zip goes beside zips: give the motions as zips as well, one for each system."
MEASURING_SETS = "Measuring clips: {share:.0%}"
MEASURED_SETS = "Measured {clips} of {sets}. Any of them opens on the stage."
CLIP_GONE = "These clips are kept no longer; give the zips again."
CLIP_DAMAGED = "What was asked for is no clip of these sets; load the page again."
CLIP_LABEL = "Open a clip on the stage"


SetsParts = tuple[gr.HTML, gr.Dropdown]
"""Where sets are shown, and which of their clips is opened."""


@dataclass(frozen=True)
class Clip:
    """One clip of all sets."""

    name: str
    motions: dict[str, Path]
    """By set, the reference among them."""
    sound: Path | None
    ask: Ask
    """Of which it is one."""


def clip_of(kept: Kept[Sets], told: object, cookie: str) -> Clip:
    """
    Args:
        told: what was chosen among `sets_updates`.

    Raises:
        RunError: where it is none of what this browser has brought.
    """
    token, _, clip = str(told).partition("/")
    sets = kept.find(token, cookie)
    if sets is None:
        raise RunError(CLIP_GONE)
    if clip not in sets.told["clips"]:
        raise RunError(CLIP_DAMAGED)
    motions = {name: files[clip] for name, files in sets.clips.items()}
    return Clip(clip, motions, sets.sounds.get(clip), sets.ask)


def sets_updates(
    sets: Sets, token: str, address: Address, parts: ResultParts, of_sets: SetsParts
) -> Updates:
    """All that a tab shows of sets.

    Args:
        token: by which their browser asks for a clip.
        address: gives it their files.
    """
    figures = figures_html(sets.files, address)
    clips, names = sets.told["clips"], list(sets.clips)
    line = MEASURED_SETS.format(
        clips=number_of(len(clips), "clip"), sets=number_of(len(names), "set")
    )
    told = sets_html(sets.told, names, figures, files_listed(sets.files, address))
    return {
        parts.status: markup.sentence_status(line),
        parts.message: shown(markup.notes_folded(list(sets.notes))),
        of_sets[0]: shown(told),
        of_sets[1]: gr.update(
            choices=[(label, f"{token}/{clip}") for label, clip in clip_choices(sets.told)],
            value=None,
            visible=True,
        ),
    }
