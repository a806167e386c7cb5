import pytest
import torch
from torch import nn

from model.systems.gan import adversary
from model.systems.gan.adversary import (
    NUM_LAYERS,
    Discriminator,
    Watch,
    discriminator_loss,
    gaussian_loss,
    generator_loss,
    gradient_penalty,
)
from model.systems.gan.config import DiscriminatorConfig
from model.training.run_folder import TrainingError
from tests.model.systems.gan.made_generator import TINY, told

SMALL = DiscriminatorConfig(frame_width=16, width=32, groups=4)


def test_gradient_penalty_is_r1_and_can_be_descended():
    """Of w x + x^2 / 2 the slope is w + x: the penalty and its own slope in w are known."""
    torch.manual_seed(0)
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


def test_discriminator_has_seven_layers_of_linear_selu_groupnorm():
    network = Discriminator(SMALL, TINY)
    layers = [network.frame, *network.window]
    assert len(layers) + 1 == NUM_LAYERS == 7
    for layer in layers:
        assert [type(part) for part in layer] == [nn.Linear, nn.SELU, nn.GroupNorm]
    assert network.score.out_features == 1


def test_scores_belong_to_their_windows_and_hear_everything():
    torch.manual_seed(0)
    network = Discriminator(SMALL, TINY)
    x_before, x_now = torch.randn(2, 3, 60, TINY.channels)
    before, now = torch.tensor([0.0, 0.2, 0.8]), torch.tensor([0.2, 0.4, 1.0])
    known = told(TINY, 3)
    scores = network(x_before, x_now, before, now, **known)
    assert scores.shape == (3,)
    alone = network(x_before[1:2], x_now[1:2], before[1:2], now[1:2],
                    **{name: value[1:2] for name, value in known.items()})  # fmt: skip
    torch.testing.assert_close(alone, scores[1:2], rtol=1e-4, atol=1e-5)

    def moved(**changes) -> torch.Tensor:
        given = {"x_before": x_before, "x_now": x_now, "before": before, "now": now, **known}
        return (network(**{**given, **changes}) - scores).abs() > 1e-6

    assert moved(x_before=x_now).all() and moved(x_now=x_before).all()
    assert moved(before=before + 0.1).all() and moved(now=now - 0.1).all()
    assert moved(speech=known["speech"].flip(1)).all() and moved(speaker=known["speaker"] + 1).all()
    assert moved(seed=-known["seed"]).tolist() == known["has_seed"].tolist()
    deaf = {"has_speech": torch.zeros(3, dtype=torch.bool)}
    unheard = network(x_before, x_now, before, now, **known | deaf)
    noise = torch.randn_like(known["speech"])
    assert torch.equal(
        network(x_before, x_now, before, now, **known | deaf | {"speech": noise}), unheard
    )


def test_groups_must_fit():
    with pytest.raises(ValueError, match="width is 60, no multiple of 8 groups"):
        DiscriminatorConfig(width=60)


def seen(watch: Watch, steps: int, **changes: float) -> None:
    numbers = {"accuracy_real": 0.7, "accuracy_fake": 0.7, "liveliness": 0.9, **changes}
    for step in range(steps):
        watch.see(numbers, step)


def test_a_discriminator_that_tells_everything_apart_stops_the_training():
    watch = Watch()
    seen(watch, 3000)
    seen(watch, adversary.PATIENCE - 1, accuracy_real=1.0, accuracy_fake=1.0)
    seen(watch, 50)  # one bad spell is none
    with pytest.raises(TrainingError, match=r"told more than 99.5% of generated steps"):
        seen(watch, 2 * adversary.PATIENCE, accuracy_real=1.0, accuracy_fake=1.0)


def test_a_discriminator_that_calls_everything_fake_is_no_collapse():
    seen(Watch(), 3000, accuracy_real=0.0, accuracy_fake=1.0)


def test_one_motion_for_everything_stops_the_training():
    with pytest.raises(TrainingError, match="spread less than 5% of recorded motion"):
        seen(Watch(), 2 * adversary.PATIENCE, liveliness=0.01)
