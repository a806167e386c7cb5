"""The generator on its Gaussian prior, the discriminator, and what they descend."""

import numpy as np
import pytest
import torch

from model.systems.gan.config import DiscriminatorConfig
from model.systems.gan.network import (
    BETA_MAX,
    BETA_MIN,
    FINGERS,
    Discriminator,
    Generator,
    ddim_step,
    diffuse,
    diffusion_factors,
    diffusion_times,
    flow_time_and_scale,
    posterior,
)
from model.systems.gan.task import (
    discriminator_loss,
    gaussian_loss,
    generator_loss,
    gradient_penalty,
)
from tests.model.made import made_components, made_prior, shaken
from tests.model.systems.gan.made_generator import TINY, made_generator, told


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
    signal, noise = diffusion_factors(t)
    torch.testing.assert_close(signal**2 + noise**2, torch.ones(3))
    direct = diffuse(one, zero, 0 * t, t)
    torch.testing.assert_close(direct[:, 0, 0], signal)
    over = diffuse(diffuse(one, zero, 0 * t, t / 3), zero, t / 3, t)
    torch.testing.assert_close(over, direct)
    assert noise[2] > 0.9999 and 1 - diffusion_factors(torch.tensor(0.02))[0] < 0.01


def test_the_last_step_leaves_x_0():
    x_now, x_0 = torch.randn(2, 4, 3, 2)
    mean, deviation = posterior(x_now, x_0, torch.zeros(4), torch.full((4,), 0.05))
    torch.testing.assert_close(mean, x_0)
    assert not deviation.any()
    assert diffusion_times(5) == pytest.approx([1.0, 0.8, 0.6, 0.4, 0.2, 0.0])
    with pytest.raises(ValueError, match="steps must be at least 1; got 0"):
        diffusion_times(0)


def test_the_priors_posterior_holds_at_the_flow_time():
    """x_0 given x_t of a Gaussian process, by solving for it in float64."""
    prior = made_prior(3)
    t = torch.tensor([0.1, 0.4, 1.0])
    signal, noise = (factor.double() for factor in diffusion_factors(t))
    x_t = torch.randn(3, 60, 3)
    tau, scale = flow_time_and_scale(t)
    nothing = torch.zeros(3, 8, 3), torch.zeros(3, dtype=torch.bool)
    found = prior.posterior_mean(x_t / scale[:, None, None], tau, *nothing)
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
    way = diffusion_times(steps)
    signal, noise = diffusion_factors(torch.tensor(way, dtype=torch.float64))
    wanted = MEAN + DEVIATION * (x - signal[0] * MEAN) / torch.hypot(signal * DEVIATION, noise)[0]
    for k in range(steps):
        gain = signal[k] * DEVIATION**2 / (signal[k] ** 2 * DEVIATION**2 + noise[k] ** 2)
        x_0 = MEAN + gain * (x - signal[k] * MEAN)  # E[x_0 | x]
        x = ddim_step(x, x_0, way[k + 1], way[k])
    assert (x - wanted).abs().max() < left
    torch.testing.assert_close(x, x_0)


def sampled(generator: Generator, steps: int, size: int, **changes: torch.Tensor) -> torch.Tensor:
    config = generator.config
    known = told(config, size, has_seed=torch.zeros(size, dtype=torch.bool)) | changes
    known["expression"] = torch.zeros(size, 60, config.expression_dim)
    x = torch.randn(size, 60, config.channels)
    way = [torch.full((size,), t) for t in diffusion_times(steps)]
    for k in range(steps):
        mean, deviation = generator(x, way[k], way[k + 1], **known)
        x_0 = generator.sample_x_0(mean, deviation, torch.randn_like(x), known["has_seed"])
        mean, deviation = posterior(x, x_0, way[k + 1], way[k])
        x = mean + deviation * torch.randn_like(x)
    return x


