from dataclasses import replace

import numpy as np
import pytest

from model.plan.called import PREPARATION_S, STROKE_S, with_called_strokes
from model.plan.kinds import KindTable
from model.plan.plan import SIDES, GesturePlan, Side
from model.plan.tracks import tracks_of
from tests.model.plan.made import REST, made_plan, phase
from tests.model.plan.test_kinds import HERE, THERE, Said, one_stroke

STILL = GesturePlan(8.0, left=(phase(0.0, 8.0, "rest"),), right=(phase(0.0, 8.0, "rest"),))


@pytest.fixture(scope="module")
def table() -> KindTable:
    plans = [(one_stroke("here", HERE, "so"), 1) for _ in range(60)]
    plans += [(one_stroke("point", THERE, "there"), 1) for _ in range(10)]
    plans += [(one_stroke("big", HERE, "huge", both=True), 1) for _ in range(10)]
    return KindTable.fit(plans, num_speakers=3, said={"so": 60, "there": 10, "huge": 20})


def called(plan: GesturePlan, words, table: KindTable, seed: int = 0) -> GesturePlan:
    return with_called_strokes(plan, words, table, np.random.default_rng(seed))


def strokes(plan: GesturePlan) -> list[tuple[Side, str, str]]:
    return [
        (side, p.kind, p.word) for side in SIDES for p in plan.hand(side) if p.phase == "stroke"
    ]


def test_how_often_a_word_is_struck_is_counted_once_for_both_hands(table):
    assert table.struck == {"there": 1.0, "huge": 0.5}
    again = KindTable.of_tensors(table.tensors())
    assert again.struck == table.struck and again.calls == table.calls


def test_a_word_on_a_still_hand_gets_its_gesture_and_the_hand_its_rest_again(table):
    word = Said("There", 4.0, 4.5)
    plan = called(STILL, [word], table)
    ((side, kind, landed),) = strokes(plan)
    assert (kind, landed) == ("point", "there")
    names = [p.phase for p in plan.hand(side)]
    assert names == ["rest", "preparation", "stroke", "hold", "retraction", "rest"]
    stroke = plan.hand(side)[2]
    assert word.start_s < stroke.end_s < word.end_s
    assert stroke.end_s - stroke.start_s == pytest.approx(STROKE_S)
    assert plan.hand(side)[1].start_s == pytest.approx(stroke.end_s - STROKE_S - PREPARATION_S)
    np.testing.assert_allclose(stroke.goal, THERE, atol=1e-6)
    assert plan.hand(side)[-1].goal == REST and plan.hand(side)[-1].end_s == 8.0
    other = SIDES[1 - SIDES.index(side)]
    assert [p.phase for p in plan.hand(other)] == ["rest"]
    assert np.isfinite(tracks_of(plan, 240)).all()


def test_both_hands_make_what_both_make_as_often_as_people_do(table):
    counts = [
        len(strokes(called(STILL, [Said("huge", 4, 4.4)], table, seed))) for seed in range(80)
    ]
    assert set(counts) == {0, 2} and 25 < counts.count(2) < 55
    busy = replace(STILL, left=made_plan().right)
    words = [Said("huge", at, at + 0.4) for at in (1.7, 2.5)]
    assert all(called(busy, words, table, seed) == busy for seed in range(20))


def test_what_is_struck_already_or_has_no_room_stays(table):
    plan = replace(STILL, right=made_plan().right)
    assert called(plan, [Said("there", 1.8, 2.0)], table) == plan  # lands at 1.9
    assert called(STILL, [Said("there", 0.3, 0.6), Said("there", 7.9, 8.0)], table) == STILL
    assert called(STILL, [Said("so", 4.0, 4.3), Said("what", 5.0, 5.2)], table) == STILL


def test_a_hold_gives_way_and_is_held_on_until_the_next_phase(table):
    held = (phase(0.0, 1.0, "stroke", HERE, "here"), phase(1.0, 5.0, "hold", HERE, "here"),
            phase(5.0, 6.0, "retraction"), phase(6.0, 8.0, "rest"))  # fmt: skip
    left = (phase(0.0, 8.0, "preparation", HERE, "here"),)  # no room
    plan = called(replace(STILL, right=held, left=left), [Said("there", 3.0, 3.4)], table)
    names = [(p.phase, p.kind) for p in plan.right]
    assert names[1:5] == [("hold", "here"), ("preparation", "point"), ("stroke", "point"),
                          ("hold", "point")]  # fmt: skip
    assert plan.right[4].end_s == plan.right[5].start_s == 5.0


def test_words_that_are_not_used_spend_their_chances_too(table):
    said = [Said("huge", 2.0, 2.4), Said("huge", 6.0, 6.4)]
    other = [Said("tea", 2.0, 2.4), Said("huge", 6.0, 6.4)]
    for seed in range(12):
        one, two = (called(STILL, words, table, seed) for words in (said, other))
        last = [{p.word for p in plan.right if p.end_s > 5.5} for plan in (one, two)]
        assert last[0] == last[1]
