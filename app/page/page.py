"""Page with its layout and event handlers, which import neither torch nor OpenGL."""

from __future__ import annotations

import gradio as gr

from app import text
from app.page.parts import markup
from app.page.parts.markup import UNQUEUED_EVENT, mount_script
from app.page.results.result_parts import ResultParts
from app.page.tabs import live as live_tab
from app.page.tabs import own_motion as own_motion_tab
from app.page.tabs import systems
from app.page.tabs.motion import build_form
from app.page.tabs.motion_run import GenerateRunner, PageLoader
from app.page.tabs.runner import Services
from app.page.tabs.stage import EditRunner, ViewerVideoRunner
from app.page.tabs.study import build_analysis, build_study_tab
from app.page.visitors.visitors import VISITOR_ROUTE, page_session_of

_FORM_ID = "motion-form"
_FORM = f"document.getElementById('{_FORM_ID}')"
_SAY = "document.querySelectorAll('#status .idle p, #own-status .idle p').forEach"
_BEGIN_LOADING = f"""() => {{
  fetch('.{VISITOR_ROUTE}', {{ method: 'POST' }});
  {_FORM}.inert = true;
  if (location.search) {_SAY}((line) => (line.textContent = '{text.LOADING}'));
}}"""
"""JavaScript that disables the form until the run of a link has filled it in, which would replace
the visitor's own input, and says that the run is loading."""
_END_LOADING = f"""() => {{
  {_FORM}.inert = false;
  {_SAY}((line) => (line.textContent = '{text.READY}'));
  document.documentElement.dataset.ready = '';
}}"""
"""JavaScript that enables the form and sets ``<html data-ready>`` for scripts that wait."""


def build_app(services: Services) -> gr.Blocks:
    with gr.Blocks(title=text.TITLE, analytics_enabled=False, fill_width=True) as page:
        gr.HTML(markup.header(services.catalogue.trained_on))
        gr.HTML(
            own_motion_tab.TAB,
            html_template="",
            js_on_load=mount_script("reopen.js", "mountReopen"),
            apply_default_css=False,
            elem_classes="told-elsewhere",
        )
        name_of_page = gr.HTML(
            "",
            html_template="",
            js_on_load=mount_script("leaving.js", "mountLeaving")
            + mount_script("back.js", "mountBack")
            + mount_script("help.js", "mountHelp"),
            apply_default_css=False,
            elem_classes="told-elsewhere",
        )
        with gr.Tabs(overflow_behavior="wrap") as tabs:  # otherwise a phone hides some in a menu
            with gr.Tab(text.MOTION_TAB, id="generate"), gr.Row(elem_classes="columns"):
                with gr.Column(scale=4, min_width=320, elem_classes="sheet", elem_id=_FORM_ID):
                    form = build_form(services)
                with gr.Column(scale=9, min_width=320, elem_classes="results"):
                    results = ResultParts()
                    if (
                        services.example_player_value is not None
                        and services.config.run_to_open is None
                    ):
                        results.player.value = services.example_player_value
            with gr.Tab(live_tab.TAB) as tab:
                tab.select(services.live.start_process, **UNQUEUED_EVENT)
                live_results = live_tab.build_live_tab(page, services)
            with gr.Tab(own_motion_tab.TAB, id="own_motion"):
                own_results = own_motion_tab.build_diagnose_tab(page, services)
            with gr.Tab(text.LADDER_TAB):
                systems.RotationNoiseRunner(services)
                systems.build_systems_tab(services.catalogue.systems)
                systems.SpeechEffectRunner(services)
                systems.StepSweepRunner(services)
            with gr.Tab(text.STUDY_TAB):
                build_study_tab(services)
                build_analysis(services)
        gr.HTML(markup.about_paper())
        for parts, prefix in ((results, ""), (live_results, "live-"), (own_results, "own-")):
            ViewerVideoRunner(services, parts).attach_events(prefix)
        EditRunner(services, results).attach_events()
        GenerateRunner(services, form, results).attach_events(
            page, form.fields, api_name="generate"
        )
        places = {"generate": results, "own_motion": own_results}
        page.load(None, js=_BEGIN_LOADING)
        page.load(page_session_of, outputs=name_of_page, **UNQUEUED_EVENT)
        opening = PageLoader(services, tabs, places, form.fields)
        for parts in places.values():
            opening.attach_clip_choice(parts)
        loading = page.load(opening.on_load, outputs=opening.outputs, **UNQUEUED_EVENT)
        for ended in (loading.then, loading.failure):
            ended(None, js=_END_LOADING)
    return page
