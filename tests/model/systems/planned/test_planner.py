"""Plans from whole speech and while it comes, and the motion that follows them."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from model.generation.base import WindowSpec
from model.generation.live import LiveGenerator, Pace
from model.generation.windows import GenerateOptions, first_window_spec
from model.motion.kinematics import open_body_skeleton
from model.motion.tracks import track_points, wrist_positions_in_chest_frame
from model.plan.editing import clamp_goals
from model.plan.kinds import REST_POSITION
from model.plan.plan import SIDES, STILL_PHASES, HandPhase, PlanError
from model.plan.plan_features import (
    TIERS,
    chain_states,
    hand_tracks,
    plan_to_chains,
    plan_tracks,
    tier_sampling_inputs,
)
from model.plan.style import LiveStyle
from model.systems.planned.config import PLANNED
from model.systems.planned.network import MarkMixture
from model.systems.planned.planner import EventChainSampler, Planner, _Events, load_planner
from model.systems.planned.streaming_planner import StreamingPlanner
from model.systems.registry import load_system
from tests.model.plan.made import made_plan


def features(num_frames: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(num_frames, 68, generator=torch.Generator().manual_seed(seed))


def draw(seed: int, sample: int = 0, guidance: float = 2.0) -> WindowSpec:
    return WindowSpec(1, seed, 1, 0, "euler", 2, guidance, sample)


@pytest.fixture(scope="module")
def planner(planned_weights) -> Planner:
    return load_planner(planned_weights)


def test_a_plan_follows_from_its_key(planner):
    one, again, other = (planner.plan(features(100), draw(0, sample, 1.0)) for sample in (0, 0, 1))
    assert one == again != other
    assert one.duration_s == 100 / 30
    assert one.right[0].start_s == 0 and one.right[-1].end_s == one.duration_s


def test_what_is_said_later_does_not_change_what_came_before(planner):
    """Beyond what the network hears ahead."""
    short, long = features(150), features(150)
    long = torch.cat([long, features(60, 9)])
    one, other = (planner.plan(f, draw(4)) for f in (short, long))
    until_s = (150 - planner.config.context_frames_per_side) / 30

    def early(plan):
        return [(p.start_s, p.phase, p.goal) for p in plan.right if p.start_s < until_s]

    assert early(one) == early(other) and len(early(one)) > 2


def test_shares_are_those_of_slow_counting(planner):
    """Whatever begins at a frame, begins as often as the network says."""
    told = features(2)
    with torch.no_grad():
        around = told[torch.arange(-31, 33).clamp(0, 1)][None]
        heard = planner.network.encode_speech_and_speaker(
            around, torch.tensor([1]), torch.tensor([True])
        )
        begun = planner.make_samplers(told, draw(0, guidance=1.0))
        chains = {name: drawer.chain for name, drawer in begun.items()}
        frames = {t.name: chain_states(t, chains[t.name], np.arange(2)) for t in TIERS}
        seen = torch.from_numpy(tier_sampling_inputs(frames)["right"])
        head = planner.network.heads["right"]
        expected = head.event_log_probs(head.hidden(heard[0], seen))[1].exp().numpy()
        told_head = head.heard(heard).numpy()
    counts = np.zeros(7)
    for seed in range(500):
        right = EventChainSampler(
            head, told_head, 1.0, chains["right"][0], np.random.default_rng(seed)
        )
        right.draw(1, begun)
        counts[0 if len(right.chain) == 1 else 1 + right.chain[-1].state] += 1
    np.testing.assert_allclose(counts / 500, expected, atol=0.07)


def test_marks_have_the_density_of_a_mixture():
    marks = MarkMixture(
        torch.tensor([[0.0, np.log(3.0)]]).float(),
        torch.tensor([[[0.0, 1.0], [2.0, -1.0]]]),
        torch.tensor([[[1.0, 0.5], [0.3, 2.0]]]),
    )
    point = torch.tensor([[0.4, 0.2]])
    slow = 0.0
    for weight, mean, spread in zip(
        (0.25, 0.75), marks.mean[0].tolist(), marks.std[0].tolist(), strict=True
    ):
        each = [
            np.exp(-0.5 * ((x - m) / s) ** 2) / (s * np.sqrt(2 * np.pi))
            for x, m, s in zip(point[0].tolist(), mean, spread, strict=True)
        ]
        slow += weight * np.prod(each)
    assert np.isclose(float(marks.log_likelihood(point)), np.log(slow), atol=1e-5)


def test_losses_are_means_over_frames(planner):
    chains = plan_to_chains(made_plan())
    frames = {t.name: chain_states(t, chains[t.name], np.arange(180)) for t in TIERS}
    seen = {n: torch.from_numpy(s)[None] for n, s in tier_sampling_inputs(frames).items()}
    event = {n: torch.from_numpy(f.event)[None] for n, f in frames.items()}
    mark = {n: torch.from_numpy(f.mark)[None] for n, f in frames.items()}
    speech = features(180 + 2 * planner.config.context_frames_per_side)[None]
    who, hears = torch.tensor([1]), torch.tensor([True])
    with torch.no_grad():
        losses = planner.network(speech, who, hears, seen, event, mark)
        heard = planner.network.encode_speech_and_speaker(speech, who, hears)
        head = planner.network.heads["nod"]
        state = head.hidden(heard, seen["nod"])
        logs = head.event_log_probs(state)[0]
        slow = -np.mean([logs[k, e].item() for k, e in enumerate(event["nod"][0].tolist())])
        assert np.isclose(losses["nod"].item(), slow, atol=1e-6)
        at = event["nod"][0].nonzero()[:, 0]
        state, begun = state[0, at], event["nod"][0, at] - 1
        marks = head.marks(state, begun)
        parts = head.mark_out(head.mark(state + head.begun.weight[begun]))
        logits = parts[:, :: parts.shape[1] // head.mixtures]
        assert torch.equal(marks.logits, logits), "what begins is added to what is heard and seen"
        told = marks.log_likelihood(mark["nod"][0, at])
        assert np.isclose(losses["nod mark"].item(), -told.sum().item() / 180, atol=1e-6)
    assert set(losses) == {t.name for t in TIERS} | {
        f"{t.name} mark" for t in TIERS if t.mark_scales
    }


def test_events_without_torch_are_those_of_the_network(planner):
    for tier in TIERS:
        head = planner.network.heads[tier.name]
        heard = torch.randn(2, head.event_out.in_features)
        seen = torch.randn(head.seen.in_features)
        state, logs = _Events(head)(heard.numpy(), seen.numpy())
        wanted = torch.nn.functional.silu(heard + head.seen(seen))
        np.testing.assert_allclose(state, wanted.numpy(), atol=1e-5)
        np.testing.assert_allclose(logs, head.event_log_probs(wanted).numpy(), atol=1e-5)


DRAW, HOP, AHEAD, LONG, USUAL = draw(4), 15, 30, 120, LiveStyle()
OPTIONS = GenerateOptions("ann", seed=3, steps=2)
SPEECH = features(LONG + 200)


def known(speech: torch.Tensor):
    return lambda first, stop: speech[torch.arange(first, stop).clamp(0, len(speech) - 1)]


def told(planner: Planner, speech, manner: LiveStyle = USUAL, long: int = LONG):
    """What is planned with each hop of some speech, or, of a function, of what is supposed then."""
    stream = StreamingPlanner(planner, DRAW)
    stream.style = manner
    for first in range(0, long, HOP):
        now = speech(first) if callable(speech) else speech
        yield first, stream.advance(known(now), first, first + HOP, first + HOP + AHEAD)


def began(planner: Planner, speech, manner: LiveStyle = USUAL, long: int = LONG):
    """Each phase as it was told when it had begun: hand, first frame -> end, name, goal."""
    found: dict[tuple[str, int], set[tuple]] = {}
    for first, plan in told(planner, speech, manner, long):
        for side in SIDES:
            for phase in plan.condition.hand(side):
                begins, ends = (
                    round(at * 30) + plan.zero_frame for at in (phase.start_s, phase.end_s)
                )
                settled = phase.phase in STILL_PHASES or ends < first + HOP + AHEAD
                if begins < first + HOP and settled:
                    found.setdefault((side, begins), set()).add((ends, phase.phase, phase.goal))
    return found


def test_where_all_speech_is_known_a_plan_is_that_of_whole_speech(planner):
    whole = planner.plan(SPEECH, DRAW)
    found = began(planner, SPEECH)
    assert len(found) > 8
    for side in SIDES:
        expected = {
            round(p.start_s * 30): (round(p.end_s * 30), p.phase, p.goal) for p in whole.hand(side)
        }
        made = {at: phases for (hand, at), phases in found.items() if hand == side}
        assert {at for at in expected if at < LONG - 1} == {at for at in made if at < LONG - 1}
        for at, phases in made.items():
            assert at >= LONG - 1 or {name for _, name, _ in phases} == {expected[at][1]}
            if at < LONG - 30 and expected[at][1] not in STILL_PHASES:
                ((end, _, goal),) = phases
                assert end == expected[at][0]
                assert goal == pytest.approx(expected[at][2], abs=1e-4)


def test_a_movement_that_has_begun_is_carried_out_whatever_is_said(planner):
    """Each time other speech is supposed to come than what came."""
    found = began(planner, lambda first: features(1000, first))
    moving = [told for told in found.values() if next(iter(told))[1] not in STILL_PHASES]
    assert len(moving) > 6 and all(len(each) == 1 for each in moving)


def test_paths_of_hands_stay_where_they_have_been(planner):
    """To the frame up to which it is planned for good, whatever holds turn out to last."""
    path = {side: np.full((LONG + HOP, 3), np.nan) for side in SIDES}
    for first, ahead in told(planner, SPEECH):
        at = first - ahead.zero_frame
        tracks = plan_tracks(ahead.condition, at + HOP).astype(float)
        for side in SIDES:
            now = tracks[:, hand_tracks(side)][:, :3]
            if first:
                before = path[side][first - HOP : first]
                np.testing.assert_allclose(now[at - HOP : at], before, atol=1e-6)
            path[side][first : first + HOP] = now[at:]
    assert np.isfinite(path["left"][:LONG]).all()


def test_what_was_expected_so_far_is_carried_from_hop_to_hop(planner):
    stream, whole = StreamingPlanner(planner, DRAW), planner.make_samplers(SPEECH, DRAW)
    for first in range(0, 60, HOP):
        stream.advance(known(SPEECH), first, first + HOP, first + HOP + AHEAD)
    for frame in range(1, 60):
        for drawer in whole.values():
            drawer.draw(frame, whole)
    for name, drawer in whole.items():
        assert stream._drawers[name]._excess == pytest.approx(drawer._excess, abs=1e-4)
    assert max(abs(drawer._excess) for drawer in whole.values()) > 0.01


def test_memory_does_not_grow(planner):
    stream, sizes = StreamingPlanner(planner, draw(4, guidance=1.0)), []
    for first in range(0, 360, 60):
        stream.advance(lambda a, b: features(b - a), first, first + 60, first + 61)
        sizes.append(sum(len(drawer.chain) for drawer in stream._drawers.values()))
    assert sizes[-1] < 1.6 * sizes[2] and min(stream._goals, key=lambda key: key[1])[1] >= 0


def test_sliders_act_on_what_has_not_begun(planner):
    def lengths(found: dict, name: str) -> list[int]:
        ends = ((at, next(iter(each))) for (_, at), each in found.items())
        return [end - at for at, (end, phase, _) in ends if phase == name]

    seldom, often = (
        began(planner, SPEECH, LiveStyle(rate_factor=times), 60) for times in (0.2, 4.0)
    )
    assert len(lengths(seldom, "preparation")) < len(lengths(often, "preparation"))
    fast, slow = (began(planner, SPEECH, LiveStyle(speed_factor=times), 60) for times in (2.0, 0.5))
    assert np.mean(lengths(fast, "stroke")) < np.mean(lengths(slow, "stroke"))
    changed = LiveStyle(size_factor=1.5, height_offset_m=0.1, smile_factor=0.0)
    plans = []
    for manner in (changed, USUAL):
        stream = StreamingPlanner(planner, DRAW)
        stream.advance(known(SPEECH), 0, 60, 120)
        stream.style = manner
        plans.append(stream.advance(known(SPEECH), 60, 120, 200))
    plan, usual_plan = plans
    assert plan.condition.smiles == () and usual_plan.condition.smiles
    compared = 0
    for side in SIDES:
        pairs = zip(plan.condition.hand(side), usual_plan.condition.hand(side), strict=True)
        for new, old in pairs:
            assert (new.start_s, new.end_s, new.phase) == (old.start_s, old.end_s, old.phase)
            if round(old.start_s * 30) + plan.zero_frame < 60:
                assert new.goal == old.goal
            elif old.phase in ("preparation", "stroke", "beat"):
                wished = [r + 1.5 * (g - r) for g, r in zip(old.goal, REST_POSITION, strict=True)]
                goal = (wished[0], wished[1] + 0.1, wished[2])
                ((reached,), _) = clamp_goals([HandPhase(0.0, 1.0, "stroke", goal)])
                assert new.goal == pytest.approx(reached.goal, abs=1e-4)
                compared += 1
    assert compared > 0


@pytest.mark.parametrize(
    "wrong",
    [
        {"rate_factor": 9},
        {"rate_factor": "1"},
        {"size_factor": True},
        {"more": 1},
        [],
        {"speed_factor": float("nan")},
    ],
)
def test_manners_that_cannot_be_are_refused(wrong):
    with pytest.raises(PlanError):
        LiveStyle.parse(wrong)
    assert LiveStyle.parse({"rate_factor": 2, "height_offset_m": -0.1}) == LiveStyle(
        rate_factor=2.0, height_offset_m=-0.1
    )


def streamed(planned_weights, speech: torch.Tensor, size: int, pace: Pace):
    """The pieces, and what was planned with each: first frame, next frame, plan."""
    live = LiveGenerator(load_system(PLANNED, planned_weights), OPTIONS, pace)
    pieces, aheads = [], []
    for heard in speech.split(size):
        live.add_features(heard)
        while live.is_due:
            first = live.next_frame
            pieces += live.step()
            aheads.append((first, live.next_frame, live.ahead))
    return pieces, aheads


def test_live_motion_hears_nothing_to_come_and_is_as_long_as_what_was_heard(planned_weights):
    speech, other = features(45), torch.cat([features(45), torch.zeros(30, 68)])
    one, two = (streamed(planned_weights, each, 3, Pace(min_hop=18))[0] for each in (speech, other))
    assert sum(piece.num_frames for piece in one) == 36
    for name in ("poses", "trans", "expressions"):
        a, b = (np.concatenate([getattr(p, name) for p in each]) for each in (one, two))
        assert np.isfinite(a).all()
        np.testing.assert_array_equal(a, b[: len(a)])


def test_live_hands_are_led_to_their_plan(planned_weights):
    """Random weights go anywhere; .6 of the way to the plan is gone in closed form."""
    pieces, aheads = streamed(planned_weights, features(120), 9, Pace(min_hop=36))
    wished = {side: [] for side in SIDES}
    for first, stop, ahead in aheads:
        tracks = plan_tracks(ahead.condition, stop - ahead.zero_frame).astype(float)
        for side in SIDES:
            wished[side].append(tracks[first - ahead.zero_frame :, hand_tracks(side)][:, :3])
    joined = {
        name: np.concatenate([getattr(piece, name) for piece in pieces])
        for name in ("poses", "trans", "expressions")
    }
    whole = replace(pieces[0], **joined)
    places = wrist_positions_in_chest_frame(track_points(whole, open_body_skeleton()))
    for side in SIDES:
        path = np.concatenate(wished[side])
        off, mixed = (
            np.linalg.norm(places[side] - np.roll(path, by, axis=0), axis=1).mean()
            for by in (0, 40)
        )
        assert off < mixed


def test_what_performs_no_plans_is_led_by_nobody(weights):
    system = load_system("globaldiff/local", weights)
    live = LiveGenerator(system, GenerateOptions("ann", steps=1), Pace(min_hop=10, look_ahead=12))
    assert live.ahead is None
    with pytest.raises(ValueError, match="takes no condition besides speech"):
        live.set_style(LiveStyle())
    with pytest.raises(ValueError, match="takes no condition besides speech"):
        system.condition_stream(first_window_spec(system, OPTIONS))
