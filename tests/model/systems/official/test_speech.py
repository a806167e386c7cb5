"""What the authors' networks hear, window by window."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from model.speech.encoder import EncoderError
from model.speech.wavlm import WINDOW_SAMPLES, resampled
from model.systems.official.checkpoints import SPEECH_DIM
from model.systems.official.speech import (
    STEP_SAMPLES,
    OfficialEncoder,
    frames_to_window,
    official_encoder,
    read_features,
    windows_to_frames,
)
from tests.helpers import official_folder
from tests.model.made import made_waveform
from tests.model.systems.official.filled import made

TINY = {
    "hidden_size": SPEECH_DIM, "num_attention_heads": 2, "intermediate_size": 8,
    "conv_dim": (8,) * 7, "num_conv_pos_embeddings": 7, "num_conv_pos_embedding_groups": 2,
    "feat_extract_norm": "layer", "num_hidden_layers": 0,
}  # fmt: skip


def _save_tiny(folder: Path, kind: str, **sizes: int) -> Path:
    transformers = pytest.importorskip("transformers", reason="transformers is not installed")
    torch.manual_seed(0)
    config = getattr(transformers, f"{kind}Config")(**TINY | sizes)
    getattr(transformers, f"{kind}Model")(config).save_pretrained(folder)
    return folder


@pytest.fixture
def encoder_of(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], OfficialEncoder]:
    """By a folder or file that is named."""

    def named(path: Path) -> OfficialEncoder:
        monkeypatch.setenv("OFFICIAL_FEATURES", str(path))
        return official_encoder()

    return named


def test_windows_survive_the_way_through_frames():
    windows = made("windows", (3, 60, 5))
    frames = windows_to_frames(windows)
    assert frames.shape == (60 + 2 * 52, 10)
    for index, window in enumerate(windows):
        assert torch.equal(frames_to_window(frames[52 * index : 52 * index + 60]), window)


def test_windows_begin_where_the_authors_script_has_them():
    begun: list[np.ndarray] = []

    def hear(windows: np.ndarray) -> torch.Tensor:
        begun.append(windows)
        return torch.zeros(len(windows), 60, SPEECH_DIM)

    waveform = made_waveform(5 * 16_000)
    features = OfficialEncoder(hear).encode(waveform, 150)
    assert features.shape == (150, 2 * SPEECH_DIM) and STEP_SAMPLES == 27_734
    (windows,) = begun
    assert windows.shape == (3, WINDOW_SAMPLES)
    np.testing.assert_array_equal(windows[1], waveform[27_734 : 27_734 + 32_000])
    rest = len(waveform) - 2 * STEP_SAMPLES
    np.testing.assert_array_equal(windows[2, :rest], waveform[2 * STEP_SAMPLES :])
    assert not windows[2, rest:].any()  # silence after the end


@pytest.mark.parametrize("kind", ["WavLM", "Hubert"])
def test_a_model_hears_each_window_on_its_own(tmp_path, kind, encoder_of):
    encoder = encoder_of(_save_tiny(tmp_path, kind))
    waveform = made_waveform(WINDOW_SAMPLES + STEP_SAMPLES)
    features = torch.from_numpy(encoder.encode(waveform, 112))
    second = waveform[STEP_SAMPLES:]
    alone = torch.from_numpy(encoder.encode(second, 60))
    torch.testing.assert_close(
        frames_to_window(features[52:]), frames_to_window(alone), atol=1e-5, rtol=0
    )
    louder = torch.from_numpy(encoder.encode(4 * second, 60))
    torch.testing.assert_close(alone, louder, atol=1e-3, rtol=0)  # each at the same level
    (tmp_path / "preprocessor_config.json").write_text('{"do_normalize": false}')
    raw = torch.from_numpy(encoder_of(tmp_path).encode(second, 60))
    assert (raw - alone).abs().max() > 1e-3


def test_models_that_the_networks_do_not_know_are_told(tmp_path, encoder_of):
    with pytest.raises(EncoderError, match=r"holds no config.json of a speech model"):
        encoder_of(tmp_path)
    for config in (
        {"model_type": "whisper", "hidden_size": 1024},
        {"model_type": "wavlm", "hidden_size": 768},
    ):
        (tmp_path / "config.json").write_text(json.dumps(config))
        told = (
            f"holds a {config['model_type']} with hidden size {config['hidden_size']}; the authors'"
        )
        with pytest.raises(EncoderError, match=told):
            encoder_of(tmp_path)
    (tmp_path / "config.json").write_text('{"model_type": "wavlm", "hidden_size": 1024}')
    pytest.importorskip("transformers", reason="transformers is not installed")
    with pytest.raises(EncoderError, match=r"The speech model in .* cannot be loaded"):
        encoder_of(tmp_path)


def test_prepared_features_are_those_of_one_speech(tmp_path, encoder_of):
    windows = made("windows", (3, 60, SPEECH_DIM)).numpy()
    np.savez(tmp_path / "clip.npz", features=windows)
    encoder = encoder_of(tmp_path / "clip.npz")
    features = torch.from_numpy(encoder.encode(made_waveform(80_000), 150))
    np.testing.assert_array_equal(frames_to_window(features[52:112]), windows[1])
    with pytest.raises(EncoderError, match=r"features of 3 windows, but this speech has 6"):
        encoder.encode(made_waveform(160_000), 300)
    with pytest.raises(EncoderError, match="but this speech has 1"):
        encoder.encode(made_waveform(100), 3)
    np.save(tmp_path / "two.npy", windows[:2])
    assert encoder_of(tmp_path / "two.npy").encode(made_waveform(100), 3).shape == (3, 2048)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (np.zeros((2, 50, 1024), np.float32), r"shape \(2, 50, 1024\); features must be"),
        (np.zeros((2, 60, 768), np.float32), r"shape \(2, 60, 768\)"),
        (np.zeros((60, 1024), np.float32), r"shape \(60, 1024\)"),
        (np.full((1, 60, 1024), np.inf, np.float32), "not finite"),
        (np.array([{}], dtype=object), "cannot be read as prepared features"),
    ],
)
def test_other_arrays_are_refused(tmp_path, content, told):
    np.save(tmp_path / "file.npy", content, allow_pickle=True)
    with pytest.raises(EncoderError, match=told):
        read_features(tmp_path / "file.npy")


def test_features_are_stretched_from_end_to_end_as_the_authors_do(tmp_path):
    line = torch.arange(99.0)[None, :, None]
    np.testing.assert_allclose(resampled(line)[0, :, 0], np.arange(60) * 98 / 59, rtol=1e-5)
    raw = made("raw", (2, 99, SPEECH_DIM))  # as the model gives them
    np.save(tmp_path / "raw.npy", raw.numpy())
    torch.testing.assert_close(read_features(tmp_path / "raw.npy"), resampled(raw))
    with np.load(official_folder() / "reference-rotations.npz") as wanted:
        found = resampled(torch.from_numpy(wanted["resample_in"]))
        np.testing.assert_allclose(found.numpy(), wanted["resample_out"], atol=1e-6)


def test_without_anything_to_hear_by_it_says_what_to_give(monkeypatch):
    for name in ("OFFICIAL_FEATURES", "WAVLM_DIR"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(EncoderError, match="with --official-features PATH"):
        official_encoder()
