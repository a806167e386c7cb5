"""Runs that have ended, as any browser can be shown them, each behind a link that opens it again.

The link holds 256 random bits. Whoever has it sees the run; a browser's own runs are listed for it
alone, by the page's cookie.
"""

from __future__ import annotations

import hashlib
import secrets
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gradio as gr

from app import text
from app.errors import page_sentence
from app.page.parts import markup
from app.page.parts.html_parts import shown
from app.page.player.player import NOTHING, Showing
from app.page.queue.jobs import Job
from app.page.queue.runner import Updates
from app.page.results.measures_table import measures_table
from app.page.results.result_parts import FiguresShown, ResultParts
from app.page.visitors.visitors import is_same

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


PARAMETER = "run"
"""Of the page's address."""
RUN_ROUTE = "/media/run"
"""Below which a run is had as a file, by its token."""
_TOKEN_BYTES = 32


@dataclass(frozen=True)
class KeptRun:
    """One run that can be opened again."""

    token: str
    job: Job
    """The link is as good as its folder is there."""
    cookie: str
    """Of the browser that asked for it; empty for one that keeps none."""
    run: EndedRun
    ended: float = field(default_factory=time.time)

    @property
    def is_there(self) -> bool:
        return self.job.folder.is_dir()


class KeptRuns:
    """All runs that can be opened again. Safe to use from several threads."""

    def __init__(self, keep_s: float) -> None:
        """
        Args:
            keep_s: for as long files are kept; only to be told.
        """
        self._keep_s = keep_s
        self._runs: dict[str, KeptRun] = {}
        self._lock = threading.Lock()

    def keep(self, job: Job, cookie: str, run: EndedRun) -> KeptRun:
        kept = KeptRun(secrets.token_urlsafe(_TOKEN_BYTES), job, cookie, run)
        with self._lock:
            for token in [token for token, one in self._runs.items() if not one.is_there]:
                del self._runs[token]
            self._runs[kept.token] = kept
        return kept

    def complete(self, token: str, bundle: Path, files: tuple[Path, ...]) -> None:
        """More has come of a run since it ended."""
        with self._lock:
            kept = self._runs.get(token)
            if kept is not None:
                whole = replace(kept.run, bundle=bundle, files=files)
                self._runs[token] = replace(kept, run=whole)

    def find(self, token: str) -> KeptRun | None:
        """None of a token that is none, or whose files are gone."""
        with self._lock:
            run = self._runs.get(token)
        return run if run is not None and run.is_there else None

    def of(self, cookie: str) -> list[KeptRun]:
        """A browser's own, the newest first."""
        with self._lock:
            runs = list(self._runs.values())
        mine = [run for run in runs if is_same(run.cookie, cookie) and run.is_there]
        return sorted(mine, key=lambda run: run.ended, reverse=True)

    def html(self, cookie: str, *opened: KeptRun) -> str:
        """The link of the run that is shown, or of two beside each other, and the list of the
        browser's own; empty without any.

        app/page/web/runs.js copies the link, sees that two are ticked, and writes times as the
        browser's clock has them.
        """
        mine = self.of(cookie)
        items = "".join(_item(run, run in opened, len(mine) > 1) for run in mine)
        if not opened and not items:
            return ""
        link = ""
        if opened:
            minutes = (min(run.ended for run in opened) + self._keep_s - time.time()) / 60
            words = text.RUN_LINK if len(opened) == 1 else text.PAIR_LINK
            link = (
                f'<p class="link"><a href="{escape(address_of(*opened))}">{words}</a>'
                f'<button type="button">{text.COPY_LINK}</button>'
                f"<span>{text.RUN_KEPT.format(minutes=max(1, round(minutes)))}</span></p>"
                f"{_saved(*opened)}"
                f"{_beside(opened, mine)}"
            )
        compare = f'<button>{text.COMPARE}</button><span class="how">{text.COMPARE_HELP}</span>'
        listed = (
            f"<details><summary>{text.YOUR_RUNS} ({len(mine)})</summary>"
            f'<form method="get" target="_blank"><ol>{items}</ol>'
            f"{compare if len(mine) > 1 else ''}</form></details>"
        )
        return f'<div class="runs">{link}{listed if items else ""}</div>'


def address_of(*runs: KeptRun) -> str:
    """Of one run, or of two beside each other; relative to the page."""
    return "?" + "&".join(f"{PARAMETER}={run.token}" for run in runs)


def _saved(*opened: KeptRun) -> str:
    """The ways to a run as a file, which the page opens again, and as one that plays anywhere."""
    (first, *others) = opened
    if others or first.run.showing is None:
        return ""
    address = f"{RUN_ROUTE.lstrip('/')}/{escape(first.token)}"
    link = f'<a href="{address}" download title="{text.SAVE_RUN_HELP}">{text.SAVE_RUN}</a>'
    page = f'<a href="{address}/page" download title="{text.SAVE_PAGE_HELP}">{text.SAVE_PAGE}</a>'
    return f"<p>{link}</p><p>{page}</p>"


def _beside(opened: tuple[KeptRun, ...], mine: list[KeptRun]) -> str:
    """The shortest way to what most want to see: a run beside the one before, of the same speech
    where there is one."""
    (shown, *others) = opened
    before = [run for run in mine if run.ended < shown.ended]
    if others or not before:
        return ""
    speech = shown.run.speech_sha256
    alike = [run for run in before if speech and run.run.speech_sha256 == speech]
    other = (alike or before)[0]
    words = text.COMPARE_LAST if alike else text.COMPARE_OTHER
    return (
        f'<p><a href="{escape(address_of(other, shown))}" target="_blank" '
        f'title="{escape(other.run.title)}">{words}</a></p>'
    )


def _item(run: KeptRun, is_shown: bool, is_ticked_off: bool) -> str:
    here = ' aria-current="page"' if is_shown else ""
    title = escape(run.run.title)
    tick = (
        f'<input type="checkbox" name="{PARAMETER}" value="{escape(run.token)}" '
        f'aria-label="{text.COMPARE_THIS.format(title=title)}"{" checked" if is_shown else ""}>'
    )
    return (
        f"<li>{tick if is_ticked_off else ''}"
        f'<time data-at="{run.ended:.0f}"></time>'
        f'<a href="{escape(address_of(run))}"{here}>{title}</a></li>'
    )
