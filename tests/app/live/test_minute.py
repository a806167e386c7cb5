"""The last minute of a live session: its sound, its motion and its plan."""

import numpy as np
import pytest

from app.errors import RunError
from app.live.minute import KEPT_FRAMES, LastMinute, LastPlan
from model.generation.base import PlannedAhead
from model.plan.plan import Blink, GesturePlan, HandPhase, Look, Nod, Stand
from tests.helpers import smooth_motion_example
from tests.model.plan.made import phase


@pytest.fixture(scope="module")
def motion():
    return smooth_motion_example(3000)


def spoken(motion, seconds: float, piece: int = 13) -> LastMinute:
    """Sound whose samples count, a second ahead of frames that count."""
    minute = LastMinute()
    sound = np.arange(round(16_000 * (seconds + 1)), dtype=np.float32)
    for first in range(0, len(sound), 640):
        minute.add_sound(sound[first : first + 640])
        known = min(int((first - 16_000) / 16_000 * 30), round(30 * seconds))
        while minute._next_frame + piece <= known:
            start = minute._next_frame
            minute.add_motion(motion.part(slice(start, start + piece)))
    return minute


@pytest.mark.parametrize("seconds", [5.0, 59.9, 61.3, 80.0])
def test_what_is_kept_is_the_last_minute_with_its_own_sound_and_little_more_is_held(
    motion, seconds: float
) -> None:
    minute = spoken(motion, seconds)
    end = minute._next_frame
    kept = minute.kept()
    first = max(0, end - KEPT_FRAMES)
    assert kept.first_frame == first and kept.motion.num_frames == end - first
    np.testing.assert_array_equal(kept.motion.poses, motion.poses[first:end])
    start = round(first * 16_000 / 30)
    count = round((end - first) * 16_000 / 30)
    np.testing.assert_array_equal(kept.waveform, np.arange(start, start + count))
    moved = kept.motion.trans - motion.trans[first:end]
    np.testing.assert_allclose(moved - moved[:1], 0, atol=1e-6)
    assert (kept.motion.trans[0, [0, 2]] == 0).all() and abs(moved[0, 1]) == 0
    assert sum(piece.num_frames for piece in minute._pieces) < KEPT_FRAMES + 26
    assert sum(len(piece) for piece in minute._sound) < 16_000 * 63


def test_too_little_is_told(motion) -> None:
    minute = LastMinute()
    minute.add_sound(np.zeros(64_000, np.float32))
    for count in (0, 59):
        if count:
            minute.add_motion(motion.part(slice(count)))
        with pytest.raises(RunError, match="no live motion to keep yet: speak for at least 2 s"):
            minute.kept()
    minute.add_motion(motion.part(slice(59, 60)))
    assert minute.kept().motion.num_frames == 60


def ahead(origin: int, *right: HandPhase, **lists) -> PlannedAhead:
    return PlannedAhead(GesturePlan(6.0, right=right, **lists), origin, ())


def told(plan: GesturePlan) -> list[tuple[str, float, float]]:
    return [(one.phase, round(one.start_s, 3), round(one.end_s, 3)) for one in plan.right]


def test_each_plan_takes_the_place_of_the_one_before_from_its_first_frame_on() -> None:
    last = LastPlan()
    rest, preparation = phase(3.0, 4.0, "rest"), phase(4.0, 4.6, "preparation")
    last.go_on(ahead(-90, rest, preparation, nods=(Nod(4.0, 5.0),)), 0)
    then = (("rest", 2.0, 2.8), ("preparation", 2.8, 3.2), ("stroke", 3.2, 4.0))
    last.go_on(ahead(-60, *(phase(start, end, name) for name, start, end in then)), 9)
    plan = last.part(0, 45)
    assert plan.duration_s == 1.5 and not plan.nods, "the nod was planned otherwise later"
    assert told(plan) == [("rest", 0.0, 0.8), ("preparation", 0.8, 1.2), ("stroke", 1.2, 1.5)]
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
