"""The WavLM encoder on a tiny network of the real class with random weights."""

from pathlib import Path

import numpy as np
import pytest
import torch

from model.speech import wavlm
from model.speech.encoder import EncoderError, make_encoder
from model.speech.wavlm import WavLMEncoder

RATE = 16_000
TINY = {
    "hidden_size": 16, "num_attention_heads": 2, "intermediate_size": 32, "conv_dim": (8,) * 7,
    "num_conv_pos_embeddings": 7, "num_conv_pos_embedding_groups": 2, "feat_extract_norm": "layer",
    "layerdrop": 0.0, "do_stable_layer_norm": True,
}  # fmt: skip


def save_tiny(folder: Path, num_layers: int) -> Path:
    transformers = pytest.importorskip("transformers", reason="transformers is not installed")
    torch.manual_seed(0)
    config = transformers.WavLMConfig(num_hidden_layers=num_layers, **TINY)
    transformers.WavLMModel(config).save_pretrained(folder)
    return folder


@pytest.fixture(scope="module")
def weights(tmp_path_factory) -> Path:
    return save_tiny(tmp_path_factory.mktemp("wavlm"), num_layers=2)


@pytest.fixture(scope="module")
def convolutional_weights(tmp_path_factory) -> Path:
    """Neither attention nor levelling: each feature sees only the speech around it."""
    folder = save_tiny(tmp_path_factory.mktemp("wavlm_conv"), num_layers=0)
    (folder / "preprocessor_config.json").write_text('{"do_normalize": false}')
    return folder


def noise(duration_s: float, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return (0.1 * rng.standard_normal(round(duration_s * RATE))).astype(np.float32)


def test_one_vector_for_each_frame_and_silence_after_short_speech(weights):
    encoder = WavLMEncoder(weights)
    assert encoder.dim == 16
    for num_frames in (1, 15, 60, 61, 100):
        features = encoder.encode(noise(num_frames / 30), num_frames)
        assert features.shape == (num_frames, 16) and features.dtype == np.float32
        assert np.isfinite(features).all()
    for seconds in (0.01, 0.0):
        assert encoder.encode(noise(seconds), 30).shape == (30, 16)


def test_agrees_with_the_network_read_at_exact_times(weights):
    """Against the plain network: features at 50 Hz, interpolated channel by channel."""
    transformers = pytest.importorskip("transformers")
    waveform = noise(3.0)
    network = transformers.WavLMModel.from_pretrained(weights).eval()
    normalised = (waveform - waveform.mean()) / np.sqrt(waveform.var() + 1e-7)
    with torch.inference_mode():
        padded = np.pad(normalised, (0, 400))
        hidden = network(torch.from_numpy(padded)[None]).last_hidden_state[0].numpy()
    # Hidden state i sees samples 320 i to 320 i + 399.
    at_s = (320 * np.arange(len(hidden)) + 199.5) / RATE
    frame_s = (np.arange(90) + 0.5) / 30
    expected = np.stack([np.interp(frame_s, at_s, column) for column in hidden.T], axis=1)
    np.testing.assert_allclose(WavLMEncoder(weights).encode(waveform, 90), expected, atol=1e-4)


def test_blocks_with_context_give_what_one_pass_gives(convolutional_weights):
    assert wavlm._receptive_field((10, 3, 3, 3, 3, 2, 2), (5, 2, 2, 2, 2, 2, 2)) == 400
    waveform = noise(7.3)
    whole = WavLMEncoder(convolutional_weights, block_s=100.0).encode(waveform, 219)
    blocks = WavLMEncoder(convolutional_weights, block_s=1.0, context_s=0.5)
    np.testing.assert_allclose(blocks.encode(waveform, 219), whole, atol=1e-5)


def test_loudness_is_taken_out_unless_the_weights_say_otherwise(weights, tmp_path):
    waveform = noise(1.0)

    def change(encoder: WavLMEncoder) -> float:
        return float(np.abs(encoder.encode(9 * waveform, 30) - encoder.encode(waveform, 30)).max())

    raw = save_tiny(tmp_path, num_layers=2)
    (raw / "preprocessor_config.json").write_text('{"do_normalize": false}')
    assert change(WavLMEncoder(weights)) < 0.05 * change(WavLMEncoder(raw))


def test_folder_from_the_environment_or_one_sentence(weights, tmp_path, monkeypatch):
    monkeypatch.setenv("WAVLM_DIR", str(weights))
    assert make_encoder("wavlm").encode(noise(1.0), 30).shape == (30, 16)
    monkeypatch.delenv("WAVLM_DIR")
    with pytest.raises(EncoderError, match="set WAVLM_DIR to a folder"):
        WavLMEncoder()
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(EncoderError, match="cannot be loaded"):
        WavLMEncoder(tmp_path)
