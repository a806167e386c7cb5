from dataclasses import replace

import numpy as np
import pytest

from model.plan.plan import SIDES
from model.plan.tiers import (
    BY_NAME,
    LONGEST_S,
    TIERS,
    Begun,
    chains_of,
    frames_of,
    plan_of,
    seen_of,
    seen_together,
)
from tests.model.plan.made import HIGH, made_plan, phase

FRAMES = np.arange(180)


def test_a_plan_becomes_chains_and_a_plan_again():
    """But for words and kinds, and to the frame."""
    plan = made_plan()
    again = plan_of(chains_of(plan), 180)
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


def test_chains_of_chains_are_the_same():
    chains = chains_of(made_plan())
    assert chains_of(plan_of(chains, 180)) == chains
    assert set(chains) == set(BY_NAME)
    assert all(chain[0].frame == 0 for chain in chains.values())


def test_a_chain_is_told_frame_by_frame():
    tier = BY_NAME["right"]
    found = frames_of(tier, chains_of(made_plan())["right"], FRAMES)
    assert found.seen.shape == (180, tier.seen) == (180, 11)
    begins = np.flatnonzero(found.event)
    assert begins.tolist() == [30, 45, 57, 72, 78, 84, 105, 126]
    assert found.event[30] == 1 + 1 and found.event[45] == 1 + 2  # preparation, stroke
    np.testing.assert_allclose(found.mark[30] * 0.2, HIGH, atol=1e-6)
    assert found.seen[30, 0] == 1 and found.seen_now[30, 1] == 1  # rest before, now preparation
    assert found.seen[30, 6] == pytest.approx(1.0) and found.seen_now[30, 6] == 0.0
    assert found.seen[29, 7] == pytest.approx(np.log(29 / 30 + 0.1))
    assert not found.mark[31:45].any()


def test_some_frames_are_told_as_in_all():
    chain = chains_of(made_plan())["left foot"]
    tier = BY_NAME["left foot"]
    whole, some = frames_of(tier, chain, FRAMES), frames_of(tier, chain, FRAMES[40:90])
    np.testing.assert_array_equal(some.seen, whole.seen[40:90])
    np.testing.assert_array_equal(some.event, whole.event[40:90])


def test_what_is_drawn_next_sees_what_training_saw():
    chains = chains_of(made_plan())
    for tier in TIERS:
        found = frames_of(tier, chains[tier.name], FRAMES)
        for frame in (1, 30, 31, 57, 100, 179):
            last = [begun for begun in chains[tier.name] if begun.frame < frame][-1]
            np.testing.assert_array_equal(seen_of(tier, last, frame), found.seen[frame])


def test_long_states_look_alike():
    tier = BY_NAME["blink"]
    late, later = (seen_of(tier, Begun(0, 0), round(30 * s)) for s in (LONGEST_S, 60))
    np.testing.assert_array_equal(late, later)


def test_the_second_hand_sees_what_the_first_has_just_begun():
    hand = (phase(0.0, 1.0, "rest"), phase(1.0, 2.0, "stroke", HIGH))
    plan = replace(made_plan(), duration_s=2.0, left=hand, right=hand, planted=())
    chains = chains_of(plan)
    frames = np.arange(60)
    seen = seen_together({t.name: frames_of(t, chains[t.name], frames) for t in TIERS})
    stroke = 2
    assert seen["right"][30, 11 + stroke] == 0.0  # the left hand has not begun for it
    assert seen["left"][30, 11 + stroke] == 1.0
    assert seen["right"][31, 11 + stroke] == 1.0
    assert {name: rows.shape[1] for name, rows in seen.items()} == {
        "right": 22, "left": 22, "look": 5, "nod": 4, "brow": 4, "blink": 3, "stand": 5,
        "left foot": 8, "right foot": 8, "smile": 5,
    }  # fmt: skip


def test_what_cannot_be_reached_is_brought_near():
    chains = chains_of(made_plan())
    chains["right"][1] = Begun(30, 1, (9.0, -9.0, 0.5))
    assert plan_of(chains, 180).right[1].goal == (0.99, -0.99, 0.1)
