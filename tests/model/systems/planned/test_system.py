"""A system that performs plans, its training, and the data that it is trained on."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from conventions.joints import JOINT_INDEX
from model.data.annotations import load_plan_annotations
from model.data.prepared import prepare
from model.data.recordings import DataError
from model.generation.windows import (
    GenerateOptions,
    draw_conditions,
    first_window_spec,
    generate_motion,
)
from model.plan.files import read_plan_file, write_plan_file
from model.plan.plan import GesturePlan
from model.speech.features import MelEncoder
from model.storage.cards import CheckpointError
from model.systems.planned.config import PLANNED, PLANNER
from model.systems.planned.system import PlannedSystem
from model.systems.registry import list_systems, load_system
from tests.model.made import made_speech
from tests.model.plan.made import made_plan
from tests.model.training.made import quick, run

SPEECH = made_speech(40_000)
OPTIONS = GenerateOptions("ann", seed=3, steps=2)


@pytest.fixture(scope="module")
def system(planned_weights) -> PlannedSystem:
    found = load_system(PLANNED, planned_weights)
    assert isinstance(found, PlannedSystem)
    return found


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    return tmp_path_factory.mktemp("planned")


def test_a_plan_given_back_gives_the_same_motion(system, tmp_path):
    (plan,) = draw_conditions(system, SPEECH, OPTIONS)
    assert plan.duration_s == 2.5 and len(plan.right) > 3
    write_plan_file(plan, tmp_path / "plan.json")
    told = replace(OPTIONS, conditions=(read_plan_file(tmp_path / "plan.json").plan,))
    (drawn,), (given,) = (generate_motion(system, SPEECH, o) for o in (OPTIONS, told))
    # The file has four decimals.
    np.testing.assert_allclose(given.poses, drawn.poses, atol=5e-3)
    again = replace(OPTIONS, conditions=(plan,))
    np.testing.assert_array_equal(generate_motion(system, SPEECH, again)[0].poses, drawn.poses)


def test_each_sample_performs_a_plan_of_its_own(system):
    options = replace(OPTIONS, num_samples=2)
    plans = draw_conditions(system, SPEECH, options)
    assert plans[0] == draw_conditions(system, SPEECH, OPTIONS)[0] != plans[1]
    motions = generate_motion(system, SPEECH, options)
    (alone,) = generate_motion(system, SPEECH, OPTIONS)
    np.testing.assert_array_equal(motions[0].poses, alone.poses)
    second = generate_motion(system, SPEECH, replace(OPTIONS, first_sample=1))[0]
    np.testing.assert_array_equal(motions[1].poses, second.poses)
    shared = replace(options, conditions=plans[:1])
    same = generate_motion(system, SPEECH, shared)
    assert np.abs(same[0].poses - same[1].poses).max() > 1e-3  # their noise differs still


def test_chance_moves_the_trunk_more_than_the_arms_and_hides_no_speaker_from_what_hears(system):
    (plan,) = draw_conditions(system, SPEECH, OPTIONS)
    spec = replace(first_window_spec(system, OPTIONS), condition=plan)
    whole = spec.noise((system.config.window_frames, system.config.motion_dim))
    unmix = system.normaliser.unmix
    moved, unscaled = (noise[0] @ unmix for noise in (system.noise(spec), whole))

    def share(joint: str) -> Tensor:
        channels = [3 * JOINT_INDEX[joint] + k for k in range(3)]
        return (moved / unscaled)[:, channels]

    torch.testing.assert_close(share("spine2"), torch.full_like(share("spine2"), 0.85))
    for joint in ("head", "left_wrist"):
        assert share(joint).max() <= 0.45 + 1e-4 and share(joint).min() >= 0.1 - 1e-4
    hears = torch.tensor([True, True, False])
    assert system.speaker_inputs(spec, hears).tolist() == [
        spec.speaker_index,
        spec.speaker_index,
        0,
    ]
    assert spec.speaker_index > 0


def test_parts_that_do_not_belong_together_are_refused(planned_weights, monkeypatch):
    from model.systems.planned import system as module

    planner = module.load_planner(planned_weights)
    other = replace(planner, kinds=replace(planner.kinds, names=("one", "two")))
    monkeypatch.setattr(module, "load_planner", lambda folder: other)
    with pytest.raises(CheckpointError, match="trained with different gesture types"):
        module.load(PLANNED, planned_weights)


def test_it_moves_for_as_long_as_the_speech_by_its_plan_and_guidance(planned_weights, system):
    assert list_systems(planned_weights) == (PLANNED,)
    assert set(system.sha256s) == {PLANNED, PLANNER, "expression"}
    one, other = (
        generate_motion(system, SPEECH, replace(OPTIONS, conditions=(plan,)))[0]
        for plan in (made_plan(), made_plan().at_speed(1.5))
    )
    assert one.num_frames == 75 and np.isfinite(one.poses).all()
    assert np.abs(one.poses - other.poses).max() > 1e-3
    deaf, strong = (
        draw_conditions(system, SPEECH, replace(OPTIONS, guidance=g))[0] for g in (0.0, 4.0)
    )
    assert deaf != strong


def test_what_cannot_be_planned_or_streamed_is_refused(system, weights):
    with pytest.raises(ValueError, match="2 conditions for 3 samples"):
        replace(OPTIONS, num_samples=3, conditions=(made_plan(), made_plan()))
    other = load_system("globaldiff/local", weights)
    with pytest.raises(ValueError, match="takes no condition besides speech"):
        generate_motion(other, SPEECH, replace(OPTIONS, conditions=(made_plan(),)))
    with pytest.raises(ValueError, match="takes no condition besides speech"):
        draw_conditions(other, SPEECH, OPTIONS)


def test_what_was_trained_performs(root, annotated_folder, tmp_path):
    for name in ("expression", PLANNER, PLANNED):
        changes = {"plan_dropout": 0.5} if name == "expression" else {}
        out = run(quick(name, **changes), annotated_folder, root / name.replace("/", "-"))
        for path in (out / "weights").iterdir():
            shutil.copy(path, tmp_path)
    system = load_system(PLANNED, tmp_path)
    assert system.face.network.plan.out.weight.any()
    assert system.condition_type is GesturePlan and system.speakers == {"ann": 1, "bob": 2}
    card = json.loads((tmp_path / "planner.json").read_text())
    assert card["validation"]["right"] > 0 and card["validation"]["right mark"] != 0


def test_data_without_plans_is_refused_in_a_sentence(root, data_folder):
    with pytest.raises(DataError, match="1_ann_0_0_0 has no annotated plan"):
        run(quick(PLANNER), data_folder, root / "none" / "out")


def test_windows_of_plans_are_those_of_their_clips_and_keep_time_with_faster_copies(
    root, annotated_folder
):
    data = prepare(annotated_folder, root / "copies", MelEncoder(), augmented_copies=1)
    plans = load_plan_annotations(data, 4)
    clips = data.clips_of_split("train")
    batch = data.draw_windows(clips, 60, 8, np.random.default_rng(0), context=5)
    tracks, kinds = plans.tracks_and_kinds(batch, 5)
    assert tracks.shape == (8, 70, 29) and kinds.shape == (8, 70, 2)
    np.testing.assert_array_equal(tracks[:, 5:-5], plans.tracks[batch.frame_rows])
    at_start = batch.frame_rows.copy()
    at_start[0] = clips[-1].start + np.arange(60)
    held, _ = plans.tracks_and_kinds(replace(batch, frame_rows=at_start), 5)
    np.testing.assert_array_equal(held[0, :6], np.repeat(plans.tracks[[clips[-1].start]], 6, 0))
    assert set(np.unique(plans.kinds[: data.clips[0].stop])) == {
        0,
        plans.kind_table.number_or_zero("offer"),
    }
    events = plans.events(batch)
    assert events.event["right"].shape == (8, 60)
    for row, frames in enumerate(batch.frame_rows):
        clip = next(k for k, c in enumerate(data.clips) if c.start <= frames[0] < c.stop)
        begins = [b.frame + data.clips[clip].start for b in plans.chains[clip]["right"][1:]]
        expected = [frame in begins for frame in frames]
        assert (events.event["right"][row] > 0).tolist() == expected
    plain, copy = (next(k for k, c in enumerate(data.clips) if c.copy == n) for n in (0, 1))
    assert data.clips[plain].name == data.clips[copy].name
    speed = data.clips[plain].num_frames / data.clips[copy].num_frames
    for one, other in zip(plans.chains[plain]["right"], plans.chains[copy]["right"], strict=True):
        assert other.frame == pytest.approx(one.frame / speed, abs=1.5)
