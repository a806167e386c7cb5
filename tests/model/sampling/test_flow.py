import math

import pytest
import torch

from model.sampling.flow import interpolate, sample, time_weight
from model.sampling.samplers import FLOW_SAMPLERS


def test_path_starts_in_noise_and_ends_in_data():
    x_0, x_1 = torch.randn(3, 5, 2), torch.randn(3, 5, 2)
    torch.testing.assert_close(interpolate(x_0, x_1, torch.zeros(3)), x_0)
    torch.testing.assert_close(interpolate(x_0, x_1, torch.ones(3)), x_1)
    x_t = interpolate(x_0, x_1, torch.tensor([0.25, 0.5, 0.75]))
    torch.testing.assert_close(x_t[0], 0.75 * x_0[0] + 0.25 * x_1[0])


@pytest.mark.parametrize("sampler", FLOW_SAMPLERS)
@pytest.mark.parametrize("steps", [1, 2, 7])
def test_every_sampler_ends_on_a_known_target(sampler, steps):
    target = torch.randn(2, 4)
    calls = []

    def predict(x, t):
        calls.append(t)
        assert 0 <= t < 1
        return target

    end = sample(predict, torch.randn(2, 4), steps=steps, sampler=sampler)
    torch.testing.assert_close(end, target)
    evaluations = {"euler": steps, "heun": 2 * steps - 1, "reinterpolate": 2 * steps}
    assert len(calls) == evaluations[sampler]


def _gaussian_error(sampler: str, steps: int) -> float:
    """End error for data N(2, 0.5^2), whose best x_1 prediction and exact flow are known.

    x_t ~ N(2t, s_t^2) with s_t^2 = (1-t)^2 + (0.5 t)^2, so E[x_1 | x_t] = 2 + 0.25 t / s_t^2
    (x_t - 2t), and the flow carries x_0 to 2 + 0.5 x_0.
    """
    x_0 = torch.linspace(-2, 2, 9, dtype=torch.float64)[None]

    def predict(x, t):
        return 2 + 0.25 * t / ((1 - t) ** 2 + 0.25 * t**2) * (x - 2 * t)

    return float((sample(predict, x_0, steps=steps, sampler=sampler) - (2 + 0.5 * x_0)).abs().max())


def test_euler_is_of_first_and_heun_of_higher_order():
    euler = [_gaussian_error("euler", n) for n in (20, 40, 80)]
    heun = [_gaussian_error("heun", n) for n in (20, 40, 80)]
    assert 1.7 < euler[0] / euler[1] < 2.4 and 1.7 < euler[1] / euler[2] < 2.4
    assert heun[0] / heun[1] > 3 and heun[1] / heun[2] > 3
    assert heun[2] < euler[2] / 10


def test_reinterpolation_is_no_solver_of_the_same_flow():
    assert _gaussian_error("reinterpolate", 80) > 10 * _gaussian_error("euler", 80)


def test_reinterpolation_keeps_the_noise_and_asks_at_step_middles():
    x_0 = torch.randn(1, 3)
    seen = []

    def predict(x, t):
        seen.append((t, x.clone()))
        return torch.full((1, 3), 5.0)

    sample(predict, x_0, steps=2, sampler="reinterpolate")
    assert [t for t, _ in seen] == [0.0, 0.25, 0.5, 0.75]
    for t, x in seen:
        torch.testing.assert_close(x, (1 - t) * x_0 + t * 5.0)


def test_steps_below_one_are_refused():
    with pytest.raises(ValueError, match="steps is 0"):
        sample(lambda x, t: x, torch.zeros(1, 1), steps=0)


def test_time_weight_has_mean_one_and_rises():
    t = (torch.arange(1000, dtype=torch.float64) + 0.5) / 1000
    weight = time_weight(t, 0.1)
    assert math.isclose(float(weight.mean()), 1, abs_tol=1e-4)
    assert (weight.diff() > 0).all()
    torch.testing.assert_close(time_weight(t, None), torch.ones_like(t))
