import numpy as np
import torch

from model.plan.tiers import TIERS, chains_of, frames_of, seen_together
from model.systems.planned.network import Marks
from model.systems.planned.planner import Planner, _Events, load_planner
from tests.model.plan.made import made_plan
from tests.model.systems.planned.made import make_planned_weights


def made_planner(folder) -> Planner:
    return load_planner(make_planned_weights(folder))


def features(num_frames: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(num_frames, 68, generator=torch.Generator().manual_seed(seed))


def test_a_plan_follows_from_its_key(tmp_path):
    planner = made_planner(tmp_path)
    one, again, other = (
        planner.plan(features(200), 1, (), key, 1.0) for key in ([0, 0], [0, 0], [0, 1])
    )
    assert one == again != other
    assert one.duration_s == 200 / 30
    assert one.right[0].start_s == 0 and one.right[-1].end_s == one.duration_s


def test_what_is_said_later_does_not_change_what_came_before(tmp_path):
    """Beyond what the network hears ahead."""
    planner = made_planner(tmp_path)
    short, long = features(150), features(150)
    long = torch.cat([long, features(60, 9)])
    one, other = (planner.plan(f, 1, (), [4], 2.0) for f in (short, long))
    until_s = (150 - planner.config.context) / 30

    def early(plan):
        return [(p.start_s, p.phase, p.goal) for p in plan.right if p.start_s < until_s]

    assert early(one) == early(other) and len(early(one)) > 2


def test_shares_are_those_of_slow_counting(tmp_path):
    """Whatever begins at a frame, begins as often as the network says."""
    planner = made_planner(tmp_path)
    told = features(2)
    with torch.no_grad():
        around = told[torch.arange(-31, 33).clamp(0, 1)][None]
        heard = planner.network.hear(around, torch.tensor([1]), torch.tensor([True]))
        begun = planner.drawers(told, 1, [0], 1.0)
        chains = {name: drawer.chain for name, drawer in begun.items()}
        frames = {t.name: frames_of(t, chains[t.name], np.arange(2)) for t in TIERS}
        seen = torch.from_numpy(seen_together(frames)["right"])
        head = planner.network.heads["right"]
        expected = head.events(head.state(heard[0], seen))[1].exp().numpy()
    counts = np.zeros(7)
    for seed in range(3000):
        plan = planner.drawers(told, 1, [seed], 1.0)
        plan["right"].draw(1, plan)
        chain = plan["right"].chain
        counts[0 if len(chain) == 1 else 1 + chain[-1].state] += 1
    np.testing.assert_allclose(counts / 3000, expected, atol=0.03)


def test_marks_have_the_density_of_a_mixture():
    marks = Marks(
        torch.tensor([[0.0, np.log(3.0)]]).float(),
        torch.tensor([[[0.0, 1.0], [2.0, -1.0]]]),
        torch.tensor([[[1.0, 0.5], [0.3, 2.0]]]),
    )
    point = torch.tensor([[0.4, 0.2]])
    slow = 0.0
    for weight, mean, spread in zip(
        (0.25, 0.75), marks.mean[0].tolist(), marks.spread[0].tolist(), strict=True
    ):
        each = [
            np.exp(-0.5 * ((x - m) / s) ** 2) / (s * np.sqrt(2 * np.pi))
            for x, m, s in zip(point[0].tolist(), mean, spread, strict=True)
        ]
        slow += weight * np.prod(each)
    assert np.isclose(float(marks.log_likelihood(point)), np.log(slow), atol=1e-5)


def test_losses_are_means_over_frames(tmp_path):
    planner = made_planner(tmp_path)
    chains = chains_of(made_plan())
    frames = {t.name: frames_of(t, chains[t.name], np.arange(180)) for t in TIERS}
    seen = {n: torch.from_numpy(s)[None] for n, s in seen_together(frames).items()}
    event = {n: torch.from_numpy(f.event)[None] for n, f in frames.items()}
    mark = {n: torch.from_numpy(f.mark)[None] for n, f in frames.items()}
    speech = features(180 + 2 * planner.config.context)[None]
    who, hears = torch.tensor([1]), torch.tensor([True])
    with torch.no_grad():
        losses = planner.network(speech, who, hears, seen, event, mark)
        heard = planner.network.hear(speech, who, hears)
        head = planner.network.heads["nod"]
        state = head.state(heard, seen["nod"])
        logs = head.events(state)[0]
        slow = -np.mean([logs[k, e].item() for k, e in enumerate(event["nod"][0].tolist())])
        assert np.isclose(losses["nod"].item(), slow, atol=1e-6)
        at = event["nod"][0].nonzero()[:, 0]
        told = head.marks(state[0, at], event["nod"][0, at] - 1).log_likelihood(mark["nod"][0, at])
        assert np.isclose(losses["nod mark"].item(), -told.sum().item() / 180, atol=1e-6)
    assert set(losses) == {t.name for t in TIERS} | {f"{t.name} mark" for t in TIERS if t.units}


def test_events_without_torch_are_those_of_the_network(tmp_path):
    planner = made_planner(tmp_path)
    for tier in TIERS:
        head = planner.network.heads[tier.name]
        heard = torch.randn(2, head.event_out.in_features)
        seen = torch.randn(head.seen.in_features)
        state, logs = _Events(head)(heard.numpy(), seen.numpy())
        wanted = torch.nn.functional.silu(heard + head.seen(seen))
        np.testing.assert_allclose(state, wanted.numpy(), atol=1e-5)
        np.testing.assert_allclose(logs, head.events(wanted).numpy(), atol=1e-5)
