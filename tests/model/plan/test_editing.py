"""Edits of plans and of ends of phases: what they change, what they leave, and what they refuse."""

from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.plan.editing import (
    MAX_CHEST_TO_WRIST_M,
    MIN_PHASE_S,
    GestureKey,
    add_event,
    add_gesture,
    change_hands,
    default_stroke_end_on_word,
    delete_gesture,
    gestures,
    move_gesture,
    move_phase_end,
    other_hand_phase_end,
    raise_gesture,
    scale_gesture,
    scale_gesture_speed,
    set_hold,
)
from model.plan.kinds import REST_POSITION, USUAL_STROKE_GOALS, group_gesture_phases
from model.plan.plan import SIDES, Blink, Gaze, GesturePlan, Nod, PlanError, PlanResult, Smile
from tests.model.plan.made import LOW, made_plan, phase, resting, said

STILL = resting(10.0)


def told(plan: GesturePlan, side="right") -> list[tuple[str, float, float]]:
    return [(p.phase, round(p.start_s, 3), round(p.end_s, 3)) for p in plan.hand(side)]


def lands(plan: GesturePlan, side="right") -> list[float]:
    return [round(g.stroke_end_s, 3) for g in gestures(plan, side)]


BUSY = STILL
"""The right hand lands at 2, 4.5 and 8, the left at 8."""
for at_s, kind, hands in ((2.0, "you", "right"), (4.5, "offer", "right"), (8.0, "big", "both")):
    BUSY = add_gesture(BUSY, kind, at_s, hands).plan
MIDDLE = GestureKey("right", 4.5)


def test_a_gesture_is_added_with_preparation_hold_and_the_way_back():
    edited = add_gesture(STILL, "you", 4.0, word="you")
    assert told(edited.plan) == [
        ("rest", 0.0, 3.2), ("preparation", 3.2, 3.69), ("stroke", 3.69, 4.0), ("hold", 4.0, 4.3),
        ("retraction", 4.3, 5.1), ("rest", 5.1, 10.0),
    ]  # fmt: skip
    stroke = edited.plan.right[2]
    assert (stroke.goal, stroke.kind, stroke.word) == (USUAL_STROKE_GOALS["you"], "you", "you")
    assert edited.plan.left == STILL.left and edited.notes == ()
    both = add_gesture(STILL, "big", 4.0).plan
    assert lands(both, "left") == lands(both, "right") == [4.0]
    assert default_stroke_end_on_word(said("you", 3.0, 4.0)) == 3.3


def test_a_hand_without_time_to_go_back_stays_where_it_was():
    plan = add_gesture(BUSY, "you", 5.7, "right").plan  # the offer holds to 4.8 and is back at 5.6
    (hold,) = (one for one in plan.right if 4.5 <= one.start_s < 4.9)
    assert (hold.phase, hold.goal, hold.end_s) == ("hold", USUAL_STROKE_GOALS["offer"], 4.9)


def test_a_moved_gesture_lands_where_it_is_asked_to():
    plan = move_gesture(BUSY, MIDDLE, 6.0, word="now").plan
    assert lands(plan) == [2.0, 6.0, 8.0] and plan.left == BUSY.left
    assert next(p for p in plan.right if p.end_s == 6.0).word == "now"
    assert told(move_gesture(plan, GestureKey("right", 6.0), 4.5).plan) == told(BUSY)
    short = STILL.with_hand("right", (
        phase(0.0, 1.0, "rest"), phase(1.0, 1.5, "preparation"), phase(1.5, 1.6, "stroke", LOW),
    ))  # fmt: skip
    mended = move_gesture(short, GestureKey("right", 1.6), 5.0)
    assert ("stroke", 4.8, 5.0) in told(mended.plan)
    assert mended.notes == ("The stroke was shorter than 0.2 s, so its start was moved earlier.",)


