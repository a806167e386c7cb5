"""A plan performed again where it was changed, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from model.generation.again import (
    ENDING,
    Performance,
    load_performance,
    perform,
    perform_again,
    save_performance,
)
from model.generation.windows import Cancelled, GenerateOptions, generate_motion
from model.motion.kinematics import joint_positions_from_local, open_body_skeleton
from model.motion.motion import Motion, put_together
from model.motion.rotations import matrix_from_axis_angle
from model.plan.editing import Gesture, added, deleted, with_event
from model.plan.plan import GesturePlan, Nod, PlanError
from model.systems.planned.config import PLANNED
from model.systems.registry import load_system
from tests.model.made import made_speech
from tests.model.plan.made import phase
from tests.model.systems.planned.made import make_planned_weights

SECONDS = 14
SPEECH = made_speech(16_000 * SECONDS)


@pytest.fixture(scope="module")
def system(tmp_path_factory):
    return load_system(PLANNED, make_planned_weights(tmp_path_factory.mktemp("planned")))


@pytest.fixture(scope="module")
def plan() -> GesturePlan:
    still = (phase(0.0, float(SECONDS), "rest"),)
    made = GesturePlan(float(SECONDS), left=still, right=still)
    for at in (2.0, 6.0, 12.0):
        made = added(made, "offer", at, "right").plan
    return made


def options(plan: GesturePlan) -> GenerateOptions:
    return GenerateOptions("ann", seed=3, steps=2, plans=(plan,))


def without(plan: GesturePlan) -> GesturePlan:
    return deleted(plan, Gesture("right", 6.0)).plan


@pytest.fixture(scope="module")
def first(system, plan) -> Performance:
    return perform(system, SPEECH, options(plan))


def arrays(motion: Motion) -> np.ndarray:
    return np.concatenate([motion.poses, motion.trans, motion.expressions], axis=1)


def test_a_performance_is_the_motion_that_is_generated(system, plan, first):
    (motion,) = generate_motion(system, SPEECH, options(plan))
    np.testing.assert_array_equal(arrays(first.motion), arrays(motion))
    assert first.fresh == (range(0, 30 * SECONDS),)


def test_the_same_plan_again_is_the_same_motion(system, plan, first):
    again = perform_again(system, SPEECH, options(plan), first)
    assert again.fresh == () and all(a is b for a, b in zip(again.made, first.made, strict=True))
    np.testing.assert_array_equal(arrays(again.motion), arrays(first.motion))


@pytest.mark.parametrize(
    ("change", "at"),
    [
        (without, 6.0),
        (lambda p: added(p, "you", 1.0, "left").plan, 1.0),
        (lambda p: with_event(p, Nod(13.8, 6.0)).plan, 13.8),
    ],
    ids=["middle", "start", "end"],
)
def test_only_what_was_changed_is_performed_anew(system, plan, first, change, at):
    again = perform_again(system, SPEECH, options(change(plan)), first)
    (fresh,) = again.fresh
    assert fresh.start <= 30 * at < fresh.stop
    assert len(fresh) < 30 * SECONDS * 0.75
    stays = np.ones(30 * SECONDS, bool)
    stays[fresh.start : fresh.stop] = False
    same = (arrays(again.motion) == arrays(first.motion)).all(axis=1)
    assert same[stays].all() and not same[~stays].any()


def test_what_is_performed_anew_is_what_the_changed_plan_would_have_been(system, plan, first):
    again = perform_again(system, SPEECH, options(without(plan)), first)
    (motion,) = generate_motion(system, SPEECH, options(without(plan)))
    inside = slice(again.fresh[0].start, again.fresh[0].stop - 52)
    np.testing.assert_array_equal(again.motion.poses[inside], motion.poses[inside])


def test_an_edit_taken_back_is_the_first_performance_nearly(system, plan, first):
    """The plan heard is the old one again, so all that was made of it comes back."""
    changed = perform_again(
        system, SPEECH, options(deleted(plan, Gesture("right", 6.0)).plan), first
    )
    back = perform_again(system, SPEECH, options(plan), changed)
    frames = back.fresh[0]
    off = np.abs(arrays(back.motion) - arrays(first.motion))
    assert off[: frames.stop - 52].max() == 0 and off[frames.stop :].max() == 0


def test_where_new_goes_over_into_old_it_is_as_smooth_as_elsewhere(system, plan, first):
    again = perform_again(system, SPEECH, options(without(plan)), first)
    local = matrix_from_axis_angle(torch.from_numpy(again.motion.poses).unflatten(-1, (55, 3)))
    trans = torch.from_numpy(again.motion.trans)
    _, joints = joint_positions_from_local(local, open_body_skeleton(), trans)
    jerk = joints.diff(n=3, dim=0).norm(dim=-1).mean(dim=1).numpy()
    fresh = again.fresh[0]
    back = jerk[fresh.stop - 52 - 3 : fresh.stop + 8]
    joins = np.concatenate([jerk[k - 3 : k + 9] for k in range(52, 30 * SECONDS - 60, 52)])
    assert back.max() <= 1.2 * joins.max()


def test_pieces_put_together_are_the_motion_and_what_did_not_change_comes_first(
    system, plan, first
):
    pieces: list[Motion] = []
    asked_after: list[int] = []

    def should_cancel() -> bool:
        asked_after.append(len(pieces))
        return False

    changed = options(deleted(plan, Gesture("right", 12.0)).plan)
    again = perform_again(system, SPEECH, changed, first, should_cancel, pieces.append)
    np.testing.assert_array_equal(arrays(put_together(pieces)), arrays(again.motion))
    assert asked_after[0] == again.fresh[0].start // 52 > 0


def test_a_performance_is_read_as_it_was_written(system, plan, first, tmp_path):
    path = tmp_path / f"take{ENDING}"
    save_performance(first, path)
    read = load_performance(path, system, plan, first.motion)
    assert torch.equal(read.heard, first.heard)
    again = perform_again(system, SPEECH, options(without(plan)), read)
    same = perform_again(system, SPEECH, options(without(plan)), first)
    np.testing.assert_array_equal(arrays(again.motion), arrays(same.motion))
    path.write_bytes(path.read_bytes()[:1000])
    for broken in (path, tmp_path / "gone"):
        with pytest.raises(PlanError, match="kept no longer"):
            load_performance(broken, system, plan, first.motion)


def test_it_stops_when_asked_to_and_refuses_what_it_cannot_keep(system, plan, first):
    with pytest.raises(Cancelled):
        perform(system, SPEECH, options(plan), lambda: True)
    with pytest.raises(ValueError, match="One sample with a plan"):
        perform(system, SPEECH, replace(options(plan), samples=2))
    with pytest.raises(ValueError, match="One sample with a plan"):
        perform_again(system, SPEECH, replace(options(plan), plans=()), first)
