"""Tab that measures and compares a visitor's own motion files."""

from __future__ import annotations

import re
import shutil
from collections.abc import Generator, Mapping, Sequence
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.config import AppConfig
from app.errors import RunError
from app.page.parts import markup
from app.page.parts.catalogue import tracked_point_choices
from app.page.parts.form_values import parse_form_values
from app.page.parts.markup import PRIVATE_EVENT, UNQUEUED_EVENT, Updates, update_html
from app.page.results.result_parts import ResultParts, figures_html, file_list_html
from app.page.results.tables import clip_choices, sets_html
from app.page.tabs import motion
from app.page.tabs.motion import FIGURE_FIELDS, LAST_FRAME, FormParts
from app.page.tabs.motion_run import MotionRunner
from app.page.tabs.runner import PAGE_VIDEO_OPTIONS, Services, request_with_page_settings
from app.page.visitors.job_folders import Job
from app.page.visitors.visitors import TokenStore
from app.run.batch.archives import UNPACKED, archive_stem, is_archive
from app.run.batch.saved_run import is_saved_run_zip
from app.run.callbacks import RunCallbacks
from app.run.examples import RECORDED, write_faulty_example
from app.run.requests.convert import replace_fields, request_from
from app.run.requests.parts import DEFAULT_TRACKED_POINT, MAX_COMPARED
from app.run.requests.requests import AnyRun, DiagnoseRequest
from app.run.tasks import MEASURE_SETS, SetResults
from app.run.upload_check import FileKind, file_kind
from conventions.names import REFERENCE_NAME, pluralise, printable
from model.speech.transcript import ENDINGS as WORD_ENDINGS

TAB = "Your motion"
API_FIELDS = (
    *("motions", "recorded", "joint", "start_frame", "window", "overlap", "shown", "has_video"),
    *("words", "told", "channel", *FIGURE_FIELDS),
)
"""Order of the form's fields in the API."""
SETS = (".zip", ".tgz", ".gz", ".tar")
"""Suffixes of archives; browsers see only the end of ``.tar.gz``."""
FILES_HELP = (
    "Motion files (.npz, .npy, .bvh), the speech audio, a transcript (.TextGrid, .srt, .vtt or "
    "English text as .txt), or zips of clips, in any order. The type of each file is detected."
)
NO_RECORDED = "none"
_IS_RECORDED = re.compile(r"reference|record|ground.?truth|(?<![a-z])gt(?![a-z])", re.IGNORECASE)
WINDOWS_HELP = (
    "Many systems generate motion in windows of a fixed length, which can leave jumps at the "
    "seams. Enter the length to check these seams. If the field is empty, every period from 2 to "
    "240 frames is tested."
)
PLANTED_LABEL = "Try an example with injected faults"
ASSUME_LABEL = "Import settings"
ASSUME_HELP = (
    "Corrections of what was detected in the files, separated by commas: up=z, facing=x, units=cm, "
    "rate=25 (fps), hands=mean, rotations=6d-columns, motion=2 (of several), frames=bridge "
    "(interpolates invalid frames), lag=.4 (s). *.bvh:up=z or NAME:up=z corrects only some files. "
    "Corrections that you choose on a file's label in the viewer are added here, and also apply to "
    "files that you add later."
)
CLIP_LABEL = "Show a clip in the viewer"
INTRODUCTION = (
    "Computes the same metrics for your motion files as for the systems here, raw and filtered. "
    "Reads almost any full-body .npz, .npy or .bvh file and shows how each was interpreted. A zip "
    "of clips is evaluated as a set; several sets are paired by clip name."
)


def build_diagnose_tab(page: gr.Blocks, services: Services) -> ResultParts:
    """Lay out and wire the tab in the current context; return its result components."""
    gr.HTML(f'<p class="hint">{INTRODUCTION}</p>')
    with gr.Row(elem_classes="columns"):
        with gr.Column(scale=4, min_width=320, elem_classes="sheet"):
            planted = gr.Button(PLANTED_LABEL, elem_id="own-planted", size="sm")
            form = build_own_motion_form(services)
        with gr.Column(scale=9, min_width=320, elem_classes="results"):
            of_sets = (
                markup.html_hidden_if_empty("own-sets"),
                gr.Dropdown([], label=CLIP_LABEL, visible=False, elem_id="own-sets-clip"),
            )
            parts = ResultParts("own-")
    runner = DiagnoseRunner(services, form, parts, of_sets)
    motions, recorded, assume = (form.fields[each] for each in ("motions", "recorded", "told"))
    markup.scroll_to_on_click(planted, parts.status)
    filled = planted.click(
        lambda: (write_faulty_example(services.config.temp_folder / "planted"), RECORDED),
        outputs=[motions, recorded],
        **PRIVATE_EVENT,
        trigger_mode="once",
    )
    # Clicked by the assumption chips of a row, to change one assumption and measure again.
    override_start = gr.Button(elem_classes="override-start told-elsewhere")
    overrides_box = override_start.click(
        None,
        assume,
        assume,
        js="(message) => document.querySelector('#own-player .lockstep').addOverride(message)",
        api_visibility="private",
    )
    runner.attach_events(
        page, form.fields, (filled.then, overrides_box.then), api_name="own_motion"
    )
    ClipRunner(services, form, parts, runner).start_after(of_sets[1].input, [of_sets[1]])
    return parts


