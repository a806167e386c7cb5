"""Branches that step at their own pace, in DDPM's own numbers and by hand."""

import math
from collections.abc import Sequence

import pytest
import torch

from conventions.joints import FACE as FACE_JOINTS
from model.sampling.flow import ClassifierFreeGuidance, interpolate, seeded_noise
from model.systems.asynfusion.network import (
    BRANCHES,
    EXPRESSION,
    GESTURE,
    DualBranchNetwork,
    FeatureBuffer,
)
from model.systems.asynfusion.system import (
    SAMPLER_NAMES,
    branch_step_indices,
    flow_times,
    noise_from_clean,
    sample,
    trailing_steps,
)
from tests.model.systems.asynfusion.made import (
    BODY,
    FACE,
    made_conditions,
    made_pair,
    made_streams,
    tiny_network,
)


def kept_shares() -> list[float]:
    """The cumulative products of DDPM, step by step."""
    product, found = 1.0, []
    for k in range(1000):
        product *= 1 - (1e-4 + k * (0.02 - 1e-4) / 999)
        found.append(product)
    return found


def test_flow_times_are_those_of_ddpms_linear_betas():
    times = flow_times()
    assert float(times[0]) == pytest.approx(0.990098, abs=1e-5)
    assert float(times[999]) == pytest.approx(0.006313, abs=1e-5)
    assert (times.diff() < 0).all()
    for k, kept in enumerate(kept_shares()):
        signal, noise = math.sqrt(kept), math.sqrt(1 - kept)
        assert float(times[k]) == pytest.approx(signal / (signal + noise), abs=1e-5)


@pytest.mark.parametrize(("step", "earlier"), [(999, 959), (500, 3), (20, 0)])
def test_a_ddim_step_is_that_of_the_variance_preserving_process(step, earlier):
    """Both in float64, so that only the algebra is compared."""
    kept, times = kept_shares(), flow_times().double()
    torch.manual_seed(step)
    x_0, noise, told = torch.randn(3, 2, 5, 4, dtype=torch.float64)
    scale, scale_earlier = (math.sqrt(kept[k]) + math.sqrt(1 - kept[k]) for k in (step, earlier))
    x = math.sqrt(kept[step]) * x_0 + math.sqrt(1 - kept[step]) * noise  # eq. 5
    eps = (x - math.sqrt(kept[step]) * told) / math.sqrt(1 - kept[step])
    wanted = math.sqrt(kept[earlier]) * told + math.sqrt(1 - kept[earlier]) * eps
    t, t_earlier = times[step].expand(2), times[earlier].expand(2)
    x_t = interpolate(noise, x_0, t)
    torch.testing.assert_close(x_t * scale, x, rtol=1e-5, atol=1e-6)
    found = interpolate(noise_from_clean(x_t, told, t), told, t_earlier)
    torch.testing.assert_close(found * scale_earlier, wanted, rtol=1e-4, atol=1e-4)


NORMALISER = made_streams()[GESTURE].normaliser


def guide_of(strength: float) -> ClassifierFreeGuidance:
    return ClassifierFreeGuidance(strength, NORMALISER, "axis-angle")


AS_TRAINED = guide_of(1.0)


def noise(which: int, step: int) -> torch.Tensor:
    return torch.stack(
        [seeded_noise([7, k, which, step], (60, (FACE, BODY)[which])) for k in (0, 1)]
    )


def watched(network: DualBranchNetwork, monkeypatch: pytest.MonkeyPatch) -> list:
    """Which branches are asked at which times, from now on."""
    calls: list[tuple[tuple[int, ...], list[float]]] = []
    predict_active = network.predict_active

    def listed(active: Sequence[int], x_t, t, buffer: FeatureBuffer, **conditions):
        calls.append((tuple(active), [float(time[0]) for time in t]))
        return predict_active(active, x_t, t, buffer, **conditions)

    monkeypatch.setattr(network, "predict_active", listed)
    return calls


@pytest.mark.parametrize("way", SAMPLER_NAMES)
def test_equal_counts_are_the_usual_sampler(way):
    """Both branches together, step by step, without any buffer."""
    network = tiny_network()
    conditions = asked(network) | {"has_seed": torch.tensor([True, True])}
    x = noise(0, 0), noise(1, 0)
    times = [*flow_times()[trailing_steps(5)].tolist(), 1.0]
    for k in range(5):
        t = torch.full((2,), times[k]), torch.full((2,), times[k])
        found = network.predict_active(BRANCHES, x, t, {}, **conditions)
        later = torch.full((2,), times[k + 1])
        kept = [
            noise_from_clean(x[b], found[b], t[b]) if way == "ddim" else noise(b, k + 1)
            for b in BRANCHES
        ]
        x = tuple(interpolate(kept[b], found[b], later) for b in BRANCHES)
    made = sample(network, AS_TRAINED, noise, (5, 5), way, **conditions)
    for which in BRANCHES:
        torch.testing.assert_close(made[which], x[which], atol=1e-5, rtol=1e-4)


