"""Edits of plans: what they change, what they leave, and what they refuse."""

from dataclasses import dataclass, replace
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.plan.editing import (
    ARM_M,
    LEAST_STROKE_S,
    Edited,
    Gesture,
    added,
    deleted,
    gestures,
    hastened,
    held,
    keeping,
    moved,
    on_word,
    raised,
    sized,
    with_event,
    with_hands,
    without_event,
)
from model.plan.kinds import strokes_of
from model.plan.palette import PLACES, REST_PLACE
from model.plan.plan import SIDES, Blink, GesturePlan, Look, Nod, PlanError, Smile
from model.plan.style import Style, excited, style_of, with_style
from tests.model.plan.made import LOW, made_plan, phase


@dataclass(frozen=True)
class Said:
    text: str
    start_s: float
    end_s: float


RIGHT = Gesture("right", 1.9)
STILL = GesturePlan(10.0, left=(phase(0.0, 10.0, "rest"),), right=(phase(0.0, 10.0, "rest"),))


def told(plan: GesturePlan, side="right") -> list[tuple[str, float, float]]:
    return [(p.phase, round(p.start_s, 3), round(p.end_s, 3)) for p in plan.hand(side)]


def lands(plan: GesturePlan, side="right") -> list[float]:
    return [round(g.lands_s, 3) for g in gestures(plan, side)]


def busy_plan() -> GesturePlan:
    """Ten seconds: the right hand lands at 2, 4.5 and 8, the left at 8."""
    plan = STILL
    for at, kind, hands in ((2.0, "you", "right"), (4.5, "offer", "right"), (8.0, "big", "both")):
        plan = added(plan, kind, at, hands).plan
    return plan


def test_a_gesture_is_added_with_preparation_hold_and_the_way_back():
    edited = added(STILL, "you", 4.0, word="you")
    assert told(edited.plan) == [
        ("rest", 0.0, 3.2), ("preparation", 3.2, 3.69), ("stroke", 3.69, 4.0), ("hold", 4.0, 4.3),
        ("retraction", 4.3, 5.1), ("rest", 5.1, 10.0),
    ]  # fmt: skip
    stroke = edited.plan.right[2]
    assert (stroke.goal, stroke.kind, stroke.word) == (PLACES["you"], "you", "you")
    assert edited.plan.left == STILL.left and edited.notes == ()
    both = added(STILL, "big", 4.0).plan
    assert lands(both, "left") == lands(both, "right") == [4.0]
    assert on_word(Said("you", 3.0, 4.0)) == 3.3


def test_a_moved_gesture_lands_where_it_is_asked_to():
    plan = moved(busy_plan(), Gesture("right", 4.5), 6.0, word="now").plan
    assert lands(plan) == [2.0, 6.0, 8.0]
    assert next(p for p in plan.right if p.end_s == 6.0).word == "now"
    assert plan.left == busy_plan().left
    back = moved(plan, Gesture("right", 6.0), 4.5).plan
    assert told(back) == told(busy_plan())


def test_a_deleted_gesture_leaves_the_hand_at_rest_or_in_the_hold_before():
    plan = deleted(busy_plan(), Gesture("right", 4.5)).plan
    assert lands(plan) == [2.0, 8.0]
    rest = next(p for p in plan.right if p.start_s > 2.2 and p.phase == "rest")
    assert rest.end_s == pytest.approx(7.2)
    chained = (
        phase(0.0, 1.0, "rest"), phase(1.0, 1.5, "preparation"), phase(1.5, 2.0, "stroke", LOW),
        phase(2.0, 2.5, "hold", LOW), phase(2.5, 3.0, "preparation"), phase(3.0, 3.4, "stroke"),
        phase(3.4, 4.0, "retraction"), phase(4.0, 10.0, "rest"),
    )  # fmt: skip
    plan = deleted(STILL.with_hand("right", chained), Gesture("right", 3.4)).plan
    assert told(plan)[3:] == [("hold", 2.0, 3.4), ("retraction", 3.4, 4.0), ("rest", 4.0, 10.0)]


