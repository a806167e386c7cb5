"""What serves all visitors of a page, one of each, as tabs ask for it; uploads are checked."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gradio as gr

from app.config import AppConfig
from app.errors import RunError, visitor_sentence
from app.live.sessions import LiveSessions
from app.page.parts import markup
from app.page.parts.catalogue import Catalogue
from app.page.parts.html_parts import PRIVATE, shown
from app.page.queue.runner import Jobs
from app.page.queue.worker import Worker
from app.page.results.kept_runs import KeptRuns
from app.page.routes.media import Media
from app.page.visitors.visitors import Kept
from app.run.display import Display
from app.run.upload_check import Given, UploadKind, refusal_of
from conventions.views import CLOSE_UPS

log = logging.getLogger(__name__)
SEEN: dict[str, Any] = {"display": Display(has_trail=True), "close_ups": CLOSE_UPS, "size": 640}
"""How runs are shown here: the player has every close-up, and shows those that are wanted."""


def set_here(config: AppConfig, job: Path) -> dict[str, Any]:
    """What this page sets of every ask."""
    return {
        "out": job / "results",
        "weights": config.weights,
        "body": config.body,
        "max_speech_s": config.max_speech_s,
    }


@dataclass(frozen=True)
class Services:
    """Of one page."""

    config: AppConfig
    catalogue: Catalogue
    jobs: Jobs
    worker: Worker
    """Does all runs."""
    videos: Worker
    """Draws what nobody waits for."""
    gate: Worker
    """Checks uploads before there is a run: nobody should wait for another's to hear that a file is
    silent."""
    kept: KeptRuns
    live: LiveSessions
    media: Media = field(default_factory=Media)
    private: Kept[Path] = field(default_factory=Kept)
    """Folders of researchers' parts that wait to be fetched."""
    first_look: tuple[dict[str, Any], Any] | None = None
    """What plays before the first run, and what is said beside it."""
    opened: tuple[str, ...] = ()
    """Tokens of the run that the page was started to show."""

    def file(
        self, kind: UploadKind, label: str, file_types: list[str], elem_id: str, **options: Any
    ) -> gr.File:
        """A watched field for files; ``options`` are Gradio's."""
        field = gr.File(
            label=label, file_types=file_types, type="filepath", elem_id=elem_id, **options
        )
        self.watch(field, kind)
        return field

    def watch(self, field: gr.Audio | gr.File, kind: UploadKind) -> None:
        """Say under a field, as soon as something is put there, why it cannot be used; called right
        after the field."""
        refusal = gr.HTML("", visible=False, elem_id=f"{field.elem_id}-refusal")
        field.change(
            lambda value: shown(markup.refusal(self._refusal(kind, value))),
            field,
            refusal,
            **PRIVATE,
            concurrency_limit=4,
        )

    def _refusal(self, kind: UploadKind, value: str | list[str] | None) -> str:
        paths = [Path(path) for path in ([value] if isinstance(value, str) else value or ())]
        try:
            given = Given(kind, paths, self.config.max_speech_s)
            sentence = self.gate.do(refusal_of, given) if paths else ""
        except Exception as error:  # of the checking, which took too long or failed itself
            log.warning("an upload could not be checked: %s", error)
            return ""
        return visitor_sentence(RunError(sentence)) if sentence else ""