def test_a_deleted_gesture_leaves_the_hand_at_rest_or_in_the_hold_before():
    plan = delete_gesture(BUSY, MIDDLE).plan
    assert lands(plan) == [2.0, 8.0]
    rest = next(p for p in plan.right if p.start_s > 2.2 and p.phase == "rest")
    assert rest.end_s == pytest.approx(7.2)
    chained = (
        phase(0.0, 1.0, "rest"), phase(1.0, 1.5, "preparation"), phase(1.5, 2.0, "stroke", LOW),
        phase(2.0, 2.5, "hold", LOW), phase(2.5, 3.0, "preparation"), phase(3.0, 3.4, "stroke"),
        phase(3.4, 4.0, "retraction"), phase(4.0, 10.0, "rest"),
    )  # fmt: skip
    plan = delete_gesture(STILL.with_hand("right", chained), GestureKey("right", 3.4)).plan
    assert told(plan)[3:] == [("hold", 2.0, 3.4), ("retraction", 3.4, 4.0), ("rest", 4.0, 10.0)]


def test_other_hands_make_it():
    plan = change_hands(BUSY, MIDDLE, "left").plan
    assert (lands(plan, "left"), lands(plan)) == ([4.5, 8.0], [2.0, 8.0])
    plan = change_hands(plan, GestureKey("left", 8.0), "right").plan
    assert (lands(plan, "left"), lands(plan)) == ([4.5], [2.0, 8.0])
    plan = change_hands(plan, GestureKey("left", 4.5), "both").plan
    assert (lands(plan, "left"), lands(plan)) == ([4.5], [2.0, 4.5, 8.0])


def test_holds_stretch_until_the_next_gesture_and_say_so():
    plan = set_hold(BUSY, MIDDLE, 1.5)
    assert ("hold", 4.5, 6.0) in told(plan.plan) and plan.notes == ()
    far = set_hold(BUSY, MIDDLE, 9.0)
    assert ("hold", 4.5, 7.2) in told(far.plan)
    assert far.notes == ("The hold was cut at 7.20 s, where the next gesture begins.",)
    assert ("retraction", 4.5, 5.3) in told(set_hold(BUSY, MIDDLE, 0.0).plan)


HELD = GesturePlan(
    6.0,
    right=(
        phase(0.0, 1.0, "rest"), phase(1.0, 2.0, "preparation"), phase(2.0, 2.6, "hold", LOW),
        phase(2.6, 2.7, "stroke", LOW), phase(2.7, 3.0, "hold", LOW), phase(3.0, 3.8, "retraction"),
        phase(3.8, 6.0, "rest"),
    ),
)  # fmt: skip
"""A gesture with a hold before its stroke, which lasts .1 s."""


def test_a_hold_before_a_stroke_belongs_to_its_gesture():
    (gesture,) = gestures(HELD, "right")
    assert told(delete_gesture(HELD, gesture).plan) == [("rest", 0, 6)]
    moved = told(move_gesture(HELD, gesture, 3.7).plan)
    assert moved[1:4] == [("preparation", 2, 3), ("hold", 3, 3.5), ("stroke", 3.5, 3.7)]
    slower = told(scale_gesture_speed(HELD, gesture, 0.5).plan)
    assert slower[:3] == [("preparation", 0, 1.9), ("hold", 1.9, 2.5), ("stroke", 2.5, 2.7)]


