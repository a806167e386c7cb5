"""Tab "User study", to plan and make a study, and to analyse its answers."""

from __future__ import annotations

import json
import os
import secrets
import shutil
from collections.abc import Generator, Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import gradio as gr

from app import text
from app.errors import Cancelled, RunError
from app.page.parts import markup
from app.page.parts.catalogue import Catalogue, default_systems
from app.page.parts.form_values import Fields, parse_form_values
from app.page.parts.markup import PRIVATE_EVENT, Updates, update_html
from app.page.results.result_parts import download_link, file_list_html
from app.page.routes.media import PARTICIPANT_TYPES, RESEARCHER_FILE, RESEARCHER_ROUTE, FileToUrl
from app.page.tabs.motion import SEED_LIMIT, copy_as_upload
from app.page.tabs.runner import Services, TabRunner
from app.page.visitors.job_folders import Job
from app.page.visitors.uploads import MAX_FILES
from app.run.callbacks import RunCallbacks
from app.study.analyse import AnalysisRequest, analyse
from app.study.design.plan import StudyPlan, load_wording, read_study_plan
from app.study.design.trials import make_design, study_minutes_and_summary
from app.study.make.export_folders import EXPORT_STUDY, ExportRequest
from conventions.views import VIEWS
from model.systems.registry import default_planning_system

INTRODUCTION = (
    "Creates a blind user study: a web page for your participants, with videos under random "
    "names, and a key that only you receive. Equivalent to <code>python -m app study "
    "export</code>."
)


def build_study_tab(services: Services) -> Fields:
    """Lay out and wire the study form in the current context; return its fields."""
    catalogue = services.catalogue
    gr.HTML(f'<p class="hint">{INTRODUCTION}</p>')
    with gr.Row(elem_classes="columns"):
        with gr.Column(scale=5, min_width=320):
            ready = _build_questions(catalogue)
            fields = _build_materials(services)
        with gr.Column(scale=5, min_width=320):
            fields |= _build_settings()
            with gr.Row(elem_classes="actions"):
                start = gr.Button("Create the study", variant="primary", elem_id="study-make")
                write = gr.Button("Write the study plan only", elem_id="study-write", min_width=110)
                cancel = gr.Button(
                    text.CANCEL, elem_id="study-cancel", min_width=110, visible=False
                )
            with gr.Column(elem_classes="results"):
                status = gr.HTML(markup.idle_status(text.READY), elem_id="study-status")
                result = markup.html_hidden_if_empty("study-made", "study_key.js", "mountKey")
    protocol, speeches, systems, changed = (
        fields[name] for name in ("protocol", "speeches", "systems", "changed")
    )

    def examples(paths: list[str] | None) -> list[str] | None:
        """Return the speech files, or copies of the examples if there are none."""
        folder = services.config.cache_folder / "examples"
        return paths or [str(copy_as_upload(path, folder)) for path in catalogue.examples] or None

    for button in ready:
        settings, changes = STUDY_PRESETS[button.value]
        filled = json.dumps([settings, [default_planning_system()], changes])
        # In the browser, so that a click on "Make the study" right after it uses these values.
        button.click(
            None,
            outputs=[protocol, systems, changed],
            js=f"() => {filled}",
            api_visibility="private",
        )
        button.click(examples, speeches, speeches, **PRIVATE_EVENT)
    outputs = [status, result]
    only_plan = StudyPlanRunner(services, fields, status, result)
    at_once: dict[str, Any] = {"concurrency_id": "plan", "show_progress": "hidden"}
    only_plan.start_on(write.click, fields, outputs=outputs, api_name="study_plan", **at_once)
    runner = StudyRunner(services, fields, status, result)
    markup.scroll_to_on_click(start, status)
    runner.start_and_cancel_on(start, cancel, fields, outputs, api_name="study")
    return fields


def _build_questions(catalogue: Catalogue) -> list[gr.Button]:
    """Lay out buttons that fill in example studies on the gestures of the system with plans."""
    if default_planning_system() not in catalogue.systems:
        return []
    gr.HTML(
        '<p class="hint">Example studies (with the example speech, unless you upload your own):</p>'
    )
    with gr.Row(elem_id="study-ready"):
        return [gr.Button(name, size="sm", min_width=110) for name in STUDY_PRESETS]


