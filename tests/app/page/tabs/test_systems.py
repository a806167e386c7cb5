"""The tab of systems: what its parts ask for, and what they show of it."""

from pathlib import Path
from typing import Any

import gradio as gr
import pytest

from app.page.tabs.systems.hearing import HearingRunner, hearing_fields
from app.page.tabs.systems.measured_figure import build_measuring_sheet
from app.page.tabs.systems.mechanism import MechanismParts, MechanismRunner
from app.page.tabs.systems.step_curve import StepCurveRunner, step_fields
from app.page.tabs.systems.systems import NOT_HERE, ladder
from app.run.examples import CLEAN
from app.run.experiments.hearing import Heard, Hearing, HearingAsk
from app.run.experiments.mechanism import NAMES, MechanismAsk, show_mechanism
from app.run.experiments.step_curve import StepCurve, StepPoint, StepsAsk
from app.run.requests.request import Grown, OnEvent, Progress, ShouldCancel
from model.measures.hearing import Decided
from model.systems.globaldiff import LADDER_EXPLAINED as EXPLAINED
from model.systems.globaldiff.config import BEST, LADDER, SYSTEMS
from tests.app.fakes import catalogue_of, made_services
from tests.app.page.made import updates_of
from tests.app.page.results.made_run import made_run

FIELDS: dict[Any, Any] = {HearingRunner: hearing_fields, StepCurveRunner: step_fields}
EXAMPLES = tuple(Path(f"/examples/{name}.wav") for name in "abc")


class Measured:
    """A part that measures, over measurements of the test's own, and what it asked them for."""

    def __init__(self, folder: Path, kind: Any, examples: tuple[Path, ...] = EXAMPLES) -> None:
        services = made_services(folder, catalogue=catalogue_of(*examples))
        with gr.Blocks():
            sheet = build_measuring_sheet("a", services.catalogue, (), FIELDS[kind], "Go")
        self.parts = sheet.parts
        self.runner = kind(services, self.measure, sheet)
        self.asked: list[Any] = []

    def measure(
        self, request: Any, on_event: OnEvent, should_cancel: ShouldCancel
    ) -> StepCurve | Hearing:
        self.asked.append(request)
        on_event(Progress("numbers", 0.5))
        out = request.ask.out
        out.mkdir()
        is_hearing = isinstance(request, HearingAsk)
        figure = out / ("hearing.png" if is_hearing else "steps.png")
        figure.write_bytes(b"0")
        if is_hearing:
            parts = {"arms": Decided(same_speech=0.5, same_noise=0.3, neither=0.1)}
            return Hearing((Heard("gan/5", 3.0, parts, 0.8),), (figure,))
        assert isinstance(request, StepsAsk)
        return StepCurve((StepPoint("gan/5", 1, None, 0.5, 100.0, 0.0),), (figure,))

    def click(self, *values: Any) -> list[dict[str, Any]]:
        return updates_of(self.runner, self.parts, *values)


def test_the_plot_of_what_steps_buy_is_shown(tmp_path):
    part = Measured(tmp_path, StepCurveRunner)
    updates = part.click(["gan/5"], "/up/s.wav")
    assert any("50%" in str(update.get("status")) for update in updates)
    assert "Measured 1 motions." in updates[-1]["status"]
    assert updates[-1]["figure"]["visible"] and "<img" in updates[-1]["figure"]["value"]
    part.click(["gan/5"], None)
    assert [each.ask.systems for each in part.asked] == [("gan/5",)] * 2
    assert [each.ask.speech for each in part.asked] == [Path("/up/s.wav"), EXAMPLES[0]]


def test_what_speech_decides_is_told_of_two_speeches_examples_where_one_is_missing(tmp_path):
    part = Measured(tmp_path, HearingRunner)
    updates = part.click(["gan/5"], None, None, -1.0, False)
    last = {name: value for update in updates for name, value in update.items()}
    line = "<li>gan/5: speech decides 40% of the arms&#x27; speed and chance 20%"
    assert last["message"]["visible"] and line in last["message"]["value"]
    assert "of 1 system." in last["status"] and "<img" in last["figure"]["value"]
    part.click(["gan/5"], None, "/up/a.wav", 1.0, True)
    first, second = part.asked
    assert first.speeches == EXAMPLES[:2] and first.seeds == 2
    assert (first.ask.guidance, first.speakers) == (None, None)
    assert second.speeches == (Path("/up/a.wav"), EXAMPLES[1]), "another than the one of its name"
    assert (second.ask.guidance, second.speakers) == (1.0, ("hana", "june"))