def test_other_hands_make_it():
    plan = with_hands(busy_plan(), Gesture("right", 4.5), "left").plan
    assert (lands(plan, "left"), lands(plan)) == ([4.5, 8.0], [2.0, 8.0])
    plan = with_hands(plan, Gesture("left", 8.0), "right").plan
    assert (lands(plan, "left"), lands(plan)) == ([4.5], [2.0, 8.0])
    plan = with_hands(plan, Gesture("left", 4.5), "both").plan
    assert (lands(plan, "left"), lands(plan)) == ([4.5], [2.0, 4.5, 8.0])


def test_holds_stretch_until_the_next_gesture_and_say_so():
    plan = held(busy_plan(), Gesture("right", 4.5), 1.5)
    assert ("hold", 4.5, 6.0) in told(plan.plan) and plan.notes == ()
    far = held(busy_plan(), Gesture("right", 4.5), 9.0)
    assert ("hold", 4.5, 7.2) in told(far.plan)
    assert far.notes == ("The hold ends at 7.20 s, where the next gesture begins.",)
    none = held(busy_plan(), Gesture("right", 4.5), 0.0).plan
    assert ("retraction", 4.5, 5.3) in told(none)
    with pytest.raises(PlanError, match="0 s or longer; got -1 s"):
        held(busy_plan(), Gesture("right", 4.5), -1.0)


def test_size_height_and_speed():
    gesture = Gesture("right", 4.5)

    def goal(edited: Edited) -> tuple[float, float, float]:
        return next(p.goal for p in edited.plan.right if p.end_s == 4.5)

    far = [
        abs(goal(sized(busy_plan(), gesture, size))[1] - REST_PLACE[1]) for size in (0.5, 1.0, 1.5)
    ]
    assert far[0] < far[1] < far[2] and far[2] == pytest.approx(3 * far[0], abs=1e-3)
    assert goal(raised(busy_plan(), gesture, 0.2))[1] == pytest.approx(PLACES["offer"][1] + 0.2)
    fast = hastened(busy_plan(), gesture, 1.3).plan
    assert ("stroke", round(4.5 - 0.31 / 1.3, 3), 4.5) in told(fast)
    slow = hastened(busy_plan(), gesture, 0.5).plan
    assert ("stroke", 3.88, 4.5) in told(slow)
    fastest = hastened(busy_plan(), gesture, 5.0)
    assert ("stroke", 4.3, 4.5) in told(fastest.plan)
    assert "Its stroke lasts 0.20 s; hands need as long." in fastest.notes


def test_places_out_of_reach_or_inside_the_body_are_mended_and_told():
    high = raised(busy_plan(), Gesture("right", 4.5), 0.9)
    stroke = next(p for p in high.plan.right if p.end_s == 4.5)
    assert sum(n * n for n in stroke.goal) ** 0.5 == pytest.approx(ARM_M, abs=1e-3)
    assert high.notes == (f"A place out of reach was brought to {ARM_M:g} m from the chest.",)
    inside = STILL.with_hand("right", (
        phase(0.0, 1.0, "rest"), phase(1.0, 1.5, "preparation", (0.05, -0.1, 0.3)),
        phase(1.5, 2.0, "stroke", (0.05, -0.1, 0.02)),
    ))  # fmt: skip
    mended = raised(inside, Gesture("right", 2.0), 0.0)
    assert mended.notes == ("A place inside the body was brought before it.",)


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (lambda p: moved(p, Gesture("right", 4.5), 2.1), r"makes a preparation \(you\).*no time"),
        (lambda p: moved(p, Gesture("right", 4.5), 0.1), "must lie between 0.2 s"),
        (lambda p: moved(p, Gesture("right", 4.5), 10.2), "the end at 10.00 s"),
        (lambda p: added(p, "offer", 8.1), r"The right hand makes a preparation \(big\)"),
        (lambda p: added(p, "whistle", 6.0), "There is no gesture 'whistle'; choose one of all"),
        (lambda p: deleted(p, Gesture("left", 4.5)), "left hand makes no gesture.*4.50 s"),
        (lambda p: sized(p, Gesture("right", 4.5), 9.0), ".1 to 4 times as large; got 9"),
        (lambda p: raised(p, Gesture("right", 4.5), 2.0), "at most 1 m"),
        (lambda p: hastened(p, Gesture("right", 4.5), 0.0), ".2 to 5 times as fast"),
        (lambda p: with_event(p, Nod(11.0, 3.0)), "The speech goes from 0 to 10.00 s"),
        (lambda p: without_event(p, Nod(1.0, 3.0)), "has no such nod"),
    ],
)
def test_what_cannot_be_is_refused(edit, says):
    with pytest.raises(PlanError, match=says):
        edit(busy_plan())


