"""Bodies that are led home."""

import torch

from model.systems.globaldiff.system import led_home

HOME_S = 40.0


def test_a_body_is_led_back_by_its_share_of_the_way_and_only_sideways():
    vectors = torch.randn(2, 60, 168)
    home = led_home(vectors, 8, HOME_S)
    torch.testing.assert_close(home[:, :8], vectors[:, :8])
    torch.testing.assert_close(home[..., :-3], vectors[..., :-3])
    torch.testing.assert_close(home[..., -2], vectors[..., -2])  # its height
    away = vectors[:, 7][:, [-3, -1]]
    led = (vectors - home)[..., [-3, -1]]
    torch.testing.assert_close(led[:, -1], away * 52 / 30 / HOME_S, rtol=2e-3, atol=1e-5)
    assert (led.diff(dim=1).sign()[:, 8:] == away.sign()[:, None]).all()
    assert led[:, 8].abs().max() < 1e-4 * away.abs().max()  # it begins and ends without a jerk
    assert (led[:, -1] - led[:, -2]).abs().max() < 1e-4 * away.abs().max()


def test_a_body_far_from_home_comes_back_in_windows_that_follow_on_one_another():
    place = torch.tensor([0.8, -0.6])
    for _ in range(round(2 * HOME_S * 30 / 52)):  # two minutes
        window = torch.zeros(1, 60, 168)
        window[..., [-3, -1]] = place
        place = led_home(window, 8, HOME_S)[0, -1, [-3, -1]]
    assert 0.1 < place.norm() < 0.15  # of 1 m, nearly 1 / e squared
