"""The tab of systems: what its parts ask for, and what they show of it."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gradio as gr
import pytest

from app.page.tabs.systems import (
    NOT_HERE,
    RotationNoiseRunner,
    SpeechEffectRunner,
    StepSweepRunner,
    ablations_html,
)
from app.run.callbacks import FolderUpdated, RunCallbacks, StageProgress
from app.run.examples import FIRST_MOTION
from app.run.experiments.rotation_noise import NOISY_MOTION_NAMES, compare_rotation_noise
from app.run.output.run_folder import RunRecord, locked_record
from app.run.requests.requests import WITHOUT_NOISE, RotationNoiseRequest
from app.run.run_writer import open_run_writer
from model.systems.globaldiff.config import ABLATION, PRIORFLOW, SYSTEMS
from model.systems.globaldiff.config import ABLATION_EXPLAINED as EXPLAINED
from tests.app.fakes import catalogue_of, made_services
from tests.app.page.made import updates_of
from tests.app.page.results.made_run import made_run

EXAMPLES = tuple(Path(f"/examples/{name}.wav") for name in "abc")


def parts_of(runner: Any, *names: str) -> Any:
    return SimpleNamespace(status=runner.status, **{name: getattr(runner, name) for name in names})


class Measured:
    """A part that measures, over measurements of the test's own, and what it asked them for."""

    def __init__(self, folder: Path, kind: Any, examples: tuple[Path, ...] = EXAMPLES) -> None:
        does = dict.fromkeys(("measure_speech_effect", "measure_step_sweep"), self.measure)
        services = made_services(folder, does, catalogue=catalogue_of(*examples))
        with gr.Blocks():
            self.runner = kind(services)
        self.parts = parts_of(self.runner, "message", "figure")
        self.asked: list[Any] = []

    def measure(self, request: Any, callbacks: RunCallbacks) -> None:
        self.asked.append(request)
        callbacks.on_event(StageProgress("numbers", 0.5))
        record = RunRecord(kind="generated", tracked_point="right_middle")
        with open_run_writer(request.output.out, record) as run:
            run.add_notes("<b> hears.")
            figure = run.folder.new_path("steps.png")
            figure.write_bytes(b"0")
            run.add_files(figure)
            run.finish("Measured it.")

    def click(self, *values: Any) -> list[dict[str, Any]]:
        return updates_of(self.runner, self.parts, *values)


def test_the_plot_of_what_steps_buy_is_shown(tmp_path):
    part = Measured(tmp_path, StepSweepRunner)
    updates = part.click(["gan/5"], "/up/s.wav")
    assert any("50 %" in str(update.get("status")) for update in updates)
    assert "Measured it." in updates[-1]["status"]
    assert "<li>&lt;b&gt; hears.</li>" in updates[-1]["message"]["value"]
    assert updates[-1]["figure"]["visible"] and "<img" in updates[-1]["figure"]["value"]
    part.click(["gan/5"], None)
    assert [each.systems for each in part.asked] == [("gan/5",)] * 2
    assert [each.speech for each in part.asked] == [Path("/up/s.wav"), EXAMPLES[0]]


def test_two_speeches_are_compared_examples_where_one_is_missing(tmp_path):
    part = Measured(tmp_path, SpeechEffectRunner)
    part.click(["gan/5"], None, None, "", False)
    part.click(["gan/5"], None, "/up/a.wav", 1.0, True)
    first, second = part.asked
    assert first.inputs == EXAMPLES[:2] and first.num_seeds == 2
    assert (first.guidance, first.speakers) == (None, None)
    assert second.inputs == (Path("/up/a.wav"), EXAMPLES[1]), "another than the one of its name"
    assert (second.guidance, second.speakers) == (1.0, ("hana", "june"))


@pytest.mark.parametrize(
    ("kind", "values", "words", "examples"),
    [
        (StepSweepRunner, ([], "/up/s.wav"), "Select at least one system to measure.", EXAMPLES),
        (StepSweepRunner, (["gan/5"], None), "no examples", ()),
        (StepSweepRunner, (list("abcdefg"), None), "One to 6 systems", EXAMPLES),
        (SpeechEffectRunner, ([], None, None, "", False), "Select at least one system", EXAMPLES),
        (SpeechEffectRunner, (["gan/5"], None, None, "", False), "fewer than two", ()),
        (
            SpeechEffectRunner,
            (["gan/5"], "/up/a.wav", "/a.wav", "", False),
            "the same name",
            EXAMPLES,
        ),
    ],
)
def test_what_is_missing_is_said(tmp_path, kind, values, words, examples):
    part = Measured(tmp_path, kind, examples)
    assert words in part.click(*values)[-1]["error"] and not part.asked


def shown(show: Any, tmp_path: Path, *values: Any) -> list[dict[str, Any]]:
    services = made_services(tmp_path, {"compare_rotation_noise": show})
    with gr.Blocks():
        runner = RotationNoiseRunner(services)
    return updates_of(runner, parts_of(runner, "message", "player", "figure"), *values)


def test_both_bodies_play_and_what_they_show_is_told(tmp_path):
    asked: list[RotationNoiseRequest] = []

    def show(request: RotationNoiseRequest, callbacks: RunCallbacks) -> None:
        asked.append(request)
        made_run(
            request.output.out.parent, jerk=dict.fromkeys((*NOISY_MOTION_NAMES, WITHOUT_NOISE), 1.0)
        )
        callbacks.on_event(FolderUpdated(request.output.out))
        callbacks.on_event(StageProgress("numbers", 0.5))
        with locked_record(request.output.out) as record:
            record.notes, record.message = ["Moved by <1> cm."], "Noise of 0.05 rad."

    *_, last = shown(show, tmp_path, 0.05, None)
    (one,) = asked
    assert (one.motion, one.noise_rad) == (FIRST_MOTION, 0.05) and FIRST_MOTION.is_file()
    assert one.output.is_incremental and not one.has_video
    rows = last["player"]["rows"]
    # The browser adds the noise, so that the slider acts at once, on a motion of one's own too.
    assert [row["noise_space"] for row in rows] == ["local", "global"]
    assert (
        len({row["frames"] for row in rows}) == 1 and WITHOUT_NOISE.split()[0] in rows[0]["frames"]
    )
    assert (
        last["player"]["noise"]["initial_rad"] == 0.05 and not last["player"]["noise"]["has_slider"]
    )
    assert last["player"]["is_example"] and last["player"]["audio"] and last["player"]["timeline"]
    assert "Moved by &lt;1&gt; cm." in last["message"]["value"]
    assert "Noise of 0.05 rad" in last["status"]


def test_noise_that_cannot_be_drawn_is_told(tmp_path):
    *_, last, raised = shown(compare_rotation_noise, tmp_path, 3.0, None)
    assert "0.005 to 0.1 rad; got 3" in raised["error"]
    assert not last["figure"]["visible"] and "got 3" in last["message"]["value"]


def test_the_ladder_has_the_steps_of_the_trainings_and_tells_those_without_weights_apart():
    assert [step.system for step in EXPLAINED.steps] == list(ABLATION)
    assert PRIORFLOW in ablations_html([PRIORFLOW])
    html = ablations_html(["globaldiff/local", "globaldiff/global"])
    assert html.count("class=absent") == 3 and html.count(NOT_HERE) == 4
    assert "absent" not in ablations_html(list(SYSTEMS)) and NOT_HERE not in ablations_html(
        list(SYSTEMS)
    )
    assert all(f"$${step.equation}$$" in ablations_html([]) for step in EXPLAINED.steps)
    assert not any(set("<>&$") & set(step.equation) for step in EXPLAINED.steps)