def _build_materials(services: Services) -> dict[str, Any]:
    """Lay out the fields of what is compared."""
    catalogue, planner = services.catalogue, default_planning_system()
    of: dict[str, Any] = {}
    of["title"] = gr.Textbox("How people move when they talk", label="Title (participants see it)")
    of["protocol"] = gr.Radio([*PROTOCOLS.items()], value="pairwise", label="Protocol")
    of["speeches"] = services.file_field(
        "speech",
        "Speech audio, one file per clip",
        ["audio"],
        "study-speech",
        file_count="multiple",
    )
    of["systems"] = gr.CheckboxGroup(
        catalogue.system_choices,
        value=default_systems(catalogue.systems),
        label="Systems",
        info="Every additional system adds one video per clip and view, and more comparisons.",
    )
    of["changed"] = gr.CheckboxGroup(
        list(PLAN_MODIFICATIONS),
        value=[],
        label="Modified gestures",
        info=f"Each choice adds one condition: {planner} with this change to its gesture plan.",
        visible=planner in catalogue.systems,
        elem_id="study-changed",
    )
    of["motions"] = services.file_field(
        "motion",
        f"Your own motion (optional), files named <system>{SEPARATOR}<name of the speech file> "
        "(.npz, .npy or .bvh)",
        [".npz", ".npy", ".bvh"],
        "study-motions",
        file_count="multiple",
    )
    of["changed"] = of.pop("changed")  # last, for the order of the API's parameters
    return of


def _build_settings() -> dict[str, Any]:
    """Lay out the fields of how videos are shown, and of the participants' information."""
    of: dict[str, Any] = {}
    with gr.Row(elem_classes="pair"):
        of["length_s"] = gr.Number(10, label="Video length (s)", minimum=0, min_width=100)
        of["participants"] = gr.Number(
            28, label="Participants", minimum=1, maximum=1000, min_width=100
        )
        of["seed"] = gr.Number(
            0, label="Seed of the trial order", minimum=0, maximum=SEED_LIMIT, min_width=100
        )
    of["views"] = gr.CheckboxGroup(
        [(text.VIEW_NAMES[view], view) for view in VIEWS], value=["front"], label="Views"
    )
    of["post_to"] = gr.Textbox(
        "",
        label="Server address for the answers (optional)",
        info="URL of your server that accepts JSON by HTTP POST. If empty, each participant "
        "saves a file at the end and sends it to the contact below.",
    )
    of["return_to"] = gr.Textbox(
        "",
        label="Completion link (optional)",
        info="Shown to participants at the end, for example the completion link of Prolific or "
        "SONA.",
    )
    of["panel_ids"] = gr.Textbox(
        "",
        label="Participant ids from the link (optional)",
        placeholder="PROLIFIC_PID, STUDY_ID, SESSION_ID",
        info="Names of the URL parameters that a recruitment service adds to the link, the "
        "participant's id first. Their values are stored with the answers, and the consent page "
        "says so.",
    )
    with gr.Accordion(
        "Researchers, contact, ethics approval, consent text", open=False, elem_id="study-told"
    ):
        with gr.Row(elem_classes="pair"):
            of["researchers"] = gr.Textbox("", label="Researchers", min_width=140)
            of["contact"] = gr.Textbox(
                "", label="Contact (participants send their files here)", min_width=140
            )
        of["ethics"] = gr.Textbox("", label="Ethics approval: board and number")
        of["consent"] = gr.Textbox(
            "", label="Consent text", placeholder=load_wording()["consent"]["text"].strip(), lines=5
        )
    return of


TITLE = "Analyse the answers"
ANALYSIS_INTRODUCTION = (
    "Upload the participants' answer files and key.json from the researcher's zip. Equivalent to "
    "<code>python -m app study analyse</code>, which needs no upload. The server deletes all "
    "uploaded files and the report within an hour."
)
NO_ANSWERS = "Add at least one answer file of a participant."
NO_KEY = "Add key.json from researcher_only.zip."
TOO_MANY = "At most {limit} files are analysed here; {count} were given. Use the command line."
ANALYSED = "Done. The report is shown below; download its files to keep them."


