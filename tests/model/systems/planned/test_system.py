from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from conventions.joints import JOINT_INDEX
from model.generation.windows import (
    GenerateOptions,
    draw_of,
    draw_plans,
    generate_motion,
    stream_motion,
)
from model.plan.plan import read_plan
from model.storage.cards import CheckpointError
from model.systems.planned.config import PLANNED, PLANNER
from model.systems.planned.system import PlannedSystem
from model.systems.registry import list_systems, load_system
from tests.model.made import TINY_BEST, made_speech, make_weights
from tests.model.plan.made import made_plan
from tests.model.systems.planned.made import make_planned_weights

SPEECH = made_speech(16_000 * 5)
OPTIONS = GenerateOptions("ann", seed=3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return make_planned_weights(tmp_path_factory.mktemp("planned"))


@pytest.fixture(scope="module")
def system(folder) -> PlannedSystem:
    found = load_system(PLANNED, folder)
    assert isinstance(found, PlannedSystem)
    return found


def test_it_moves_for_as_long_as_the_speech(folder, system):
    assert list_systems(folder) == (PLANNED,)
    assert set(system.sha256s) == {PLANNED, PLANNER, "expression"}
    (motion,) = generate_motion(system, SPEECH, OPTIONS)
    assert motion.num_frames == 150 and np.isfinite(motion.poses).all()


def test_a_plan_given_back_gives_the_same_motion(system, tmp_path):
    (plan,) = draw_plans(system, SPEECH, OPTIONS)
    assert plan.duration_s == 5.0 and len(plan.right) > 3
    plan.write(tmp_path / "plan.json")
    told = replace(OPTIONS, plans=(read_plan(tmp_path / "plan.json"),))
    (drawn,), (given,) = (generate_motion(system, SPEECH, o) for o in (OPTIONS, told))
    # The file has four decimals.
    np.testing.assert_allclose(given.poses, drawn.poses, atol=5e-3)
    again = replace(OPTIONS, plans=(plan,))
    np.testing.assert_array_equal(generate_motion(system, SPEECH, again)[0].poses, drawn.poses)


def test_another_plan_gives_other_motion(system):
    one, other = (
        generate_motion(system, SPEECH, replace(OPTIONS, plans=(plan,)))[0]
        for plan in (made_plan(), made_plan().at_speed(1.5))
    )
    assert np.abs(one.poses - other.poses).max() > 1e-3


def test_each_sample_performs_a_plan_of_its_own(system):
    options = replace(OPTIONS, samples=2)
    plans = draw_plans(system, SPEECH, options)
    assert plans[0] == draw_plans(system, SPEECH, OPTIONS)[0] != plans[1]
    motions = generate_motion(system, SPEECH, options)
    (alone,) = generate_motion(system, SPEECH, OPTIONS)
    np.testing.assert_array_equal(motions[0].poses, alone.poses)
    second = generate_motion(system, SPEECH, replace(OPTIONS, first_sample=1))[0]
    np.testing.assert_array_equal(motions[1].poses, second.poses)
    shared = replace(options, plans=plans[:1])
    same = generate_motion(system, SPEECH, shared)
    assert np.abs(same[0].poses - same[1].poses).max() > 1e-3  # their noise differs still


def test_plans_are_as_many_as_samples_or_one(system):
    with pytest.raises(ValueError, match="2 plans for 3 samples"):
        replace(OPTIONS, samples=3, plans=(made_plan(), made_plan()))


def test_progress_and_guidance_are_told(system):
    seen: list[float] = []
    generate_motion(system, SPEECH, replace(OPTIONS, samples=2), seen.append)
    assert seen == sorted(seen) and seen[-1] == 1.0
    deaf, strong = (draw_plans(system, SPEECH, replace(OPTIONS, guidance=g))[0] for g in (0.0, 4.0))
    assert deaf != strong


def test_chance_moves_the_trunk_more_than_the_arms_and_hides_no_speaker_from_what_hears(system):
    (plan,) = draw_plans(system, SPEECH, OPTIONS)
    draw = replace(draw_of(system, OPTIONS), plan=plan)
    whole = draw.noise((system.config.window_frames, system.config.motion_dim))
    unmix = system.normaliser.unmix
    moved, unscaled = (noise[0] @ unmix for noise in (system.noise(draw), whole))

    def share(joint: str) -> Tensor:
        channels = [3 * JOINT_INDEX[joint] + k for k in range(3)]
        return (moved / unscaled)[:, channels]

    torch.testing.assert_close(share("spine2"), torch.full_like(share("spine2"), 0.85))
    for joint in ("head", "left_wrist"):
        assert share(joint).max() <= 0.45 + 1e-4 and share(joint).min() >= 0.1 - 1e-4
    hears = torch.tensor([True, True, False])
    assert system.known_speaker(draw, hears).tolist() == [draw.speaker, draw.speaker, 0]
    assert draw.speaker > 0


def test_what_needs_whole_speech_is_not_streamed(system):
    with pytest.raises(ValueError, match="plans all of the speech first"):
        list(stream_motion(system, [], OPTIONS))


def test_it_is_left_out_where_features_alone_are_told(system):
    motion = generate_motion(system, SPEECH, OPTIONS)[0]
    tracks = {"right": system.encoder.encode(SPEECH.waveform, 150)}
    assert system.predict_with(motion, tracks, 1, 8) is None


def test_a_system_that_does_not_plan_refuses_plans(tmp_path):
    other = load_system(
        "workbench/priorflow", make_weights(tmp_path, {"workbench/priorflow": TINY_BEST})
    )
    with pytest.raises(ValueError, match="performs no plans"):
        generate_motion(other, SPEECH, replace(OPTIONS, plans=(made_plan(),)))
    with pytest.raises(ValueError, match="performs no plans"):
        draw_plans(other, SPEECH, OPTIONS)


def test_parts_that_do_not_belong_together_are_refused(folder, monkeypatch):
    from model.systems.planned import system as module

    planner = module.load_planner(folder)
    other = replace(planner, kinds=replace(planner.kinds, names=("one", "two")))
    monkeypatch.setattr(module, "load_planner", lambda folder: other)
    with pytest.raises(CheckpointError, match="trained on other gestures"):
        module.load(PLANNED, folder)
