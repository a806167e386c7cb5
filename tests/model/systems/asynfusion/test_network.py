import pytest
import torch

from model.systems.asynfusion.network import BRANCHES, FeatureBuffer
from tests.model.systems.asynfusion.made import made_conditions, made_pair, tiny_network

T = torch.tensor([0.2, 0.7]), torch.tensor([0.4, 0.7])


def seed_of(pair):
    return pair[0][:, :8], pair[1][:, :8]


@pytest.mark.parametrize(
    ("interaction", "changed"),
    [
        ("cross-attention", (True, True)),
        ("expression-to-gesture", (False, True)),
        ("gesture-to-expression", (True, False)),
        ("none", (False, False)),
    ],
)
def test_a_branch_changes_with_what_it_hears(interaction, changed):
    """Another motion in one branch is heard in the other."""
    network, x_t, other = tiny_network(interaction), made_pair(), made_pair(seed=1)
    asked = {"t": T, "seed": seed_of(made_pair(seed=2)), **made_conditions()}
    plain = network(x_t, **asked)
    for which in BRANCHES:
        mixed = [x_t[0], x_t[1]]
        mixed[1 - which] = other[1 - which]
        found = network((mixed[0], mixed[1]), **asked)
        assert bool((found[which] - plain[which]).abs().max() > 1e-5) == changed[which]


def test_cutting_cosync_changes_both_branches():
    network, x_t = tiny_network(), made_pair()
    asked = {"t": T, "seed": seed_of(x_t), **made_conditions()}
    joined = network(x_t, **asked)
    for branch in network.branches:
        for exchange in branch.exchanges:
            torch.nn.init.zeros_(exchange.mlp[-1].weight)
            torch.nn.init.zeros_(exchange.mlp[-1].bias)
    cut = network(x_t, **asked)
    for which in BRANCHES:
        assert (joined[which] - cut[which]).abs().max() > 1e-4


def test_alone_a_branch_hears_what_the_buffer_holds():
    network, x_t = tiny_network(), made_pair()
    conditions = made_conditions()
    heard = network.hear(conditions.pop("speech"), conditions.pop("has_speech"))
    asked = {"heard": heard, "seed": seed_of(x_t), **conditions}
    buffer: FeatureBuffer = {}
    both = network.evaluate(BRANCHES, x_t, T, buffer, **asked)
    for which in BRANCHES:
        torch.testing.assert_close(
            network.evaluate([which], x_t, T, buffer, **asked)[which], both[which]
        )
    for layer in range(2):
        buffer[0, layer] = torch.zeros_like(buffer[0, layer])
    alone = network.evaluate([1], x_t, T, buffer, **asked)
    assert list(alone) == [1] and (alone[1] - both[1]).abs().max() > 1e-4
    assert not buffer[0, 0].any()


def test_a_sample_does_not_depend_on_the_others():
    network, x_t, conditions = tiny_network(), made_pair(), made_conditions()
    both = network(x_t, T, seed=seed_of(x_t), **conditions)
    first = {name: value[:1] for name, value in conditions.items()}
    one = (x_t[0][:1], x_t[1][:1])
    alone = network(one, (T[0][:1], T[1][:1]), seed=seed_of(one), **first)
    for which in BRANCHES:
        torch.testing.assert_close(alone[which], both[which][:1], atol=1e-4, rtol=1e-4)


def test_where_there_is_no_speech_neither_branch_hears_any():
    network, x_t, conditions = tiny_network(), made_pair(), made_conditions()
    other = conditions | {"speech": conditions["speech"].flip(0)}
    one, another = (
        network(x_t, T, seed=seed_of(x_t), **told | {"has_speech": torch.tensor([True, False])})
        for told in (conditions, other)
    )
    for which in BRANCHES:
        change = (one[which] - another[which]).abs().amax((1, 2))
        assert change[0] > 1e-3 and change[1] == 0


def test_a_consistent_network_gives_clean_motion_back():
    network, x = tiny_network(consistent=True), made_pair()
    now = torch.full((2,), 1.0)
    for which, found in enumerate(network(x, (now, now), seed=seed_of(x), **made_conditions())):
        own_seed = torch.tensor([0.0, 1.0])[:, None, None]  # where a seed is held, frames are known
        error = ((found - x[which]) * own_seed).abs()
        assert error.max() < 2e-3
