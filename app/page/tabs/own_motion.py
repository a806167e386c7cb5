"""The tab of the page that measures and compares motion files of a visitor's own."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.page.parts.asked import Field, some_files, whole
from app.page.parts.catalogue import point_choices
from app.page.parts.html_parts import AT_ONCE, PRIVATE, reveal_on_click, told_part
from app.page.results.result_parts import ResultParts, build_results
from app.page.tabs.motion import LAST_FRAME, FormParts, words_of
from app.page.tabs.own_motion_run import ClipRunner, OwnMotionRunner, display_names
from app.page.tabs.services import Services
from app.run.ask import MAX_COMPARED, read_assumptions, read_channel
from app.run.examples import RECORDED, planted_files
from app.run.followed_point import TIP
from app.run.many.unpacked import stem_of
from app.run.upload_check import kind_of

TAB = "Your motion"
SETS = (".zip", ".tgz", ".gz", ".tar")
"""Endings of sets; ``.tar.gz`` is one of which browsers know the end alone."""
FILES_LABEL = "Motions, and what goes with them"
FILES_HELP = (
    "Any files: motions (.npz, .npy, .bvh), their speech, its words (.TextGrid, or English as "
    ".txt), zips of clips. No order is needed: each is known by what is in it."
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
CLIP_LABEL = "Open a clip on the stage"
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
            planted = gr.Button(PLANTED_LABEL, elem_id="own-planted", size="sm")
            form = build_own_form(services)
        with gr.Column(scale=9, min_width=320, elem_classes="results"):
            of_sets = (
                told_part("own-sets", "figures.js", "mountFigures"),
                gr.Dropdown([], label=CLIP_LABEL, visible=False, elem_id="own-sets-clip"),
            )
            parts = build_results("own-")
    runner = OwnMotionRunner(services, form, parts, of_sets)
    motions, recorded, assume = (
        form.fields[each].part for each in ("motions", "reference", "told")
    )
    reveal_on_click(planted, parts.status)
    filled = planted.click(
        lambda: (planted_files(services.config.temp / "planted"), RECORDED),
        outputs=[motions, recorded],
        **PRIVATE,
        trigger_mode="once",
    )
    # Pressed by the chips of a row: says one thing otherwise, and runs anew.
    otherwise = gr.Button(elem_classes="otherwise-start told-elsewhere")
    said = otherwise.click(
        None,
        assume,
        assume,
        js="(said) => document.querySelector('#own-player .lockstep').said(said)",
        api_visibility="private",
    )
    runner.wire(page, form.fields, (filled.then, said.then), api_name="own_motion")
    ClipRunner(services, form, parts, runner).after(of_sets[1].input, [of_sets[1]])
    return parts


def build_own_form(services: Services) -> FormParts:
    """The left column."""
    motions = services.file(
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
    with gr.Row(elem_classes="actions"):
        start = gr.Button("Measure and compare", variant="primary", elem_id="own-start")
        cancel = gr.Button(text.CANCEL, elem_id="own-cancel", visible=False, min_width=110)
    fields = {
        "motions": Field(motions, some_files),
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
    return FormParts(fields, start, cancel)


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