def build_analysis(services: Services) -> None:
    """Lay out and wire the analysis in the current context."""
    gr.HTML(f'{markup.heading(TITLE)}<p class="hint">{ANALYSIS_INTRODUCTION}</p>')
    with gr.Row(elem_classes="columns"):
        with gr.Column(scale=4, min_width=320, elem_classes="sheet"):
            answers = gr.File(
                label="Answers (.json)",
                file_count="multiple",
                file_types=[".json"],
                type="filepath",
                elem_id="analysis-answers",
            )
            key = gr.File(
                label="Key (key.json)",
                file_types=[".json"],
                type="filepath",
                elem_id="analysis-key",
            )
            with gr.Row(elem_classes="actions"):
                start = gr.Button("Analyse", variant="primary", elem_id="analysis-start")
        with gr.Column(scale=9, min_width=320, elem_classes="results"):
            status = gr.HTML(markup.idle_status(text.READY), elem_id="analysis-status")
            report = markup.html_hidden_if_empty("analysis-report")
    fields = {"answers": answers, "key": key}
    markup.scroll_to_on_click(start, status)
    runner = AnalysisRunner(services, fields, status, report)
    runner.start_on(start.click, [answers, key], outputs=[status, report])


SEPARATOR = "--"
PROTOCOLS = {
    "Pairwise comparison: human-likeness (without sound)": "pairwise",
    "Matched or mismatched speech: appropriateness (one system at a time)": "matched",
    "Ranking of all systems: three questions (with sound)": "ranking",
    "Slider ratings of all systems: human-likeness (with sound)": "rating",
}
PLAN_MODIFICATIONS = {
    "strokes on other words": "{ wrong_words = true }",
    "half as many gestures": "{ times = { gestures_per_min = 0.5 } }",
    "smaller": "{ times = { size_m = 0.6 } }",
    "larger": "{ times = { size_m = 1.5 } }",
}
"""Plan edits of the system with plans, as styles of `model.plan.style`."""
STUDY_PRESETS = {
    "Do strokes have to match the words?": ("ranking", ["strokes on other words"]),
    "Effect of the gesture rate": ("rating", ["half as many gestures"]),
    "Effect of the gesture size": ("rating", ["smaller", "larger"]),
}
"""Example studies: a protocol, and edits that are compared with the unedited gestures."""
MAX_UPLOADS = 60
TOO_MANY_UPLOADS = "At most {limit} files can be uploaded; use the command line for more."
MAX_VIDEO_S = 1800.0
"""Maximum total length (s) of a study's videos on the page."""


def study_plan_toml(values: Mapping[str, Any]) -> str:
    """Format the study plan as TOML with relative file names; raises RunError."""
    clips, length_s = values["speeches"], values["length_s"]
    if not clips:
        raise RunError(
            "There is no speech yet: upload at least one file. For a study of your own motion "
            "without sound, use the command line (docs/user-study.md)."
        )
    if len(clips) + len(values["motions"]) > MAX_UPLOADS:
        raise RunError(TOO_MANY_UPLOADS.format(limit=MAX_UPLOADS))
    if not length_s:
        raise RunError("Enter the length of the videos in seconds.")
    others, changed = _by_system(values["motions"]), values["changed"]
    unknown = next((name for name in changed if name not in PLAN_MODIFICATIONS), None)
    if unknown is not None:
        raise RunError(
            f"Unknown modification {unknown!r}; choose from {', '.join(PLAN_MODIFICATIONS)}."
        )
    count = (
        len(clips) * (len(values["systems"]) + len(others) + len(changed)) * len(values["views"])
    )
    if count * length_s > MAX_VIDEO_S:
        raise RunError(
            f"This study has {count * length_s / 60:.0f} minutes of video; this page renders at "
            f"most {MAX_VIDEO_S / 60:.0f} minutes. Use the command line, fewer clips or "
            "systems, or shorter videos."
        )
    lines = [
        f"title = {_text(values['title'] or 'Co-speech motion')}",
        f"protocol = {_text(values['protocol'] or '')}",
        f"participants = {values['participants']}",
        f"seed = {values['seed']}",
        f"views = [{', '.join(_text(view) for view in values['views'])}]",
        f"length_s = {length_s:g}",
    ]
    for name in ("post_to", "return_to", "researchers", "contact", "ethics", "consent"):
        if values[name]:
            lines.append(f"{name} = {_text(values[name])}")
    if panel_ids := (values.get("panel_ids") or "").replace(",", " ").split():
        lines.append(f"panel_ids = [{', '.join(map(_text, panel_ids))}]")
    for clip in clips:
        lines += ["", "[[clips]]", f"name = {_text(clip.stem)}", f"speech = {_text(clip.name)}"]
    for system in values["systems"]:
        lines += ["", "[[systems]]", f"name = {_text(system)}"]
    for name in changed:
        planner = default_planning_system()
        lines += ["", "[[systems]]", f"name = {_text(f'{planner} {name}')}"]
        lines += [f"system = {_text(planner)}", f"style = {PLAN_MODIFICATIONS[name]}"]
    for system, motions in others.items():
        lines += ["", "[[systems]]", f"name = {_text(system)}", "[systems.motion]"]
        lines += [f"{_text(clip)} = {_text(path.name)}" for clip, path in motions.items()]
    return "\n".join(lines) + "\n"


