import pytest
import torch

from model.expression import ExpressionNetwork, predict_expressions
from tests.model.made import TINY_EXPRESSION


@pytest.fixture
def network() -> ExpressionNetwork:
    torch.manual_seed(1)
    network = ExpressionNetwork(TINY_EXPRESSION).eval()
    torch.nn.init.normal_(network.out.weight, std=0.05)
    torch.nn.init.constant_(network.out.bias, 0.5)
    return network


@pytest.mark.parametrize("num_frames", [1, 29, 30, 31, 59, 60, 61, 90, 91, 200])
def test_every_length_comes_back_whole(network, num_frames):
    speech = torch.randn(num_frames, 68)
    units = predict_expressions(network, speech, speaker=1)
    assert units.shape == (num_frames, 52)
    assert torch.isfinite(units).all() and units.min() >= 0 and units.max() <= 1


def test_blend_weights_add_up_to_one():
    network = ExpressionNetwork(TINY_EXPRESSION).eval()  # its output layer starts at zero
    torch.nn.init.constant_(network.out.bias, 0.25)
    units = predict_expressions(network, torch.randn(133, 68), speaker=0)
    torch.testing.assert_close(units, torch.full((133, 52), 0.25))


def test_no_jump_where_windows_meet(network):
    time = torch.arange(300)[:, None] / 30
    speech = torch.sin(time * torch.linspace(0.2, 1.0, 68))
    steps = predict_expressions(network, speech, speaker=1).diff(dim=0).abs().amax(1)
    joins = steps[29::30]
    assert joins.max() < 4 * steps.median() + 1e-3


def test_batches_do_not_change_the_result(network):
    speech = torch.randn(400, 68)
    torch.testing.assert_close(
        predict_expressions(network, speech, 1, batch_size=3),
        predict_expressions(network, speech, 1),
        atol=1e-6, rtol=1e-5,
    )  # fmt: skip
