"""Two branches that hear of each other, against the paper's equations."""

import math

import torch
import torch.nn.functional as F

from model.systems.asynfusion.network import BRANCHES, CoSync, FeatureBuffer
from tests.model.systems.asynfusion.made import made_conditions, made_pair, tiny_network


def frames(seed: int) -> torch.Tensor:
    return torch.randn(2, 5, 6, generator=torch.Generator().manual_seed(seed))


def test_cosync_begins_as_no_exchange_and_is_equations_9_and_10():
    module = CoSync(6, 1)
    torch.testing.assert_close(module(frames(1), frames(2)), frames(1))
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


T = torch.tensor([0.2, 0.7]), torch.tensor([0.4, 0.7])


def seed_of(pair):
    return pair[0][:, :8], pair[1][:, :8]


def test_each_branch_hears_the_other():
    network, x_t, other = tiny_network(), made_pair(), made_pair(seed=1)
    asked = {"t": T, "seed": seed_of(made_pair(seed=2)), **made_conditions()}
    plain = network(x_t, **asked)
    for which, mixed in enumerate([(x_t[0], other[1]), (other[0], x_t[1])]):
        assert (network(mixed, **asked)[which] - plain[which]).abs().max() > 1e-5


def test_alone_a_branch_hears_what_the_buffer_holds():
    network, x_t = tiny_network(), made_pair()
    conditions = made_conditions()
    heard = network.speech_tokens(conditions.pop("speech"), conditions.pop("has_speech"))
    asked = {"speech_tokens": heard, "seed": seed_of(x_t), **conditions}
    buffer: FeatureBuffer = {}
    both = network.predict_active(BRANCHES, x_t, T, buffer, **asked)
    for which in BRANCHES:
        torch.testing.assert_close(
            network.predict_active([which], x_t, T, buffer, **asked)[which], both[which]
        )
    for layer in range(2):
        buffer[0, layer] = torch.zeros_like(buffer[0, layer])
    alone = network.predict_active([1], x_t, T, buffer, **asked)
    assert list(alone) == [1] and (alone[1] - both[1]).abs().max() > 1e-4
    assert not buffer[0, 0].any()


def test_a_consistent_network_gives_clean_motion_back():
    network, x = tiny_network(consistent=True), made_pair()
    now = torch.full((2,), 1.0)
    for which, found in enumerate(network(x, (now, now), seed=seed_of(x), **made_conditions())):
        own_seed = torch.tensor([0.0, 1.0])[:, None, None]  # where a seed is held, frames are known
        error = ((found - x[which]) * own_seed).abs()
        assert error.max() < 2e-3
