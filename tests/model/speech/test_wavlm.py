"""The WavLM encoder on a tiny network of the real class with random weights."""

from pathlib import Path

import numpy as np
import pytest
import torch

from model.speech.encoder import EncoderError
from model.speech.encoders import make_encoder
from model.speech.wavlm import WavLMEncoder, resampled
from tests.model.made import made_waveform

TINY = {
    "hidden_size": 16, "num_attention_heads": 2, "intermediate_size": 32, "conv_dim": (8,) * 7,
    "num_conv_pos_embeddings": 7, "num_conv_pos_embedding_groups": 2, "feat_extract_norm": "layer",
    "layerdrop": 0.0, "do_stable_layer_norm": True, "num_hidden_layers": 2,
}  # fmt: skip


@pytest.fixture(scope="module")
def weights(tmp_path_factory) -> Path:
    transformers = pytest.importorskip("transformers", reason="transformers is not installed")
    torch.manual_seed(0)
    folder = tmp_path_factory.mktemp("wavlm")
    transformers.WavLMModel(transformers.WavLMConfig(**TINY)).save_pretrained(folder)
    return folder


def test_each_window_of_two_seconds_is_heard_on_its_own_at_its_own_level(weights):
    """How a model hears one is tested with the authors' networks, which hear so, too."""
    transformers = pytest.importorskip("transformers")
    encoder = WavLMEncoder(weights)
    network = transformers.WavLMModel.from_pretrained(weights).eval()
    waveform = made_waveform(80_000)
    for num_frames in (1, 60, 61, 150):
        features = encoder.encode(waveform, num_frames)
        assert features.shape == (num_frames, encoder.dim) and features.dtype == np.float32
    window = torch.from_numpy(waveform[32_000:64_000])
    level = (window - window.mean()) / window.std(correction=0)
    with torch.inference_mode():
        wanted = resampled(network(level[None]).last_hidden_state)[0]
    np.testing.assert_allclose(features[60:120], wanted, atol=1e-4)
    assert np.isfinite(encoder.encode(made_waveform(0), 30)).all()


def test_folder_from_the_environment_or_one_sentence(weights, tmp_path, monkeypatch):
    monkeypatch.setenv("WAVLM_DIR", str(weights))
    assert make_encoder("wavlm").dim == 16
    monkeypatch.delenv("WAVLM_DIR")
    with pytest.raises(EncoderError, match="set WAVLM_DIR to a folder"):
        WavLMEncoder()
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(EncoderError, match="cannot be loaded"):
        WavLMEncoder(tmp_path)
