"""The speech encoder learns what is annotated, and planners hear by it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from model.data.annotations import load_plan_annotations, load_speech_labels
from model.data.prepared import prepare
from model.data.recordings import DataError
from model.networks.speech_codes import SpeechPredictions, load_speech_codes
from model.speech.encoder import PHONES, SPEECH_ENCODER, SPEECH_LABELS
from model.speech.features import MelEncoder
from model.systems.helpers.task import prediction_losses
from tests.model.systems.helpers.made_spoken import SPOKEN, make_spoken_folder
from tests.model.training.made import quick, run


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Annotated data, and beside it an encoder that was trained on it."""
    root = tmp_path_factory.mktemp("spoken")
    run(quick(SPEECH_ENCODER), make_spoken_folder(root / "data"), root / "encoder")
    return root


def test_frames_are_told_what_is_annotated_at_the_speed_of_each_copy(root):
    data = prepare(root / "data", root / "copies", MelEncoder(), augmented_copies=1)
    plans = load_plan_annotations(data, 4)
    table = replace(plans.kind_table, stroke_shares_by_word={"whole": 0.75})
    spoken = load_speech_labels(data, replace(plans, kind_table=table))
    plain, copy = (next(c for c in data.clips if c.copy == n) for n in (0, 1))
    phone = spoken.phones[plain.start : plain.stop]
    named = [PHONES[number - 1] if number else "" for number in phone[:60]]
    wanted = [""] * 6 + ["hh"] * 6 + ["ow"] * 9 + [""] * 24 + ["er"] * 15
    assert named == wanted
    told = {
        name: spoken.labels[plain.start : plain.stop, k] for k, name in enumerate(SPEECH_LABELS)
    }
    assert np.flatnonzero(told["accent"]).tolist() == [14, 15, 16, 53, 54, 55]
    np.testing.assert_allclose(told["strength"][[15, 54]], [0.8, 0.3], atol=1e-6)
    assert np.flatnonzero(told["voice"]).tolist() == [*range(6, 30), *range(45, 60)]
    assert np.flatnonzero(told["phrase_end"]).tolist() == [*range(27, 32), *range(57, 62)]
    assert set(told["struck"][6:21]) == {0.75} and not told["struck"][21:].any()
    assert told["speed"][45] > 10 * told["speed"][5] >= 0  # of a stroke, and before anything moves
    speed = plain.num_frames / copy.num_frames
    faster = spoken.phones[copy.start : copy.stop]
    assert np.flatnonzero(faster)[0] == pytest.approx(6 / speed, abs=1)


def test_an_encoder_that_was_trained_gives_codes_beside_features(root, tmp_path):
    codes = load_speech_codes(root / "encoder" / "weights")
    features = torch.randn(2, 40, 68)
    found = codes.encode(features)
    assert found.shape == (2, 40, 8) and found.abs().max() <= 1
    torch.testing.assert_close(codes.encode(features[1]), found[1])
    later = features.clone()
    later[:, 20:] += 1
    reach = codes.network.config.context_frames_per_side
    torch.testing.assert_close(codes.encode(later)[:, : 20 - reach], found[:, : 20 - reach])
    assert not torch.allclose(codes.encode(later)[:, 20 - reach], found[:, 20 - reach], atol=1e-6)
    card = json.loads((root / "encoder" / "weights" / "speech-encoder.json").read_text())
    assert 0 <= card["validation"]["phones_right"] <= 1
    assert set(card["validation"]) == {"phone", *SPEECH_LABELS, "phones_right", "total"}


def test_losses_are_those_of_what_is_right():
    phone = torch.tensor([[2, 0]])
    sure = 30.0 * torch.nn.functional.one_hot(phone, 1 + len(PHONES)).float()
    told = torch.tensor([[[1, 0.7, 0, 1, 0, 0.2], [0, 0.0, 1, 0, 1, 0.4]]])
    said = torch.where(told > 0.5, 30.0, -30.0)
    said[..., 1], said[..., 5] = told[..., 1], told[..., 5]
    losses = prediction_losses(SpeechPredictions(sure, said), phone, told)
    assert max(losses.values()) < 1e-6
    said[0, 1, 1], said[0, 0, 1] = 5.0, 0.5  # the strength counts where there is an accent
    losses = prediction_losses(SpeechPredictions(sure, said), phone, told)
    assert losses["strength"].item() == pytest.approx(0.04)


@pytest.mark.parametrize("tiers", [("words",), ("words", "phones")])
def test_data_that_tells_too_little_is_refused_in_a_sentence(tmp_path, tiers):
    make_spoken_folder(tmp_path / "data", *SPOKEN[: len(tiers)])
    missing = "phones" if len(tiers) == 1 else "accents"
    with pytest.raises(DataError, match=f"No TextGrid of data has a tier of {missing}"):
        run(quick(SPEECH_ENCODER), tmp_path / "data", tmp_path / "out")
