"""Faces that are drawn window by window, remembered, and led by a plan."""

import pytest
import torch

from model.plan.plan_features import NUM_HEAD_FACE_TRACKS
from model.systems.face.face import FaceModel, FaceNetwork, load_face
from tests.model.made import TINY_EXPRESSION, made_prior

HEARD = 60 + 2 * TINY_EXPRESSION.speech_context


@pytest.fixture(scope="module")
def face(weights) -> FaceModel:
    return load_face(weights)


def test_a_face_that_was_drawn_is_remembered_and_no_other_taken_for_it(face, monkeypatch):
    speech = torch.randn(HEARD, 68)
    first = face.window(speech, 1, None, 0, 0)
    after = face.window(speech, 1, first, 0, 1)
    drawn = []
    real = type(face).sample
    monkeypatch.setattr(
        type(face), "sample", lambda self, *asked: drawn.append(1) or real(self, *asked)
    )
    again = face.window(speech.clone(), 1, face.window(speech, 1, None, 0, 0), 0, 1)
    assert again is after and not drawn
    assert face.window(speech, 2, None, 0, 0) is not first  # another speaker
    assert face.window(speech, 1, None, 1, 0) is not first  # other noise
    assert face.window(speech + 1e-3, 1, None, 0, 0) is not first  # other speech
    assert face.window(speech, 1, face.window(speech, 1, None, 1, 0), 0, 1) is not after
    assert len(drawn) == 4
    alone = real(face, speech[None], 1, None, face.noise(1, 0))
    torch.testing.assert_close(face.window(speech, 1, None, 1, 0), alone[0])


def test_a_plan_changes_the_face_and_is_remembered_beside_it(weights):
    face = load_face(weights)
    speech = torch.randn(HEARD, 68)
    plan = torch.zeros(HEARD, NUM_HEAD_FACE_TRACKS)
    plan[:, -1] = 1.0
    for layer in (face.network.plan, face.network.branch):
        layer.out.weight.normal_(std=0.3)
    unplanned, planned = (face.window(speech, 3, None, 0, 0, told) for told in (None, plan))
    assert (unplanned - planned).abs().max() > 0.01
    assert face.window(speech, 3, None, 0, 0, plan.clone()) is planned
    assert face.window(speech, 3, None, 0, 0) is unplanned


def test_before_training_a_plan_says_nothing():
    network = FaceNetwork(TINY_EXPRESSION, made_prior(52))
    with torch.no_grad():
        network.branch.out.weight.normal_()
    asked = {
        "speech": torch.randn(2, HEARD, 68),
        "seed": torch.zeros(2, 8, 52),
        "speaker": torch.tensor([1, 2]),
        "has_seed": torch.zeros(2, dtype=torch.bool),
        "has_speech": torch.ones(2, dtype=torch.bool),
    }
    x_t, t = torch.randn(2, 60, 52), torch.tensor([0.1, 0.6])
    tracks = torch.randn(2, HEARD, NUM_HEAD_FACE_TRACKS)
    plain = network(x_t, t, **asked)
    torch.testing.assert_close(network(x_t, t, tracks=tracks, **asked), plain)
    with torch.no_grad():
        network.plan.out.weight.normal_()
    one = network(x_t, t, tracks=tracks, has_plan=torch.tensor([True, False]), **asked)
    assert (one[0] - plain[0]).abs().max() > 0.01
    torch.testing.assert_close(one[1], plain[1])


def test_windows_are_faded_into_each_other(face):
    speech = torch.randn(HEARD, 68)
    first = face.window(speech, 1, None, 5, 0)
    after = face.window(speech, 1, first, 5, 1)
    seed = face.normaliser.normalise(first[None, -8:])
    alone = face.sample(speech[None], 1, seed, face.noise(5, 1))
    torch.testing.assert_close(after[8:], alone[0, 8:])
    assert (after[0] - first[-8]).abs().max() < 0.02 + 0.1 * (alone[0, 0] - first[-8]).abs().max()


def test_a_face_is_drawn_anew_from_other_noise_stays_in_range_and_goes_on(face):
    speech = torch.randn(3, HEARD, 68)
    noise = torch.cat([face.noise(k, 0) for k in (0, 1, 0)])
    first = face.sample(speech, 1, None, noise)
    assert first.shape == (3, 60, 52) and first.min() >= 0 and first.max() <= 1
    alone = face.sample(speech[:1], 1, None, noise[:1])
    torch.testing.assert_close(first[:1], alone, atol=1e-4, rtol=1e-4)
    other = face.sample(speech[:1], 1, None, noise[1:2])
    assert (other - alone).abs().max() > 0.05
    seed = face.normaliser.normalise(first[:, -8:])
    after = face.sample(speech, 1, seed, torch.cat([face.noise(k, 1) for k in (0, 1, 0)]))
    assert (after[:, :8] - first[:, -8:]).abs().mean() < 0.2 * first.std()
