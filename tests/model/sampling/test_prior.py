"""The linear-Gaussian denoiser against a slow one that conditions one large Gaussian vector."""

import math

import pytest
import torch

from model.sampling.prior import (
    SEED_NOISE_VARIANCE_SHARE,
    GaussianPrior,
    fit_components,
    fit_prior,
    time_grid,
)
from tests.model.made import made_prior

CHANNELS, FRAMES, SEED = 5, 60, 8


@pytest.fixture(scope="module")
def prior() -> GaussianPrior:
    return made_prior(CHANNELS)


def dense_covariance(prior: GaussianPrior) -> torch.Tensor:
    """Of a window laid out as one vector, frame by frame, (T C, T C); float64."""
    full = torch.einsum("cts,cd->tcsd", prior.covariance.double(), torch.eye(CHANNELS).double())
    return full.reshape(FRAMES * CHANNELS, -1)


def dense_posterior(prior, x_t, t, seed) -> tuple[torch.Tensor, torch.Tensor]:
    """Mean (T, C) and covariance of x_1 given x_t and, noisily, the seed."""
    covariance = dense_covariance(prior)
    looks, noise, seen = [t * torch.eye(len(covariance), dtype=torch.float64)], [], []
    noise.append(torch.full((len(covariance),), (1 - t) ** 2, dtype=torch.float64))
    seen.append(x_t.double().flatten())
    if seed is not None:
        looks.append(torch.eye(len(covariance), dtype=torch.float64)[: SEED * CHANNELS])
        noise.append((SEED_NOISE_VARIANCE_SHARE * prior.covariance[:, 0, 0].double()).repeat(SEED))
        seen.append(seed.double().flatten())
    look, observed = torch.cat(looks), torch.cat(seen)
    gain = (
        covariance
        @ look.T
        @ torch.linalg.inv(look @ covariance @ look.T + torch.diag(torch.cat(noise)))
    )
    return (gain @ observed).reshape(FRAMES, CHANNELS), covariance - gain @ look @ covariance


@pytest.mark.parametrize("t", [0.0, 0.03, 0.5, 0.97])
@pytest.mark.parametrize("with_seed", [False, True])
def test_the_posterior_is_that_of_one_large_gaussian(prior, t, with_seed):
    generator = torch.Generator().manual_seed(3)
    x_t = torch.randn(1, FRAMES, CHANNELS, generator=generator)
    seed = torch.randn(1, SEED, CHANNELS, generator=generator) * 0.3
    has_seed, time = torch.tensor([with_seed]), torch.tensor([t])
    expected, covariance = dense_posterior(prior, x_t[0], t, seed[0] if with_seed else None)
    found = prior.posterior_mean(x_t, time, seed, has_seed)[0]
    torch.testing.assert_close(found.double(), expected, atol=2e-3, rtol=2e-3)
    # A unit vector comes back as a deviation: shaping twice is a product with the covariance.
    unit = torch.randn(1, FRAMES, CHANNELS, generator=generator)
    twice = prior.scale_by_posterior(
        prior.scale_by_posterior(unit, time, has_seed), time, has_seed
    )[0]
    wanted = (covariance @ unit[0].double().flatten()).reshape(FRAMES, CHANNELS)
    torch.testing.assert_close(twice.double(), wanted, atol=3e-3, rtol=3e-3)


@pytest.mark.parametrize("with_seed", [False, True])
@pytest.mark.parametrize("heun", [False, True])
def test_without_a_network_any_number_of_steps_gives_the_same_motion(prior, with_seed, heun):
    x_0 = torch.randn(3, FRAMES, CHANNELS, generator=torch.Generator().manual_seed(0))
    seed = 0.3 * torch.randn(3, SEED, CHANNELS, generator=torch.Generator().manual_seed(1))

    def predict(x_t, t):
        return prior.posterior_mean(x_t, torch.full((3,), t), seed, torch.full((3,), with_seed))

    given = seed if with_seed else None
    one, many = (prior.sample(predict, x_0, given, steps=n, heun=heun) for n in (1, 17))
    torch.testing.assert_close(one, many, atol=2e-3, rtol=1e-3)


@pytest.mark.parametrize("with_seed", [False, True])
def test_the_flow_of_the_gaussian_ends_where_many_small_steps_end(prior, with_seed):
    """`flow_to_data` against steps by the midpoint along the posterior's own velocity."""
    generator = torch.Generator().manual_seed(5)
    x = torch.randn(1, FRAMES, CHANNELS, generator=generator)
    seed = torch.randn(1, SEED, CHANNELS, generator=generator) * 0.3
    has_seed = torch.tensor([with_seed])
    start, steps = 0.2, 100
    found = prior.flow_to_data(x, torch.tensor([start]), seed, has_seed)
    walked, length = x, (1 - start) / steps

    def velocity(x_t, t):
        return (prior.posterior_mean(x_t, torch.tensor([t]), seed, has_seed) - x_t) / (1 - t)

    for t in (start + length * k for k in range(steps)):
        middle = walked + length / 2 * velocity(walked, t)
        walked = walked + length * velocity(middle, t + length / 2)
    torch.testing.assert_close(found, walked, atol=0.02, rtol=0.02)
    if not with_seed:
        now = torch.tensor([1.0])
        torch.testing.assert_close(
            prior.flow_to_data(x, now, seed, has_seed), x, atol=1e-3, rtol=1e-3
        )


