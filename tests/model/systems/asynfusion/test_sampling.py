from collections.abc import Sequence

import pytest
import torch

from model.sampling.flow import interpolate, seeded_noise
from model.systems.asynfusion.network import BRANCHES, EXPRESSION, DualBranchNetwork, FeatureBuffer
from model.systems.asynfusion.sampling import (
    WAYS,
    Way,
    blended,
    flow_times,
    noise_of,
    sample,
    trailing_steps,
    turns,
)
from tests.model.systems.asynfusion.made import BODY, FACE, made_conditions, made_pair, tiny_network


def noise(which: int, step: int) -> torch.Tensor:
    return torch.stack(
        [seeded_noise([7, k, which, step], (60, (FACE, BODY)[which])) for k in (0, 1)]
    )


def asked(network: DualBranchNetwork) -> dict:
    conditions = made_conditions()
    x = made_pair(seed=3)
    heard = network.hear(conditions.pop("speech"), conditions.pop("has_speech"))
    return {"heard": heard, "seed": (x[0][:, :8], x[1][:, :8]), **conditions}


def watched(network: DualBranchNetwork, monkeypatch: pytest.MonkeyPatch) -> list:
    """Which branches are asked at which times, from now on."""
    calls: list[tuple[tuple[int, ...], list[float]]] = []
    evaluate = network.evaluate

    def listed(active: Sequence[int], x_t, t, buffer: FeatureBuffer, **conditions):
        calls.append((tuple(active), [float(time[0]) for time in t]))
        return evaluate(active, x_t, t, buffer, **conditions)

    monkeypatch.setattr(network, "evaluate", listed)
    return calls


def test_turns_lie_at_even_distances():
    assert turns(4, 8) == [0, 2, 4, 6] and turns(8, 8) == list(range(8))
    assert turns(3, 8) == [0, 2, 5] and turns(1, 8) == [0]


@pytest.mark.parametrize("kind", ["ddim", "lcm"])
def test_equal_counts_are_the_usual_sampler(kind):
    """Both branches together, step by step, without any buffer."""
    network = tiny_network()
    conditions = asked(network)
    x = noise(0, 0), noise(1, 0)
    times = [*flow_times()[trailing_steps(5)].tolist(), 1.0]
    for k in range(5):
        t = torch.full((2,), times[k]), torch.full((2,), times[k])
        found = network.evaluate(BRANCHES, x, t, {}, **conditions)
        later = torch.full((2,), times[k + 1])
        kept = [
            noise_of(x[b], found[b], t[b]) if kind == "ddim" else noise(b, k + 1) for b in BRANCHES
        ]
        x = tuple(interpolate(kept[b], found[b], later) for b in BRANCHES)
    made = sample(network, noise, (5, 5), Way(kind), **conditions)
    for which in BRANCHES:
        torch.testing.assert_close(made[which], x[which], atol=1e-5, rtol=1e-4)


def test_the_face_rests_while_the_body_goes_on(monkeypatch):
    network = tiny_network()
    calls = watched(network, monkeypatch)
    sample(network, noise, (2, 4), WAYS["lcm"], **asked(network))
    face, body = (flow_times()[trailing_steps(count)].tolist() for count in (2, 4))
    assert calls == [
        ((0, 1), [face[0], body[0]]),
        ((1,), [face[1], body[1]]),
        ((0, 1), [face[1], body[2]]),
        ((1,), [1.0, body[3]]),
    ]


def test_recomputing_asks_the_idle_branch_and_changes_what_is_heard(monkeypatch):
    network = tiny_network()
    conditions = asked(network)
    with monkeypatch.context() as patch:
        calls = watched(network, patch)
        anew = sample(network, noise, (2, 4), WAYS["lcm-recomputed"], **conditions)
    assert [active for active, _ in calls] == [(0, 1)] * 4
    stale = sample(network, noise, (2, 4), WAYS["lcm"], **conditions)
    assert (anew[1] - stale[1]).abs().max() > 1e-5
    equal = [
        sample(network, noise, (4, 4), WAYS[way], **conditions) for way in ("lcm", "lcm-recomputed")
    ]
    for which in BRANCHES:
        torch.testing.assert_close(equal[0][which], equal[1][which])


def test_what_is_stale_is_the_last_step_of_the_idle_branch():
    """The whole of 1/2 by hand: the body's second step hears the face's only one."""
    network = tiny_network()
    conditions = asked(network)
    times = flow_times()
    start = torch.full((2,), float(times[999]))
    half = torch.full((2,), float(times[499]))
    buffer: FeatureBuffer = {}
    x = noise(0, 0), noise(1, 0)
    first = network.evaluate(BRANCHES, x, (start, start), buffer, **conditions)
    heard = {at: features.clone() for at, features in buffer.items() if at[0] == EXPRESSION}
    assert len(heard) == 2
    body = interpolate(noise(1, 1), first[1], half)
    second = network.evaluate([1], (first[0], body), (half, half), buffer, **conditions)
    made = sample(network, noise, (1, 2), WAYS["lcm"], **conditions)
    torch.testing.assert_close(made[0], first[0])
    torch.testing.assert_close(made[1], second[1])
    for at, kept in heard.items():
        torch.testing.assert_close(kept, buffer[at])


def test_noise_does_not_depend_on_how_many_steps_are_taken():
    network = tiny_network()
    conditions = asked(network)
    drawn: list[list[tuple[int, int]]] = []
    for counts in ((2, 4), (4, 4), (4, 2)):
        keys: list[tuple[int, int]] = []

        def listed(which: int, step: int, keys=keys) -> torch.Tensor:
            keys.append((which, step))
            return noise(which, step)

        sample(network, listed, counts, WAYS["lcm"], **conditions)
        drawn.append(sorted(keys))
        assert drawn[-1] == sorted((b, k) for b in BRANCHES for k in range(counts[b]))


def test_blending_leads_from_the_window_before():
    before, clean = torch.zeros(1, 3, 2), torch.ones(1, 5, 2)
    found = blended(before, clean)
    torch.testing.assert_close(found[0, :, 0], torch.tensor([0.25, 0.5, 0.75, 1.0, 1.0]))
    network = tiny_network()
    conditions = asked(network) | {"has_seed": torch.tensor([True, True])}
    plain = sample(network, noise, (2, 2), WAYS["ddim"], **conditions)
    led = sample(network, noise, (2, 2), WAYS["ddim-blend"], **conditions)
    nearer = [
        (motion[1][:, 0] - conditions["seed"][1][:, 0]).abs().mean() for motion in (led, plain)
    ]
    assert nearer[0] < nearer[1]
