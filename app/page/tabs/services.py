"""What serves all visitors of a page, one of each, as tabs ask for it; uploads are checked."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.config import AppConfig
from app.errors import RunError, visitor_sentence
from app.live.sessions import LiveSessions
from app.page.parts import markup
from app.page.parts.catalogue import Catalogue
from app.page.parts.html_parts import PRIVATE, shown
from app.page.queue.jobs import Jobs
from app.page.queue.worker import Worker
from app.page.results.kept_runs import KeptRuns
from app.page.results.study_preview import StudyPreviews
from app.page.routes.media import MediaAddresses
from app.page.visitors.researcher_part import Handover
from app.run.requests.upload_check import Given, UploadKind, refusal_of

log = logging.getLogger(__name__)


class UploadCheck:
    """Watches the fields of a page."""

    def __init__(self, worker: Worker, max_speech_s: float) -> None:
        """
        Args:
            worker: apart from that of the runs: nobody should wait for another's run to hear that a
                file is silent.
        """
        self._worker = worker
        self._max_speech_s = max_speech_s
        self._refusals: list[gr.HTML] = []

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
        """Say under a field why what was put there cannot be used; called right after the field."""
        name = f"{field.elem_id}-refusal" if field.elem_id else None
        refusal = gr.HTML("", visible=False, elem_id=name)
        self._refusals.append(refusal)
        field.change(
            lambda value: self._told(kind, value),
            field,
            refusal,
            **PRIVATE,
            concurrency_limit=4,
        )

    @staticmethod
    def reason() -> gr.HTML:
        """Where it is said why a button is disabled."""
        return gr.HTML("", visible=False)

    def guard(self, button: gr.Button, reason: gr.HTML) -> None:
        """Disable the button of a form while a file in one of its fields cannot be used: of those
        that are watched since the last form."""
        refusals, self._refusals = self._refusals, []

        def held(was_held: str, *sentences: str) -> tuple[Any, Any]:
            is_held = any(sentences)
            if is_held == bool(was_held):  # a run that has begun meanwhile keeps the button
                return gr.skip(), gr.skip()
            why = markup.refusal(text.UNUSABLE) if is_held else ""
            return gr.update(interactive=not is_held), shown(why)

        gr.on(
            [refusal.change for refusal in refusals], held, [reason, *refusals], [button, reason],
            **PRIVATE, queue=False,
        )  # fmt: skip

    def _told(self, kind: UploadKind, value: str | list[str] | None) -> Any:
        paths = [Path(path) for path in ([value] if isinstance(value, str) else value or ())]
        try:
            given = Given(kind, paths, self._max_speech_s)
            sentence = self._worker.do(refusal_of, given) if paths else ""
        except Exception as error:  # of the checking, which took too long or failed itself
            log.warning("an upload could not be checked: %s", error)
            sentence = ""
        if sentence:
            sentence = visitor_sentence(RunError(sentence))
        return shown(markup.refusal(sentence))


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
    check: UploadCheck
    """Of uploads, before there is a run."""
    kept: KeptRuns
    handover: Handover
    live: LiveSessions
    addresses: MediaAddresses = field(default_factory=MediaAddresses)
    previews: StudyPreviews = field(default_factory=StudyPreviews)
    first_look: tuple[dict[str, Any], Any] | None = None
    """What plays before the first run, and what is said beside it."""
    opened: tuple[str, ...] = ()
    """Tokens of the run that the page was started to show."""