def collect_files(uploads: Iterable[Path], folder: Path) -> None:
    """Link or copy uploads next to the plan; raises RunError if two have the same name."""
    for path in uploads:
        target = folder / path.name
        if target.exists():
            raise RunError(f"Two uploads have the name {target.name}; rename one.")
        try:
            os.link(path, target)
        except OSError:
            shutil.copyfile(path, target)


def _by_system(paths: Iterable[Path]) -> dict[str, dict[str, Path]]:
    systems: dict[str, dict[str, Path]] = {}
    for path in paths:
        system, separator, clip = path.stem.partition(SEPARATOR)
        if not (system and separator and clip):
            raise RunError(
                f"The motion file {path.name} must be named <system>{SEPARATOR}<clip>{path.suffix}"
                ", where <clip> is the name of a speech file."
            )
        systems.setdefault(system, {})[clip] = path
    return systems


def _text(value: str) -> str:
    """Format a TOML string; JSON's escapes are valid in TOML."""
    return json.dumps(value, ensure_ascii=True).replace("\x7f", "\\u007f")


NO_COOKIE = (
    "Your browser blocks cookies for this page. They are needed to keep the researcher's files "
    "private to you. Allow cookies and reload the page."
)
STUDY_READY = (
    "The study is ready; the check found nothing that reveals the systems. Download the key, check "
    "the preview, then host the participants' page."
)
KEY_HELP = (
    "Without the key nobody, including you, can tell which video shows which system, and the "
    "answers cannot be analysed. The server deletes the key when you have downloaded it, and "
    "after {minutes} minutes in any case. Do not give the key to participants."
)
KEY_BUTTON = "Download the researcher's files with the key (zip; possible only once)"
KEY_FETCHED = "Downloaded. Check that researcher_only.zip is in your downloads folder."
PREVIEW = "Preview as participant"
PARTICIPANTS = "For participants: the page and its videos (zip)"
PLAN = "Study plan (TOML)"


class StudyRunner(TabRunner):
    """Runner that makes studies."""

    tab = "study"

    def __init__(
        self, services: Services, fields: Fields, status: gr.HTML, result: gr.HTML
    ) -> None:
        super().__init__(services, status)
        self.fields = fields
        self.result_part = result

    def job_updates(self, job: Job, values: Sequence[Any]) -> Generator[Updates, None, None]:
        fields = parse_form_values(StudyPlan, self.fields, values)
        path = job.folder / "plan.toml"
        path.write_text(study_plan_toml(fields), "utf-8")
        plan = read_study_plan(path)
        size = study_minutes_and_summary(plan, make_design(plan))[1]
        yield {
            self.status: markup.sentence_status(text.STARTING),
            self.result_part: update_html(""),
        }
        to_url = self.services.media.share(job.folder, job.cookie)
        yield from self._make_study(job, fields, path, size, to_url)

    def _make_study(
        self, job: Job, fields: Mapping[str, Any], plan: Path, size: str, to_url: FileToUrl
    ) -> Generator[Updates, None, None]:
        """Create the study, the participants' part with the job, the researcher's in private."""
        if not job.cookie:
            raise RunError(NO_COOKIE)
        services, config = self.services, self.services.config_with_character(job)
        work, waiting = (config.private_folder / secrets.token_hex(16) for _ in "ab")
        job.extra_paths += [work, waiting]
        bundle, key = job.folder / "participant_bundle.zip", waiting / RESEARCHER_FILE

        def make(callbacks: RunCallbacks) -> Path:
            """Make the participants' page, and clean up when the process has ended."""
            try:
                for folder in (work, waiting):
                    folder.mkdir(parents=True, mode=0o700)
                written = Path(shutil.copyfile(plan, work / plan.name))
                collect_files((*fields["speeches"], *fields["motions"]), work)
                request = ExportRequest(
                    plan=written,
                    out=work / "study",
                    weights=config.weights,
                    body=config.body,
                    zips=(bundle, key),
                )
                study = services.worker.do(EXPORT_STUDY, request, callbacks)
                if callbacks.should_cancel():
                    raise Cancelled
                return Path(shutil.move(study.bundle, job.folder / "bundle"))
            except BaseException:
                shutil.rmtree(waiting, ignore_errors=True)
                raise
            finally:
                shutil.rmtree(work, ignore_errors=True)

        try:
            pages = yield from self.run_with_updates(
                job, make, "Making the videos: {percent:.0f} %"
            )
        except BaseException:
            job.cancel()
            shutil.rmtree(waiting, ignore_errors=True)  # if the task ended before that
            raise
        token = services.private_files.keep(waiting, waiting, job.cookie)
        look = services.media.share(pages, job.cookie, PARTICIPANT_TYPES)(pages / "index.html")
        files = (
            _link("study-participants", to_url(bundle), bundle.name, PARTICIPANTS),
            _link("study-plan", to_url(job.folder / plan.name), plan.name, PLAN),
        )
        html = (
            f"{_key(token, config.result_lifetime_s)}{_preview(f'{look}&preview')}{''.join(files)}"
        )
        yield {
            self.status: markup.sentence_status(f"{STUDY_READY} {size}"),
            self.result_part: update_html(f'<div class="downloads">{html}</div>'),
        }

    def stopped_updates(self, status: str, message: str) -> Updates:
        return {self.status: message or status}


