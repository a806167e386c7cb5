"""The plan of a live session, put together of what was planned on the way."""

from itertools import pairwise
from pathlib import Path

import pytest

from app.live.minute import LastPlan
from app.live.session import LiveAsk, LiveSession
from app.live.told_plan import told_plan
from model.generation.base import PlannedAhead
from model.plan.plan import Blink, GesturePlan, HandPhase, Look, Nod, Stand
from model.systems.registry import load_system
from tests.app.live.test_session import Clock, speak
from tests.model.plan.made import phase
from tests.model.systems.planned.made import make_planned_weights


def ahead(origin: int, *right: HandPhase, **lists) -> PlannedAhead:
    return PlannedAhead(GesturePlan(6.0, right=right, **lists), origin, ())


def told(plan: GesturePlan) -> list[tuple[str, float, float]]:
    return [(one.phase, round(one.start_s, 3), round(one.end_s, 3)) for one in plan.right]


def test_each_plan_takes_the_place_of_the_one_before_from_its_first_frame_on() -> None:
    last = LastPlan()
    last.go_on(
        ahead(-90, phase(3.0, 4.0, "rest"), phase(4.0, 4.6, "preparation"), nods=(Nod(4.0, 5.0),)),
        0,
    )
    last.go_on(
        ahead(
            -60, phase(2.0, 2.8, "rest"), phase(2.8, 3.2, "preparation"), phase(3.2, 4.0, "stroke")
        ),
        9,
    )
    plan = last.part(0, 45)
    assert plan.duration_s == 1.5 and not plan.nods, "the nod was planned otherwise later"
    assert told(plan) == [
        ("rest", 0.0, 0.8),
        ("preparation", 0.8, 1.2),
        ("stroke", 1.2, 1.5),
    ]
    last.go_on(ahead(-30, phase(2.2, 2.9, "stroke"), blinks=(Blink(2.5),)), 40)
    assert told(last.part(0, 60))[2:] == [("stroke", 1.2, 1.9)]
    assert [one.time_s for one in last.part(30, 30).blinks] == [pytest.approx(0.5)]


def test_what_went_on_before_the_minute_begins_with_it_and_what_ended_is_forgotten() -> None:
    last = LastPlan()
    spans = {"looks": (Look(0.0, 4.0, 5.0, 0.0),), "stands": (Stand(1.0, 9.0, "left"),)}
    last.go_on(ahead(0, phase(0.0, 2.0, "rest"), phase(2.0, 6.0, "hold"), **spans), 0)
    plan = last.part(30, 90)
    assert told(plan) == [("rest", 0.0, 1.0), ("hold", 1.0, 3.0)]
    assert [(one.start_s, one.end_s) for one in plan.looks] == [(0.0, 3.0)]
    last.forget_before(75)
    assert told(last.part(75, 45)) == [("hold", 0.0, 1.5)]
    assert len(last._events["right"]) == 1


def test_the_kept_plan_is_what_was_planned_when_each_frame_was_made(tmp_path: Path) -> None:
    system = load_system("workbench/planned", make_planned_weights(tmp_path))
    clock = Clock()
    session = LiveSession(
        system, LiveAsk("workbench/planned", "ann", seed=2), "", lambda _: None, clock
    )
    made: list[tuple[int, int, dict]] = []
    step = session._live.step

    def watched():
        first = session._live.next_frame
        motion = step()
        made.append((first, session._live.next_frame, told_plan(session._live.ahead, first)))
        return motion

    session._live.step = watched
    speak(session, clock, 4.0, 6400)
    kept = session.kept().minute
    assert kept.plan is not None and kept.first_frame == 0
    assert kept.plan.duration_s == pytest.approx(kept.motion.num_frames / 30)
    checked = 0
    for side in ("left", "right"):
        phases = kept.plan.hand(side)
        assert phases[0].start_s == 0
        assert all(one.end_s == pytest.approx(other.start_s) for one, other in pairwise(phases))
        for first, stop, told_then in made:
            for frame in range(first, stop):
                at = (frame + 0.5) / 30
                now = next(one for one in phases if one.start_s <= at < one.end_s)
                then = next(one for one in told_then[side] if one[0] <= at < one[1])
                assert (now.phase, now.kind) == (then[2], then[3])
                checked += 1
    assert checked == 2 * kept.motion.num_frames
