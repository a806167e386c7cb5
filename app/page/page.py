"""The page: its layout and what a click does. It knows neither torch nor GL, only a callable that
does a run."""

from __future__ import annotations

from dataclasses import fields

import gradio as gr

from app import text
from app.config import AppConfig
from app.live.sessions import LiveSessions
from app.page.parts import markup
from app.page.parts.catalogue import Catalogue
from app.page.parts.html_parts import mount, reveal_on_click
from app.page.parts.named_fields import named_fields
from app.page.player.edited_runs import EditedRuns
from app.page.player.first_look_shown import FirstLooks
from app.page.queue.in_turn import Updates
from app.page.queue.jobs import JobBook
from app.page.queue.run_processes import RunProcesses
from app.page.results.kept_runs import PARAMETER, KeptRuns
from app.page.results.result_parts import ResultParts, build_results
from app.page.results.study_preview import StudyPreviews
from app.page.routes.media import MediaAddresses
from app.page.tabs.generate.generate import FormParts, build_form
from app.page.tabs.generate.generate_form import Form
from app.page.tabs.generate.generate_run import Generate, GenerateRunner
from app.page.tabs.generate.opening import Opening
from app.page.tabs.generate.takes_run import MakeTake, TakesRunner
from app.page.tabs.live import live as live_tab
from app.page.tabs.own_motion import own_motion as own_motion_tab
from app.page.tabs.seen_run import SeenRunner
from app.page.tabs.study.study import build_study_tab
from app.page.tabs.study.study_analysis import build_analysis
from app.page.tabs.systems.hearing import build_hearing
from app.page.tabs.systems.mechanism import build_mechanism
from app.page.tabs.systems.step_curve import build_step_curve
from app.page.tabs.systems.systems import build_systems_tab
from app.page.tabs.upload_check import UploadCheck
from app.page.tabs.videos_behind import Draw, VideosBehind
from app.page.visitors.researcher_part import Handover

EXAMPLE_EVERY_S = 0.5
"""How often a page asks for an example that is being made."""


def build_app(
    generate: Generate,
    processes: RunProcesses,
    check: UploadCheck,
    catalogue: Catalogue,
    config: AppConfig,
    jobs: JobBook,
    handover: Handover,
    previews: StudyPreviews,
    addresses: MediaAddresses,
    live: LiveSessions,
    first_look: FirstLooks | None = None,
    draw: Draw | None = None,
    take: MakeTake | None = None,
    kept: KeptRuns | None = None,
) -> gr.Blocks:
    """The whole page.

    Args:
        generate: what a test may replace by a function of its own.
        processes: does all other runs.
        check: of uploads, before there is a run.
        first_look: what plays before the first run.
        draw: the same of the videos of a run; None lets the processes of runs draw them.
        take: the same of a take of it.
        kept: where runs are kept; None is a place of its own.
    """
    draws = draw or processes.draw_behind
    kept = kept or KeptRuns(config.keep_results_s)
    with gr.Blocks(
        title=text.TITLE,
        analytics_enabled=False,
        fill_width=True,
    ) as page:
        gr.HTML(markup.header(catalogue.trained_on))
        gr.HTML(
            own_motion_tab.TAB, html_template="", js_on_load=mount("reopen.js", "mountReopen"),
            apply_default_css=False, elem_classes="told-elsewhere",
        )  # fmt: skip
        with gr.Tabs(overflow_behavior="wrap") as tabs:  # a phone would hide some in a menu
            with gr.Tab(text.MOTION_TAB, id="generate"), gr.Row(elem_classes="columns"):
                with gr.Column(scale=4, min_width=320, elem_classes="sheet"):
                    form = build_form(catalogue, config, check)
                with gr.Column(scale=9, min_width=320, elem_classes="results"):
                    results = build_results(empty=markup.empty_state())
            with gr.Tab(live_tab.TAB):
                live_results = live_tab.build_live_tab(
                    page, generate, catalogue, config, jobs, addresses, live, kept, draws
                )
            with gr.Tab(own_motion_tab.TAB, id="own_motion"):
                own_results = own_motion_tab.build_own_motion_tab(
                    *(page, config, jobs, addresses, processes.diagnose, check, kept, draws),
                    processes.measure_sets,
                )
            with gr.Tab(text.LADDER_TAB) as systems_tab:
                build_mechanism(
                    page, systems_tab, config, jobs, addresses, processes.show_mechanism
                )
                build_systems_tab(catalogue.systems)
                build_hearing(page, catalogue, config, jobs, addresses, processes.measure_hearing)
                build_step_curve(page, catalogue, config, jobs, addresses, processes.measure_steps)
            with gr.Tab(text.STUDY_TAB):
                build_study_tab(
                    page, catalogue, config, jobs, handover, previews, processes.export_study, check
                )
                build_analysis(page, jobs, processes.analyse_study)
        for parts, prefix in ((results, ""), (live_results, "live-"), (own_results, "own-")):
            SeenRunner(processes.draw_seen, config, jobs, addresses, parts).wire(page, prefix)
        videos = VideosBehind(draws, jobs, results, kept, "videos")
        edited = EditedRuns()
        runner = GenerateRunner(
            generate, catalogue, config, jobs, addresses, form, results, kept, videos, edited
        )
        TakesRunner(take or processes.make_take, edited, jobs, results).wire(page)
        if first_look is not None:
            _await_example(page, form, results, first_look)
        _wire(page, form, results, runner, videos)
        places = {"generate": results, "own_motion": own_results}
        named = dict(zip([field.name for field in fields(Form)], form.fields, strict=True))
        opening = Opening(kept, config.keep_results_s, tabs, places, first_look, named)
        page.load(
            opening.opened, outputs=opening.outputs, queue=False, api_visibility="private",
            show_progress="hidden",
        )  # fmt: skip
    return page


