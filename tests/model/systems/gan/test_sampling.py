"""Steps of the chain and of solvers against tables, Bayes' rule and exact denoisers."""

import numpy as np
import pytest
import torch

from model.systems.gan.sampling import (
    BETA_MAX,
    BETA_MIN,
    diffused,
    flow_time,
    posterior,
    signal_and_noise,
    stepped,
    times,
)
from tests.model.made import made_prior


def tables(steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Betas of the steps, and the products of their complements, one after the other (float64)."""

    def log_signal(t: float) -> float:
        return -0.25 * t**2 * (BETA_MAX - BETA_MIN) - 0.5 * t * BETA_MIN

    squares = [np.exp(2 * log_signal(k / steps)) for k in range(steps + 1)]
    betas = np.array([1 - squares[k + 1] / squares[k] for k in range(steps)])
    products = []
    for beta in betas:
        products.append((products[-1] if products else 1.0) * (1 - beta))
    return betas, np.array([1.0, *products])


@pytest.mark.parametrize("steps", [1, 5, 20, 50])
def test_posterior_is_that_of_the_discrete_chain(steps):
    """Ho et al. (2020), eqs. 6 and 7, on the tables of denoising diffusion GANs."""
    betas, kept = tables(steps)
    torch.manual_seed(0)
    x_now, x_0 = torch.randn(2, steps, 3, 4)
    k = torch.arange(1, steps + 1)
    mean, deviation = posterior(x_now, x_0, (k - 1) / steps, k / steps)
    for n in range(steps):
        left = 1 - kept[n + 1]
        share_0 = np.sqrt(kept[n]) * betas[n] / left
        share_now = np.sqrt(1 - betas[n]) * (1 - kept[n]) / left
        expected = share_0 * x_0[n].double() + share_now * x_now[n].double()
        torch.testing.assert_close(mean[n].double(), expected, rtol=1e-4, atol=1e-5)
        variance = (1 - kept[n]) / left * betas[n]
        assert float(deviation[n]) == pytest.approx(np.sqrt(variance), rel=1e-4, abs=1e-6)


def test_two_ways_of_diffusing_agree():
    t = torch.tensor([0.2, 0.5, 1.0])
    one, zero = torch.ones(3, 1, 1), torch.zeros(3, 1, 1)
    signal, noise = signal_and_noise(t)
    torch.testing.assert_close(signal**2 + noise**2, torch.ones(3))
    direct = diffused(one, zero, 0 * t, t)
    torch.testing.assert_close(direct[:, 0, 0], signal)
    over = diffused(diffused(one, zero, 0 * t, t / 3), zero, t / 3, t)
    torch.testing.assert_close(over, direct)
    assert noise[2] > 0.9999 and 1 - signal_and_noise(torch.tensor(0.02))[0] < 0.01


def test_the_last_step_leaves_x_0():
    x_now, x_0 = torch.randn(2, 4, 3, 2)
    mean, deviation = posterior(x_now, x_0, torch.zeros(4), torch.full((4,), 0.05))
    torch.testing.assert_close(mean, x_0)
    assert not deviation.any()
    assert times(5) == pytest.approx([1.0, 0.8, 0.6, 0.4, 0.2, 0.0])
    with pytest.raises(ValueError, match="steps is 0; at least 1 is needed"):
        times(0)


def test_the_priors_posterior_holds_at_the_flow_time():
    """x_0 given x_t of a Gaussian process, by solving for it in float64."""
    prior = made_prior(3)
    t = torch.tensor([0.1, 0.4, 1.0])
    signal, noise = (factor.double() for factor in signal_and_noise(t))
    x_t = torch.randn(3, 60, 3)
    tau, scale = flow_time(t)
    nothing = torch.zeros(3, 8, 3), torch.zeros(3, dtype=torch.bool)
    found = prior.posterior(x_t / scale[:, None, None], tau, *nothing)
    full = prior.covariance.double()
    for b in range(3):
        for c in range(3):
            total = signal[b] ** 2 * full[c] + noise[b] ** 2 * torch.eye(60)
            wanted = signal[b] * full[c] @ torch.linalg.solve(total, x_t[b, :, c].double())
            torch.testing.assert_close(found[b, :, c].double(), wanted, rtol=1e-3, atol=2e-4)


MEAN, DEVIATION = 0.7, 0.3


@pytest.mark.parametrize(("steps", "left"), [(50, 0.2), (400, 0.03)])
def test_steps_of_ddim_go_where_the_ode_of_gaussian_data_goes(steps, left):
    x = torch.randn(1, 5, 6, dtype=torch.float64)
    way = times(steps)
    signal, noise = signal_and_noise(torch.tensor(way, dtype=torch.float64))
    wanted = MEAN + DEVIATION * (x - signal[0] * MEAN) / torch.hypot(signal * DEVIATION, noise)[0]
    for k in range(steps):
        gain = signal[k] * DEVIATION**2 / (signal[k] ** 2 * DEVIATION**2 + noise[k] ** 2)
        x_0 = MEAN + gain * (x - signal[k] * MEAN)  # E[x_0 | x]
        x = stepped(x, x_0, way[k + 1], way[k])
    assert (x - wanted).abs().max() < left
    torch.testing.assert_close(x, x_0)
