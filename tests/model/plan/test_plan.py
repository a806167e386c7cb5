import json
from dataclasses import replace

import pytest

from model.plan.plan import GesturePlan, Nod, PlanError, read_plan
from tests.model.plan.made import HIGH, made_plan, phase


def test_what_was_written_is_read(tmp_path):
    plan = made_plan()
    plan.write(tmp_path / "plan.json")
    assert read_plan(tmp_path / "plan.json") == plan


def test_a_plan_may_tell_little(tmp_path):
    path = tmp_path / "plan.json"
    path.write_text('{"format": 1, "duration_s": 2, "nods": [{"time_s": 1, "depth_deg": 3}]}')
    assert read_plan(path) == GesturePlan(2.0, nods=(Nod(1.0, 3.0),))


def test_twice_as_fast_takes_half_as_long():
    plan = made_plan().at_speed(2.0)
    assert plan.duration_s == 3.0
    assert plan.right[2].end_s == 0.95 and plan.right[2].goal == made_plan().right[2].goal
    assert plan.nods[0] == Nod(0.95, 4.0)
    assert plan.at_speed(0.5) == made_plan()


BAD = {
    "not json": "is no plan of format 1",
    "[]": "is no plan of format 1",
    '{"format": 2}': "is no plan of format 1",
    '{"format": 1, "duration_s": "x"}': "lasts nan s",
    '{"format": 1, "duration_s": 2, "dance": []}': "'dance', which no plan has",
    '{"format": 1, "duration_s": 2, "nods": 3}': "nods is no list",
    '{"format": 1, "duration_s": 2, "nods": [7]}': "has not the fields time_s, depth_deg",
    '{"format": 1, "duration_s": 2, "nods": [{"time_s": 1}]}': "has not the fields",
    '{"format": 1, "duration_s": 2, "nods": [{"time_s": true, "depth_deg": 1}]}': "no number",
    '{"format": 1, "duration_s": 2, "nods": [{"time_s": 1e999, "depth_deg": 1}]}': "no number",
    '{"format": 1, "duration_s": 2, "smiles": [{"start_s": 1, "end_s": 1, "size": 1}]}': (
        "it must end after it begins"
    ),
    '{"format": 1, "duration_s": 2, "stands": [{"start_s": 0, "end_s": 1, "leg": "third"}]}': (
        "has a leg 'third'; use one of left, right, both"
    ),
}


@pytest.mark.parametrize("text", BAD)
def test_what_is_no_plan_is_refused_in_a_sentence(tmp_path, text):
    path = tmp_path / "plan.json"
    path.write_text(text)
    with pytest.raises(PlanError, match=r"^plan\.json") as told:
        read_plan(path)
    assert BAD[text] in str(told.value)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"phase": "dance"}, "a phase 'dance'; use one of rest, preparation"),
        ({"goal": [0, 0]}, "no three numbers"),
        ({"goal": [0, 0, 3]}, "a goal farther than 1 m from the chest"),
        ({"goal": [0, 0, "x"]}, "no three numbers"),
        ({"goal": "here"}, "no three numbers"),
        ({"kind": 5}, "kind that is no short text"),
        ({"word": "x" * 100}, "word that is no short text"),
        ({"start_s": 0.5}, "in the middle of a rest; a hand does one thing at a time"),
        ({"end_s": None}, "end_s that is no number"),
    ],
)
def test_a_hand_that_cannot_is_refused(tmp_path, change, told):
    path = tmp_path / "plan.json"
    wrong = json.loads(made_plan().as_json())
    wrong["right"][1] |= change
    path.write_text(json.dumps(wrong))
    with pytest.raises(PlanError) as found:
        read_plan(path)
    assert told in str(found.value)


def test_a_missing_and_a_huge_file_are_told(tmp_path, monkeypatch):
    with pytest.raises(PlanError, match="could not be read: no such file"):
        read_plan(tmp_path / "none.json")
    monkeypatch.setattr("model.plan.plan.MAX_BYTES", 10)
    made_plan().write(tmp_path / "plan.json")
    with pytest.raises(PlanError, match="larger than"):
        read_plan(tmp_path / "plan.json")


def test_deep_nesting_is_no_plan(tmp_path):
    path = tmp_path / "plan.json"
    path.write_text("[" * 100_000)
    with pytest.raises(PlanError, match="is no plan"):
        read_plan(path)


def test_a_hand_is_exchanged_by_side():
    other = (phase(0.0, 1.0, "rest", HIGH),)
    assert made_plan().with_hand("left", other) == replace(made_plan(), left=other)
    assert made_plan().with_hand("right", other).hand("right") == other
