"""The speech encoder alone, and as a part of the networks of other systems."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch

from conventions.rates import SAMPLE_RATE
from model.data.prepared import prepare
from model.networks.speech_codes import Listener, heard_accents, listener_of, load_codes
from model.networks.trained import Trained
from model.speech.audio import load_speech
from model.speech.encoders import make_encoder
from model.speech.features import MelEncoder
from model.storage.cards import BUNDLED_WEIGHTS, CheckpointError
from model.storage.checkpoint import load_weights
from model.systems.globaldiff.config import NetworkConfig
from model.systems.globaldiff.network import MotionNetwork
from model.systems.registry import family_of
from model.training.task import TaskSetup
from tests.model.made import made_speech

CODES = 48
SHAPE = NetworkConfig(width=96, num_blocks=2, num_heads=3)
"""Of the bundled ladder."""


@pytest.fixture(scope="module")
def features() -> torch.Tensor:
    speech = made_speech(32000)
    return torch.from_numpy(make_encoder("mel64").encode(speech.waveform, 60))[None]


def conditions(speech: torch.Tensor, has_speech: bool = True) -> dict[str, torch.Tensor]:
    return {
        "speech": speech,
        "expression": torch.zeros(1, 60, 52),
        "seed": torch.zeros(1, 8, 333),
        "speaker": torch.ones(1, dtype=torch.long),
        "has_seed": torch.tensor([False]),
        "has_speech": torch.tensor([has_speech]),
    }


def started(codes: int) -> MotionNetwork:
    network = MotionNetwork(replace(SHAPE, codes=codes))
    given = Trained.read(BUNDLED_WEIGHTS, "globaldiff/global")
    TaskSetup(BUNDLED_WEIGHTS).put_weights_into(network, given)
    return network.eval()


def test_a_listener_gives_the_codes_of_its_encoder_and_never_learns(features):
    codes = load_codes(BUNDLED_WEIGHTS)
    listener = listener_of(features.shape[-1], CODES)
    assert listener is not None and listener_of(68, 0) is None
    listener.become(codes)
    found = listener(features.requires_grad_())
    torch.testing.assert_close(found, codes.of(features.detach()), rtol=0, atol=1e-5)
    assert not found.requires_grad and not any(p.requires_grad for p in listener.parameters())


def test_a_network_that_learns_to_listen_begins_as_it_was(features):
    x_t, t = torch.randn(1, 60, 333), torch.tensor([0.3])
    before, after = started(0), started(CODES)
    with torch.no_grad():
        told = conditions(features)
        torch.testing.assert_close(after(x_t, t, **told), before(x_t, t, **told))


def test_codes_reach_the_motion_and_are_hidden_with_the_speech(features):
    network = started(CODES)
    with torch.no_grad():
        network.speech.frames[0].weight[:, -CODES:] = 0.3  # type: ignore[index]
        x_t, t = torch.randn(1, 60, 333), torch.tensor([0.3])
        heard, deaf = (network(x_t, t, **conditions(features, has)) for has in (True, False))
        assert isinstance(network.listener, Listener)
        network.listener.network.code.weight.neg_()
        other, still = (network(x_t, t, **conditions(features, has)) for has in (True, False))
    assert (heard - other).abs().max() > 1e-3
    assert torch.equal(deaf, still)


def test_what_cannot_be_heard_with_is_told(tmp_path):
    network = MotionNetwork(replace(SHAPE, codes=CODES // 2))
    with pytest.raises(CheckpointError, match="speech-encoder do not fit"):
        TaskSetup(BUNDLED_WEIGHTS).put_weights_into(network, None)
    with pytest.raises(CheckpointError, match="speech-encoder"):
        TaskSetup(tmp_path).put_weights_into(MotionNetwork(replace(SHAPE, codes=CODES)), None)


EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "three_reasons.wav"


def test_accents_are_heard_where_somebody_speaks():
    speech = load_speech(EXAMPLE)
    accents = heard_accents(speech, BUNDLED_WEIGHTS)
    assert 0.5 < len(accents) / speech.duration_s < 4
    assert all(after.time_s - before.time_s > 0.1 for before, after in pairwise(accents))
    loud = np.abs(speech.waveform)
    around = [
        loud[max(0, int(SAMPLE_RATE * (a.time_s - 0.1))) : int(SAMPLE_RATE * (a.time_s + 0.1))]
        for a in accents
    ]
    assert np.mean([part.mean() for part in around]) > 1.3 * loud.mean()
    assert all(0 <= accent.strength <= 1 for accent in accents)


def test_without_its_weights_nothing_is_heard(tmp_path):
    assert heard_accents(load_speech(EXAMPLE), tmp_path) == ()


@pytest.mark.parametrize(
    ("system", "shape"),
    [
        ("globaldiff/local", "network"),
        ("workbench/priorflow", "network"),
        pytest.param("gan/20", "generator", marks=pytest.mark.slow),
        pytest.param("asynfusion/ddim", "network", marks=pytest.mark.slow),
        ("expression", "expression"),
    ],
)
def test_every_family_can_hear_codes_and_saves_the_encoder(tmp_path, data_folder, system, shape):
    family = family_of(system)
    config = family.config("smoke", system)
    heard = replace(getattr(config, shape), codes=CODES)
    data = prepare(data_folder, tmp_path / "prepared", MelEncoder())
    task = family.make_task(replace(config, **{shape: heard}), data, TaskSetup(BUNDLED_WEIGHTS))
    encoder, _ = load_weights(BUNDLED_WEIGHTS, "speech-encoder")
    kept = {key: t for key, t in task.export().items() if ".listener.network." in f".{key}"}
    assert len(kept) == sum(key.startswith("network.") for key in encoder)
    for key, tensor in kept.items():
        assert torch.equal(tensor, encoder[key.replace("listener.network.", "")])
