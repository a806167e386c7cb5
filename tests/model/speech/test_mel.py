import numpy as np

from model.speech.acoustics import mel_filters


def test_a_filter_peaks_at_its_mel_and_has_unit_area():
    filters = mel_filters(16_000, 16_384, 40, 0.0)
    hz_per_bin = 16_000 / 16_384
    np.testing.assert_allclose(filters.sum(1) * hz_per_bin, 1.0, atol=2e-3)
    # 8 kHz are 15 + 27 ln(8) / ln(6.4) = 45.2456 mels, so a filter is 1.10355 mels from the next.
    assert abs(filters[0].argmax() * hz_per_bin - 1.10355 * 200 / 3) < hz_per_bin
