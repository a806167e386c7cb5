"""Plans as numbers frame by frame: tracks that networks hear, and tiers that planners draw."""

from dataclasses import replace

import numpy as np
import pytest

from model.plan.plan import HANGING_PLACE, PHASES, SIDES, GesturePlan, HandPhase, fill_gaps
from model.plan.plan_features import (
    MAX_STATE_S,
    NUM_TRACKS,
    TIERS,
    TIERS_BY_NAME,
    EventOnset,
    body_track,
    both_hands_rest_weight,
    chain_state_at,
    chain_states,
    chains_to_plan,
    hand_tracks,
    plan_to_chains,
    plan_tracks,
    tier_sampling_inputs,
)
from tests.model.plan.made import HIGH, LOW, REST, made_plan, phase

FRAMES = 180
PLAN = made_plan()


def test_tracks_tell_goals_phases_and_ends_at_their_times():
    tracks = plan_tracks(PLAN, FRAMES)
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
    tracks = plan_tracks(PLAN, FRAMES)

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
    found = fill_gaps(told, 5.0)
    assert [(p.phase, p.start_s, p.end_s) for p in found] == [
        ("rest", 0.0, 1.0),
        ("stroke", 1.0, 1.5),
        ("hold", 1.5, 3.0),
        ("retraction", 3.0, 3.5),
        ("rest", 3.5, 5.0),
    ]
    assert found[2].goal == HIGH and found[2].kind == "offer" and found[4].kind == ""
    assert fill_gaps((), 2.0) == (HandPhase(0.0, 2.0, "rest", HANGING_PLACE),)
    tracks = plan_tracks(GesturePlan(2.0), 60)  # an empty plan hangs
    np.testing.assert_allclose(
        tracks[:, hand_tracks("left")][:, :3], [HANGING_PLACE] * 60, atol=1e-6
    )


def test_both_hands_rest_where_neither_does_anything():
    plan = PLAN  # the right hand moves from 1 s to 4.2 s, the left rests
    rest = both_hands_rest_weight(plan, range(180))
    assert rest[:26].min() > 0.99 and rest[131:174].min() > 0.99
    assert rest[35:121].max() < 0.01
    assert 0.05 < rest[30] < 0.95
    np.testing.assert_allclose(both_hands_rest_weight(plan, range(20, 50)), rest[20:50], atol=1e-6)
    assert (
        both_hands_rest_weight(plan, range(170, 230))[10:].min() > 0.99
    )  # beyond the end of the plan
    both = replace(plan, left=plan.right)
    np.testing.assert_array_equal(both_hands_rest_weight(both, range(180)), rest)


ALL = np.arange(180)
CHAINS = plan_to_chains(PLAN)


def test_a_plan_becomes_chains_and_a_plan_again():
    """But for words and kinds, and to the frame."""
    plan = PLAN
    again = chains_to_plan(CHAINS, 180)
    for side in SIDES:
        assert len(again.hand(side)) == len(plan.hand(side))
        for one, other in zip(again.hand(side), plan.hand(side), strict=True):
            assert one.phase == other.phase
            assert one.start_s == pytest.approx(other.start_s, abs=1 / 60)
            assert one.end_s == pytest.approx(other.end_s, abs=1 / 60)
            np.testing.assert_allclose(one.goal, other.goal, atol=1e-9)
    assert [(nod.time_s, nod.depth_deg) for nod in again.nods] == [(1.9, 4.0), (3.0, 2.5)]
    for name in ("looks", "brows", "smiles", "blinks", "stands", "planted"):
        assert getattr(again, name) == getattr(plan, name)
    assert plan_to_chains(again) == CHAINS and set(CHAINS) == set(TIERS_BY_NAME)
    assert all(chain[0].frame == 0 for chain in CHAINS.values())


def test_a_chain_is_told_frame_by_frame():
    tier = TIERS_BY_NAME["right"]
    found = chain_states(tier, CHAINS["right"], ALL)
    assert found.features_before.shape == (180, tier.state_feature_dim) == (180, 11)
    begins = np.flatnonzero(found.event)
    assert begins.tolist() == [30, 45, 57, 72, 78, 84, 105, 126]
    assert found.event[30] == 1 + 1 and found.event[45] == 1 + 2  # preparation, stroke
    np.testing.assert_allclose(found.mark[30] * 0.2, HIGH, atol=1e-6)
    assert (
        found.features_before[30, 0] == 1 and found.features_after[30, 1] == 1
    )  # rest before, now preparation
    assert found.features_before[30, 6] == pytest.approx(1.0) and found.features_after[30, 6] == 0.0
    assert found.features_before[29, 7] == pytest.approx(np.log(29 / 30 + 0.1))
    assert not found.mark[31:45].any()


def test_what_is_drawn_next_and_some_frames_see_what_training_saw():
    for tier in TIERS:
        chain = CHAINS[tier.name]
        found, some = chain_states(tier, chain, ALL), chain_states(tier, chain, ALL[40:90])
        np.testing.assert_array_equal(some.features_before, found.features_before[40:90])
        np.testing.assert_array_equal(some.event, found.event[40:90])
        for frame in (1, 30, 31, 57, 100, 179):
            last = [begun for begun in chain if begun.frame < frame][-1]
            np.testing.assert_array_equal(
                chain_state_at(tier, last, frame), found.features_before[frame]
            )


def test_long_states_look_alike():
    tier = TIERS_BY_NAME["blink"]
    late, later = (chain_state_at(tier, EventOnset(0, 0), round(30 * s)) for s in (MAX_STATE_S, 60))
    np.testing.assert_array_equal(late, later)


def test_the_second_hand_sees_what_the_first_has_just_begun():
    hand = (phase(0.0, 1.0, "rest"), phase(1.0, 2.0, "stroke", HIGH))
    plan = replace(made_plan(), duration_s=2.0, left=hand, right=hand, planted=())
    chains = plan_to_chains(plan)
    frames = np.arange(60)
    seen = tier_sampling_inputs({t.name: chain_states(t, chains[t.name], frames) for t in TIERS})
    stroke = 2
    assert seen["right"][30, 11 + stroke] == 0.0  # the left hand has not begun for it
    assert seen["left"][30, 11 + stroke] == 1.0
    assert seen["right"][31, 11 + stroke] == 1.0
    assert {name: rows.shape[1] for name, rows in seen.items()} == {
        "right": 22, "left": 22, "look": 5, "nod": 4, "brow": 4, "blink": 3, "stand": 5,
        "left foot": 8, "right foot": 8, "smile": 5,
    }  # fmt: skip


def test_what_cannot_be_reached_is_brought_near():
    chains = CHAINS | {"right": list(CHAINS["right"])}
    chains["right"][1] = EventOnset(30, 1, (9.0, -9.0, 0.5))
    assert chains_to_plan(chains, 180).right[1].goal == (0.99, -0.99, 0.1)