def test_the_face_rests_while_the_body_goes_on(monkeypatch):
    network = tiny_network()
    calls = watched(network, monkeypatch)
    sample(network, AS_TRAINED, noise, (2, 4), "lcm", **asked(network))
    face, body = (flow_times()[trailing_steps(count)].tolist() for count in (2, 4))
    assert calls == [
        ((0, 1), [face[0], body[0]]),
        ((1,), [face[1], body[1]]),
        ((0, 1), [face[1], body[2]]),
        ((1,), [1.0, body[3]]),
    ]


def test_what_is_stale_is_the_last_step_of_the_idle_branch():
    """The whole of 1/2 by hand: the body's second step hears the face's only one."""
    network = tiny_network()
    conditions = asked(network)
    times = flow_times()
    start = torch.full((2,), float(times[999]))
    half = torch.full((2,), float(times[499]))
    buffer: FeatureBuffer = {}
    x = noise(0, 0), noise(1, 0)
    first = network.predict_active(BRANCHES, x, (start, start), buffer, **conditions)
    heard = {at: features.clone() for at, features in buffer.items() if at[0] == EXPRESSION}
    assert len(heard) == 2
    body = interpolate(noise(1, 1), first[1], half)
    second = network.predict_active([1], (first[0], body), (half, half), buffer, **conditions)
    made = sample(network, AS_TRAINED, noise, (1, 2), "lcm", **conditions)
    torch.testing.assert_close(made[0], first[0])
    torch.testing.assert_close(made[1], second[1])
    for at, kept in heard.items():
        torch.testing.assert_close(kept, buffer[at])


@pytest.mark.parametrize("strength", [0.0, 2.5])
def test_speech_moves_the_body_further_and_leaves_jaw_and_face(strength):
    network, guide, seed = tiny_network(), guide_of(strength), made_pair(seed=2)
    told = made_conditions() | {"seed": (seed[0][:, :8], seed[1][:, :8])}
    first = torch.full((2,), float(flow_times()[999]))
    x_t = noise(EXPRESSION, 0), noise(GESTURE, 0)
    heard = network(x_t, (first, first), **told)
    unheard = told | {"has_speech": torch.zeros(2, dtype=torch.bool)}
    deaf = network(x_t, (first, first), **unheard)
    found = sample(network, guide, noise, (1, 1), "ddim", **asked(network, guide))
    torch.testing.assert_close(found[EXPRESSION], heard[EXPRESSION], atol=1e-5, rtol=1e-4)
    body, with_speech, without = (
        NORMALISER.restore(x) for x in (found[GESTURE], heard[GESTURE], deaf[GESTURE])
    )
    wanted = without + strength * (with_speech - without)
    jaw = [3 * joint + k for joint in FACE_JOINTS for k in range(3)]
    wanted[..., jaw] = with_speech[..., jaw]
    torch.testing.assert_close(body, wanted, atol=1e-4, rtol=1e-4)


def asked(network: DualBranchNetwork, guide: ClassifierFreeGuidance = AS_TRAINED) -> dict:
    conditions, seed = made_conditions(), made_pair(seed=2)
    del conditions["has_speech"]
    heard = network.speech_tokens(
        guide.duplicate(conditions.pop("speech")), guide.conditional_mask(2)
    )
    return {"speech_tokens": heard, "seed": (seed[0][:, :8], seed[1][:, :8]), **conditions}


def test_steps_begin_at_pure_noise_and_lie_at_even_distances():
    assert trailing_steps(25).tolist() == list(range(999, 0, -40))
    assert trailing_steps(8).tolist() == [999, 874, 749, 624, 499, 374, 249, 124]
    assert trailing_steps(1).tolist() == [999] and len(trailing_steps(1000)) == 1000
    for count in (0, 1001):
        with pytest.raises(ValueError, match=f"from 1 to 1000; got {count}"):
            trailing_steps(count)
    assert branch_step_indices(4, 8) == [0, 2, 4, 6] and branch_step_indices(8, 8) == list(range(8))
    assert branch_step_indices(3, 8) == [0, 2, 5] and branch_step_indices(1, 8) == [0]
