"""Plans drawn while speech comes, and the motion that follows them."""

import numpy as np
import pytest
import torch

from model.generation.live import LiveMotion, Pace
from model.generation.windows import GenerateOptions, draw_of
from model.motion.kinematics import open_body_skeleton
from model.motion.tracks import track_points
from model.plan.editing import within_reach
from model.plan.kinds import wrist_places
from model.plan.palette import REST_PLACE
from model.plan.plan import PHASES, SIDES, HandPhase, PlanError
from model.plan.style import Manner
from model.plan.tracks import STILL, hand_tracks, tracks_of
from model.systems.planned.causal import CausalPlanner
from model.systems.planned.config import PLANNED
from model.systems.planned.planner import Planner, load_planner
from model.systems.registry import load_system
from tests.model.made import TINY_SYSTEMS, make_weights
from tests.model.systems.planned.made import make_planned_weights

KEY, HOP, LONG = [4, 0], 15, 120
OPTIONS = GenerateOptions("ann", seed=3, steps=2)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return make_planned_weights(tmp_path_factory.mktemp("weights"))


@pytest.fixture(scope="module")
def planner(folder) -> Planner:
    return load_planner(folder)


def features(num_frames: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(num_frames, 68, generator=torch.Generator().manual_seed(seed))


def told(planner: Planner, speech: torch.Tensor, manner: Manner | None = None, ahead: int = 60):
    """What is planned with each hop; all of the speech is known before."""
    stream = CausalPlanner(planner, 1, KEY, 2.0)
    stream.manner = manner or Manner()

    def heard(first: int, stop: int) -> torch.Tensor:
        return speech[torch.arange(first, stop).clamp(0, len(speech) - 1)]

    for first in range(0, LONG, HOP):
        yield first, stream.go_on(heard, first, first + HOP, first + HOP + ahead)


def began(planner: Planner, speech: torch.Tensor, manner: Manner | None = None, ahead: int = 60):
    """Each phase as it was told when it had begun: hand, first frame -> end, name, goal, kind."""
    found: dict[tuple[str, int], set[tuple]] = {}
    for first, plan in told(planner, speech, manner, ahead):
        for side in SIDES:
            for phase in plan.plan.hand(side):
                begins, ends = (round(at * 30) + plan.origin for at in (phase.start_s, phase.end_s))
                if begins < first + HOP:
                    seen = found.setdefault((side, begins), set())
                    seen.add((ends, phase.phase, phase.goal))
    return found


def test_where_all_speech_is_known_a_plan_is_that_of_whole_speech(planner):
    speech = features(LONG + 200)
    whole = planner.plan(speech, 1, (), KEY, 2.0)
    found = began(planner, speech)
    assert len(found) > 8
    for side in SIDES:
        expected = [
            (round(p.start_s * 30), p.phase) for p in whole.hand(side) if p.start_s * 30 < LONG - 1
        ]
        made = [
            (at, next(iter(phases))[1])
            for (hand, at), phases in sorted(found.items())
            if hand == side and at < LONG - 1
        ]
        assert made == expected
    moving = {
        (side, round(p.start_s * 30)): (round(p.end_s * 30), p.goal)
        for side in SIDES
        for p in whole.hand(side)
        if p.phase not in STILL
    }
    for key, phases in found.items():
        if key in moving and key[1] < LONG - 30:
            ((end, _, goal),) = phases
            assert end == moving[key][0]
            assert goal == pytest.approx(moving[key][1], abs=1e-4)


def test_a_movement_that_has_begun_is_carried_out_whatever_is_said(planner):
    """Each time other speech is supposed to come than what came."""
    stream = CausalPlanner(planner, 1, KEY, 2.0)
    found: dict[tuple[str, int], set] = {}
    for number, first in enumerate(range(0, LONG, HOP)):
        supposed = features(1000, number)
        plan = stream.go_on(
            lambda a, b, known=supposed: known[torch.arange(a, b).clamp(0)],
            first,
            first + HOP,
            first + 80,
        )
        for side in SIDES:
            for phase in plan.plan.hand(side):
                begins, ends = (round(at * 30) + plan.origin for at in (phase.start_s, phase.end_s))
                if begins < first + HOP and phase.phase not in STILL and ends < first + 80:
                    found.setdefault((side, begins), set()).add((ends, phase.phase, phase.goal))
    assert len(found) > 6 and all(len(each) == 1 for each in found.values())


def test_paths_of_hands_stay_where_they_have_been(planner):
    """To the frame up to which it is planned for good, whatever holds turn out to last."""
    path = {side: np.full((LONG + HOP, 3), np.nan) for side in SIDES}
    for first, ahead in told(planner, features(LONG + 200)):
        at = first - ahead.origin
        tracks = tracks_of(ahead.plan, at + HOP).astype(float)
        for side in SIDES:
            now = tracks[:, hand_tracks(side)][:, :3]
            if first:
                before = path[side][first - HOP : first]
                np.testing.assert_allclose(now[at - HOP : at], before, atol=1e-6)
            path[side][first : first + HOP] = now[at:]
    assert np.isfinite(path["left"][:LONG]).all()


def test_memory_does_not_grow(planner):
    stream, sizes = CausalPlanner(planner, 1, KEY, 1.0), []
    for first in range(0, 900, 90):
        stream.go_on(lambda a, b: features(b - a), first, first + 90, first + 91)
        sizes.append(sum(len(drawer.chain) for drawer in stream._drawers.values()))
    assert sizes[-1] < 1.6 * sizes[3] and min(stream._goals, key=lambda key: key[1])[1] >= 0


def test_sliders_act_on_what_has_not_begun(planner):
    speech = features(LONG + 200)

    def count(manner: Manner, name: str) -> int:
        return sum(next(iter(each))[1] == name for each in began(planner, speech, manner).values())

    def mean_length(manner: Manner) -> float:
        ends = [
            (next(iter(each))[0] - at)
            for (_, at), each in began(planner, speech, manner).items()
            if next(iter(each))[1] == "stroke" and at < LONG - 30
        ]
        return float(np.mean(ends))

    assert count(Manner(often=0.2), "preparation") < count(Manner(often=4.0), "preparation")
    assert mean_length(Manner(fast=2.0)) < mean_length(Manner(fast=0.5))

    stream = CausalPlanner(planner, 1, KEY, 2.0)

    def heard(first: int, stop: int) -> torch.Tensor:
        return speech[torch.arange(first, stop).clamp(0)]

    stream.go_on(heard, 0, 60, 120)
    stream.manner = Manner(large=1.5, high_m=0.1, smile=0.0)
    plan = stream.go_on(heard, 60, 120, 200)
    raw = CausalPlanner(planner, 1, KEY, 2.0)
    raw.go_on(heard, 0, 60, 120)
    usual_plan = raw.go_on(heard, 60, 120, 200)
    assert plan.plan.smiles == () and usual_plan.plan.smiles
    changed = 0
    for side in SIDES:
        pairs = zip(plan.plan.hand(side), usual_plan.plan.hand(side), strict=True)
        for new, old in pairs:
            assert (new.start_s, new.end_s, new.phase) == (old.start_s, old.end_s, old.phase)
            if round(old.start_s * 30) + plan.origin < 60:
                assert new.goal == old.goal
            elif old.phase in ("preparation", "stroke", "beat"):
                wished = [r + 1.5 * (g - r) for g, r in zip(old.goal, REST_PLACE, strict=True)]
                goal = (wished[0], wished[1] + 0.1, wished[2])
                ((reached,), _) = within_reach([HandPhase(0.0, 1.0, "stroke", goal)])
                assert new.goal == pytest.approx(reached.goal, abs=1e-4)
                changed += 1
    assert changed > 0


@pytest.mark.parametrize(
    "wrong",
    [{"often": 9}, {"often": "1"}, {"large": True}, {"more": 1}, [], {"fast": float("nan")}],
)
def test_manners_that_cannot_be_are_refused(wrong):
    with pytest.raises(PlanError):
        Manner.of(wrong)
    assert Manner.of({"often": 2, "high_m": -0.1}) == Manner(often=2.0, high_m=-0.1)


def streamed(folder, speech: torch.Tensor, sizes: list[int], manner: Manner | None = None):
    live = LiveMotion(load_system(PLANNED, folder), OPTIONS, Pace())
    if manner is not None:
        live.lead(manner)
    pieces, start, k, aheads = [], 0, 0, []
    while start < len(speech):
        size = sizes[k % len(sizes)]
        live.hear(speech[start : start + size])
        start, k = start + size, k + 1
        while live.is_due:
            first = live.next_frame
            pieces += live.step()
            aheads.append((first, live.next_frame, live.ahead))
    return pieces, aheads


def test_live_motion_hears_nothing_to_come_and_is_as_long_as_what_was_heard(folder):
    speech, other = features(72), torch.cat([features(72), torch.zeros(30, 68)])
    one, two = (streamed(folder, each, [3])[0] for each in (speech, other))
    assert sum(piece.num_frames for piece in one) == 63
    for name in ("poses", "trans", "expressions"):
        a, b = (np.concatenate([getattr(p, name) for p in each]) for each in (one, two))
        assert np.isfinite(a).all()
        np.testing.assert_array_equal(a, b[: len(a)])


def test_live_hands_are_led_to_their_plan(folder):
    """Random weights go anywhere; .6 of the way to the plan is gone in closed form."""
    pieces, aheads = streamed(folder, features(120), [9])
    poses = np.concatenate([piece.poses for piece in pieces])
    off, wished = [], {side: [] for side in SIDES}
    for first, stop, ahead in aheads:
        tracks = tracks_of(ahead.plan, stop - ahead.origin).astype(float)
        for side in SIDES:
            wished[side].append(tracks[first - ahead.origin :, hand_tracks(side)][:, :3])
    whole = type(pieces[0])(
        poses=poses,
        trans=np.concatenate([piece.trans for piece in pieces]),
        expressions=np.concatenate([piece.expressions for piece in pieces]),
        expression_basis=pieces[0].expression_basis,
        betas=pieces[0].betas,
    )
    places = wrist_places(track_points(whole, open_body_skeleton()))
    for side in SIDES:
        path = np.concatenate(wished[side])
        off.append(np.linalg.norm(places[side] - path, axis=1))
        mixed = np.linalg.norm(places[side] - np.roll(path, 40, axis=0), axis=1)
        assert off[-1].mean() < mixed.mean()
    assert len(PHASES) == 6


def test_what_performs_no_plans_is_led_by_nobody(folder):
    system = load_system("globaldiff/local", make_weights(folder, TINY_SYSTEMS))
    live = LiveMotion(system, GenerateOptions("ann", steps=1), Pace(hop=10, heard_ahead=12))
    assert live.ahead is None
    with pytest.raises(ValueError, match="performs no plans"):
        live.lead(Manner())
    with pytest.raises(ValueError, match="performs no plans"):
        system.plan_stream(draw_of(system, OPTIONS))
