"""Tab "Live", in which a body moves to live speech, with a run of the last minute."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gradio as gr

from app import text
from app.page.parts.catalogue import Catalogue, example_title
from app.page.parts.markup import mount_script
from app.page.results.result_parts import ResultParts
from app.page.routes.live_route import EXAMPLE_ROUTE
from app.page.tabs.motion import FormParts
from app.page.tabs.motion_run import MotionRunner
from app.page.tabs.runner import PAGE_VIDEO_OPTIONS, Services
from app.page.visitors.job_folders import Job
from app.run.requests.convert import replace_fields
from app.run.requests.requests import GenerateRequest
from model.systems.registry import family_of, representatives

_MAX_TOKEN = 100


class LiveRecordingRunner(MotionRunner):
    """Runner that makes a run of the last minute of a live session."""

    tab = "live"

    def make_request(self, job: Job, values: Sequence[Any]) -> GenerateRequest:
        """Write the last minute to the job's folder, and return its request; raises RunError."""
        token = values[0] if isinstance(values[0], str) else ""
        recording = self.services.live.save_last_minute(token[:_MAX_TOKEN], job.cookie, job.folder)
        config = self.services.config_with_character(job)
        display = {**PAGE_VIDEO_OPTIONS, "figure_formats": ("png",)}
        return replace_fields(recording, weights=config.weights, body=config.body, **display)


TAB = "Live"
INTRODUCTION = (
    "Speak, and the body moves about a second later. Audio is sent only to the server of this "
    "page, which keeps the last minute in memory until ten minutes after you stop."
)
KEEP = "Save the last minute"
SAVE_HELP = "Saves the last minute as a run with audio, video, figures, metrics and downloads."
_TOKEN_OF_PAGE = "() => [document.querySelector('.live')?.live?.stopForSaving() ?? '']"


def build_live_tab(page: gr.Blocks, services: Services) -> ResultParts:
    """Lay out and wire the tab in the current context; return its result components."""
    gr.HTML(f'<p class="hint">{INTRODUCTION}</p>')
    gr.HTML(
        live_choices(services.catalogue),
        html_template='<div class="live"></div>',
        js_on_load=mount_script("live/live.js", "mountLive"),
        apply_default_css=False,
        elem_id="live",
    )
    token = gr.Textbox(visible=False)
    with gr.Row():
        keep = gr.Button(KEEP, elem_id="live-keep", scale=0, min_width=220)
        cancel = gr.Button(
            text.CANCEL, visible=False, elem_id="live-cancel", scale=0, min_width=110
        )
    results = ResultParts("live-", SAVE_HELP)
    runner = LiveRecordingRunner(services, FormParts({}, keep, cancel), results)
    runner.attach_events(page, [token], js=_TOKEN_OF_PAGE)
    return results


def live_choices(catalogue: Catalogue) -> dict[str, Any]:
    """Return the choices of the browser's live form, defaults first."""
    live = [name for name in catalogue.systems if name not in family_of(name).offline_only]
    usual = representatives("streaming")
    systems = sorted(live, key=lambda name: name not in usual)
    return {
        "systems": systems,
        "speakers": list(catalogue.speakers),
        "examples": [
            {"label": example_title(path), "url": f"{EXAMPLE_ROUTE.lstrip('/')}/{path.name}"}
            for path in catalogue.examples
        ],
    }
