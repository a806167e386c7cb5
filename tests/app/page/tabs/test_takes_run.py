"""What a browser asks its editor for, and the take that comes of it."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gradio as gr
import pytest

from app import text
from app.errors import RunError
from app.page.player.edited_runs import EditedRuns
from app.page.player.player import Showing
from app.page.results.result_parts import build_results
from app.page.routes.media import MediaAddresses
from app.page.tabs.takes_run import Asked, MakeTake, TakesRunner, read_asked
from app.run.output.telling import Reporter
from app.run.pieces import PieceTeller
from app.run.requests.request import Artefact, GenerateRequest, OnEvent, ShouldCancel
from app.run.takes.take import Take, TakeFiles, TakeRequest
from model.motion.motion import save_motion
from model.plan.plan import GesturePlan, PlanError
from model.speech.audio import write_wav
from model.speech.transcript import Word
from tests.app.fakes import made_motion, made_services
from tests.model.made import made_waveform
from tests.model.plan.made import phase

COOKIE = "a browser"
ROW = "workbench/planned"
FRAMES = 90
NOD = {"do": "nod", "at": 1.0}


def make(request: TakeRequest, on_event: OnEvent, should_cancel: ShouldCancel) -> Take:
    request.out.mkdir()
    motion = request.out / f"{request.name.replace('/', '-')}.npz"
    save_motion(made_motion(FRAMES), motion)
    PieceTeller(request.name, FRAMES, Reporter(on_event, should_cancel)).go_on(made_motion(FRAMES))
    told = request.out / "told.json"
    told.write_text("{}")
    on_event(Artefact("motion", request.name, motion))
    return Take(TakeFiles(request.plan, motion, told), told, ("It was mended.",), ((0.5, 1.0),))


class Page:
    """A tab with one run of this browser's."""

    def __init__(self, folder: Path, make: MakeTake = make, cookie: str = COOKIE) -> None:
        with gr.Blocks():
            self.parts = build_results()
        self.runs = EditedRuns()
        services = made_services(folder, {"make_take": make})
        self.jobs = services.jobs
        self.runner = TakesRunner(services, self.runs, self.parts)
        run = folder / "run"
        run.mkdir()
        write_wav(folder / "talk.wav", made_waveform(16_000 * FRAMES // 30))
        request = GenerateRequest(folder / "talk.wav", run / "results", folder, (ROW,))
        self.showing = Showing.of_run(request, (ROW,), run, MediaAddresses(), cookie)
        self.showing.begin()
        plan, motion = run / "x.plan.json", run / "x.npz"
        GesturePlan(3.0, left=(phase(0.0, 3.0, "rest"),)).write(plan)
        save_motion(made_motion(FRAMES), motion)
        self.showing.take(Artefact("plan", ROW, plan))
        self.showing.take(Artefact("motion", ROW, motion))
        words = (Word(0.2, 0.5, "you"),)
        self.run = self.runs.keep(cookie, run, request, self.showing, words)

    def ask(self, *edits: Any, start: str = ROW, cookie: str = COOKIE) -> list[dict[str, Any]]:
        told = {"run": "run", "start": start, "edits": list(edits), "locked": []}
        request: Any = SimpleNamespace(
            session_hash="visitor", cookies={"study_visitor": cookie}, client=None
        )
        updates = list(self.runner.run(request, json.dumps(told)))
        return [update[self.parts.player] for update in updates]


def rows(value: dict[str, Any]) -> list[str]:
    return [row["name"] for row in value["rows"]]


def test_a_take_stands_beside_the_run_and_the_next_begins_from_it(tmp_path: Path) -> None:
    asked: list[TakeRequest] = []

    def noted(request: TakeRequest, *how: Any) -> Take:
        asked.append(request)
        return make(request, *how)

    page = Page(tmp_path, noted)
    ready = page.ask()[-1]
    assert ready["editing"]["said"] == text.EDITOR_READY and rows(ready) == [ROW]
    last = page.ask(NOD)[-1]
    assert rows(last) == [ROW, f"{ROW}.take1"]
    take = last["rows"][1]
    assert (take["label"], take["take"], take["of"]) == ("take 1", 1, ROW)
    assert take["noise"] == last["rows"][0]["noise"] and take["there"]["end"] == FRAMES
    editing = last["editing"]
    assert editing["said"] == f"{text.TAKE_DONE.format(number=1)} It was mended."
    assert editing["known"][f"{ROW}.take1"]["from"] == ROW and not editing["state"]
    again = page.ask(NOD, start=f"{ROW}.take1")[-1]
    assert again["editing"]["known"][f"{ROW}.take2"]["from"] == f"{ROW}.take1"
    first, one, two = asked
    assert not first.edits and first.before is None
    assert one.before is not None and one.words[0].text == "you"
    assert two.before is not None and "take1" in two.before.motion.name
    assert page.showing.drawn().keys() == {ROW}  # videos and pairs are of the run


def test_an_edit_that_is_not_ready_for_gets_ready_first(tmp_path: Path) -> None:
    last = Page(tmp_path).ask(NOD)[-1]
    assert set(last["editing"]["known"]) == {ROW, f"{ROW}.take1"}


def test_what_cannot_be_done_is_said_and_leaves_no_row(tmp_path: Path) -> None:
    def fails(request: TakeRequest, on_event: OnEvent, should_cancel: ShouldCancel) -> Take:
        made = make(request, on_event, should_cancel)
        if request.edits:
            raise PlanError("The hand has no time.")
        return made

    page = Page(tmp_path, fails)
    last = page.ask(NOD)[-1]
    assert rows(last) == [ROW]
    told = last["editing"]
    assert (told["said"], told["refused"], told["state"]) == ("The hand has no time.", True, "")
    wrong = page.ask({"do": "nod", "at": "now"})[-1]["editing"]
    assert wrong["refused"] and "now is no number from 0 to 3600" in wrong["said"]


def test_nobody_reaches_the_run_of_another(tmp_path: Path) -> None:
    page = Page(tmp_path)
    for cookie in ("another", ""):
        with pytest.raises(gr.Error, match="is another browser's"):
            page.ask(NOD, cookie=cookie)
    assert "editing" not in page.showing.for_visitor("another").value(is_over=True)
    assert "editing" in page.showing.for_visitor(COOKIE).value(is_over=True)
    unknown = page.ask(NOD, start="gan/20")[-1]["editing"]
    assert unknown["refused"] and unknown["said"] == text.EDITS_GONE


@pytest.mark.parametrize(
    "told",
    [
        None, 7, "", "nonsense", "[]", "null", "[" * 100_000, "x" * 3_000_000,
        json.dumps({"run": 3, "start": ROW, "edits": [], "locked": []}),
        json.dumps({"run": "x" * 300, "start": ROW, "edits": [], "locked": []}),
        json.dumps({"run": "run", "start": ROW, "edits": {}, "locked": []}),
        json.dumps({"run": "run", "start": ROW, "edits": [], "locked": None}),
        json.dumps({"run": "run", "start": ROW, "edits": [{"do": "rm"}], "locked": []}),
        '{"run": "run", "start": "x", "edits": [{"do": "nod", "at": NaN}], "locked": []}',
    ],
)  # fmt: skip
def test_anything_else_is_refused_with_a_sentence(told: Any) -> None:
    with pytest.raises(RunError):
        Asked.of(read_asked(told))
