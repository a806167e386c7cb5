from dataclasses import replace

import pytest
import torch

from model.networks.layers import RecurrentBlock
from model.systems.gan.config import STEP_COUNTS
from model.systems.gan.generator import FINGERS, Generator
from model.systems.gan.sampling import posterior, signal_and_noise, times
from tests.model.made import made_components, made_prior, shaken
from tests.model.systems.gan.made_generator import TINY, made_generator, told

FEW = replace(TINY, channels=3, decoupled=False)


def sampled(generator: Generator, steps: int, size: int, **changes: torch.Tensor) -> torch.Tensor:
    config = generator.config
    known = told(config, size, has_seed=torch.zeros(size, dtype=torch.bool)) | changes
    known["expression"] = torch.zeros(size, 60, config.expression_dim)
    x = torch.randn(size, 60, config.channels)
    way = [torch.full((size,), t) for t in times(steps)]
    for k in range(steps):
        mean, deviation = generator(x, way[k], way[k + 1], **known)
        x_0 = generator.drawn(mean, deviation, torch.randn_like(x), known["has_seed"])
        mean, deviation = posterior(x, x_0, way[k + 1], way[k])
        x = mean + deviation * torch.randn_like(x)
    return x


@pytest.mark.parametrize("steps", [1, 5, 20])
def test_untrained_it_draws_the_gaussian_process_in_any_number_of_steps(steps):
    torch.manual_seed(0)
    generator = made_generator(FEW).eval()
    with torch.no_grad():
        x = sampled(generator, steps, 600)
    found = torch.einsum("nic,njc->cij", x, x) / len(x)
    wanted = generator.prior.covariance
    scale = wanted.diagonal(dim1=1, dim2=2).mean(1)[:, None, None]
    assert ((found - wanted) / scale).abs().max() < 0.3
    bends = x.diff(n=2, dim=1).var(dim=(0, 1))
    curve = torch.zeros(58, 60)
    for k in range(58):
        curve[k, k : k + 3] = torch.tensor([1.0, -2.0, 1.0])
    expected = (curve @ wanted @ curve.T).diagonal(dim1=1, dim2=2).mean(1)
    torch.testing.assert_close(bends, expected, rtol=0.1, atol=0.0)


def test_without_a_latent_few_steps_lose_most_of_the_spread():
    torch.manual_seed(0)
    generator = made_generator(replace(FEW, latent=False)).eval()
    with torch.no_grad():
        spread = [float(sampled(generator, steps, 100).std()) for steps in (1, 5, 50)]
    assert spread[0] < 0.2 * spread[1] and spread[1] < 0.95 * spread[2]


def test_it_continues_its_seed_in_every_number_of_steps():
    torch.manual_seed(0)
    generator = made_generator(FEW).eval()
    process = torch.linalg.cholesky(generator.prior.covariance + 1e-5 * torch.eye(60))
    seed = (process @ torch.randn(3, 60, 64)).permute(2, 1, 0)[:, :8]
    for steps in STEP_COUNTS:
        with torch.no_grad():
            x = sampled(generator, steps, 64, seed=seed, has_seed=torch.ones(64).bool())
        error = (x[:, :8] - seed).square().mean() / seed.square().mean()
        assert error < 0.01
        jump = (x[:, 8] - x[:, 7]).square().mean().sqrt()
        assert jump < 1.5 * x[:, 8:].diff(dim=1).square().mean().sqrt()


def test_each_branch_sees_its_region_and_the_balance_mixes_them():
    torch.manual_seed(0)
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


def test_one_branch_serves_all_where_nothing_is_decoupled():
    generator = made_generator(replace(TINY, decoupled=False))
    assert len(generator.branches) == 1 and not hasattr(generator, "balance")


def test_gradients_reach_every_weight():
    torch.manual_seed(0)
    generator = shaken(made_generator())
    now = torch.tensor([1.0, 0.3, 0.6, 0.05])
    known = told(TINY, 4, has_speech=torch.tensor([True, True, False, True]))
    mean, deviation = generator(
        torch.randn(4, 60, 168), now, now / 2, expression=torch.rand(4, 60, 52), **known
    )
    (mean.square().sum() + deviation.log().sum()).backward()
    for name, parameter in generator.named_parameters():
        assert parameter.grad is not None and parameter.grad.abs().sum() > 0, name


def test_deviations_are_the_priors_before_training():
    generator = made_generator(FEW)
    now = torch.tensor([0.4, 0.4])
    known = told(FEW, 2, has_seed=torch.tensor([True, False]))
    _, deviation = generator(
        torch.randn(2, 60, 3), now, now / 2, expression=torch.zeros(2, 60, 52), **known
    )
    signal, noise = (float(factor) for factor in signal_and_noise(now[0]))
    for b, which in ((0, 1), (1, 0)):
        variance = generator.prior.variance[which].double()
        wanted = (1 / (1 / variance + signal**2 / noise**2)).sqrt()
        torch.testing.assert_close(deviation[..., b].double(), wanted, rtol=1e-3, atol=1e-6)


def test_windows_with_and_without_a_seed_share_a_batch():
    """Alone each turns to the eigenvectors of its kind; in a batch, and in training, to both."""
    torch.manual_seed(0)
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
    mine = generator.posterior(x_t, tau, known["seed"], known["has_seed"])
    wanted = generator.prior.posterior(x_t, tau, known["seed"], known["has_seed"])
    torch.testing.assert_close(mine, wanted, rtol=1e-4, atol=1e-4)


def test_of_speech_it_may_hear_the_cepstrum_alone():
    torch.manual_seed(0)
    config = replace(TINY, cepstra=13)
    generator = shaken(made_generator(config))
    assert generator.speech.frames[0].in_features == 13
    half, x_t = torch.full((2,), 0.5), torch.randn(2, 60, 168)
    inputs = {"expression": torch.zeros(2, 60, 52), **told(config, 2)}
    heard = generator(x_t, half, half / 2, **inputs)[0]
    speech = inputs["speech"].clone()
    speech[..., 64:] += 1.0  # energy, onsets and pitch are not among the log-mels
    same = generator(x_t, half, half / 2, **{**inputs, "speech": speech})[0]
    torch.testing.assert_close(same, heard, atol=0.0, rtol=0.0)
    speech[..., :8] += 1.0
    other = generator(x_t, half, half / 2, **{**inputs, "speech": speech})[0]
    assert (other - heard).abs().max() > 1e-3


def test_recurrent_blocks_hear_the_seed_and_both_directions():
    torch.manual_seed(0)
    block = RecurrentBlock(16, 2)
    x, seed, condition = torch.randn(1, 10, 16), torch.randn(1, 3, 16), torch.randn(1, 16)
    kept = block(x, seed, condition)
    for frame in (0, -1):
        moved = x.clone()
        moved[:, frame, 0] += 1.0
        assert (block(moved, seed, condition) - kept).abs().amax(2).min() > 0
    assert (block(x, seed + 1.0, condition) - kept).abs().amax(2).min() > 0
    generator = shaken(made_generator(replace(TINY, frames_by="gru")))
    assert not any("attention" in name for name, _ in generator.named_parameters())
