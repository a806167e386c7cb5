"""What networks hear of speech: of a whole clip, and while it is being said."""

import numpy as np
import pytest
import torch

from model.metrics.beats import speech_onsets
from model.speech import features
from model.speech.audio import load_speech
from model.speech.features import (
    BLOCK_FRAMES,
    BLOCK_SAMPLES,
    LOOK_AHEAD,
    NUM_MELS,
    MelEncoder,
    RunningVoice,
    StreamingMelEncoder,
    VoiceReference,
    analyse_hops,
    simulate_microphone,
    vocal_tract_perturbation,
)
from tests.helpers import ROOT
from tests.model.made import made_waveform

ENERGY, ONSET, PITCH, VOICED = range(NUM_MELS, NUM_MELS + 4)


def test_features_are_those_that_the_bundled_weights_were_trained_with():
    """Of seconds 3 to 5 of an example, by the code with which they were."""
    told = np.load(ROOT / "tests" / "model" / "speech" / "heard.npz")
    speech = load_speech(ROOT / "examples" / "three_reasons.wav")
    found = MelEncoder().encode(speech.waveform, speech.num_motion_frames)
    np.testing.assert_allclose(found[90:150], told["features"], atol=1e-4)
    np.testing.assert_allclose(speech_onsets(speech.waveform)[:40], told["onsets_s"])
    assert len(speech_onsets(np.zeros(32_000, np.float32))) == 0


def tone(frequency: float, seconds: float = 2.0) -> np.ndarray:
    time = np.arange(round(16_000 * seconds)) / 16_000
    partials = sum(np.sin(2 * np.pi * k * frequency * time) / k for k in (1, 2, 3))
    return (0.2 * partials).astype(np.float32)


def test_each_motion_frame_has_a_row_in_which_its_click_is_heard():
    for num_frames in (1, 15, 59, 60, 61, 100):
        rows = MelEncoder().encode(tone(150), num_frames)
        assert rows.shape == (num_frames, 68) and rows.dtype == np.float32
        assert np.isfinite(rows).all()
    for frame in (7, 8, 9, 31):
        waveform = np.zeros(32_000, np.float32)
        middle = round((frame + 0.5) / 30 * 16_000)
        waveform[middle - 40 : middle + 40] = 0.8
        assert MelEncoder().encode(waveform, 60)[:, ENERGY].argmax() == frame


def test_block_size_does_not_change_the_numbers(monkeypatch):
    rng = np.random.default_rng(0)
    waveform = (tone(140, 3) + 0.01 * rng.standard_normal(48_000)).astype(np.float32)
    whole = MelEncoder().encode(waveform, 90)
    for block in (1, 7, 100):
        monkeypatch.setattr(features, "_HOPS_AT_ONCE", block)
        features._cache.clear()
        np.testing.assert_allclose(MelEncoder().encode(waveform, 90), whole, atol=1e-5)


def test_features_of_one_speech_are_computed_once_for_all_systems(monkeypatch):
    counts: list[int] = []
    analyse = features.analyse_hops
    monkeypatch.setattr(features, "_MAX_CACHED_HOPS", 450)
    monkeypatch.setattr(features, "analyse_hops", lambda *how: [counts.append(1), analyse(*how)][1])
    clip, other = made_waveform(32_000), made_waveform(32_000)[::-1].copy()
    features._cache.clear()
    whole = MelEncoder().encode(clip, 80)
    for num_frames in (60, 80):  # windows of each system end elsewhere
        np.testing.assert_array_equal(
            MelEncoder().encode(clip.copy(), num_frames), whole[:num_frames]
        )
    assert len(counts) == 1
    MelEncoder().encode(other, 60)
    MelEncoder().encode(clip, 60)
    assert len(counts) == 2, "several speeches stay"
    clip *= 0.5
    MelEncoder().encode(clip, 60)
    assert len(counts) == 3 and len(features._cache) == 2, (
        "what it holds counts, and memory is bounded"
    )


def test_frames_beyond_the_end_are_silence():
    rows = MelEncoder().encode(tone(150, 1.0), 90)
    assert (rows[40:, :NUM_MELS] == -2.0).all() and (rows[40:, VOICED] == 0).all()
    np.testing.assert_allclose(rows[:29], MelEncoder().encode(tone(150, 1.0), 30)[:29], atol=1e-5)