@pytest.mark.parametrize(
    ("kind", "values", "words", "examples"),
    [
        (StepCurveRunner, ([], "/up/s.wav"), "Tick at least one system to measure.", EXAMPLES),
        (StepCurveRunner, (["gan/5"], None), "no examples", ()),
        (StepCurveRunner, (list("abcdefg"), None), "One to 6 systems", EXAMPLES),
        (HearingRunner, ([], None, None, -1.0, False), "Tick at least one system", EXAMPLES),
        (HearingRunner, (["gan/5"], None, None, -1.0, False), "fewer than two", ()),
        (HearingRunner, (["gan/5"], "/up/a.wav", "/a.wav", -1.0, False), "one name", EXAMPLES),
    ],
)
def test_what_is_missing_is_said(tmp_path, kind, values, words, examples):
    part = Measured(tmp_path, kind, examples)
    assert words in part.click(*values)[-1]["error"] and not part.asked


def shown(show: Any, tmp_path: Path, *values: Any) -> list[dict[str, Any]]:
    with gr.Blocks():
        parts = MechanismParts(*(gr.HTML() for _ in range(4)))
    services = made_services(tmp_path, {"show_mechanism": show})
    return updates_of(MechanismRunner(services, parts), parts, *values)


@pytest.mark.parametrize("needs_video", [False, True])
def test_both_bodies_play_and_what_they_show_is_told(tmp_path, needs_video):
    asked: list[MechanismAsk] = []

    def show(
        request: MechanismAsk, on_event: OnEvent, should_cancel: ShouldCancel
    ) -> tuple[Path | None, tuple[str, ...]]:
        asked.append(request)
        out = request.ask.out
        made_run(out.parent, jerk=dict.fromkeys(NAMES, 1.0))
        on_event(Grown(out.parent / "results"))
        on_event(Progress("numbers", 0.5))
        out.write_bytes(b"0")
        return out if request.ask.has_video else None, ("Moved by <1> cm.",)

    *_, last = shown(show, tmp_path, 0.05, None, needs_video)
    (one,) = asked
    assert (one.ask.motions, one.noise_rad) == ((CLEAN,), 0.05) and CLEAN.is_file()
    assert one.played == one.ask.out.with_name("results") and one.ask.has_video == needs_video
    rows = last["player"]["rows"]
    assert [row["label"] for row in rows] == list(NAMES) and all("frames" in row for row in rows)
    assert last["player"]["plays"] and last["player"]["audio"] and last["player"]["timeline"]
    assert ("<video" in last["says"]["value"]) == needs_video
    assert "Moved by &lt;1&gt; cm." in last["says"]["value"]
    assert "Noise of 0.05 rad" in last["status"]


def test_noise_that_cannot_be_drawn_is_told(tmp_path):
    *_, last, raised = shown(show_mechanism, tmp_path, 3.0, None, False)
    assert "0.005 to 0.1 rad; got 3" in raised["error"]
    assert not last["says"]["visible"] and "got 3" in last["message"]["value"]


def test_the_ladder_has_the_rungs_of_the_trainings_and_tells_those_without_weights_apart():
    assert [rung.system for rung in EXPLAINED.rungs] == list(LADDER)
    assert BEST in ladder([BEST])
    html = ladder(["globaldiff/local", "globaldiff/global"])
    assert html.count("class=absent") == 3 and html.count(NOT_HERE) == 4
    assert "absent" not in ladder(list(SYSTEMS)) and NOT_HERE not in ladder(list(SYSTEMS))
    assert all(f"$${rung.equation}$$" in ladder([]) for rung in EXPLAINED.rungs)
    assert not any(set("<>&$") & set(rung.equation) for rung in EXPLAINED.rungs)