class StudyPlanRunner(StudyRunner):
    """Runner that only writes the study plan."""

    def _make_study(
        self, job: Job, fields: Mapping[str, Any], plan: Path, size: str, to_url: FileToUrl
    ) -> Generator[Updates, None, None]:
        link = _link("study-plan", to_url(plan), plan.name, PLAN)
        yield {
            self.status: markup.sentence_status(f"The plan is written. {size}"),
            self.result_part: update_html(f'<div class="downloads">{link}</div>'),
        }


def _link(elem_id: str, url: str, name: str, words: str) -> str:
    link = download_link(url, name, words)
    return f'<p id="{elem_id}">{link}</p>'


def _key(token: str, keep_s: float) -> str:
    """Format the box with the researcher's key, which comes before anything to be hosted."""
    return (
        '<div class="key" role="note" id="study-researcher">'
        "<h3>First download the key, which is only for you</h3>"
        f"<p>{KEY_HELP.format(minutes=round(keep_s / 60))}</p>"
        f'<form method="post" action=".{RESEARCHER_ROUTE}/{token}">'
        f'<button type="submit" class="lg primary">{KEY_BUTTON}</button></form>'
        f'<p class="done">{KEY_FETCHED}</p></div>'
    )


def _preview(address: str) -> str:
    return (
        f'<p class="study-preview"><a href="{escape(address)}" target="_blank" rel="noopener">'
        f"{PREVIEW}</a><span>Opens in a new tab; no answers are sent.</span></p>"
    )


class AnalysisRunner(StudyRunner):
    """Runner that analyses answers for a researcher."""

    tab = "analysis"

    def job_updates(self, job: Job, values: Sequence[Any]) -> Generator[Updates, None, None]:
        fields = parse_form_values(AnalysisRequest, self.fields, values)
        answers, key = fields["answers"], fields["key"]
        if not answers:
            raise RunError(NO_ANSWERS)
        if not key:
            raise RunError(NO_KEY)
        if len(answers) > MAX_FILES:
            raise RunError(TOO_MANY.format(limit=MAX_FILES, count=len(answers)))
        yield {
            self.status: markup.sentence_status(text.STARTING),
            self.result_part: update_html(""),
        }
        request = AnalysisRequest(answers, key, job.folder / "results")
        files = yield from self.run_task(job, analyse, request)
        links = file_list_html(files, self.services.media.share(job.folder, job.cookie))
        html = (
            f'{report_frame_html(files[0].read_text("utf-8"))}<div class="downloads">{links}</div>'
        )
        yield {self.status: markup.sentence_status(ANALYSED), self.result_part: update_html(html)}


def report_frame_html(report: str) -> str:
    """Format a report in a sandboxed frame, as it contains untrusted names."""
    return (
        f'<iframe class="report" sandbox="" title="Report of the study" '
        f'srcdoc="{escape(report, quote=True)}"></iframe>'
    )
