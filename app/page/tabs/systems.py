"""Tab "Systems", with explanations of all systems and with experiments."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Generator, Mapping, Sequence
from html import escape
from typing import Any, ClassVar

import gradio as gr

from app import text
from app.errors import RunError
from app.page.parts import markup
from app.page.parts.catalogue import (
    Catalogue,
    descriptions_by_label,
    guidance_choices,
    labels_by_group,
)
from app.page.parts.form_values import Fields, parse_form_values
from app.page.parts.markup import Updates, update_html
from app.page.results.result_parts import figures_html
from app.page.results.run_view import EMPTY_PLAYER_VALUE, RunView, rotation_noise_player_value
from app.page.tabs.runner import Services, TabRunner, last_fraction, request_with_page_settings
from app.page.visitors.job_folders import Job
from app.run import tasks
from app.run.callbacks import FolderUpdated, RunEvent
from app.run.examples import FIRST_MOTION
from app.run.requests.requests import (
    MAX_NOISE_RAD,
    MIN_NOISE_RAD,
    WITHOUT_NOISE,
    RotationNoiseRequest,
    SpeechEffectRequest,
    StepSweepRequest,
)
from model.generation.family import Ablation, AblationStep, NonAblationSystem, Topic
from model.storage.cards import DEFAULT_SPEAKER_PAIR
from model.systems.registry import families, family_of, representatives

NOT_HERE = "weights not installed"
_DELIMITERS = {"left": "$$", "right": "$$", "display": True}


def build_systems_tab(systems: Sequence[str]) -> None:
    """Lay out the tab in the current context, for systems that have weights."""
    # Markdown, because Gradio renders its formulas; the text is our own and needs no sanitising.
    gr.Markdown(
        ablations_html(systems),
        sanitize_html=False,
        latex_delimiters=[_DELIMITERS],
        elem_id="ladder",
    )


def ablations_html(systems: Sequence[str]) -> str:
    """Format the ablation steps as cards, and mark those without weights."""
    ablations = [family.ablation for family in families() if family.ablation is not None]
    cards = "".join(_ablation(each, systems) for each in ablations)
    explained = [name for each in ablations for name in each.explained_systems]
    others = _others([name for name in systems if name not in explained])
    return f'<section class="ladder">{cards}{others}</section>'


def _ablation(ablation: Ablation, systems: Sequence[str]) -> str:
    cards = "".join(_card(i, step, systems) for i, step in enumerate(ablation.steps, start=1))
    extra = "".join(_extra(each, systems) for each in ablation.extra)
    title, introduction = escape(ablation.title), escape(ablation.introduction)
    return f"<h2>{title}</h2><p>{introduction}</p><ol>{cards}</ol>{extra}"


def _extra(system: NonAblationSystem, systems: Sequence[str]) -> str:
    missing = "" if system.system in systems else f"<em>{NOT_HERE}</em>"
    return (
        f'<div class="own"><h3>{escape(system.title)}</h3>'
        f"<code>{escape(system.system)}</code>{missing}"
        f"<p>{escape(system.meaning)}</p></div>"
    )


def _others(others: Sequence[str]) -> str:
    cards = []
    for title in dict.fromkeys(family_of(name).title for name in others):
        rows = "".join(
            f"<dt><code>{escape(name)}</code></dt>"
            f"<dd>{escape(family_of(name).descriptions.get(name, ''))}</dd>"
            for name in others
            if family_of(name).title == title
        )
        cards.append(f'<div class="own"><h3>{escape(title)}</h3><dl>{rows}</dl></div>')
    return "".join(cards)


def _card(number: int, step: AblationStep, systems: Sequence[str]) -> str:
    is_here = step.system in systems
    missing = "" if is_here else f"<em>{NOT_HERE}</em>"
    return (
        f'<li{"" if is_here else " class=absent"}><h3><i aria-hidden="true">{number}</i>'
        f"{escape(step.adds)}</h3>"
        f"<code>{escape(step.system)}</code>{missing}<p>{escape(step.meaning)}</p>"
        f'<div class="equation">$${step.equation}$$'
        f"<small>{escape(step.equation_reference)}</small></div>"
        f"<p><b>What to watch</b> {escape(step.look_for)}</p></li>"
    )


MOTION_TYPES = [".npz", ".npy", ".bvh"]


class ExperimentRunner(TabRunner):
    """Runner of an experiment: a part of the tab with a form and a figure."""

    preview_player_value: dict[str, Any] = EMPTY_PLAYER_VALUE
    """Player's value before a run."""
    title: ClassVar[str]
    introduction: ClassVar[str]
    button_label: ClassVar[str]
    request_type: ClassVar[type[Any]]
    task: ClassVar[tasks.ImportedFunction]

    def __init__(self, services: Services) -> None:
        """Lay out and wire the part."""
        self.examples = services.catalogue.examples
        gr.HTML(f'{markup.heading(self.title)}<p class="hint">{self.introduction}</p>')
        with gr.Row(elem_classes="columns"):
            with gr.Column(scale=4, min_width=320, elem_classes="sheet"):
                self.fields = self.make_fields(services.catalogue)
                with gr.Row(elem_classes="actions"):
                    start = gr.Button(
                        self.button_label, variant="primary", elem_id=f"{self.tab}-start"
                    )
                    cancel = gr.Button(
                        text.CANCEL, elem_id=f"{self.tab}-cancel", min_width=110, visible=False
                    )
            with gr.Column(scale=9, min_width=320, elem_classes="results"):
                status = gr.HTML(markup.idle_status(text.READY), elem_id=f"{self.tab}-status")
                self.player = markup.player_component(f"{self.tab}-")
                self.message = markup.html_hidden_if_empty(f"{self.tab}-says")
                self.figure = markup.html_hidden_if_empty(f"{self.tab}-figures")
        super().__init__(services, status)
        markup.scroll_to_on_click(start, status)
        outputs = [status, self.player, self.message, self.figure]
        self.start_and_cancel_on(start, cancel, self.fields, outputs, api_name=self.tab)

    def systems_field(self, catalogue: Catalogue, topic: Topic) -> gr.CheckboxGroup:
        """Make a field of systems, with the representatives of a topic selected."""
        ticked = [name for name in representatives(topic) if name in catalogue.systems]
        choices, elem_id = catalogue.system_choices, f"{self.tab}-systems"
        chips = gr.CheckboxGroup(choices, value=ticked, label="Systems", elem_id=elem_id)
        about, groups = descriptions_by_label(catalogue.systems), labels_by_group(catalogue.systems)
        markup.group_choices(elem_id, about, groups)
        return chips

    @abstractmethod
    def make_fields(self, catalogue: Catalogue) -> Fields:
        """Make the fields of the form."""

    @abstractmethod
    def request_fields(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Convert form values to fields of the request; raises RunError for the visitor."""

    def job_updates(self, job: Job, values: Sequence[Any]) -> Generator[Updates, None, None]:
        wanted = self.request_fields(parse_form_values(self.request_type, self.fields, values)) | {
            "is_incremental": True
        }
        request = request_with_page_settings(
            self.request_type, wanted, self.services.config_with_character(job), job.folder
        )
        request.check()
        yield self.stopped_updates(markup.sentence_status(text.STARTING_SYSTEMS), "")
        to_url = self.services.media.share(job.folder, job.cookie)
        run_view = RunView(request.output.out, to_url, job.folder.name)

        def updates_of(events: list[RunEvent]) -> Updates:
            updates: Updates = {}
            has_grown = any(isinstance(event, FolderUpdated) for event in events)
            if has_grown and run_view.has_begun and run_view.record.is_playable:
                updates[self.player] = self.player_value(run_view, wanted)
            share = last_fraction(events)
            if share is not None:
                updates[self.status] = markup.sentence_status(f"Measuring: {100 * share:.0f} %")
            return updates

        yield from self.run_task(job, self.task, request, updates_of)
        record = run_view.record
        lines = "".join(f"<li>{escape(sentence)}</li>" for sentence in record.notes)
        files = (request.output.out / name for name in record.result_files)
        yield {
            self.status: markup.sentence_status(record.message),
            self.player: self.player_value(run_view, wanted),
            self.message: update_html(f'<ul class="hint">{lines}</ul>'),
            self.figure: update_html(figures_html(files, to_url)),
        }

    def player_value(self, run_view: RunView, wanted: Mapping[str, Any]) -> dict[str, Any]:
        """Return the player's value of a run."""
        return run_view.player_value() | {"is_example": True}

    def stopped_updates(self, status: str, message: str) -> Updates:
        return {
            self.status: status,
            self.player: self.preview_player_value,
            self.message: update_html(message),
            self.figure: update_html(""),
        }


def _file(label: str, file_types: list[str]) -> gr.File:
    return gr.File(label=label, file_types=file_types, type="filepath")


class RotationNoiseRunner(ExperimentRunner):
    """Runner that compares equal noise on local and on global rotations, without a network.

    The page adds the noise, so that its slider acts at once; a run measures and draws the error
    along the arm, of the example or of an own motion.
    """

    tab, button_label = "mechanism", "Measure the error along the arm"
    title = "Why global rotations? Equal noise on local and on global rotations"
    introduction = (
        "Two bodies perform the same motion with equally large random rotations added to every "
        "joint: on one body relative to the parent joint, on the other in world coordinates. No "
        "network is involved. Move the slider and watch the fingertips."
    )
    request_type, task = RotationNoiseRequest, tasks.COMPARE_ROTATION_NOISE

    def __init__(self, services: Services) -> None:
        super().__init__(services)
        if services.example_player_value is not None:
            self.preview_player_value = _without_slider(services.example_player_value)
            self.player.value = self.preview_player_value
        set_noise = f"rad => document.querySelector('#{self.tab}-player .lockstep').setNoise(rad)"
        self.fields["noise_rad"].input(
            None, self.fields["noise_rad"], js=set_noise, api_visibility="private"
        )

    def make_fields(self, catalogue: Catalogue) -> Fields:
        noise = gr.Slider(
            MIN_NOISE_RAD,
            MAX_NOISE_RAD,
            value=RotationNoiseRequest.noise_rad,
            step=0.005,
            buttons=[],
            label="Rotation noise per joint (standard deviation about each axis, rad)",
            elem_id="mechanism-noise",
        )
        return {"noise_rad": noise, "motion": _file("Motion of your own (optional)", MOTION_TYPES)}

    def request_fields(self, values: Mapping[str, Any]) -> dict[str, Any]:
        return {
            "motion": values["motion"] or FIRST_MOTION,
            "noise_rad": values["noise_rad"],
            "has_video": False,
        }

    def player_value(self, run_view: RunView, wanted: Mapping[str, Any]) -> dict[str, Any]:
        value = run_view.player_value()
        clean = next((row for row in value["rows"] if row["name"] == WITHOUT_NOISE), {})
        if "frames_available" not in clean:
            return EMPTY_PLAYER_VALUE
        return _without_slider(rotation_noise_player_value(value, clean, wanted["noise_rad"]))


def _without_slider(value: dict[str, Any]) -> dict[str, Any]:
    return {**value, "noise": {**value["noise"], "has_slider": False}}


class SpeechEffectRunner(ExperimentRunner):
    """Runner that measures the effect of speech and of the noise seed on motion."""

    tab, button_label, title = "hearing", "Compare", "Does the motion follow the speech?"
    introduction = (
        "Each system generates motion for two speech recordings with two noise seeds. If the "
        "motion follows the speech, arm speeds rise and fall together in motions for the same "
        "speech; if it depends on the noise, they do so in motions with the same seed."
    )
    request_type, task = SpeechEffectRequest, tasks.MEASURE_SPEECH_EFFECT

    def make_fields(self, catalogue: Catalogue) -> Fields:
        systems = self.systems_field(catalogue, "speech_effect")
        speeches = {
            name: _file(f"Speech {letter} (optional)", ["audio"])
            for name, letter in (("first", "A"), ("second", "B"))
        }
        strength = gr.Radio(
            guidance_choices(1.0, 2.0, 3.0),
            value="",
            label=text.GUIDANCE_LABEL,
            elem_id="hearing-strength",
        )
        calm, lively = DEFAULT_SPEAKER_PAIR
        speakers = gr.Checkbox(
            label=f"Also compare the speakers {calm} and {lively}",
            info="Also generates motion in a calm and a lively style for the first recording, with "
            "the same two seeds.",
            elem_id="hearing-speakers",
        )
        return {"systems": systems, **speeches, "guidance": strength, "speakers": speakers}

    def request_fields(self, values: Mapping[str, Any]) -> dict[str, Any]:
        fields = dict(values)
        if not fields["systems"]:
            raise RunError("Select at least one system to compare.")
        uploads = [path for path in (fields.pop("first"), fields.pop("second")) if path is not None]
        missing = 2 - len(uploads)
        spare = [path for path in self.examples if path.stem not in {p.stem for p in uploads}]
        if len(spare) < missing:
            raise RunError(
                "Upload two speech recordings to compare; this installation has fewer than two "
                "examples."
            )
        speakers = DEFAULT_SPEAKER_PAIR if fields["speakers"] else None
        return {**fields, "inputs": (*uploads, *spare[:missing]), "speakers": speakers}


class StepSweepRunner(ExperimentRunner):
    """Runner that measures quality and speed for several numbers of sampling steps."""

    tab, button_label = "steps", "Measure"
    title = "Sampling steps: quality and speed on this server"
    introduction = (
        "Generates motion for the same speech with 1, 2, 4, 8 and 25 steps, and shows fingertip "
        "jerk, distance from the 25-step result, and time per frame on this server."
    )
    request_type, task = StepSweepRequest, tasks.MEASURE_STEPS

    def make_fields(self, catalogue: Catalogue) -> Fields:
        label = "Speech (optional; the first 10 s are used)"
        systems = self.systems_field(catalogue, "sampling_steps")
        return {"systems": systems, "speech": _file(label, ["audio"])}

    def request_fields(self, values: Mapping[str, Any]) -> dict[str, Any]:
        speech = values["speech"] or next(iter(self.examples), None)
        if not values["systems"]:
            raise RunError("Select at least one system to measure.")
        if speech is None:
            raise RunError("Upload a speech recording; this installation has no examples.")
        return {**values, "speech": speech}