@pytest.mark.parametrize("steps", [1, 5])
def test_untrained_it_draws_the_gaussian_process_in_any_number_of_steps(steps):
    generator = made_generator().eval()
    with torch.no_grad():
        x = sampled(generator, steps, 200)
    found = torch.einsum("nic,njc->cij", x, x) / len(x)
    wanted = generator.prior.covariance
    scale = wanted.diagonal(dim1=1, dim2=2).mean(1)[:, None, None]
    assert ((found - wanted) / scale).mean(0).abs().max() < 0.05
    bends = x.diff(n=2, dim=1).var(dim=(0, 1))
    curve = torch.zeros(58, 60)
    for k in range(58):
        curve[k, k : k + 3] = torch.tensor([1.0, -2.0, 1.0])
    expected = (curve @ wanted @ curve.T).diagonal(dim1=1, dim2=2).mean(1)
    torch.testing.assert_close(bends, expected, rtol=0.1, atol=0.0)


def test_it_continues_its_seed_in_any_number_of_steps():
    generator = made_generator().eval()
    process = torch.linalg.cholesky(generator.prior.covariance + 1e-5 * torch.eye(60))
    seed = (process @ torch.randn(TINY.channels, 60, 64)).permute(2, 1, 0)[:, :8]
    for steps in (1, 5):
        with torch.no_grad():
            x = sampled(generator, steps, 64, seed=seed, has_seed=torch.ones(64).bool())
        error = (x[:, :8] - seed).square().mean() / seed.square().mean()
        assert error < 0.01
        jump = (x[:, 8] - x[:, 7]).square().mean().sqrt()
        assert jump < 1.5 * x[:, 8:].diff(dim=1).square().mean().sqrt()


def test_each_branch_sees_its_region_and_the_balance_mixes_them():
    generator = shaken(made_generator())
    rest = generator.regions[1]
    assert len(FINGERS) == 90 and sorted(FINGERS + rest) == list(range(168))
    seen = []
    for branch in generator.branches:
        branch.register_forward_pre_hook(lambda module, args: seen.append(args[0]))
    x_t, half = torch.randn(2, 60, 168), torch.full((2,), 0.5)
    face = torch.rand(2, 60, 52)
    inputs = {"expression": face, **told(TINY, 2)}
    mean, deviation = generator(x_t, half, half / 2, **inputs)
    in_channels = x_t @ generator.unmix
    torch.testing.assert_close(seen[0], in_channels[..., FINGERS])
    torch.testing.assert_close(seen[1], in_channels[..., rest])
    assert mean.shape == (2, 60, 168) and (deviation > 0).all()
    with torch.no_grad():
        generator.balance.fill_(40.0)
        fingers, _ = generator(x_t, half, half / 2, **inputs)
        generator.balance.fill_(-40.0)
        others, _ = generator(x_t, half, half / 2, **inputs)
        generator.balance.fill_(0.0)
        both, _ = generator(x_t, half, half / 2, **inputs)
    assert (fingers - others).abs().max() > 1e-3
    torch.testing.assert_close(both, (fingers + others) / 2, rtol=1e-3, atol=1e-4)


def test_the_balance_begins_with_the_fingers_part_of_each_component():
    normaliser = made_components(torch.zeros(168), 0.1)  # components are channels in reverse
    balance = Generator(TINY, made_prior(168), normaliser).balance.sigmoid()
    of_fingers = torch.zeros(168).bool()
    of_fingers[[167 - channel for channel in FINGERS]] = True
    torch.testing.assert_close(balance[of_fingers], torch.full((90,), 0.95))
    torch.testing.assert_close(balance[~of_fingers], torch.full((78,), 0.05))