def test_size_height_and_speed_change_and_what_no_arm_can_is_mended_and_told():
    def goal(edited: PlanResult) -> tuple[float, float, float]:
        return next(p.goal for p in edited.plan.right if p.end_s == 4.5)

    small, same, large = (
        goal(scale_gesture(BUSY, MIDDLE, size))[1] - REST_POSITION[1] for size in (0.5, 1.0, 1.5)
    )
    assert same == pytest.approx(2 * small, abs=1e-3) and large == pytest.approx(
        3 * small, abs=1e-3
    )
    assert goal(raise_gesture(BUSY, MIDDLE, 0.2))[1] == pytest.approx(
        USUAL_STROKE_GOALS["offer"][1] + 0.2
    )
    for speed, start_s in ((1.3, round(4.5 - 0.31 / 1.3, 3)), (0.5, 3.88), (5.0, 4.3)):
        fast = scale_gesture_speed(BUSY, MIDDLE, speed)
        assert ("stroke", start_s, 4.5) in told(fast.plan)
    assert "The stroke now lasts 0.20 s, the shortest possible." in fast.notes
    high = raise_gesture(BUSY, MIDDLE, 0.9)
    assert sum(n * n for n in goal(high)) ** 0.5 == pytest.approx(MAX_CHEST_TO_WRIST_M, abs=1e-3)
    assert high.notes == (
        f"A hand position out of reach was moved to {MAX_CHEST_TO_WRIST_M:g} m from the chest.",
    )
    inside = STILL.with_hand("right", (
        phase(0.0, 1.0, "rest"), phase(1.0, 1.5, "preparation", (0.05, -0.1, 0.3)),
        phase(1.5, 2.0, "stroke", (0.05, -0.1, 0.02)),
    ))  # fmt: skip
    mended = raise_gesture(inside, GestureKey("right", 2.0), 0.0)
    assert mended.notes == ("A hand position inside the body was moved in front of it.",)


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (lambda p: move_gesture(p, MIDDLE, 2.1), r"makes a preparation \(you\).*no time"),
        (lambda p: move_gesture(p, MIDDLE, 0.1), "must start at 0.2 s or later"),
        (lambda p: move_gesture(p, MIDDLE, 10.2), "before the speech does, at 10.00 s"),
        (lambda p: add_gesture(p, "offer", 8.1), r"The right hand makes a preparation \(big\)"),
        (
            lambda p: add_gesture(p, "whistle", 6.0),
            "There is no gesture 'whistle'; choose one of all",
        ),
        (
            lambda p: delete_gesture(p, GestureKey("left", 4.5)),
            "no gesture whose stroke ends at 4.50",
        ),
        (lambda p: set_hold(p, MIDDLE, -1.0), "0 s or longer; got -1 s"),
        (lambda p: scale_gesture(p, MIDDLE, 9.0), "0.1 to 4; got 9"),
        (lambda p: raise_gesture(p, MIDDLE, 2.0), "at most 1 m"),
        (lambda p: scale_gesture_speed(p, MIDDLE, 0.0), "0.2 to 5; got 0"),
        (lambda p: add_event(p, Nod(11.0, 3.0)), "within the speech, 0 to 10.00 s"),
        (
            lambda p: move_phase_end(p, "right", 4.0, 4.2),
            "No phase of the right hand ends at 4.00 s",
        ),
        (
            lambda p: move_phase_end(p, "left", 10.0, 9.0),
            "left hand's last phase, a rest, ends with the speech",
        ),
        (
            lambda p: move_phase_end(move_phase_end(p, "right", 2.0, 0.0).plan, "right", 1.89, 1.8),
            r"The stroke ends at 1.89 s: it must last at least 0.2 s\.",
        ),
        (
            lambda p: move_phase_end(move_phase_end(p, "right", 2.0, 4.0).plan, "right", 2.2, 3.0),
            "the next hold needs at least 0.1 s",
        ),
    ],
)
def test_what_cannot_be_is_refused(edit, says):
    with pytest.raises(PlanError, match=says):
        edit(BUSY)


def test_nods_looks_smiles_and_blinks():
    plan = add_event(add_event(STILL, Nod(3.0, 4.0)).plan, Nod(1.0, 2.0)).plan
    assert [n.time_s for n in plan.nods] == [1.0, 3.0]
    looking = replace(STILL, looks=(Gaze(0.0, 10.0, 0.0, 0.0),))
    plan = add_event(looking, Gaze(4.0, 5.0, 12.0, 0.0)).plan
    assert [(k.start_s, k.end_s) for k in plan.looks] == [(0.0, 4.0), (4.0, 5.0), (5.0, 10.0)]
    plan = add_event(add_event(STILL, Smile(1.0, 3.0, 0.5)).plan, Smile(0.5, 4.0, 0.2)).plan
    assert plan.smiles == (Smile(0.5, 4.0, 0.2),)
    assert add_event(STILL, Blink(2.0)).plan.blinks == (Blink(2.0),)