def build_own_motion_form(services: Services) -> FormParts:
    of: dict[str, Any] = {}
    of["motions"] = services.file_field(
        "files",
        "Motion files, speech and transcript",
        [".npz", ".npy", ".bvh", *WORD_ENDINGS, "audio", *SETS],
        "own-motions",
        file_count="multiple",
    )
    gr.HTML(f'<p class="hint">{FILES_HELP}</p>')
    of["recorded"] = gr.Dropdown(
        choices=[(NO_RECORDED, "")],
        value="",
        allow_custom_value=True,  # see below
        visible=False,
        label="Reference motion (a recording)",
        elem_id="own-reference",
    )
    of["shown"] = gr.Dropdown(
        choices=[],
        multiselect=True,
        max_choices=MAX_COMPARED,
        allow_custom_value=True,  # a removed file may still be selected
        visible=False,
        label="Shown in the viewer and in figures",
        info="At most six, including the reference. Metrics are computed for all files.",
        elem_id="own-shown",
    )
    of["channel"] = gr.Dropdown(
        [("All channels, mixed", ""), ("Left channel", "left"), ("Right channel", "right")],
        value="",
        label="Audio channel of the speaker",
        elem_id="own-channel",
        visible=False,
    )
    chosen = [of[name] for name in ("recorded", "shown", "channel")]
    of["motions"].change(_choices, of["motions"], chosen, **UNQUEUED_EVENT)
    of["words"] = gr.Checkbox(False, label=text.WORDS_LABEL, info=text.WORDS_HELP)
    of["joint"] = gr.Dropdown(
        choices=tracked_point_choices(), value=DEFAULT_TRACKED_POINT, label=text.POINT_LABEL
    )
    of["has_video"] = gr.Checkbox(
        True, label=text.VIDEOS_LABEL, info=text.VIDEOS_HELP, elem_id="own-videos"
    )
    with gr.Accordion("Import settings", open=False):
        of["told"] = gr.Textbox(
            "", max_length=2000, label=ASSUME_LABEL, info=ASSUME_HELP, elem_id="own-assume"
        )
    with gr.Accordion("Fingertip figure (Figure 6 of the GlobalDiff paper)", open=False):
        of |= motion.figure_fields()
    with gr.Accordion("Generation windows", open=False):
        gr.HTML(f'<p class="hint">{WINDOWS_HELP}</p>')
        with gr.Row(elem_classes="pair"):
            limits: dict[str, Any] = {"minimum": 0, "maximum": LAST_FRAME}
            of["window"] = gr.Number(value=None, label="Window length (frames)", **limits)
            of["overlap"] = gr.Number(value=None, label="Overlap (frames)", **limits)
    with gr.Row(elem_classes="actions"):
        start = gr.Button("Measure and compare", variant="primary", elem_id="own-start")
        cancel = gr.Button(text.CANCEL, elem_id="own-cancel", visible=False, min_width=110)
    return FormParts({name: of[name] for name in API_FIELDS}, start, cancel)


def _choices(paths: list[str] | None) -> tuple[Any, Any, Any]:
    """Update the choices of files: the recorded motion by its name, shown motions, and channels."""
    paths = list(dict.fromkeys(paths or ()))[: MAX_FILES + len(SINGLE_FILE_KINDS)]
    kinds = {path: file_kind(path) for path in map(Path, paths)}
    names = display_names([archive_stem(path) for path, kind in kinds.items() if kind == "motions"])
    recorded = next(filter(_IS_RECORDED.search, names), "")
    first = list(names[:MAX_COMPARED])
    return (
        gr.update(choices=[(NO_RECORDED, ""), *names], value=recorded, visible=len(names) > 1),
        gr.update(choices=list(names), value=first, visible=len(names) > MAX_COMPARED),
        gr.update(visible="sounds" in kinds.values()),
    )