def test_windows_with_and_without_a_seed_share_a_batch():
    """Alone each turns to the eigenvectors of its kind; in a batch, and in training, to both."""
    generator = shaken(made_generator())
    now = torch.tensor([1.0, 0.4, 0.1])
    x_t, face = torch.randn(3, 60, 168), torch.rand(3, 60, 52)
    known = {"expression": face, **told(TINY, 3)}
    mean, deviation = generator(x_t, now, now / 2, **known)
    for b in range(3):
        one = {name: value[b : b + 1] for name, value in known.items()}
        alone, spread = generator(x_t[b : b + 1], now[b : b + 1], now[b : b + 1] / 2, **one)
        torch.testing.assert_close(alone[0], mean[b], rtol=1e-4, atol=1e-4)
        torch.testing.assert_close(spread[..., 0], deviation[..., b], rtol=1e-4, atol=1e-6)
    trained, _ = generator.train()(x_t, now, now / 2, **known)
    torch.testing.assert_close(trained, mean, rtol=1e-4, atol=1e-4)
    tau = now / 2
    mine = generator.posterior_mean(x_t, tau, known["seed"], known["has_seed"])
    wanted = generator.prior.posterior_mean(x_t, tau, known["seed"], known["has_seed"])
    torch.testing.assert_close(mine, wanted, rtol=1e-4, atol=1e-4)


SMALL = DiscriminatorConfig(frame_width=16, width=32, groups=4)


def test_gradient_penalty_is_r1_and_can_be_descended():
    """Of w x + x^2 / 2 the slope is w + x: the penalty and its own slope in w are known."""
    w = torch.randn(3, 2, requires_grad=True)
    x = torch.randn(4, 3, 2, requires_grad=True)
    penalty = gradient_penalty((w * x + x.square() / 2).sum((1, 2)), x)
    torch.testing.assert_close(penalty, (w + x).square().sum((1, 2)) / 2)
    (slope,) = torch.autograd.grad(penalty.sum(), w)
    torch.testing.assert_close(slope, (w + x).sum(0))


def test_losses_are_logistic_and_the_generators_does_not_saturate():
    scores = torch.tensor([-20.0, 0.0, 20.0])
    found = discriminator_loss(scores, torch.zeros(3))
    torch.testing.assert_close(
        found - torch.log(torch.tensor(2.0)), torch.tensor([20.0, 0.6931472, 0.0])
    )
    caught = torch.tensor([-20.0], requires_grad=True)
    generator_loss(caught).sum().backward()
    assert caught.grad is not None and float(caught.grad) == pytest.approx(-1)


def test_the_best_deviation_is_that_of_the_errors():
    errors = 0.3 * torch.randn(20_000, generator=torch.Generator().manual_seed(0))
    sizes = torch.linspace(0.2, 0.4, 41)
    found = [float(gaussian_loss(errors, size.expand_as(errors))) for size in sizes]
    assert float(sizes[found.index(min(found))]) == pytest.approx(0.3, abs=0.011)


def test_scores_belong_to_their_windows_and_hear_everything():
    network = Discriminator(SMALL, TINY)
    x_s, x_t = torch.randn(2, 3, 60, TINY.channels)
    s, t = torch.tensor([0.0, 0.2, 0.8]), torch.tensor([0.2, 0.4, 1.0])
    known = told(TINY, 3)
    scores = network(x_s, x_t, s, t, **known)
    assert scores.shape == (3,)
    alone = network(x_s[1:2], x_t[1:2], s[1:2], t[1:2],
                    **{name: value[1:2] for name, value in known.items()})  # fmt: skip
    torch.testing.assert_close(alone, scores[1:2], rtol=1e-4, atol=1e-5)

    def moved(**changes) -> torch.Tensor:
        given = {"x_s": x_s, "x_t": x_t, "s": s, "t": t, **known}
        return (network(**{**given, **changes}) - scores).abs() > 1e-6

    assert moved(x_s=x_t).all() and moved(x_t=x_s).all()
    assert moved(s=s + 0.1).all() and moved(t=t - 0.1).all()
    assert moved(speech=known["speech"].flip(1)).all() and moved(speaker=known["speaker"] + 1).all()
    assert moved(seed=-known["seed"]).tolist() == known["has_seed"].tolist()
    deaf = {"has_speech": torch.zeros(3, dtype=torch.bool)}
    unheard = network(x_s, x_t, s, t, **known | deaf)
    noise = torch.randn_like(known["speech"])
    assert torch.equal(network(x_s, x_t, s, t, **known | deaf | {"speech": noise}), unheard)
