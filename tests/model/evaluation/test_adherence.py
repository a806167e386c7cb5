"""Whether motion does what a plan says: asked of wrists that are known to."""

import math

import numpy as np
import pytest

from model.evaluation.adherence import (
    EDITS,
    Asked,
    Distances,
    gesture_size,
    moves_alone,
    planned_places,
    random_edit,
    rest_speeds,
    stroke_lags,
)
from model.motion.motion import Motion
from model.networks.autoencoder import load_encoder
from model.plan.editing import Gesture, added, gestures, sized
from model.plan.palette import PLACES, REST_PLACE
from model.plan.plan import SIDES, GesturePlan
from model.storage.cards import BUNDLED_WEIGHTS
from model.systems.autoencoders.config import FGD_ENCODER
from tests.model.plan.made import phase

FRAMES = 300
STILL = GesturePlan(10.0, left=(phase(0.0, 10.0, "rest"),), right=(phase(0.0, 10.0, "rest"),))


@pytest.fixture
def plan() -> GesturePlan:
    made = STILL
    for at, hand in ((2.0, "right"), (5.0, "right"), (8.0, "left")):
        made = added(made, "stop", at, hand).plan
    return made


def test_strokes_are_as_late_as_they_are(plan):
    exact = planned_places(plan)
    assert stroke_lags(exact, plan) == [0.0] * 3
    late = {side: np.roll(path, 5, axis=0) for side, path in exact.items()}
    assert stroke_lags(late, plan) == pytest.approx([5 / 30] * 3)
    small = {side: 0.3 * path + 0.1 for side, path in exact.items()}
    assert stroke_lags(small, plan) == [0.0] * 3
    inside = stroke_lags(late, plan, [range(140, 160)])
    assert inside == pytest.approx([5 / 30])


def test_a_stroke_that_nobody_makes_is_none(plan):
    rng = np.random.default_rng(0)
    still = {side: rng.normal(0, 0.001, (FRAMES, 3)) for side in SIDES}
    assert all(map(math.isnan, stroke_lags(still, plan)))


def test_the_asked_hand_moves_and_the_other_stays(plan):
    places, gesture = planned_places(plan), Gesture("right", 5.0)
    assert moves_alone(places, plan, gesture) is True
    assert moves_alone({**places, "left": places["right"]}, plan, gesture) is False
    assert moves_alone({**places, "right": places["left"]}, plan, gesture) is False
    drifting = places["left"] + np.arange(FRAMES)[:, None] * [0.1 / 30, 0, 0]
    assert moves_alone({**places, "left": drifting}, plan, gesture) is True
    gone = places["left"] + np.arange(FRAMES)[:, None] * [0.15 / 30, 0, 0]
    assert moves_alone({**places, "left": gone}, plan, gesture) is False
    both = added(plan, "stop", 5.0, "left").plan
    assert moves_alone(planned_places(both), both, gesture) is None


def test_a_gesture_is_as_large_as_it_ends_far_from_rest(plan):
    gesture = Gesture("right", 5.0)
    usual = math.dist(PLACES["stop"], REST_PLACE)
    for size in (0.6, 1.0, 1.4):
        larger = sized(plan, gesture, size).plan
        found = gesture_size(planned_places(larger), larger, gesture)
        assert found == pytest.approx(size * usual, rel=0.05)


def test_rests_are_measured_inside(plan):
    places = planned_places(plan)
    assert rest_speeds(places, plan) == pytest.approx([0.0] * 5, abs=0.05)
    drifting = {
        side: path + np.arange(FRAMES)[:, None] * [0.01, 0, 0] for side, path in places.items()
    }
    assert rest_speeds(drifting, plan) == pytest.approx([0.3] * 5, abs=0.05)


def test_random_edits_are_of_every_kind_and_tell_what_they_are_about(plan):
    rng, seen = np.random.default_rng(1), set()
    for _ in range(120):
        name, edited, gesture = random_edit(plan, rng)
        seen.add(name)
        assert edited.plan != plan or edited.notes or name in ("hold", "size", "height")
        if gesture is not None:
            lands = [g.lands_s for g in gestures(edited.plan, gesture.side)]
            assert min(abs(at - gesture.lands_s) for at in lands) < 1e-6
    assert seen == set(EDITS)
    assert random_edit(STILL, rng)[0] == "add"


def test_answers_are_told_with_their_number():
    asked = Asked()
    asked.add("a", [1.0, 0.0])
    asked.add("a", [1.0, math.nan])
    asked.add("b", [])
    assert asked.told() == {"a": {"mean": pytest.approx(2 / 3), "count": 4}}


def moved(seed: int, size: float) -> Motion:
    poses = np.cumsum(np.random.default_rng(seed).normal(0, size / 10, (FRAMES, 165)), axis=0)
    return Motion(
        poses=poses.astype(np.float32),
        trans=np.zeros((FRAMES, 3), np.float32),
        expressions=np.zeros((FRAMES, 100), np.float32),
        expression_basis="arkit52",
        betas=np.zeros(300, np.float32),
    )


def test_distances_are_those_of_edited_and_unedited_motion():
    encoder = load_encoder(BUNDLED_WEIGHTS, FGD_ENCODER)
    recorded, near, far = moved(0, 0.02), moved(1, 0.02), moved(2, 0.3)
    distances = Distances(encoder)
    assert distances.told() == {}
    for _ in range(2):
        distances.add(recorded, [near, near, far])
    told = {name: answer["mean"] for name, answer in distances.told().items()}
    alone = Distances(encoder)
    for _ in range(2):
        alone.add(recorded, [near, far])
    plain = {name: answer["mean"] for name, answer in alone.told().items()}
    assert told["FGD, unedited"] == plain["FGD, unedited"] > 0
    assert plain["FGD, edited"] > plain["FGD, unedited"]
    half = (plain["FGD, unedited"] + plain["FGD, edited"]) / 2
    assert told["FGD, edited"] == pytest.approx(half)
    ratio = told["FGD, edited"] / told["FGD, unedited"]
    assert told["FGD, edited / unedited"] == pytest.approx(ratio)
