"""Agreement of found and annotated plans, and the fit of the network that finds."""

import numpy as np
import pytest
import torch

from model.evaluation import finding
from model.evaluation.finding import (
    Counts,
    PhaseNetwork,
    agreement,
    near,
    overlapping,
    with_long_holds,
)
from model.plan import found
from tests.model.plan.made import made_plan, phase


def test_moments_are_met_once_each():
    assert near([1.0, 1.05, 3.0], [1.02, 5.0], 0.1) == Counts(1, 3, 2)
    counts = Counts(1, 3, 2)
    assert counts.f1 == pytest.approx(0.4)
    assert counts.as_json() == {"f1": 0.4, "precision": 0.333, "recall": 0.5, "annotated": 2}
    assert near([], [1.0], 0.1) + near([1.0], [1.0], 0.1) == Counts(1, 1, 2)


def test_phases_must_lie_over_each_other():
    told = [phase(0.0, 1.0, "stroke"), phase(2.0, 3.0, "stroke")]
    assert overlapping([phase(0.1, 1.2, "stroke")], told) == Counts(1, 1, 2)
    assert overlapping([phase(0.9, 2.1, "stroke")], told) == Counts(0, 1, 2)
    twice = [phase(0.0, 0.5, "stroke"), phase(0.5, 1.0, "stroke")]
    assert overlapping(twice, told) == Counts(1, 2, 2)


def test_holds_that_follow_on_holds_are_one():
    phases = [phase(0.0, 1.0, "hold"), phase(1.0, 2.0, "hold"), phase(2.0, 3.0, "stroke")]
    assert [(p.phase, p.end_s) for p in with_long_holds(phases)] == [("hold", 2.0), ("stroke", 3.0)]


def test_a_plan_agrees_with_itself_in_everything():
    counts = agreement(made_plan(), made_plan())
    assert {question: one.f1 for question, one in counts.items() if one.told} == dict.fromkeys(
        [q for q, one in counts.items() if one.told], 1.0
    )
    moved = agreement(made_plan().at_speed(1.5), made_plan())
    assert moved["ends of strokes"].met == 0 and moved["nods"].met == 1


def test_what_is_fitted_is_what_is_computed_without_torch(tmp_path, monkeypatch):
    """The written weights give the network's own scores."""
    rng = np.random.default_rng(0)
    path = np.cumsum(rng.normal(0, 0.01, (400, 3)), axis=0)
    monkeypatch.setattr(finding, "_recorded", lambda *_: (made_plan(), dict(left=path, right=path)))
    monkeypatch.setattr(finding, "STEPS", 3)
    kept = {}
    monkeypatch.setattr(
        PhaseNetwork,
        "state_dict",
        lambda self: kept.setdefault("net", self) and torch.nn.Module.state_dict(self),
    )
    finding.fit(tmp_path, ["a"], tmp_path / "w.npz")
    monkeypatch.setattr(found, "WEIGHTS", tmp_path / "w.npz")
    found._weights.cache_clear()
    features = found.hand_features(path, path)
    likely, stay, change = found._likelihoods(features)
    told = found._weights()
    x = torch.from_numpy((features - told["mean"]) / told["std"]).T[None]
    with torch.no_grad():
        own = torch.log_softmax(kept["net"](x)[0].T, dim=1).numpy()
    np.testing.assert_allclose(likely, own, atol=0.02)
    assert np.isfinite(stay).all() and np.isfinite(change).all()
    found._weights.cache_clear()