def _await_example(
    page: gr.Blocks, form: FormParts, results: ResultParts, first_look: FirstLooks
) -> None:
    """An example that is still being made plays as soon as it is there, unless the visitor shows
    or begins a run meanwhile."""
    timer, seen = gr.Timer(EXAMPLE_EVERY_S, active=False), gr.State(0)

    def wait(request: gr.Request) -> gr.Timer:
        return gr.Timer(active=first_look.is_coming and PARAMETER not in request.query_params)

    def look(before: int) -> Updates:
        is_over, version = not first_look.is_coming, first_look.version
        if version == before and not is_over:
            return {timer: gr.skip()}
        player, empty = first_look.updates()
        going = gr.Timer(active=False) if is_over else gr.skip()
        return {results.player: player, results.empty: empty, seen: version, timer: going}

    page.load(wait, outputs=timer, queue=False, api_visibility="private", show_progress="hidden")
    timer.tick(
        look, inputs=seen, outputs=[results.player, results.empty, seen, timer], queue=False,
        api_visibility="private", show_progress="hidden",
    )  # fmt: skip
    # Listeners of a click are served in turn: before the run, which would come first otherwise.
    form.generate.click(
        lambda: gr.Timer(active=False), outputs=timer, queue=False, api_visibility="private",
        show_progress="hidden",
    )  # fmt: skip


def _wire(
    page: gr.Blocks,
    form: FormParts,
    results: ResultParts,
    runner: GenerateRunner,
    videos: VideosBehind,
) -> None:
    reveal_on_click(form.generate, results.status)
    run = form.generate.click(
        named_fields(runner.run, Form, optional=("reference", "transcript", "plan")),
        inputs=list(form.fields),
        outputs=[*results.all, form.generate, form.cancel],
        api_name="generate",
        show_progress="hidden",
        trigger_mode="once",
        concurrency_limit=None,  # JobBook lets them in one by one and tells each its place
    )
    videos.follow(run)
    page.unload(videos.left)
    form.cancel.click(runner.cancel, queue=False, api_visibility="private", show_progress="hidden")
    page.unload(runner.cancel)