def test_a_short_stroke_is_mended():
    short = STILL.with_hand("right", (
        phase(0.0, 1.0, "rest"), phase(1.0, 1.5, "preparation"), phase(1.5, 1.6, "stroke", LOW),
    ))  # fmt: skip
    edited = moved(short, Gesture("right", 1.6), 5.0)
    assert ("stroke", 4.8, 5.0) in told(edited.plan)
    assert edited.notes == ("Its stroke was shorter than 0.2 s and begins earlier.",)


def test_nods_looks_smiles_and_blinks():
    plan = with_event(with_event(STILL, Nod(3.0, 4.0)).plan, Nod(1.0, 2.0)).plan
    assert [n.time_s for n in plan.nods] == [1.0, 3.0]
    assert without_event(plan, Nod(3.0, 4.0)).plan.nods == (Nod(1.0, 2.0),)
    looking = replace(STILL, looks=(Look(0.0, 10.0, 0.0, 0.0),))
    plan = with_event(looking, Look(4.0, 5.0, 12.0, 0.0)).plan
    assert [(k.start_s, k.end_s) for k in plan.looks] == [(0.0, 4.0), (4.0, 5.0), (5.0, 10.0)]
    plan = with_event(with_event(STILL, Smile(1.0, 3.0, 0.5)).plan, Smile(0.5, 4.0, 0.2)).plan
    assert plan.smiles == (Smile(0.5, 4.0, 0.2),)
    assert with_event(STILL, Blink(2.0)).plan.blinks == (Blink(2.0),)


def test_locked_gestures_stay():
    plan = busy_plan()
    locked = (Gesture("right", 4.5),)
    with pytest.raises(PlanError, match=r"right hand's gesture at 4.50 s is locked"):
        keeping(locked, plan, sized(plan, locked[0], 1.5))
    edited = sized(plan, Gesture("right", 2.0), 1.5)
    assert keeping(locked, plan, edited) is edited


EDITS = st.tuples(
    st.sampled_from(["move", "delete", "add", "hands", "hold", "size", "raise", "speed"]),
    st.floats(0.0, 10.0),
    st.sampled_from(sorted(PLACES)),
    st.sampled_from(["left", "right", "both"]),
    st.floats(0.3, 2.5),
)


def edited(plan: GesturePlan, edit: tuple[str, float, str, str, float]) -> Edited:
    what, at, kind, hands, by = edit
    there = [g for side in SIDES for g in gestures(plan, side)]
    if what == "add" or not there:
        return added(plan, kind, at, hands)
    gesture = there[int(at * 1e6) % len(there)]
    return {
        "move": lambda: moved(plan, gesture, at),
        "delete": lambda: deleted(plan, gesture),
        "hands": lambda: with_hands(plan, gesture, hands),
        "hold": lambda: held(plan, gesture, by),
        "size": lambda: sized(plan, gesture, by),
        "raise": lambda: raised(plan, gesture, by - 1.3),
        "speed": lambda: hastened(plan, gesture, by),
    }[what]()


