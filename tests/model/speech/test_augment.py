"""Other voices and microphones: what was asked for can be measured, and nothing moves in time."""

import numpy as np
import pytest

from model.speech.augment import (
    TELEPHONE_HZ,
    RecordingConditions,
    add_noise,
    add_reverberation,
    apply_gain,
    apply_recording_conditions,
    band_pass,
    impulse_response,
    perturb_speed,
    sample_recording_conditions,
)
from tests.model.made import made_waveform

RATE = 16_000


def level_db(waveform: np.ndarray) -> float:
    return 10 * np.log10(np.mean(np.square(waveform, dtype=float)))


def tone(hz: float, seconds: float = 2.0) -> np.ndarray:
    return np.sin(2 * np.pi * hz * np.arange(round(RATE * seconds)) / RATE).astype(np.float32)


@pytest.mark.parametrize("slope_db", [0.0, -3.0, -6.0])
def test_noise_has_its_level_and_colour(slope_db):
    speech = made_waveform(4 * RATE)
    for snr_db in (0.0, 20.0):
        noise = add_noise(speech, snr_db, slope_db, np.random.default_rng(0)) - speech
        assert level_db(speech) - level_db(noise) == pytest.approx(snr_db, abs=0.05)
        power = np.abs(np.fft.rfft(noise)) ** 2
        frequency = np.fft.rfftfreq(len(noise), 1 / RATE)
        octaves = [power[(frequency >= f) & (frequency < 2 * f)].mean() for f in (100, 400, 1600)]
        for steps in np.diff(10 * np.log10(octaves)):
            assert steps == pytest.approx(2 * slope_db, abs=1.0)  # two octaves apart
    assert not add_noise(np.zeros(RATE, np.float32), 20.0, -3.0, np.random.default_rng(0)).any()


def test_a_room_decays_by_60_db_in_its_time_and_keeps_length_and_time():
    for rt60_s in (0.2, 0.6):
        response = impulse_response(rt60_s, 6.0, np.random.default_rng(0))
        assert response[0] == 1.0 and not response[1:48].any()  # 3 ms
        energy = 10 * np.log10(np.sum(np.square(response[1:], dtype=float)))
        assert energy == pytest.approx(-6.0, abs=0.01)
        left = np.cumsum(np.square(response[::-1]))[::-1]  # Schroeder's backward integral
        rows = np.arange(round(0.01 * RATE), round(0.4 * rt60_s * RATE))
        slope, _ = np.polyfit(rows / RATE, 10 * np.log10(left[rows]), 1)
        assert -60 / slope == pytest.approx(rt60_s, rel=0.06)
    click = np.zeros(RATE, np.float32)
    click[4000] = 1.0
    heard = add_reverberation(click, 0.5, 3.0, np.random.default_rng(0))
    assert heard.shape == click.shape and heard.dtype == np.float32
    assert np.argmax(np.abs(heard)) == 4000 and np.abs(heard[:4000]).max() < 1e-6
    assert level_db(heard[4001:9000]) > -60


def test_gain_is_in_db_and_clips_at_full_scale():
    quiet = 0.1 * tone(440)
    assert level_db(apply_gain(quiet, 6.0)) - level_db(quiet) == pytest.approx(6.0, abs=1e-3)
    assert level_db(apply_gain(quiet, -20.0)) - level_db(quiet) == pytest.approx(-20.0, abs=1e-3)
    assert np.abs(apply_gain(quiet, 40.0)).max() == 1.0


def test_a_telephone_passes_its_band_only():
    for hz, low, high in ((1000, -0.1, 0.1), (100, -200, -60), (7000, -200, -40)):
        change = level_db(band_pass(tone(hz), *TELEPHONE_HZ)[RATE // 2 : -RATE // 2])
        assert low < change - level_db(tone(hz)) < high
    click = np.zeros(RATE, np.float32)
    click[8000] = 1.0
    assert np.argmax(np.abs(band_pass(click, *TELEPHONE_HZ))) == 8000


@pytest.mark.parametrize("speed", [0.9, 1.0, 1.1])
def test_speed_changes_length_and_pitch_alike(speed):
    fast = perturb_speed(tone(500), speed)
    assert len(fast) == np.ceil(2 * RATE / speed)
    peak = np.argmax(np.abs(np.fft.rfft(fast))) * RATE / len(fast)
    assert peak == pytest.approx(500 * speed, abs=1.0)
    if speed == 1.0:
        np.testing.assert_array_equal(fast, tone(500))


def test_conditions_are_applied_together_and_repeat():
    speech = made_waveform(2 * RATE)
    nothing = RecordingConditions(None, 0.0, None, 0.0, None, 0.0)
    np.testing.assert_array_equal(
        apply_recording_conditions(speech, nothing, np.random.default_rng(0)), speech
    )
    everything = RecordingConditions(0.3, 3.0, 20.0, -3.0, TELEPHONE_HZ, -6.0)
    first, again, other = (
        apply_recording_conditions(speech, everything, np.random.default_rng(seed))
        for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 1e-3 and first.shape == speech.shape
    power = np.abs(np.fft.rfft(first)) ** 2  # noise and room come before the microphone's band
    assert power[: 100 * 2].sum() < 1e-4 * power.sum()


def test_draws_cover_clean_and_bad_conditions():
    drawn = [sample_recording_conditions(np.random.default_rng(k)) for k in range(200)]
    assert drawn[0] == sample_recording_conditions(np.random.default_rng(0))
    for part in ("rt60_s", "snr_db", "band_hz"):
        share = np.mean([getattr(each, part) is None for each in drawn])
        assert 0.15 < share < 0.6
    for each in drawn:
        heard = apply_recording_conditions(made_waveform(RATE // 4), each, np.random.default_rng(0))
        assert np.isfinite(heard).all() and np.abs(heard).max() > 1e-3
