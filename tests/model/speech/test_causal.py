import numpy as np
import pytest

from model.speech.causal import BLOCK_FRAMES, BLOCK_SAMPLES, LOOK_AHEAD, CausalMel, RunningVoice
from model.speech.features import MelEncoder, Voice, analysed
from tests.model.made import made_waveform

VOICE = Voice(level_db=25.0, pitch=7.0)


def heard(waveform, sizes, voice_of=None):
    causal, start, rows = CausalMel(voice_of), 0, []
    while start < len(waveform):
        size = sizes[len(rows) % len(sizes)]
        rows.append(causal.hear(waveform[start : start + size]))
        start += size
    return np.concatenate(rows)


@pytest.mark.parametrize("sizes", [[640], [1], [1600, 7, 431], [100_000]])
def test_they_equal_those_of_the_whole_clip_given_the_same_voice(sizes):
    waveform = made_waveform(16_000 if sizes == [1] else 50_000)
    causal = heard(waveform, sizes, lambda hops: VOICE)
    blocks = (len(waveform) - LOOK_AHEAD) // BLOCK_SAMPLES
    assert len(causal) == BLOCK_FRAMES * blocks
    offline = MelEncoder().relative_to(VOICE, waveform, len(causal))
    np.testing.assert_allclose(causal, offline, atol=2e-4)


def test_sound_to_come_changes_nothing_and_a_block_is_known_27_ms_after_it():
    first = made_waveform(16_000)
    known = heard(first, [640])
    for seed in (1, 2):
        longer = np.concatenate([first, made_waveform(20_000, seed)])
        np.testing.assert_array_equal(heard(longer, [640])[: len(known)], known)
    causal = CausalMel()
    assert len(causal.hear(first[: BLOCK_SAMPLES + LOOK_AHEAD - 1])) == 0
    assert len(causal.hear(first[BLOCK_SAMPLES + LOOK_AHEAD - 1 :][:1])) == BLOCK_FRAMES
    assert LOOK_AHEAD == 432  # 27 ms


def test_memory_does_not_grow():
    causal = CausalMel()
    for _ in range(200):
        causal.hear(made_waveform(640))
    assert len(causal._sound) < 2 * BLOCK_SAMPLES


@pytest.mark.parametrize("gain", [0.05, 0.3, 1.0])
def test_the_running_level_finds_the_clips_own(gain):
    waveform = gain * made_waveform(20 * 16_000)
    causal = heard(waveform, [640])[-150:]
    clip = MelEncoder().encode(waveform, 600)[-len(causal) - 3 :][: len(causal)]
    level = slice(None, 65)
    assert np.abs(causal[:, level].mean() - clip[:, level].mean()) < 0.15  # 3 dB


def test_silence_and_noise_leave_the_level_alone():
    voice, rng = RunningVoice(), np.random.default_rng(0)

    def hops(waveform):
        return analysed(waveform.astype(np.float32), 0, len(waveform) // 160)

    spoken = voice.voice(hops(made_waveform(10 * 16_000)))
    for quiet in (np.zeros(40 * 16_000), 1e-3 * rng.standard_normal(40 * 16_000)):
        after = voice.voice(hops(quiet))
        assert abs(after.level_db - spoken.level_db) < 1.0
    # In a quiet room where nobody has spoken, what there is stays quiet.
    silent = RunningVoice()
    assert silent.voice(hops(1e-3 * rng.standard_normal(16_000))).level_db > 20