@settings(max_examples=60, deadline=None)
@given(st.lists(EDITS, min_size=1, max_size=6))
def test_whatever_is_edited_hands_can_do_it(edits):
    plan = made_plan()
    for edit in edits:
        before = {side: gestures(plan, side) for side in SIDES}
        try:
            new = edited(plan, edit).plan
        except PlanError as error:
            assert str(error).endswith((".", "longer."))
            continue
        for side in SIDES:
            phases = new.hand(side)
            if phases == plan.hand(side):
                continue
            assert phases[0].start_s == 0 and phases[-1].end_s == pytest.approx(plan.duration_s)
            for one, other in pairwise(phases):
                assert other.start_s == pytest.approx(one.end_s, abs=1e-6)
                assert one.end_s > one.start_s
            for stroke in strokes_of(new.with_hand(side, phases)):
                first = new.hand(stroke.side)[stroke.first]
                is_new = stroke.lands not in plan.hand(stroke.side)
                if is_new and first.phase == "preparation":
                    lasts = stroke.lands.end_s - stroke.lands.start_s
                    assert lasts >= LEAST_STROKE_S - 1e-6
            gone = {round(g.lands_s, 4) for g in before[side]} - {
                round(g.lands_s, 4) for g in gestures(new, side)
            }
            assert len(gone) <= 1  # no other gesture is lost
        assert (new.nods, new.looks, new.planted) == (plan.nods, plan.looks, plan.planted)
        plan = new


WORDS = [Said(f"w{k}", 0.5 + k * 0.9, 1.0 + k * 0.9) for k in range(10)]


def test_sliders_stand_where_the_plan_is_and_leave_it_there():
    plan = busy_plan()
    style = style_of(plan)
    assert style.gestures_per_min == 18 and style.both == pytest.approx(1 / 3)
    assert with_style(plan, style, WORDS) == Edited(plan)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("gestures_per_min", (0.0, 6.0, 36.0)),
        ("size_m", (0.1, 0.25, 0.4)),
        ("height_m", (-0.25, -0.05, 0.1)),
        ("stroke_s", (0.22, 0.3, 0.45)),
        ("both", (0.0, 0.7, 1.0)),
        ("smile", (0.0, 0.2, 0.6)),
    ],
)
def test_sliders_bring_what_they_say(name, values):
    plan = busy_plan()
    for value in values:
        new = with_style(plan, replace(style_of(plan), **{name: value}), WORDS).plan
        assert getattr(style_of(new), name) == pytest.approx(value, rel=0.12, abs=0.02)


def test_sliders_leave_locked_gestures_and_say_where_there_is_no_room():
    plan, locked = busy_plan(), (Gesture("right", 4.5),)
    none = with_style(plan, replace(style_of(plan), gestures_per_min=0.0), locked=locked)
    assert lands(none.plan) == [4.5] and lands(none.plan, "left") == []
    assert keeping(locked, plan, none)
    more = with_style(plan, replace(style_of(plan), gestures_per_min=60.0))
    assert more.plan == plan and more.notes == ("There is room for 18 gestures a minute.",)


def test_excitement_moves_all_sliders_one_way():
    style = style_of(busy_plan())
    calm, wild = excited(style, -1.0), excited(style, 1.0)
    for name in ("gestures_per_min", "size_m", "height_m", "both"):
        assert getattr(calm, name) < getattr(style, name) < getattr(wild, name)
    assert wild.stroke_s < style.stroke_s < calm.stroke_s and excited(style, 0.0) == style
    with pytest.raises(PlanError, match=r"from -1 to 1; got 2"):
        excited(style, 2.0)
    with pytest.raises(PlanError, match="size_m is 2; it must lie between"):
        Style(10.0, 2.0, 0.0, 0.3, 0.0, 0.0)
