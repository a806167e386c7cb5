"""Whether motion does what a plan says, and found plans agree with annotated ones."""

import json
import math

import numpy as np
import pytest
import torch

from model.evaluate import main
from model.evaluation import plan_detection
from model.evaluation.adherence import (
    distance_from_rest_m,
    fgd_before_and_after_edits,
    only_one_hand_moves,
    random_edit,
    rest_speeds,
    stroke_lags,
)
from model.evaluation.plan_detection import (
    DetectionCounts,
    detection_counts_by_metric,
    match_intervals,
    match_points,
    merge_adjacent_holds,
)
from model.plan import detection
from model.plan.detection import PhaseNetwork
from model.plan.editing import GestureKey, add_gesture, gestures, scale_gesture
from model.plan.kinds import REST_POSITION, USUAL_STROKE_GOALS
from model.plan.plan import SIDES, GesturePlan
from model.plan.plan_features import hand_tracks, plan_tracks
from tests.model.plan.made import made_plan, phase

FRAMES = 300
STILL = GesturePlan(10.0, left=(phase(0.0, 10.0, "rest"),), right=(phase(0.0, 10.0, "rest"),))


@pytest.fixture
def plan() -> GesturePlan:
    made = STILL
    for at, hand in ((2.0, "right"), (5.0, "right"), (8.0, "left")):
        made = add_gesture(made, "stop", at, hand).plan
    return made


def planned_places(plan: GesturePlan) -> dict:
    """Where a plan has the wrists."""
    planned = plan_tracks(plan, FRAMES).astype(np.float64)
    return {side: planned[:, hand_tracks(side)][:, :3] for side in SIDES}


def test_strokes_are_as_late_as_they_are(plan):
    exact = planned_places(plan)
    assert stroke_lags(exact, plan) == [0.0] * 3
    late = {side: np.roll(path, 5, axis=0) for side, path in exact.items()}
    assert stroke_lags(late, plan) == pytest.approx([5 / 30] * 3)
    small = {side: 0.3 * path + 0.1 for side, path in exact.items()}
    assert stroke_lags(small, plan) == [0.0] * 3
    inside = stroke_lags(late, plan, range(140, 160))
    assert inside == pytest.approx([5 / 30])


def test_a_stroke_that_nobody_makes_is_none(plan):
    rng = np.random.default_rng(0)
    still = {side: rng.normal(0, 0.001, (FRAMES, 3)) for side in SIDES}
    assert all(map(math.isnan, stroke_lags(still, plan)))


def test_the_asked_hand_moves_and_the_other_stays(plan):
    places, gesture = planned_places(plan), GestureKey("right", 5.0)
    assert only_one_hand_moves(places, plan, gesture) is True
    assert only_one_hand_moves({**places, "left": places["right"]}, plan, gesture) is False
    assert only_one_hand_moves({**places, "right": places["left"]}, plan, gesture) is False
    drifting = places["left"] + np.arange(FRAMES)[:, None] * [0.1 / 30, 0, 0]
    assert only_one_hand_moves({**places, "left": drifting}, plan, gesture) is True
    gone = places["left"] + np.arange(FRAMES)[:, None] * [0.15 / 30, 0, 0]
    assert only_one_hand_moves({**places, "left": gone}, plan, gesture) is False
    both = add_gesture(plan, "stop", 5.0, "left").plan
    assert only_one_hand_moves(planned_places(both), both, gesture) is None


def test_a_gesture_is_as_large_as_it_ends_far_from_rest(plan):
    gesture = GestureKey("right", 5.0)
    usual = math.dist(USUAL_STROKE_GOALS["stop"], REST_POSITION)
    for size in (0.6, 1.0, 1.4):
        larger = scale_gesture(plan, gesture, size).plan
        measured = distance_from_rest_m(planned_places(larger), gesture)
        assert measured == pytest.approx(size * usual, rel=0.05)


def test_rests_are_measured_inside(plan):
    places = planned_places(plan)
    assert rest_speeds(places, plan) == pytest.approx([0.0] * 5, abs=0.05)
    drifting = {
        side: path + np.arange(FRAMES)[:, None] * [0.01, 0, 0] for side, path in places.items()
    }
    assert rest_speeds(drifting, plan) == pytest.approx([0.3] * 5, abs=0.05)


def test_random_edits_change_the_plan_and_tell_what_they_are_about(plan):
    rng, gone = np.random.default_rng(1), 0
    for _ in range(120):
        edited, gesture = random_edit(plan, rng)
        gone += gesture is None
        if gesture is not None:
            lands = [g.stroke_end_s for g in gestures(edited.plan, gesture.side)]
            assert min(abs(at - gesture.stroke_end_s) for at in lands) < 1e-6
    assert 5 < gone < 40, "one kind in seven deletes"
    assert len(gestures(random_edit(STILL, rng)[0].plan, "right")) < 2