EDITS = st.tuples(
    st.sampled_from(["move", "delete", "add", "hands", "hold", "size", "raise", "speed"]),
    st.floats(0.0, 10.0),
    st.sampled_from(sorted(USUAL_STROKE_GOALS)),
    st.sampled_from(["left", "right", "both"]),
    st.floats(0.3, 2.5),
)


def edited(plan: GesturePlan, edit: tuple[str, float, str, str, float]) -> PlanResult:
    what, at, kind, hands, by = edit
    there = [g for side in SIDES for g in gestures(plan, side)]
    if what == "add" or not there:
        return add_gesture(plan, kind, at, hands)
    gesture = there[int(at * 1e6) % len(there)]
    return {
        "move": lambda: move_gesture(plan, gesture, at),
        "delete": lambda: delete_gesture(plan, gesture),
        "hands": lambda: change_hands(plan, gesture, hands),
        "hold": lambda: set_hold(plan, gesture, by),
        "size": lambda: scale_gesture(plan, gesture, by),
        "raise": lambda: raise_gesture(plan, gesture, by - 1.3),
        "speed": lambda: scale_gesture_speed(plan, gesture, by),
    }[what]()


@settings(max_examples=15, deadline=None, derandomize=True)
@given(st.lists(EDITS, min_size=1, max_size=6))
def test_whatever_is_edited_hands_can_do_it(edits):
    plan = made_plan()
    for edit in edits:
        before = {side: set(lands(plan, side)) for side in SIDES}
        try:
            new = edited(plan, edit).plan
        except PlanError as error:
            assert str(error).endswith(".")
            continue
        for side in SIDES:
            phases = new.hand(side)
            if phases == plan.hand(side):
                continue
            assert phases[0].start_s == 0 and phases[-1].end_s == pytest.approx(plan.duration_s)
            for one, other in pairwise(phases):
                assert other.start_s == pytest.approx(one.end_s, abs=1e-6)
                assert one.end_s > one.start_s
            for stroke in group_gesture_phases(new):
                first = new.hand(stroke.side)[stroke.first_index]
                is_new = stroke.last_stroke not in plan.hand(stroke.side)
                if is_new and first.phase == "preparation":
                    assert (
                        stroke.last_stroke.end_s - stroke.last_stroke.start_s
                        >= MIN_PHASE_S["stroke"] - 1e-6
                    )
            assert len(before[side] - set(lands(new, side))) <= 1  # no other gesture is lost
        assert (new.nods, new.looks, new.planted) == (plan.nods, plan.looks, plan.planted)
        plan = new


ENDS = add_gesture(add_gesture(STILL, "you", 2.0, "right").plan, "offer", 6.5, "right").plan
"""The right hand rests to 1.2, gets ready to 1.69, strikes to 2, holds to 2.3, goes back to 3.1,
rests to 5.7, and strikes again to 6.5."""


@pytest.mark.parametrize(
    ("until", "hold", "retraction", "rest"),
    [(3.5, 3.5, 4.3, 5.7), (2.12, 2.12, 2.92, 5.7), (4.9, 4.9, 5.5, 5.7)],
    ids=["longer", "shorter", "so long that the way back shortens"],
)
def test_another_end_of_a_hold_moves_the_way_back_into_the_rest(until, hold, retraction, rest):
    new = move_phase_end(ENDS, "right", 2.3, until)
    assert told(new.plan)[3:6] == [
        ("hold", 2.0, hold), ("retraction", hold, retraction), ("rest", retraction, rest),
    ]  # fmt: skip
    assert new.plan.right[6:] == ENDS.right[6:] and new.plan.left == ENDS.left
    if until == 3.5:
        assert new.notes == ()
        assert told(move_phase_end(new.plan, "right", 3.5, 2.3).plan) == told(ENDS)


