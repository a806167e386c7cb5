"""Kinds of gestures by words, speakers and places, and strokes that words call for."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from model.plan.kinds import PREPARATION_S, STROKE_S, KindTable, group_gesture_phases
from model.plan.plan import SIDES, GesturePlan, Side, fill_gaps
from model.plan.plan_features import plan_tracks
from tests.model.plan.made import REST, made_plan, phase, resting, said

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
    assert set(table.kind_shares_by_word) == {"huge"} and table.kind_shares_by_word["huge"] == {
        "big": 1.0
    }


def test_kinds_go_by_speaker_place_and_hands(table):
    def drawn(goal, speaker: int, both: bool = False) -> Counter[str]:
        plan = one_stroke("", goal, both=both)
        rng = np.random.default_rng(3)
        found = [table.sample_kinds(plan, speaker, (), rng).right[1].kind for _ in range(50)]
        return Counter(found)

    assert drawn(HERE, 1).most_common(1)[0][0] == "here"
    assert drawn(THERE, 2).most_common(1)[0][0] == "there"
    assert drawn(HERE, 1, both=True)["big"] > 40


def test_a_word_that_calls_gets_its_gesture_and_its_place(table):
    plan = one_stroke("", THERE)
    told = table.sample_kinds(plan, 2, (said("Huge", 0.8, 1.1),), np.random.default_rng(0))
    assert [p.kind for p in told.right] == ["big", "big", "big", ""]
    assert told.right[1].word == "huge"
    moved = np.linalg.norm(np.subtract(told.right[1].goal, HERE))
    assert moved < 0.4 * np.linalg.norm(np.subtract(THERE, HERE))
    far = table.sample_kinds(plan, 2, (said("huge", 1.6, 1.9),), np.random.default_rng(0))
    assert far.right[1].word == "" and far.right[1].goal == THERE


def test_both_hands_that_land_together_make_one_gesture(table):
    for seed in range(20):
        told = table.sample_kinds(
            one_stroke("", HERE, both=True), 1, (), np.random.default_rng(seed)
        )
        assert told.left[1].kind == told.right[1].kind != ""


def test_beats_outside_gestures_follow(table):
    hand = (phase(0.0, 1.0, "rest"), phase(1.0, 1.2, "beat"), phase(1.2, 2.0, "rest"))
    told = table.sample_kinds(GesturePlan(2.0, right=hand), 1, (), np.random.default_rng(0))
    assert [p.kind for p in told.right] == ["", "follow", ""]


def test_strokes_hold_what_follows_them():
    (stroke,) = group_gesture_phases(made_plan())
    assert (stroke.side, stroke.first_index, stroke.last_index, stroke.is_bimanual) == (
        "right",
        1,
        6,
        False,
    )
    assert stroke.last_stroke.word == "whole"
    plan = replace(made_plan(), left=made_plan().right)
    assert [s.is_bimanual for s in group_gesture_phases(plan)] == [True, True]


P, S, H, B, R = "preparation", "stroke", "hold", "beat", "retraction"


@pytest.mark.parametrize(
    ("rows", "gestures"),
    [
        # pre-stroke hold, stroke, post-stroke hold (Kita et al. 1998)
        ([(0, 1, P), (1, 2, H), (2, 3, S), (3, 4, H), (4, 5, R)], [(0, 4)]),
        ([(0, 1, P), (1, 2, H), (2, 3, P), (3, 4, S)], [(2, 4)]),
        ([(0, 1, S), (1, 2, H), (2, 3, S), (3, 4, H)], [(0, 2), (2, 4)]),
        ([(0, 1, P), (1, 2, H), (2, 3, R)], []),
        ([(0, 1, H), (1, 2, S), (2, 3, B)], [(1, 3)]),
        # strokes in succession: a gap or another kind separates them
        ([(0, 1, S), (1, 2, S)], [(0, 2)]),
        ([(0, 1, S), (1.005, 2, S)], [(0, 2)]),
        ([(0, 1, S), (1.04, 2, S), (3, 4, S), (5, 6, S)], [(0, 1), (1.04, 2), (3, 4), (5, 6)]),
        ([(0, 1, S, "you"), (1, 2, S, "you"), (2, 3, S, "one")], [(0, 2), (2, 3)]),
        ([(0, 1, S, "you"), (1, 2, S)], [(0, 2)]),
    ],
)
def test_a_gesture_begins_and_ends_where_annotators_say(rows, gestures):
    plan = GesturePlan(
        8.0, right=tuple(phase(float(a), float(b), name, HERE, *kind) for a, b, name, *kind in rows)
    )
    found = group_gesture_phases(plan)
    spans = [(plan.right[s.first_index].start_s, plan.right[s.last_index].end_s) for s in found]
    assert spans == gestures
    filled = plan.with_hand("right", fill_gaps(plan.right, plan.duration_s))
    assert [s.last_stroke for s in group_gesture_phases(filled)] == [s.last_stroke for s in found]


STILL = resting(8.0)


@pytest.fixture(scope="module")
def calling() -> KindTable:
    plans = [(one_stroke("here", HERE, "so"), 1) for _ in range(60)]
    plans += [(one_stroke("point", THERE, "there"), 1) for _ in range(10)]
    plans += [(one_stroke("big", HERE, "huge", both=True), 1) for _ in range(10)]
    return KindTable.fit(plans, num_speakers=3, word_counts={"so": 60, "there": 10, "huge": 20})


def called(plan: GesturePlan, words, table: KindTable, seed: int = 0) -> GesturePlan:
    return table.add_word_strokes(plan, words, np.random.default_rng(seed))


def strokes(plan: GesturePlan) -> list[tuple[Side, str, str]]:
    return [
        (side, p.kind, p.word) for side in SIDES for p in plan.hand(side) if p.phase == "stroke"
    ]


def test_how_often_a_word_is_struck_is_counted_once_for_both_hands_and_weights_carry_it(calling):
    assert calling.stroke_shares_by_word == {"there": 1.0, "huge": 0.5}
    again = KindTable.from_tensors({k: t.float() for k, t in calling.to_tensors().items()})
    assert (again.names, again.kind_shares_by_word, again.stroke_shares_by_word) == (
        calling.names, calling.kind_shares_by_word, calling.stroke_shares_by_word,
    )  # fmt: skip
    np.testing.assert_allclose(again.mean_goals, calling.mean_goals, rtol=1e-6)
    assert [again.number_or_zero(name) for name in ("", "none", "big", "point")] == [0, 0, 1, 4]


def test_a_word_on_a_still_hand_gets_its_gesture_and_the_hand_its_rest_again(calling):
    word = said("There", 4.0, 4.5)
    plan = called(STILL, [word], calling)
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
    assert np.isfinite(plan_tracks(plan, 240)).all()


def test_both_hands_make_what_both_make_as_often_as_people_do(calling):
    counts = [
        len(strokes(called(STILL, [said("huge", 4, 4.4)], calling, seed))) for seed in range(80)
    ]
    assert set(counts) == {0, 2} and 25 < counts.count(2) < 55
    busy = replace(STILL, left=made_plan().right)
    words = [said("huge", at, at + 0.4) for at in (1.7, 2.5)]
    assert all(called(busy, words, calling, seed) == busy for seed in range(20))


def test_what_is_struck_already_or_has_no_room_stays(calling):
    plan = replace(STILL, right=made_plan().right)
    assert called(plan, [said("there", 1.8, 2.0)], calling) == plan  # lands at 1.9
    assert called(STILL, [said("there", 0.3, 0.6), said("there", 7.9, 8.0)], calling) == STILL
    assert called(STILL, [said("so", 4.0, 4.3), said("what", 5.0, 5.2)], calling) == STILL


def test_a_hold_gives_way_and_is_held_on_until_the_next_phase(calling):
    held = (phase(0.0, 1.0, "stroke", HERE, "here"), phase(1.0, 5.0, "hold", HERE, "here"),
            phase(5.0, 6.0, "retraction"), phase(6.0, 8.0, "rest"))  # fmt: skip
    left = (phase(0.0, 8.0, "preparation", HERE, "here"),)  # no room
    plan = called(replace(STILL, right=held, left=left), [said("there", 3.0, 3.4)], calling)
    names = [(p.phase, p.kind) for p in plan.right]
    assert names[1:5] == [("hold", "here"), ("preparation", "point"), ("stroke", "point"),
                          ("hold", "point")]  # fmt: skip
    assert plan.right[4].end_s == plan.right[5].start_s == 5.0


def test_words_that_are_not_used_spend_their_chances_too(calling):
    both = [said("huge", 2.0, 2.4), said("huge", 6.0, 6.4)]
    other = [said("tea", 2.0, 2.4), said("huge", 6.0, 6.4)]
    for seed in range(12):
        one, two = (called(STILL, words, calling, seed) for words in (both, other))
        last = [{p.word for p in plan.right if p.end_s > 5.5} for plan in (one, two)]
        assert last[0] == last[1]
