"""Runs that have ended, each behind a link that opens it again for as long as its files are kept.

The link holds 256 random bits. Whoever has it sees the run; a browser's own runs are listed for it
alone, by the page's cookie.
"""

from __future__ import annotations

import secrets
import threading
import time
from dataclasses import dataclass, field
from html import escape

from app import text
from app.page.results.ended_run import EndedRun
from app.page.serving.jobs import Job
from app.page.serving.visitors import is_same

PARAMETER = "run"
"""Of the page's address."""
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
    def address(self) -> str:
        """Relative to the page."""
        return f"?{PARAMETER}={self.token}"

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

    def html(self, cookie: str, shown: KeptRun | None = None) -> str:
        """The link of the run that is shown, and the list of the browser's own; empty without any.

        app/page/web/runs.js copies the link and writes times as the browser's clock has them.
        """
        link = ""
        if shown is not None:
            minutes = max(1, round((shown.ended + self._keep_s - time.time()) / 60))
            link = (
                f'<p class="link"><a href="{escape(shown.address)}">{text.RUN_LINK}</a>'
                f'<button type="button">{text.COPY_LINK}</button>'
                f"<span>{text.RUN_KEPT.format(minutes=minutes)}</span></p>"
            )
        items = "".join(_item(run, run == shown) for run in self.of(cookie))
        if not link and not items:
            return ""
        listed = f"<details><summary>{text.YOUR_RUNS}</summary><ol>{items}</ol></details>"
        return f'<div class="runs">{link}{listed if items else ""}</div>'


def _item(run: KeptRun, is_shown: bool) -> str:
    here = ' aria-current="page"' if is_shown else ""
    return (
        f'<li><time data-at="{run.ended:.0f}"></time>'
        f'<a href="{escape(run.address)}"{here}>{escape(run.run.title)}</a></li>'
    )
