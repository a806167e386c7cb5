from dataclasses import replace

import numpy as np
import pytest

from model.plan.plan import PHASES, GesturePlan, HandPhase
from model.plan.tracks import (
    HANGING,
    NUM_TRACKS,
    at_rest,
    body_track,
    hand_tracks,
    tracks_of,
    without_gaps,
)
from tests.model.plan.made import HIGH, LOW, REST, made_plan, phase

FRAMES = 180


def test_tracks_tell_goals_phases_and_ends_at_their_times():
    tracks = tracks_of(made_plan(), FRAMES)
    assert tracks.shape == (FRAMES, NUM_TRACKS) == (180, 29)
    right = tracks[:, hand_tracks("right")]
    np.testing.assert_allclose(right[15, :3], REST, atol=1e-6)
    np.testing.assert_allclose(right[45, :3], HIGH, atol=2e-3)  # 1.5 s: the preparation is over
    np.testing.assert_allclose(right[65, :3], LOW, atol=1e-6)
    halfway = (np.array(REST) + HIGH) / 2  # of a minimum-jerk move, at half its time
    np.testing.assert_allclose(right[[37, 38 - 1], :3].mean(0), halfway, atol=0.02)
    stroke = 4 + PHASES.index("stroke")
    assert right[50, stroke] > 0.9 and right[15, stroke] < 1e-3
    assert right[:, 3].argmax() in (44, 45, 56, 57, 77, 78, 83, 84, 125, 126)
    assert right[10, 3] < 1e-3
    left = tracks[:, hand_tracks("left")]
    np.testing.assert_allclose(left[:, 4 + PHASES.index("rest")], 1.0, atol=1e-6)


def test_the_body_has_its_pulses_and_levels():
    tracks = tracks_of(made_plan(), FRAMES)

    def track(name: str) -> np.ndarray:
        return tracks[:, body_track(name)]

    assert track("nod").argmax() in (56, 57) and track("nod").max() == pytest.approx(0.8, abs=0.02)
    assert track("yaw")[75] == pytest.approx(1.4, abs=1e-3) and abs(track("yaw")[30]) < 1e-3
    assert track("blink")[24] == pytest.approx(1.0, abs=0.1) and track("blink")[60] < 1e-3
    assert track("stand")[30] == pytest.approx(1, abs=0.01)
    assert track("stand")[150] == pytest.approx(-1, abs=0.01)
    assert track("right foot")[82] < 0.01 < 0.99 < track("left foot")[82]
    assert track("smile")[120] == pytest.approx(0.4, abs=0.01)


def test_gaps_are_holds_and_rests():
    told = (phase(1.0, 1.5, "stroke", HIGH, "offer"), phase(3.0, 3.5, "retraction"))
    found = without_gaps(told, 5.0)
    assert [(p.phase, p.start_s, p.end_s) for p in found] == [
        ("rest", 0.0, 1.0),
        ("stroke", 1.0, 1.5),
        ("hold", 1.5, 3.0),
        ("retraction", 3.0, 3.5),
        ("rest", 3.5, 5.0),
    ]
    assert found[2].goal == HIGH and found[2].kind == "offer" and found[4].kind == ""
    assert without_gaps((), 2.0) == (HandPhase(0.0, 2.0, "rest", HANGING),)


def test_an_empty_plan_hangs():
    tracks = tracks_of(GesturePlan(2.0), 60)
    np.testing.assert_allclose(tracks[:, hand_tracks("left")][:, :3], [HANGING] * 60, atol=1e-6)


def test_both_hands_rest_where_neither_does_anything():
    plan = made_plan()  # the right hand moves from 1 s to 4.2 s, the left rests
    rest = at_rest(plan, range(180))
    assert rest[:26].min() > 0.99 and rest[131:174].min() > 0.99
    assert rest[35:121].max() < 0.01
    assert 0.05 < rest[30] < 0.95
    np.testing.assert_allclose(at_rest(plan, range(20, 50)), rest[20:50], atol=1e-6)
    assert at_rest(plan, range(170, 230))[10:].min() > 0.99  # beyond the end of the plan
    both = replace(plan, left=plan.right)
    np.testing.assert_array_equal(at_rest(both, range(180)), rest)