def test_augmentation_keeps_pitch_and_differs_between_samples():
    rows = torch.from_numpy(MelEncoder().encode(tone(150), 60)).expand(4, -1, -1)
    varied = simulate_microphone(rows, torch.Generator().manual_seed(0))
    assert torch.isfinite(varied).all()
    torch.testing.assert_close(varied[..., ONSET:], rows[..., ONSET:])
    assert (varied[0] - varied[1])[:, :NUM_MELS].abs().mean() > 0.05
    again = simulate_microphone(rows, torch.Generator().manual_seed(0))
    torch.testing.assert_close(varied, again)
    loud = 6 + torch.rand(4, 60, 68)  # where no noise is heard, another level for each band
    other = (simulate_microphone(loud, torch.Generator().manual_seed(0)) - loud)[..., :NUM_MELS]
    assert other.std(dim=1).max() < 1e-4 and 0.1 < other[..., :32].abs().max() < 9 / 20


def test_another_throat_stretches_the_mel_bands_and_leaves_the_rest():
    rows = torch.randn(3, 5, 68)
    same = vocal_tract_perturbation(rows, (1.0, 1.0), torch.Generator())
    torch.testing.assert_close(same, rows)
    longer = vocal_tract_perturbation(rows, (1.25, 1.25), torch.Generator())
    wanted = np.interp(np.arange(64) * 1.25, np.arange(64), rows[2, 3, :NUM_MELS].numpy())
    np.testing.assert_allclose(longer[2, 3, :NUM_MELS], wanted, atol=1e-5)
    torch.testing.assert_close(longer[..., NUM_MELS:], rows[..., NUM_MELS:])
    drawn = vocal_tract_perturbation(
        rows[:1].expand(4, -1, -1), (0.8, 1.2), torch.Generator().manual_seed(0)
    )
    assert len({round(float(one[0, 40]), 4) for one in drawn}) == 4


VOICE = VoiceReference(level_db=25.0, log2_pitch_hz=7.0)


def heard(waveform, sizes):
    causal, start, rows = StreamingMelEncoder(), 0, []
    while start < len(waveform):
        size = sizes[len(rows) % len(sizes)]
        rows.append(causal.add_samples(waveform[start : start + size]))
        start += size
    return np.concatenate(rows)


@pytest.mark.parametrize("sizes", [[640], [1], [1600, 7, 431], [100_000]])
def test_they_equal_those_of_the_whole_clip_given_the_same_voice(sizes, monkeypatch):
    monkeypatch.setattr(RunningVoice, "update", lambda self, hops: VOICE)
    waveform = made_waveform(3_000 if sizes == [1] else 30_000)
    causal = heard(waveform, sizes)
    blocks = (len(waveform) - LOOK_AHEAD) // BLOCK_SAMPLES
    assert len(causal) == BLOCK_FRAMES * blocks
    offline = MelEncoder().encode_relative_to(VOICE, waveform, len(causal))
    np.testing.assert_allclose(causal, offline, atol=2e-4)


def test_sound_to_come_changes_nothing_and_a_block_is_known_27_ms_after_it():
    first = made_waveform(16_000)
    known = heard(first, [640])
    for seed in (1, 2):
        longer = np.concatenate([first, made_waveform(20_000, seed)])
        np.testing.assert_array_equal(heard(longer, [640])[: len(known)], known)
    causal = StreamingMelEncoder()
    assert len(causal.add_samples(first[: BLOCK_SAMPLES + LOOK_AHEAD - 1])) == 0
    assert len(causal.add_samples(first[BLOCK_SAMPLES + LOOK_AHEAD - 1 :][:1])) == BLOCK_FRAMES
    assert LOOK_AHEAD == 432  # 27 ms


def test_memory_does_not_grow():
    causal = StreamingMelEncoder()
    for _ in range(40):
        causal.add_samples(made_waveform(640))
    assert len(causal._sound) < 2 * BLOCK_SAMPLES


@pytest.mark.parametrize("gain", [0.05, 1.0])
def test_the_running_level_finds_the_clips_own(gain):
    waveform = gain * made_waveform(20 * 16_000)
    causal = heard(waveform, [640])[-150:]
    clip = MelEncoder().encode(waveform, 600)[-len(causal) - 3 :][: len(causal)]
    level = slice(None, 65)
    assert np.abs(causal[:, level].mean() - clip[:, level].mean()) < 0.15  # 3 dB


def test_silence_and_noise_leave_the_level_alone():
    voice, rng = RunningVoice(), np.random.default_rng(0)

    def hops(waveform):
        return analyse_hops(waveform.astype(np.float32), 0, len(waveform) // 160)

    spoken = voice.update(hops(made_waveform(10 * 16_000)))
    for quiet in (np.zeros(40 * 16_000), 1e-3 * rng.standard_normal(40 * 16_000)):
        after = voice.update(hops(quiet))
        assert abs(after.level_db - spoken.level_db) < 1.0
    # In a quiet room where nobody has spoken, what there is stays quiet.
    silent = RunningVoice()
    assert silent.update(hops(1e-3 * rng.standard_normal(16_000))).level_db > 20
