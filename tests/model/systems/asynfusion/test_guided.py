import pytest
import torch

from conventions.joints import FACE as FACE_JOINTS
from model.sampling.flow import SpeechGuide, seeded_noise
from model.systems.asynfusion.network import BRANCHES, EXPRESSION, GESTURE
from model.systems.asynfusion.sampling import WAYS, GuidedNetwork, sample
from tests.model.systems.asynfusion.made import (
    BODY,
    FACE,
    made_conditions,
    made_pair,
    made_streams,
    tiny_network,
)

NORMALISER = made_streams()[GESTURE].normaliser
T = torch.tensor([0.2, 0.7]), torch.tensor([0.4, 0.7])


def guide_of(strength: float) -> SpeechGuide:
    return SpeechGuide(strength, NORMALISER, "axis-angle")


def asked(guide: SpeechGuide) -> dict:
    conditions = made_conditions()
    del conditions["has_speech"]
    seed = made_pair(seed=2)
    network = tiny_network()
    heard = network.hear(guide.twice(conditions.pop("speech")), guide.hears(2))
    return {"heard": heard, "seed": (seed[0][:, :8], seed[1][:, :8]), **conditions}


def noise(which: int, step: int) -> torch.Tensor:
    return torch.stack(
        [seeded_noise([7, k, which, step], (60, (FACE, BODY)[which])) for k in (0, 1)]
    )


@pytest.mark.parametrize("strength", [0.0, 2.5])
def test_speech_moves_the_body_further_and_leaves_jaw_and_face(strength):
    network, x_t, guide = tiny_network(), made_pair(), guide_of(strength)
    seed = made_pair(seed=2)
    told = made_conditions() | {"seed": (seed[0][:, :8], seed[1][:, :8])}
    heard = network(x_t, T, **told)
    deaf = network(x_t, T, **told | {"has_speech": torch.zeros(2, dtype=torch.bool)})
    found = GuidedNetwork(network, guide).evaluate(BRANCHES, x_t, T, {}, **asked(guide))
    torch.testing.assert_close(found[EXPRESSION], heard[EXPRESSION], atol=1e-5, rtol=1e-4)
    body, with_speech, without = (
        NORMALISER.restore(x) for x in (found[GESTURE], heard[GESTURE], deaf[GESTURE])
    )
    wanted = without + strength * (with_speech - without)
    jaw = [3 * joint + k for joint in FACE_JOINTS for k in range(3)]
    wanted[..., jaw] = with_speech[..., jaw]
    torch.testing.assert_close(body, wanted, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("way", ["ddim", "lcm", "lcm-recomputed", "lcm-blend"])
def test_at_1_every_way_of_sampling_is_that_of_the_network_alone(way):
    network = tiny_network()
    conditions = asked(guide_of(1.0))
    alone = sample(network, noise, (2, 4), WAYS[way], **conditions)
    guided = sample(GuidedNetwork(network, guide_of(1.0)), noise, (2, 4), WAYS[way], **conditions)
    for which in BRANCHES:
        assert torch.equal(guided[which], alone[which])


@pytest.mark.parametrize("way", ["ddim", "lcm", "lcm-recomputed"])
def test_with_as_much_speech_as_none_strength_changes_nothing(way):
    """Copies that hear the same are the same all the way, what is stale among them, too."""
    network, guide = tiny_network(), guide_of(3.0)
    conditions = asked(guide)
    conditions["heard"] = conditions["heard"][:2].repeat(2, 1, 1)
    plain = asked(guide_of(1.0))
    alone = sample(network, noise, (2, 4), WAYS[way], **plain)
    guided = sample(GuidedNetwork(network, guide), noise, (2, 4), WAYS[way], **conditions)
    for which in BRANCHES:
        torch.testing.assert_close(guided[which], alone[which], atol=1e-4, rtol=1e-4)
