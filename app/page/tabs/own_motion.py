"""The tab of the page that measures and compares motion files of a visitor's own."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.page.parts.asked import Field, Fields, whole
from app.page.parts.catalogue import point_choices
from app.page.parts.html_parts import AT_ONCE, PRIVATE, in_turn, named_fields, reveal_on_click
from app.page.results.result_parts import ResultParts, build_results
from app.page.results.sets_shown import KeptSets
from app.page.tabs.motion import LAST_FRAME, words_of
from app.page.tabs.own_motion_run import (
    ClipRunner,
    OwnMotionRunner,
    display_names,
)
from app.page.tabs.own_sets_run import SetsTools, build_sets
from app.page.tabs.services import Services, UploadCheck
from app.page.tabs.videos_run import VideosBehind
from app.run.examples import RECORDED, planted_files
from app.run.followed_point import TIP
from app.run.many.sets import measure_sets
from app.run.many.unpacked import stem_of
from app.run.requests.request import MAX_COMPARED, read_assumptions, read_channel
from app.run.requests.upload_check import kind_of

TAB = "Your motion"
SETS = (".zip", ".tgz", ".gz", ".tar")
"""Endings of sets; ``.tar.gz`` is one of which browsers know the end alone."""
FILES_LABEL = "Motions, and what goes with them"
FILES_HELP = (
    "Any files: motions (.npz, .npy, .bvh), their speech, its words (.TextGrid, or English as "
    ".txt), zips of clips. What each is is seen from it."
)
RECORDED_LABEL = "Recorded motion among them, as reference"
NO_RECORDED = "none"
_IS_RECORDED = re.compile(r"reference|record|ground.?truth|(?<![a-z])gt(?![a-z])", re.IGNORECASE)
WINDOWS_HELP = (
    "If you know how long the windows are, jumps are looked for where they join. Left empty, every "
    "period from 2 to 240 frames is tried."
)
PLANTED_LABEL = "Try an example with planted faults"
ASSUME_LABEL = "How the files are to be read"
ASSUME_HELP = (
    "What chips on the bodies say is kept here for the next files: up=z, facing=x, units=cm, "
    "rate=25, hands=mean, rotations=6d-columns, motion=2, frames=bridge, lag=.4; of some files "
    "alone *.bvh:up=z or NAME:up=z."
)
CHANNEL_LABEL = "Which side of a dialogue speaks"
SHOWN_LABEL = "Shown on the stage and in figures"
SHOWN_HELP = "At most six with the reference; all are measured."
INTRODUCTION = (
    "Measures motion files of your own as it measures the systems, raw and filtered: "
    "nearly any .npz, .npy or .bvh of a whole body; how each was understood is told. A zip of "
    "clips is measured as a set, several beside each other by the clips' names."
)


def build_own_motion_tab(page: gr.Blocks, services: Services) -> ResultParts:
    """Lay out the tab inside the current context and wire it; returns where it shows results."""
    gr.HTML(f'<p class="hint">{INTRODUCTION}</p>')
    with gr.Row(elem_classes="columns"):
        with gr.Column(scale=4, min_width=320, elem_classes="sheet"):
            form = build_own_form(services.check)
        with gr.Column(scale=9, min_width=320, elem_classes="results"):
            of_sets = build_sets()
            parts = build_results("own-")
    videos = VideosBehind(services, parts, "own_videos")
    sets = SetsTools(partial(services.worker.do, measure_sets), of_sets, KeptSets())
    runner, opener = (
        kind(services, parts, videos, sets, form.fields) for kind in (OwnMotionRunner, ClipRunner)
    )
    asks: dict[str, Any] = {
        "inputs": [field.part for field in form.fields.values()],
        "outputs": [*parts.all, of_sets.shown],
        **in_turn(parts.status),
    }
    for button in (form.start, form.planted):
        reveal_on_click(button, parts.status)
    started = form.start.click(
        named_fields(runner.run, form.fields),
        **asks,
        api_name="own_motion",
    )
    planted = form.planted.click(
        lambda: (planted_files(services.config.temp / "planted"), RECORDED),
        outputs=asks["inputs"][:2],
        **PRIVATE,
        trigger_mode="once",
    ).then(runner.run, **asks, api_visibility="private")
    otherwise = form.otherwise.click(
        None,
        form.assume,
        form.assume,
        js="(said) => document.querySelector('#own-player .lockstep').said(said)",
        api_visibility="private",
    ).then(runner.run, **asks, api_visibility="private")
    for run in (started, planted, otherwise):
        videos.follow(run)
    reveal_on_click(of_sets.start, parts.status)
    of_sets.start.click(
        opener.run,
        inputs=[of_sets.asked],
        outputs=parts.all,
        js="() => [document.querySelector('#own-sets .sets')?.asked ?? '']",
        api_visibility="private",
        **in_turn(parts.status),
    )
    page.unload(videos.left)
    form.cancel.click(runner.cancel, outputs=asks["outputs"], cancels=[started, planted], **AT_ONCE)
    return parts


@dataclass(frozen=True)
class FormParts:
    """The fields by what they ask for (`Ask`), and the buttons."""

    fields: Fields
    start: gr.Button
    cancel: gr.Button
    planted: gr.Button
    assume: gr.Textbox
    otherwise: gr.Button
    """Pressed by the chips of a row: says one thing otherwise, and runs anew."""


def build_own_form(check: UploadCheck) -> FormParts:
    """The left column."""
    planted = gr.Button(PLANTED_LABEL, elem_id="own-planted", size="sm")
    motions = check.file(
        "files",
        FILES_LABEL,
        [".npz", ".npy", ".bvh", ".TextGrid", ".txt", "audio", *SETS],
        "own-motions",
        height=170,
        file_count="multiple",
    )
    gr.HTML(f'<p class="hint">{FILES_HELP}</p>')
    reference = gr.Dropdown(
        choices=[(NO_RECORDED, "")],
        value="",
        allow_custom_value=True,  # as below
        visible=False,
        label=RECORDED_LABEL,
        elem_id="own-reference",
    )
    shown = gr.Dropdown(
        choices=[],
        multiselect=True,
        max_choices=MAX_COMPARED,
        allow_custom_value=True,  # of files just taken away: a click may come before the answer
        visible=False,
        label=SHOWN_LABEL,
        info=SHOWN_HELP,
        elem_id="own-shown",
    )
    channel = gr.Dropdown(
        [("All channels, mixed", ""), ("Left channel", "left"), ("Right channel", "right")],
        value="",
        label=CHANNEL_LABEL,
        elem_id="own-channel",
        visible=False,
    )
    motions.change(_choices, motions, [reference, shown, channel], **AT_ONCE)
    has_words = gr.Checkbox(False, label=text.WORDS_LABEL, info=text.WORDS_HELP)
    point = gr.Dropdown(choices=point_choices(), value=TIP, label=text.POINT_LABEL)
    start_frame = gr.Number(value=0, minimum=0, label=text.START_LABEL)
    has_videos = gr.Checkbox(
        True, label=text.VIDEOS_LABEL, info=text.VIDEOS_HELP, elem_id="own-videos"
    )
    with gr.Accordion("Read otherwise?", open=False):
        assume = gr.Textbox(
            "", max_length=2000, label=ASSUME_LABEL, info=ASSUME_HELP, elem_id="own-assume"
        )
    with gr.Accordion("Made of windows?", open=False):
        gr.HTML(f'<p class="hint">{WINDOWS_HELP}</p>')
        with gr.Row(elem_classes="pair"):
            window = gr.Number(value=None, minimum=0, label="Frames of a window")
            a_window = whole("Frames of a window", 0, LAST_FRAME, 0)
            overlap = gr.Number(value=None, minimum=0, label="Shared by two")
    reason = check.reason()
    with gr.Row(elem_classes="actions"):
        start = gr.Button("Measure and compare", variant="primary", elem_id="own-start")
        cancel = gr.Button(text.CANCEL, elem_id="own-cancel", min_width=110)
    check.guard(start, reason)
    fields = {
        "motions": Field(motions, lambda paths: tuple(map(Path, paths or ()))),
        "reference": Field(reference),
        "joint": Field(point, lambda name: name or TIP),
        "start_frame": Field(start_frame, whole(text.START_LABEL, 0, LAST_FRAME, 0)),
        "window": Field(window, lambda frames: a_window(frames) or None),
        "overlap": Field(overlap, whole("Shared by two", 0, LAST_FRAME, 0)),
        "shown": Field(shown, lambda names: tuple(names or ())),
        "has_video": Field(has_videos),
        "words": Field(has_words, words_of),
        "told": Field(assume, read_assumptions),
        "channel": Field(channel, lambda side: read_channel(side) if side else None),
    }
    otherwise = gr.Button(elem_classes="otherwise-start told-elsewhere")
    return FormParts(fields, start, cancel, planted, assume, otherwise)


def _choices(paths: list[str] | None) -> tuple[Any, Any, Any]:
    """Which motion is the recorded one, as a name says it; which are shown, where not all fit; and
    a channel where there is sound."""
    kinds = {path: kind_of(path) for path in map(Path, paths or ())}
    names = display_names([stem_of(path) for path, kind in kinds.items() if kind == "motions"])
    recorded = next(filter(_IS_RECORDED.search, names), "")
    first = list(names[:MAX_COMPARED])
    return (
        gr.update(choices=[(NO_RECORDED, ""), *names], value=recorded, visible=len(names) > 1),
        gr.update(choices=list(names), value=first, visible=len(names) > MAX_COMPARED),
        gr.update(visible="sounds" in kinds.values()),
    )