def test_distances_are_those_of_edited_and_unedited_motion():
    rng = np.random.default_rng(0)
    recorded, near, far = (rng.normal(at, 1, (200, 3)) for at in (0.0, 0.1, 2.0))
    assert fgd_before_and_after_edits([[recorded, near, far]]) == {}
    scores = {
        name: each["mean"]
        for name, each in fgd_before_and_after_edits([[recorded, near, near, far]] * 2).items()
    }
    plain = {
        name: each["mean"]
        for name, each in fgd_before_and_after_edits([[recorded, near, far]] * 2).items()
    }
    assert plain["FGD, edited"] > scores["FGD, unedited"] == plain["FGD, unedited"] > 0
    half = (plain["FGD, unedited"] + plain["FGD, edited"]) / 2
    assert scores["FGD, edited"] == pytest.approx(half)
    assert scores["FGD, edited / unedited"] == pytest.approx(half / plain["FGD, unedited"])


def test_moments_are_met_once_each():
    assert match_points([1.0, 1.05, 3.0], [1.02, 5.0], 0.1) == DetectionCounts(1, 3, 2)
    counts = DetectionCounts(1, 3, 2)
    assert counts.f1 == pytest.approx(0.4)
    assert counts.as_json() == {"f1": 0.4, "precision": 0.333, "recall": 0.5, "annotated": 2}
    assert match_points([], [1.0], 0.1) + match_points([1.0], [1.0], 0.1) == DetectionCounts(
        1, 1, 2
    )


def test_phases_must_lie_over_each_other():
    told = [phase(0.0, 1.0, "stroke"), phase(2.0, 3.0, "stroke")]
    assert match_intervals([phase(0.1, 1.2, "stroke")], told) == DetectionCounts(1, 1, 2)
    assert match_intervals([phase(0.9, 2.1, "stroke")], told) == DetectionCounts(0, 1, 2)
    twice = [phase(0.0, 0.5, "stroke"), phase(0.5, 1.0, "stroke")]
    assert match_intervals(twice, told) == DetectionCounts(1, 2, 2)


def test_holds_that_follow_on_holds_are_one():
    phases = [phase(0.0, 1.0, "hold"), phase(1.0, 2.0, "hold"), phase(2.0, 3.0, "stroke")]
    assert [(p.phase, p.end_s) for p in merge_adjacent_holds(phases)] == [
        ("hold", 2.0),
        ("stroke", 3.0),
    ]


def test_a_plan_agrees_with_itself_in_everything():
    counts = detection_counts_by_metric(made_plan(), made_plan())
    assert {
        question: one.f1 for question, one in counts.items() if one.num_annotated
    } == dict.fromkeys([q for q, one in counts.items() if one.num_annotated], 1.0)
    moved = detection_counts_by_metric(made_plan().at_speed(1.5), made_plan())
    assert moved["ends of strokes"].num_matched == 0 and moved["nods"].num_matched == 1


def test_what_is_fitted_is_what_is_read(tmp_path, monkeypatch):
    rng = np.random.default_rng(0)
    path = np.cumsum(rng.normal(0, 0.01, (400, 3)), axis=0)
    monkeypatch.setattr(
        plan_detection, "_recorded", lambda *_: (made_plan(), dict(left=path, right=path))
    )
    monkeypatch.setattr(plan_detection, "STEPS", 3)
    fitted = []
    monkeypatch.setattr(
        plan_detection, "PhaseNetwork", lambda n: fitted.append(PhaseNetwork(n)) or fitted[0]
    )
    plan_detection.train_phase_network(tmp_path, ["a"], tmp_path / "w.npz")
    monkeypatch.setattr(detection, "WEIGHTS", tmp_path / "w.npz")
    detection._weights.cache_clear()
    read, told = detection._weights()
    detection._weights.cache_clear()
    assert told["next"].sum(axis=1) == pytest.approx(1) and (told["frames"] > 0).all()
    for name, tensor in fitted[0].state_dict().items():
        torch.testing.assert_close(read.state_dict()[name], tensor.half().float())


def test_the_command_asks_a_protocol_by_its_name(annotated_folder, tmp_path, capsys):
    command = ["--data", str(annotated_folder), "--out", str(tmp_path / "told.json")]
    assert main(["finding", *command]) == 0
    told = json.loads((tmp_path / "told.json").read_text())
    assert told["protocol"] == "workbench/1"
    assert told["strokes"]["annotated"] > 0 and list(told["f1 of strokes"]) == ["eve"]
    assert f"strokes: f1 {told['strokes']['f1']:.4g}, precision" in capsys.readouterr().out
    assert main(["adherence", *command, "--weights", str(tmp_path)]) == 1
    assert "workbench/planned" in capsys.readouterr().err