SINGLE_FILE_KINDS: Mapping[FileKind, str] = {"sounds": "speech file", "transcript": "transcript"}
"""Kinds of files of which there is one for all motions."""
ONE_FILE = "Only one {what} can be used; {count} were added."
NO_REFERENCE = "The reference {name!r} is no longer among the files. Please choose it again."
NO_SETS = "Zips of clips cannot be mixed with single motion files. Add one zip for each system."
SetsParts = tuple[gr.HTML, gr.Dropdown]
"""Components for the results of sets and for the selection of a clip."""
MAX_FILES = 24
TOO_MANY = "At most {limit} files are measured at once; {count} were given."
TOO_MANY_SHOWN = "At most {limit} motions can be shown side by side; {count} are selected."
DIAGNOSE_DEFAULTS: dict[str, Any] = {
    **PAGE_VIDEO_OPTIONS,
    "picture_height_px": 512,
    "max_total_frames": 108_000,
}
"""Fields of this tab's requests; the limit is an hour of frames, which the command line lacks."""
MAX_NAME = 60
"""Maximum length of a file's name in figures and tables (characters)."""


def own_motion_request(values: Mapping[str, Any], job: Path, config: AppConfig) -> DiagnoseRequest:
    """Make the request of a form from the result of `parse_form_values`; raises RunError."""
    values = motion.with_default_panels(values)
    values |= assign_files_to_fields(values["motions"], values.pop("recorded"))
    motions, reference, speech = values["motions"], values["reference"], values["speech"]
    if not motions:
        raise RunError("Choose at least one motion file (.npz, .npy or .bvh), or a zip of many.")
    if is_saved_run_zip(motions):
        return request_for_motions({"run": motions[0]}, None, job, config)
    limit = MAX_COMPARED - (reference is not None)
    if has_clip_archives(motions):
        if len(motions) > limit:
            raise RunError(TOO_MANY_SHOWN.format(limit=limit, count=len(motions)))
        of_sets = ("motions", "names", "reference", "speech", "told", "channel")
        chosen = {name: values[name] for name in of_sets} | {"out": job / "results"}
        return request_from(DiagnoseRequest, chosen)
    if len(motions) > MAX_FILES:
        raise RunError(TOO_MANY.format(limit=MAX_FILES, count=len(motions)))
    names = values["names"]
    chosen = tuple(name for name in values["shown"] if name in names)
    if len(chosen) > limit:
        raise RunError(TOO_MANY_SHOWN.format(limit=limit, count=len(chosen)))
    files = [*motions, *filter(None, [reference])]
    if any(map(is_archive, [*files, *filter(None, [speech])])):
        raise RunError(NO_SETS)
    values["shown"] = chosen if len(motions) > limit else ()
    values["told"] = values["told"].restricted_to(files, *names)
    return request_with_page_settings(DiagnoseRequest, {**DIAGNOSE_DEFAULTS, **values}, config, job)


def assign_files_to_fields(files: Sequence[Path], recorded: str | None) -> dict[str, Any]:
    """Assign files to the request's fields by their kind; raises RunError if that is not unique."""
    if len(files) > MAX_FILES + len(SINGLE_FILE_KINDS):
        raise RunError(TOO_MANY.format(limit=MAX_FILES, count=len(files)))
    by_kind: dict[FileKind, list[Path]] = {"motions": [], "sounds": [], "transcript": []}
    for path in files:
        by_kind[file_kind(path)].append(path)
    for kind, what in SINGLE_FILE_KINDS.items():
        if len(by_kind[kind]) > 1:
            raise RunError(ONE_FILE.format(what=what, count=len(by_kind[kind])))
    names = display_names([archive_stem(path) for path in by_kind["motions"]])
    motions = dict(zip(names, by_kind["motions"], strict=True))
    if recorded and recorded not in motions:
        raise RunError(NO_REFERENCE.format(name=printable(recorded)))
    reference = motions.pop(recorded) if recorded else None
    speech, transcript = (next(iter(by_kind[kind]), None) for kind in SINGLE_FILE_KINDS)
    return {
        "motions": tuple(motions.values()),
        "names": tuple(motions),
        "reference": reference,
        "speech": speech,
        "transcript": transcript,
    }


def has_clip_archives(motions: Sequence[Path]) -> bool:
    """Check whether archives of clips are measured."""
    return any(map(is_archive, motions)) and not is_saved_run_zip(motions)


