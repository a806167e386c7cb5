"""A run that has ended, as any browser can be shown it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gradio as gr

from app.errors import page_sentence
from app.page.parts import markup
from app.page.parts.html_parts import shown
from app.page.player.player import NOTHING, Showing
from app.page.queue.in_turn import Updates
from app.page.results.figures_shown import FiguresShown
from app.page.results.measures_table import measures_table
from app.page.results.result_parts import ResultParts

if TYPE_CHECKING:
    from model.diagnostics import Diagnostics


@dataclass(frozen=True)
class EndedRun:
    """Everything that a tab shows of it."""

    title: str
    """What it was made of, in a few words."""
    settings: Mapping[str, str]
    """What was asked for, in words, as `app.page.results.settings` has it."""
    speech_sha256: str
    """Of its file; empty where there was none."""
    line: str
    """How it went, in a sentence."""
    notes: tuple[str, ...]
    verdict: str
    diagnostics: Diagnostics
    showing: Showing | None
    """None where nothing was drawn."""
    figures: FiguresShown
    bundle: Path
    files: tuple[Path, ...]
    form: Mapping[str, Any] = field(default_factory=dict)
    """Values of the form that asked for it, by field, as far as whoever opens it may have them."""

    def updates(self, parts: ResultParts, *, begins: bool = False) -> Updates:
        """For the browser that asked for it.

        Args:
            begins: whether it plays at once, where it does not yet.
        """
        player = NOTHING
        if self.showing is not None:
            player = self.showing.value(is_over=True) | {"begins": begins}
        return {
            parts.status: markup.sentence_status(self.line),
            parts.message: shown(markup.notes_folded([page_sentence(note) for note in self.notes])),
            parts.verdict: shown(self.verdict),
            parts.player: player,
            parts.figures: shown(self.figures.html(self.diagnostics)),
            parts.numbers: shown(measures_table(self.diagnostics)),
            parts.downloads_part: gr.update(visible=True),
            parts.bundle: gr.update(value=str(self.bundle)),
            parts.files: [str(file) for file in self.files],
        }

    def for_visitor(self, cookie: str) -> EndedRun:
        """For another browser, whose files have addresses of their own."""
        showing = None if self.showing is None else self.showing.for_visitor(cookie)
        return replace(self, showing=showing, figures=self.figures.for_visitor(cookie))


def sha256_of(path: Path | None) -> str:
    """Of a file that somebody gave; empty of none, or of one that is gone."""
    if path is None or not path.is_file():
        return ""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
