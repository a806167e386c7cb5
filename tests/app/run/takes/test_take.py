"""A run's motion made again after its plan was changed."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.errors import CancelledRun, RunError
from app.run.pipeline import generate_all
from app.run.requests.request import Artefact, Event, GenerateRequest, Piece
from app.run.takes.edits import Edit
from app.run.takes.take import TakeRequest, make_take, row_of
from model.motion.motion import load_motion
from model.plan.editing import added, gestures
from model.plan.plan import GesturePlan, PlanError, read_plan
from model.speech.audio import write_wav
from model.systems.planned.config import PLANNED
from tests.model.made import made_waveform
from tests.model.plan.made import phase
from tests.model.systems.planned.made import make_planned_weights

SECONDS = 12.0


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> TakeRequest:
    """A request that changes nothing, of a run that is there."""
    folder = tmp_path_factory.mktemp("take")
    weights = make_planned_weights(folder / "weights")
    write_wav(folder / "talk.wav", made_waveform(round(16_000 * SECONDS)))
    still = (phase(0.0, SECONDS, "rest"),)
    plan = added(GesturePlan(SECONDS, left=still, right=still), "offer", 9.0, "right").plan
    plan.write(folder / "plan.json")
    run = GenerateRequest(
        folder / "talk.wav", folder / "run", weights, (PLANNED,), seed=4, plan=folder / "plan.json",
        steps=2, has_video=False, has_figures=False,
    )  # fmt: skip
    generate_all(run)
    stem = "workbench-planned"
    return TakeRequest(
        run, PLANNED, 1, PLANNED, folder / "first", run.out / f"{stem}.plan.json", None,
        run.out / f"{stem}.npz",
    )  # fmt: skip


def test_the_plan_as_it_is_gives_the_motion_of_the_run(made: TakeRequest) -> None:
    take = make_take(made, lambda event: None, lambda: False)
    run, again = load_motion(made.beside), load_motion(take.files.motion)
    for name in ("poses", "trans", "expressions"):
        np.testing.assert_array_equal(getattr(run, name), getattr(again, name))


def test_a_take_changes_what_was_edited_and_keeps_the_rest(
    made: TakeRequest, tmp_path: Path
) -> None:
    first = make_take(made, lambda event: None, lambda: False)
    events: list[Event] = []
    edit = Edit("move", {"side": "right", "lands": 9.0, "at": 9.5})
    asked = replace(made, name="x.take1", out=tmp_path / "out", before=first.files, edits=(edit,))
    take = make_take(asked, events.append, lambda: False)
    (part,) = take.fresh_s
    assert 5 < part[0] < 9 and part[1] == SECONDS
    old, new = load_motion(first.files.motion), load_motion(take.files.motion)
    stays = round(30 * part[0])
    np.testing.assert_array_equal(old.poses[:stays], new.poses[:stays])
    assert not np.array_equal(old.poses[stays:], new.poses[stays:])
    pieces = [event for event in events if isinstance(event, Piece)]
    assert pieces[-1].end == old.num_frames and {one.name for one in pieces} == {"x.take1"}
    assert len({(one.turn_rad, one.shift_m) for one in pieces}) == 1  # where the run's stands
    assert {one.kind for one in events if isinstance(one, Artefact)} == {"plan", "motion"}
    assert [one.lands_s for one in gestures(read_plan(take.files.plan), "right")] == [9.5]
    told = json.loads(take.told.read_text())
    (gesture,) = told["gestures"]
    assert (gesture["lands"], gesture["kind"], gesture["partner"]) == (9.5, "offer", None)
    back = Edit("move", {"side": "right", "lands": 9.5, "at": 9.0})
    again = replace(
        made, out=tmp_path / "back", before=take.files, plan=take.files.plan, edits=(back,)
    )
    other = make_take(again, lambda event: None, lambda: False)
    assert [one.lands_s for one in gestures(read_plan(other.files.plan), "right")] == [9.0]


def test_what_cannot_be_leaves_nothing(made: TakeRequest, tmp_path: Path) -> None:
    late = Edit("move", {"side": "right", "lands": 9.0, "at": 40.0})
    asked = replace(made, out=tmp_path / "out", edits=(late,))
    with pytest.raises(PlanError, match=r"the end at 12.00 s"):
        make_take(asked, lambda event: None, lambda: False)
    with pytest.raises(CancelledRun):
        make_take(replace(asked, edits=()), lambda event: None, lambda: True)
    assert not list(tmp_path.rglob("*.npz"))


def test_a_row_says_which_motion_it_is() -> None:
    assert row_of("a/b.s2", ("a/x", "a/b"), 2) == ("a/b", 2)
    with pytest.raises(RunError, match="no such motion"):
        row_of("a/b.s3", ("a/x", "a/b"), 2)