def display_names(stems: Sequence[str]) -> tuple[str, ...]:
    """Return shortened, unique names of files."""
    names: list[str] = []
    for stem in stems:
        name = printable(stem)[:MAX_NAME] or "motion"
        number = 2
        unique = name
        while unique in names:
            unique = f"{name} ({number})"
            number += 1
        names.append(unique)
    return tuple(names)


class DiagnoseRunner(MotionRunner):
    """Runner that measures motion files of a visitor, or archives of many."""

    tab = "own_motion"

    def __init__(
        self, services: Services, form: FormParts, parts: ResultParts, of_sets: SetsParts
    ) -> None:
        super().__init__(services, form, parts)
        self._of_sets = of_sets
        self.outputs += of_sets
        self.sets: TokenStore[SetResults] = TokenStore()

    def make_request(self, job: Job, values: Sequence[Any]) -> DiagnoseRequest:
        fields = parse_form_values(DiagnoseRequest, self.form.fields, values)
        return own_motion_request(fields, job.folder, self.services.config_with_character(job))

    def perform(
        self, job: Job, request: AnyRun, form: Mapping[str, Any]
    ) -> Generator[Updates, None, None]:
        assert isinstance(request, DiagnoseRequest)
        if not has_clip_archives(request.motions.motions):
            yield from super().perform(job, request, form)
            return

        def do(callbacks: RunCallbacks) -> SetResults:
            try:
                return self.services.worker.do(MEASURE_SETS, request, callbacks)
            except BaseException:  # clips can only be opened after a complete run
                shutil.rmtree(request.output.out / UNPACKED, ignore_errors=True)
                raise

        results = yield from self.run_with_updates(job, do, "Measuring clips: {percent:.0f} %")
        to_url = self.services.media.share(job.folder, job.cookie)
        token = self.sets.keep(results, job.folder, job.cookie or None)
        figures = figures_html(results.files, to_url)
        files = file_list_html(results.files, to_url)
        choices = [(label, f"{token}/{clip}") for label, clip in clip_choices(results.batch_json)]
        line = "Measured {clips} per set ({sets}). Choose a clip to show it in the viewer.".format(
            clips=pluralise(len(choices), "clip"), sets=pluralise(len(results.motion_files), "set")
        )
        summary, clip = self._of_sets
        yield {
            self.status: markup.sentence_status(line),
            self.parts.message: update_html(markup.collapsed_notes(list(results.notes))),
            summary: update_html(
                sets_html(results.batch_json, list(results.motion_files), figures, files)
            ),
            clip: gr.update(choices=choices, value=None, visible=True),
            **self.button_updates(is_running=False),
        }

    def _without_results(self) -> Updates:
        summary, clip = self._of_sets
        return {
            **super()._without_results(),
            summary: update_html(""),
            clip: gr.update(visible=False),
        }


class ClipRunner(MotionRunner):
    """Runner that opens a clip of measured sets as a run, below the sets."""

    tab = "own_motion"

    def __init__(
        self, services: Services, form: FormParts, parts: ResultParts, of: DiagnoseRunner
    ) -> None:
        super().__init__(services, form, parts)
        self._sets, self.videos = of.sets, of.videos

    def make_request(self, job: Job, values: Sequence[Any]) -> DiagnoseRequest:
        token, _, clip = str(values[0] if values else "").partition("/")
        sets, config = self._sets.find(token, job.cookie), self.services.config_with_character(job)
        if sets is None:
            raise RunError("These clips have expired. Please upload the zips again.")
        if clip not in sets.batch_json["clips"]:
            raise RunError("This clip is not in the uploaded sets. Please reload the page.")
        motions = {name: files[clip] for name, files in sets.motion_files.items()}
        request = request_for_motions(motions, sets.audio_files.get(clip), job.folder, config)
        names, overrides = request.motions.names, sets.request.imports.import_overrides
        return replace_fields(
            request,
            import_overrides=overrides.restricted_to(request.motions.motions, *names),
            channel=sets.request.speech.channel,
            title=f"{clip} of {', '.join(names)}",
        )


def request_for_motions(
    files: Mapping[str, Path], speech: Path | None, job: Path, config: AppConfig
) -> DiagnoseRequest:
    """Make the request for motions with known names, including the reference."""
    motions = {name: path for name, path in files.items() if name != REFERENCE_NAME}
    values = {"motions": tuple(motions.values()), "names": tuple(motions), "speech": speech}
    values |= {"reference": files.get(REFERENCE_NAME), "has_video": True}
    return request_with_page_settings(DiagnoseRequest, {**DIAGNOSE_DEFAULTS, **values}, config, job)