def test_a_constant_pull_of_the_network_turns_by_the_whole_angle(prior):
    """dz = f d(angle) over a right angle: with f = 1 everywhere z grows by pi / 2."""
    x_0 = torch.zeros(1, FRAMES, CHANNELS)
    ones = prior.from_eigenbasis(torch.ones(CHANNELS, FRAMES, 1), 0)

    def predict(x_t, t):
        time, none = torch.full((1,), t), torch.zeros(1, dtype=torch.bool)
        known = prior.posterior_mean(x_t, time, x_t[:, :SEED], none)
        return known + prior.scale_by_posterior(ones, time, none)

    for steps in (1, 10):
        z = prior.to_eigenbasis(prior.sample(predict, x_0, None, steps=steps), 0)
        wanted = math.pi / 2 * prior.variance[0].sqrt()[..., None]
        large = prior.variance[0, :, :, None] > 1e-4
        torch.testing.assert_close(z[large], wanted[large], rtol=1e-2, atol=1e-3)


def test_fitting_recovers_the_process(prior):
    x_0 = torch.randn(3000, FRAMES, CHANNELS, generator=torch.Generator().manual_seed(0))
    none = torch.zeros(3000, dtype=torch.bool)

    def predict(x_t, t):
        return prior.posterior_mean(x_t, torch.full((3000,), t), x_t[:, :SEED], none)

    drawn = prior.sample(predict, x_0, None, steps=1)
    found = fit_prior(list(drawn.split(1000)), SEED)
    size = prior.covariance[:, :1, :1]
    torch.testing.assert_close(found.covariance / size, prior.covariance / size, rtol=0.0, atol=0.1)


def test_components_are_uncorrelated_in_value_and_in_acceleration():
    """Three sources of different pace, mixed: each component is one of them again."""
    generator = torch.Generator().manual_seed(0)
    time = torch.arange(FRAMES)
    phase = 6.3 * torch.rand(400, 1, 3, generator=generator)
    pace = torch.tensor([0.05, 0.2, 0.8])
    sources = torch.sin(time[:, None] * pace + phase) * 2**0.5
    mixing = torch.randn(3, 3, generator=generator)
    mix, unmix = fit_components(list((sources @ mixing).split(100)))
    torch.testing.assert_close(mix @ unmix, torch.eye(3), atol=1e-5, rtol=0.0)
    gain = (mixing @ mix).abs()  # from sources to components: one of each
    torch.testing.assert_close(gain.amax(0), torch.ones(3), atol=0.1, rtol=0.0)
    assert gain.sort(0).values[1].max() < 0.15
    assert sorted(gain.argmax(0).tolist()) == [0, 1, 2]


def test_steps_are_even_in_the_angle_and_end_at_one():
    assert time_grid(1) == [0.0, 1.0]
    times = time_grid(4)
    assert times[0] == 0 and times[-1] == 1 and times == sorted(times)
    assert times[2] == pytest.approx(1 / (1 + math.sqrt(10)))
    with pytest.raises(ValueError, match="steps is 0"):
        made_prior(2).sample(lambda x, t: x, torch.zeros(1, FRAMES, 2), None, steps=0)


@pytest.mark.parametrize("has_seed", [False, True])
def test_where_all_samples_agree_one_kind_of_eigenvectors_gives_the_same(has_seed):
    prior = made_prior(3)
    x_t, t, seed = torch.randn(4, 60, 3), torch.rand(4), torch.randn(4, 8, 3)
    flags = torch.full((4,), has_seed)
    for call in (
        lambda: prior.posterior_mean(x_t, t, seed, flags),
        lambda: prior.flow_to_data(x_t, t, seed, flags),
        lambda: prior.scale_by_posterior(x_t, t, flags),
    ):
        prior.train()
        both = call()
        prior.eval()
        one = call()
        torch.testing.assert_close(one, both, rtol=1e-5, atol=1e-6)
    mixed = torch.tensor([True, False, True, False])
    assert prior.common_has_seed(mixed) is None and prior.common_has_seed(flags) == int(has_seed)
    same = mixed == has_seed  # those of a batch that mixes both
    both, one = (prior.posterior_mean(x_t, t, seed, each)[same] for each in (mixed, flags))
    torch.testing.assert_close(both, one, rtol=1e-4, atol=1e-5)


def test_channels_that_never_move_and_estimates_that_are_no_covariance_do_no_harm():
    windows = torch.randn(50, FRAMES, 4, generator=torch.Generator().manual_seed(0))
    windows[..., 2] = 0.0
    mix, unmix = fit_components([windows])
    assert mix.isfinite().all() and unmix.isfinite().all()
    wild = torch.eye(FRAMES)[None].clone()
    wild[0, 0, 7] = wild[0, 7, 0] = -3.0  # would give a negative variance
    for prior in (fit_prior([windows @ mix], SEED), GaussianPrior(wild, SEED)):
        assert (prior.variance > 0).all() and prior.variance.isfinite().all()
        assert prior.gain.isfinite().all()
