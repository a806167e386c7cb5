from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import pytest

from model.plan.kinds import KindTable, strokes_of
from model.plan.plan import GesturePlan
from tests.model.plan.made import REST, made_plan, phase


@dataclass(frozen=True)
class Said:
    text: str
    start_s: float
    end_s: float


HERE, THERE = (0.1, 0.0, 0.3), (0.4, 0.2, 0.3)


def one_stroke(kind: str, goal, word: str = "", both: bool = False) -> GesturePlan:
    hand = (
        phase(0.0, 0.5, "preparation", goal, kind),
        phase(0.5, 1.0, "stroke", goal, kind, word),
        phase(1.0, 1.5, "hold", goal, kind),
        phase(1.5, 2.0, "retraction", REST),
    )
    return GesturePlan(2.0, left=hand if both else (), right=hand)


@pytest.fixture(scope="module")
def table() -> KindTable:
    rng = np.random.default_rng(0)

    def near(goal):
        return tuple(np.array(goal) + rng.normal(0, 0.02, 3))

    plans = [(one_stroke("here", near(HERE), "so"), 1) for _ in range(60)]
    plans += [(one_stroke("there", near(THERE), "so"), 2) for _ in range(60)]
    plans += [(one_stroke("big", near(HERE), "huge", both=True), 1) for _ in range(9)]
    return KindTable.fit(plans, num_speakers=3)


def test_words_call_what_lands_on_them_more_than_on_others(table):
    assert table.names == ("big", "follow", "here", "there")
    assert set(table.calls) == {"huge"} and table.calls["huge"] == {"big": 1.0}


def test_kinds_go_by_speaker_place_and_hands(table):
    def drawn(goal, speaker: int, both: bool = False) -> Counter[str]:
        plan = one_stroke("", goal, both=both)
        rng = np.random.default_rng(3)
        found = [table.drawn(plan, speaker, (), rng).right[1].kind for _ in range(50)]
        return Counter(found)

    assert drawn(HERE, 1).most_common(1)[0][0] == "here"
    assert drawn(THERE, 2).most_common(1)[0][0] == "there"
    assert drawn(HERE, 1, both=True)["big"] > 40


def test_a_word_that_calls_gets_its_gesture_and_its_place(table):
    plan = one_stroke("", THERE)
    told = table.drawn(plan, 2, (Said("Huge", 0.8, 1.1),), np.random.default_rng(0))
    assert [p.kind for p in told.right] == ["big", "big", "big", ""]
    assert told.right[1].word == "huge"
    moved = np.linalg.norm(np.subtract(told.right[1].goal, HERE))
    assert moved < 0.4 * np.linalg.norm(np.subtract(THERE, HERE))
    far = table.drawn(plan, 2, (Said("huge", 1.6, 1.9),), np.random.default_rng(0))
    assert far.right[1].word == "" and far.right[1].goal == THERE


def test_both_hands_that_land_together_make_one_gesture(table):
    for seed in range(20):
        told = table.drawn(one_stroke("", HERE, both=True), 1, (), np.random.default_rng(seed))
        assert told.left[1].kind == told.right[1].kind != ""


def test_beats_outside_gestures_follow(table):
    hand = (phase(0.0, 1.0, "rest"), phase(1.0, 1.2, "beat"), phase(1.2, 2.0, "rest"))
    told = table.drawn(GesturePlan(2.0, right=hand), 1, (), np.random.default_rng(0))
    assert [p.kind for p in told.right] == ["", "follow", ""]


def test_strokes_hold_what_follows_them():
    (stroke,) = strokes_of(made_plan())
    assert (stroke.side, stroke.first, stroke.last, stroke.both) == ("right", 1, 6, False)
    assert stroke.lands.word == "whole"
    plan = replace(made_plan(), left=made_plan().right)
    assert [s.both for s in strokes_of(plan)] == [True, True]


def test_weights_carry_the_table(table):
    again = KindTable.of_tensors({k: t.float() for k, t in table.tensors().items()})
    assert again.names == table.names and again.calls == table.calls
    np.testing.assert_allclose(again.goal, table.goal, rtol=1e-6)
    assert [again.place(name) for name in ("", "none", "big", "there")] == [0, 0, 1, 4]
