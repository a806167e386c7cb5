"""Ends of phases, moved: what gives way, what is mended and what is refused."""

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.plan.editing import Gesture, added, gestures, held, keeping
from model.plan.ends import LEAST_S, counterpart, ended
from model.plan.plan import SIDES, GesturePlan, PlanError
from tests.model.plan.made import made_plan, phase

STILL = (phase(0.0, 10.0, "rest"),)


def told(plan: GesturePlan, side="right") -> list[tuple[str, float, float]]:
    return [(p.phase, round(p.start_s, 3), round(p.end_s, 3)) for p in plan.hand(side)]


@pytest.fixture
def plan() -> GesturePlan:
    """Ten seconds: the right hand rests to 1.2, gets ready to 1.69, strikes to 2, holds to 2.3,
    goes back to 3.1, rests to 5.7, and strikes again to 6.5."""
    still = GesturePlan(10.0, left=STILL, right=STILL)
    return added(added(still, "you", 2.0, "right").plan, "offer", 6.5, "right").plan


def test_a_longer_hold_moves_the_way_back_into_the_rest_and_leaves_the_next_gesture(plan):
    longer = ended(plan, "right", 2.3, 3.5)
    assert told(longer.plan)[3:6] == [
        ("hold", 2.0, 3.5),
        ("retraction", 3.5, 4.3),
        ("rest", 4.3, 5.7),
    ]
    assert longer.plan.right[6:] == plan.right[6:] and longer.plan.left == plan.left
    assert longer.notes == ()
    assert told(ended(longer.plan, "right", 3.5, 2.3).plan) == told(plan)
    short = ended(plan, "right", 2.3, 2.12).plan
    assert told(short)[3:6] == [
        ("hold", 2.0, 2.12),
        ("retraction", 2.12, 2.92),
        ("rest", 2.92, 5.7),
    ]


def test_a_way_back_shortens_before_it_goes_and_that_is_said(plan):
    tight = ended(plan, "right", 2.3, 4.9)
    assert told(tight.plan)[3:6] == [
        ("hold", 2.0, 4.9),
        ("retraction", 4.9, 5.5),
        ("rest", 5.5, 5.7),
    ]
    stays = ended(plan, "right", 2.3, 5.3)
    assert told(stays.plan)[3:5] == [("hold", 2.0, 5.7), ("preparation", 5.7, 6.19)]
    (note,) = stays.notes
    assert note.endswith("back to rest: the hold lasts until the next gesture begins, 5.70 s.")
    again = ended(stays.plan, "right", 5.7, 4.0)
    assert told(again.plan)[3:6] == [
        ("hold", 2.0, 4.0),
        ("retraction", 4.0, 4.8),
        ("rest", 4.8, 5.7),
    ]
    assert again.plan.right[4].goal == again.plan.right[5].goal == plan.right[4].goal
    last = held(plan, Gesture("right", 6.5), 1.0).plan
    until_end = ended(last, "right", 7.5, 9.8)
    assert told(until_end.plan)[-1] == ("hold", 6.5, 10.0)
    assert "until the speech ends, 10.00 s" in until_end.notes[0]


def test_what_follows_gives_way_but_for_what_a_hand_needs(plan):
    slow = ended(plan, "right", 2.0, 2.15)
    assert told(slow.plan)[2:4] == [("stroke", 1.69, 2.15), ("hold", 2.15, 2.3)]
    far = ended(plan, "right", 2.0, 4.0)
    assert told(far.plan)[2:4] == [("stroke", 1.69, 2.2), ("hold", 2.2, 2.3)]
    assert far.notes == ("The stroke ends at 2.20 s: the hold after it needs 0.1 s.",)
    early = ended(plan, "right", 2.0, 0.0)
    assert told(early.plan)[2] == ("stroke", 1.69, 1.89)
    assert early.notes == ("The stroke ends at 1.89 s: it lasts 0.2 s at least.",)
    later = ended(plan, "right", 1.2, 1.6)
    assert told(later.plan)[:2] == [("rest", 0.0, 1.49), ("preparation", 1.49, 1.69)]
    back = ended(plan, "right", 3.1, 2.4)
    assert told(back.plan)[4:6] == [("retraction", 2.3, 2.8), ("rest", 2.8, 5.7)]


def test_ends_that_cannot_be_moved_are_refused_in_a_sentence(plan):
    with pytest.raises(PlanError, match=r"right hand does nothing that ends at 4.00 s"):
        ended(plan, "right", 4.0, 4.2)
    with pytest.raises(PlanError, match=r"left hand's rest ends with the speech"):
        ended(plan, "left", 10.0, 9.0)
    shortest = ended(plan, "right", 2.0, 0.0).plan
    with pytest.raises(PlanError, match=r"The stroke ends at 1.89 s: it lasts 0.2 s at least\."):
        ended(shortest, "right", 1.89, 1.8)
    tight = ended(plan, "right", 2.0, 4.0).plan
    with pytest.raises(PlanError, match=r"the hold after it needs 0.1 s"):
        ended(tight, "right", 2.2, 3.0)


def test_both_hands_parts_of_a_gesture_are_found_together():
    both = added(GesturePlan(10.0, left=STILL, right=STILL), "big", 4.0, "both").plan
    assert counterpart(both, "left", 4.3) == 4.3
    assert counterpart(both, "left", 4.0) == 4.0
    rest_s = both.left[0].end_s
    assert counterpart(both, "left", rest_s) is None, "rests are no part of a gesture"
    alone = ended(both, "left", 4.3, 5.0).plan
    assert counterpart(alone, "left", 5.0) is None
    assert counterpart(made_plan(), "right", 2.4) is None


def test_a_locked_gesture_keeps_its_strokes(plan):
    locked = [Gesture("right", 2.0)]
    held_on = ended(plan, "right", 2.3, 3.0)
    assert keeping(locked, plan, held_on) == held_on
    with pytest.raises(PlanError, match="is locked"):
        keeping(locked, plan, ended(plan, "right", 2.0, 2.1))


@settings(max_examples=80, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(SIDES), st.integers(0, 30), st.floats(0, 6)), max_size=8))
def test_whatever_ends_elsewhere_phases_follow_on_one_another(moves):
    plan = made_plan()
    for side, which, at in moves:
        phases = plan.hand(side)
        try:
            new = ended(plan, side, phases[which % len(phases)].end_s, at).plan
        except PlanError as error:
            assert str(error).endswith(".")
            continue
        after = new.hand(side)
        assert after[0].start_s == 0 and after[-1].end_s == plan.duration_s
        for one, other in pairwise(after):
            assert other.start_s == one.end_s
        before = {
            p.phase: min(q.end_s - q.start_s for q in phases if q.phase == p.phase) for p in phases
        }
        for one in after:
            least = min(LEAST_S[one.phase], before.get(one.phase, LEAST_S[one.phase]))
            assert one.end_s - one.start_s >= least - 1e-6
        assert len(gestures(new, side)) == len(gestures(plan, side))
        assert new.hand(SIDES[1 - SIDES.index(side)]) == plan.hand(SIDES[1 - SIDES.index(side)])
        plan = new