def test_a_way_back_that_has_no_room_goes_and_that_is_said():
    stays = move_phase_end(ENDS, "right", 2.3, 5.3)
    assert told(stays.plan)[3:5] == [("hold", 2.0, 5.7), ("preparation", 5.7, 6.19)]
    (note,) = stays.notes
    assert note.endswith(
        "until the next gesture begins at 5.70 s: there is no time for a retraction."
    )
    again = move_phase_end(stays.plan, "right", 5.7, 4.0)
    assert told(again.plan)[3:6] == [
        ("hold", 2.0, 4.0), ("retraction", 4.0, 4.8), ("rest", 4.8, 5.7),
    ]  # fmt: skip
    assert again.plan.right[4].goal == again.plan.right[5].goal == ENDS.right[4].goal
    last = set_hold(ENDS, GestureKey("right", 6.5), 1.0).plan
    until_end = move_phase_end(last, "right", 7.5, 9.8)
    assert told(until_end.plan)[-1] == ("hold", 6.5, 10.0)
    assert "until the speech ends at 10.00 s" in until_end.notes[0]


def test_what_follows_gives_way_but_for_what_a_hand_needs():
    slow = move_phase_end(ENDS, "right", 2.0, 2.15)
    assert told(slow.plan)[2:4] == [("stroke", 1.69, 2.15), ("hold", 2.15, 2.3)]
    far = move_phase_end(ENDS, "right", 2.0, 4.0)
    assert told(far.plan)[2:4] == [("stroke", 1.69, 2.2), ("hold", 2.2, 2.3)]
    assert far.notes == ("The stroke ends at 2.20 s: the next hold needs at least 0.1 s.",)
    early = move_phase_end(ENDS, "right", 2.0, 0.0)
    assert told(early.plan)[2] == ("stroke", 1.69, 1.89)
    assert early.notes == ("The stroke ends at 1.89 s: it must last at least 0.2 s.",)
    later = move_phase_end(ENDS, "right", 1.2, 1.6)
    assert told(later.plan)[:2] == [("rest", 0.0, 1.49), ("preparation", 1.49, 1.69)]
    back = move_phase_end(ENDS, "right", 3.1, 2.4)
    assert told(back.plan)[4:6] == [("retraction", 2.3, 2.8), ("rest", 2.8, 5.7)]


def test_both_hands_parts_of_a_gesture_are_found_together():
    both = add_gesture(STILL, "big", 4.0, "both").plan
    assert (
        other_hand_phase_end(both, "left", 4.3) == 4.3
        and other_hand_phase_end(both, "left", 4.0) == 4.0
    )
    assert other_hand_phase_end(both, "left", both.left[0].end_s) is None, (
        "rests are not part of a gesture"
    )
    assert other_hand_phase_end(move_phase_end(both, "left", 4.3, 5.0).plan, "left", 5.0) is None
    assert other_hand_phase_end(made_plan(), "right", 2.4) is None


@settings(max_examples=20, deadline=None, derandomize=True)
@given(st.lists(st.tuples(st.sampled_from(SIDES), st.integers(0, 30), st.floats(0, 6)), max_size=8))
def test_whatever_ends_elsewhere_phases_follow_on_one_another(moves):
    plan = made_plan()
    for side, which, at in moves:
        phases = plan.hand(side)
        try:
            new = move_phase_end(plan, side, phases[which % len(phases)].end_s, at).plan
        except PlanError as error:
            assert str(error).endswith(".")
            continue
        after = new.hand(side)
        assert after[0].start_s == 0 and after[-1].end_s == plan.duration_s
        assert all(other.start_s == one.end_s for one, other in pairwise(after))
        for one in after:
            before = [p.end_s - p.start_s for p in phases if p.phase == one.phase]
            assert one.end_s - one.start_s >= min(MIN_PHASE_S[one.phase], *before, 99) - 1e-6
        assert len(gestures(new, side)) == len(gestures(plan, side))
        other_side = SIDES[1 - SIDES.index(side)]
        assert new.hand(other_side) == plan.hand(other_side)
        plan = new
