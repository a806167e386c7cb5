"""The part that asks what speech decides: what it asks for, and what it then shows."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gradio as gr
import pytest

from app.page.tabs.systems.hearing import HearingRunner
from app.page.tabs.systems.measured_figure import FigureParts
from app.run.experiments.hearing import Heard, Hearing, HearingRequest
from model.measures.hearing import Decided
from tests.app.fakes import catalogue_of, made_services

VISITOR = SimpleNamespace(session_hash="visitor", cookies={})
EXAMPLES = (Path("/examples/a.wav"), Path("/examples/b.wav"), Path("/examples/c.wav"))

Runs = Callable[..., tuple[list[HearingRequest], dict[str, Any]]]


@pytest.fixture
def runs(tmp_path: Path) -> Runs:
    def run(
        *values: Any, examples: tuple[Path, ...] = EXAMPLES
    ) -> tuple[list[HearingRequest], dict[str, Any]]:
        asked: list[HearingRequest] = []

        def measure(request: HearingRequest, on_progress: Callable[[float], None]) -> Hearing:
            asked.append(request)
            on_progress(0.5)
            request.out.mkdir()
            (request.out / "hearing.png").write_bytes(b"0")
            parts = {"arms": Decided(same_speech=0.5, same_noise=0.3, neither=0.1)}
            return Hearing((Heard("gan/5", 3.0, parts, 0.8),), (request.out / "hearing.png",))

        with gr.Blocks():
            parts = FigureParts(gr.HTML(), gr.HTML(), gr.HTML())
        names = {getattr(parts, name): name for name in parts.__dataclass_fields__}
        runner = HearingRunner(
            made_services(tmp_path, catalogue=catalogue_of(*examples)), measure, parts
        )
        last: dict[str, Any] = {}
        try:
            for update in runner.run(VISITOR, *values):  # type: ignore[arg-type]
                last |= {names[part]: value for part, value in update.items()}
        except gr.Error as error:
            last = {"error": str(error.message)}
        return asked, last

    return run


def test_two_examples_are_compared_where_nothing_is_uploaded(runs: Runs) -> None:
    (asked,), last = runs(["gan/5"], None, None, -1.0, False)
    assert asked.speakers is None
    assert asked.speeches == EXAMPLES[:2] and asked.guidance is None and asked.seeds == 2
    assert "of 1 system." in last["status"]
    line = "<li>gan/5: speech decides 40% of the arms&#x27; speed and chance 20%"
    assert last["message"]["visible"] and line in last["message"]["value"]
    assert last["figure"]["visible"] and "<img" in last["figure"]["value"]


def test_an_example_takes_the_place_of_the_speech_that_is_missing(runs: Runs) -> None:
    (asked,), _ = runs(["gan/5"], None, "/up/a.wav", 1.0, True)
    assert asked.speeches == (Path("/up/a.wav"), EXAMPLES[1]), "another than the one of its name"
    assert asked.guidance == 1.0 and asked.speakers == ("hana", "june")


def test_what_is_missing_is_said(runs: Runs) -> None:
    assert runs([], None, None, -1.0, False)[1] == {"error": "Tick at least one system to compare."}
    assert "fewer than two" in runs(["gan/5"], None, None, -1.0, False, examples=())[1]["error"]
    both = runs(["gan/5"], "/up/a.wav", "/down/a.wav", -1.0, False)[1]
    assert "one name" in both["error"]
