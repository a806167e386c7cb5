"""A plan performed again where it was changed, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from model.generation.regenerate import (
    STATE_SUFFIX,
    GenerationState,
    StateError,
    regenerate,
    restore_state,
    save_windows,
)
from model.generation.windows import GenerateOptions, generate_motion
from model.motion.kinematics import forward_kinematics, open_body_skeleton
from model.motion.motion import Motion, concatenate
from model.plan.editing import GestureKey, add_event, add_gesture, delete_gesture
from model.plan.plan import GesturePlan, Nod
from model.systems.planned.config import PLANNED
from model.systems.registry import load_system
from processes.job import Cancelled
from tests.model.made import made_speech
from tests.model.plan.made import resting

SECONDS = 14
FRAMES = 30 * SECONDS
SPEECH = made_speech(16_000 * SECONDS)
PLAN = resting(float(SECONDS))
for at in (2.0, 6.0, 12.0):
    PLAN = add_gesture(PLAN, "offer", at, "right").plan
WITHOUT = delete_gesture(PLAN, GestureKey("right", 6.0)).plan


def options(plan: GesturePlan) -> GenerateOptions:
    return GenerateOptions("ann", seed=3, steps=2, conditions=(plan,))


@pytest.fixture(scope="module")
def system(planned_weights):
    return load_system(PLANNED, planned_weights)


@pytest.fixture(scope="module")
def first(system) -> GenerationState:
    return regenerate(system, SPEECH, options(PLAN))


@pytest.fixture(scope="module")
def changed(system, first) -> GenerationState:
    return regenerate(system, SPEECH, options(WITHOUT), first)


def arrays(motion: Motion) -> np.ndarray:
    return np.concatenate([motion.poses, motion.trans, motion.expressions], axis=1)


def test_a_performance_is_the_motion_that_is_generated_and_again_the_same(system, first):
    (motion,) = generate_motion(system, SPEECH, options(PLAN))
    np.testing.assert_array_equal(arrays(first.motion), arrays(motion))
    assert first.changed_frames == (range(0, FRAMES),)
    again = regenerate(system, SPEECH, options(PLAN), first)
    assert again.changed_frames == () and all(
        a is b for a, b in zip(again.windows, first.windows, strict=True)
    )
    np.testing.assert_array_equal(arrays(again.motion), arrays(first.motion))


@pytest.mark.parametrize("where", ["middle", "start", "end"])
def test_only_what_was_changed_is_performed_anew(system, first, changed, where):
    at, plan = {
        "middle": (6.0, WITHOUT),
        "start": (1.0, add_gesture(PLAN, "you", 1.0, "left").plan),
        "end": (13.8, add_event(PLAN, Nod(13.8, 6.0)).plan),
    }[where]
    again = changed if plan is WITHOUT else regenerate(system, SPEECH, options(plan), first)
    (fresh,) = again.changed_frames
    assert fresh.start <= 30 * at < fresh.stop and len(fresh) < FRAMES * 0.75
    same = (arrays(again.motion) == arrays(first.motion)).all(axis=1)
    inside = np.isin(np.arange(FRAMES), fresh)
    np.testing.assert_array_equal(same, ~inside)


def test_what_is_performed_anew_is_what_the_changed_plan_would_have_been(system, changed):
    (motion,) = generate_motion(system, SPEECH, options(WITHOUT))
    inside = slice(changed.changed_frames[0].start, changed.changed_frames[0].stop - 52)
    np.testing.assert_array_equal(changed.motion.poses[inside], motion.poses[inside])


def test_an_edit_taken_back_is_the_first_performance_nearly(system, first, changed):
    """The plan heard is the old one again, so all that was made of it comes back."""
    back = regenerate(system, SPEECH, options(PLAN), changed)
    frames = back.changed_frames[0]
    off = np.abs(arrays(back.motion) - arrays(first.motion))
    assert off[: frames.stop - 52].max() == 0 and off[frames.stop :].max() == 0


def test_where_new_goes_over_into_old_it_is_as_smooth_as_elsewhere(changed):
    motion = changed.motion
    _, joints = forward_kinematics(
        motion.local_rotations(), open_body_skeleton(), torch.from_numpy(motion.trans)
    )
    jerk = joints.diff(n=3, dim=0).norm(dim=-1).mean(dim=1).numpy()
    stop = changed.changed_frames[0].stop
    joins = np.concatenate([jerk[k - 3 : k + 9] for k in range(52, FRAMES - 60, 52)])
    assert jerk[stop - 52 - 3 : stop + 8].max() <= 1.2 * joins.max()


def test_pieces_put_together_are_the_motion_and_what_did_not_change_comes_first(system, first):
    pieces: list[Motion] = []
    asked_after: list[int] = []

    def should_cancel() -> bool:
        asked_after.append(len(pieces))
        return False

    plan = delete_gesture(PLAN, GestureKey("right", 12.0)).plan
    again = regenerate(system, SPEECH, options(plan), first, should_cancel, pieces.append)
    np.testing.assert_array_equal(arrays(concatenate(pieces)), arrays(again.motion))
    assert asked_after[0] == again.changed_frames[0].start // 52 > 0


def test_a_performance_is_read_as_it_was_written(system, first, changed, tmp_path):
    path = tmp_path / f"take{STATE_SUFFIX}"
    save_windows(first, path)
    read = restore_state(path, system, PLAN, first.motion)
    assert torch.equal(read.conditioning, first.conditioning)
    again = regenerate(system, SPEECH, options(WITHOUT), read)
    np.testing.assert_array_equal(arrays(again.motion), arrays(changed.motion))
    path.write_bytes(path.read_bytes()[:1000])
    for broken in (path, tmp_path / "gone"):
        with pytest.raises(StateError, match="has expired"):
            restore_state(broken, system, PLAN, first.motion)


def test_it_stops_when_asked_to_and_refuses_what_it_cannot_keep(system, first):
    with pytest.raises(Cancelled):
        regenerate(system, SPEECH, options(PLAN), None, lambda: True)
    with pytest.raises(ValueError, match="Only one sample with one condition"):
        regenerate(system, SPEECH, replace(options(PLAN), num_samples=2))
    with pytest.raises(ValueError, match="Only one sample with one condition"):
        regenerate(system, SPEECH, replace(options(PLAN), conditions=()), first)
