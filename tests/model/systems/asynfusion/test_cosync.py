import math

import pytest
import torch
import torch.nn.functional as F

from model.systems.asynfusion.network import Concatenation, CoSync, Gate, make_exchange


def frames(seed: int) -> torch.Tensor:
    return torch.randn(2, 5, 6, generator=torch.Generator().manual_seed(seed))


def test_cosync_is_equations_9_and_10():
    torch.manual_seed(0)
    module = CoSync(6, 1)
    torch.nn.init.normal_(module.mlp[-1].weight)
    own, other = frames(1), frames(2)
    found = module(own, other)
    attention = module.attention
    for sample in range(2):
        key, value = attention.key_value(other[sample]).split(6, dim=-1)
        for frame in range(5):
            query = attention.query(own[sample, frame])
            scores = torch.stack([query @ key[k] / math.sqrt(6) for k in range(5)])
            shares = scores.exp() / scores.exp().sum()
            mixed = attention.out(sum(shares[k] * value[k] for k in range(5)))
            wanted = module.mlp(F.layer_norm(mixed, (6,))) + own[sample, frame]
            torch.testing.assert_close(found[sample, frame], wanted, atol=1e-5, rtol=1e-4)


def test_it_begins_as_no_exchange():
    own = frames(1)
    for module in (CoSync(6, 2), Concatenation(6)):
        torch.testing.assert_close(module(own, frames(2)), own)


def test_a_gate_is_equation_19():
    module, own, other = Gate(6), frames(1), frames(2)
    share = torch.sigmoid(module.gate(torch.cat([own, other], dim=-1)))
    torch.testing.assert_close(module(own, other), share * own + (1 - share) * other)
    torch.testing.assert_close(module(own, own), own)


@pytest.mark.parametrize(
    ("interaction", "hears"),
    [
        ("none", (False, False)),
        ("expression-to-gesture", (False, True)),
        ("gesture-to-expression", (True, False)),
        ("concatenation", (True, True)),
        ("gated", (True, True)),
        ("cross-attention", (True, True)),
    ],
)
def test_each_interaction_leads_where_its_name_says(interaction, hears):
    for which in (0, 1):
        torch.manual_seed(0)
        module = make_exchange(interaction, which, 6, 2)
        for parameter in module.parameters():
            torch.nn.init.normal_(parameter)
        change = module(frames(1), frames(2)) - module(frames(1), frames(3))
        assert bool(change.abs().max() > 1e-3) == hears[which]
