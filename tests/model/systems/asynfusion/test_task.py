"""The teacher's and the student's losses against the papers' equations, and short trainings."""

from dataclasses import replace

import pytest
import torch

from conventions.joints import FACE as FACE_JOINTS
from model.data.prepared import prepare
from model.speech.features import MelEncoder
from model.storage.cards import CheckpointError
from model.systems.asynfusion.config import DDIM, LCM_SYNC, presets
from model.systems.asynfusion.system import flow_times
from model.systems.asynfusion.task import (
    consistency_target,
    draw_steps,
    make_task,
    noise_training_terms,
    pseudo_huber,
)
from model.systems.registry import load_system
from model.training.task import TaskSetup
from tests.model.systems.asynfusion.made import (
    BODY,
    made_conditions,
    made_pair,
    made_streams,
    tiny_network,
)
from tests.model.training.made import (
    quick,
    run,
)


@pytest.fixture(scope="module")
def trained(tmp_path_factory, data_folder):
    """The teacher's run, and the student's."""
    root = tmp_path_factory.mktemp("trained")
    teacher = run(quick(DDIM), data_folder, root / "teacher")
    return teacher, run(quick(LCM_SYNC), data_folder, root / "student", teacher / "weights")


def test_branches_stand_at_steps_of_their_own_in_a_share_of_the_samples():
    generator = torch.Generator().manual_seed(0)
    config = presets(DDIM)["demo"]
    face, body = draw_steps(4000, config, generator)
    assert 0.45 < float((face != body).float().mean()) < 0.55
    assert int(body.min()) == 0 and int(body.max()) == 999
    face, body = draw_steps(500, replace(config, independent_steps_share=0.0), generator)
    assert torch.equal(face, body)
    assert int(draw_steps(4000, presets(LCM_SYNC)["demo"], generator)[1].min()) == 20


def test_the_terms_are_equations_12_to_14():
    normaliser = made_streams()[1].normaliser
    weights = presets(DDIM)["demo"].loss
    torch.manual_seed(0)
    x_1, noise, told = torch.randn(3, 2, 5, BODY)
    t = torch.tensor([0.25, 0.5])
    x_t = (1 - t)[:, None, None] * noise + t[:, None, None] * x_1
    terms = noise_training_terms(weights, normaliser, x_t, told, x_1, noise, t)
    for k in range(2):
        eps = (x_t[k] - t[k] * told[k]) / (1 - t[k])
        wanted = 10 * ((noise[k] - eps) ** 2).mean()
        torch.testing.assert_close(terms["noise"][k], wanted)
        error = (told[k] - x_1[k]) @ normaliser.unmix
        small = error.abs() < 1
        huber = torch.where(small, error**2 / 2, error.abs() - 0.5).mean()
        torch.testing.assert_close(terms["huber"][k], huber, rtol=1e-4, atol=1e-5)
        torch.testing.assert_close(terms["velocity"][k], (error.diff(dim=0) ** 2).mean())
    exact = noise_training_terms(weights, normaliser, x_t, x_1, x_1, noise, t)
    assert all(float(term.max()) < 1e-8 for term in exact.values())


@pytest.mark.parametrize("strength", [1.0, 2.5])
def test_a_student_agrees_with_itself_after_a_step_of_its_guided_teacher(strength):
    config = replace(presets(LCM_SYNC)["demo"], teacher_guidance=strength)
    teacher, student = tiny_network(), tiny_network(consistent=True)
    normaliser = made_streams()[1].normaliser
    x_t, seed = made_pair(), made_pair(seed=2)
    conditions = made_conditions() | {"seed": (seed[0][:, :8], seed[1][:, :8])}
    steps = torch.tensor([500, 700]), torch.tensor([500, 300])
    found = consistency_target(config, student, teacher, normaliser, x_t, steps, conditions)
    times = flow_times()
    t, earlier = ((times[face - k], times[body - k]) for k in (0, 20) for face, body in [steps])
    heard = teacher(x_t, t, **conditions)
    deaf = teacher(x_t, t, **conditions | {"has_speech": torch.zeros(2, dtype=torch.bool)})
    with_speech, without = (normaliser.restore(each[1]) for each in (heard, deaf))
    body = without + strength * (with_speech - without)
    jaw = [3 * joint + k for joint in FACE_JOINTS for k in range(3)]
    body[..., jaw] = with_speech[..., jaw]
    moved = []
    for k, clean in enumerate((heard[0], normaliser.normalise(body))):
        now, then = t[k][:, None, None], earlier[k][:, None, None]
        noise = (x_t[k] - now * clean) / (1 - now)
        moved.append((1 - then) * noise + then * clean)
    wanted = student(tuple(moved), earlier, **conditions)
    for one, other in zip(found, wanted, strict=True):
        torch.testing.assert_close(one, other, atol=2e-4, rtol=1e-3)


def test_consistency_is_zero_for_equal_windows_and_grows_like_a_distance():
    a = torch.randn(3, 5, 4)
    assert not pseudo_huber(a, a).any()
    torch.testing.assert_close(pseudo_huber(a, a + 2), torch.full((3,), 1.9702), atol=1e-3, rtol=0)


def test_teacher_and_student_are_systems(trained):
    teacher, student = trained
    assert not load_system(DDIM, teacher / "weights").network.consistent
    for name in (LCM_SYNC, "asynfusion/lcm-async"):
        assert load_system(name, student / "weights").network.consistent


def test_the_student_begins_as_its_teacher(trained, data_folder, tmp_path):
    teacher, student = trained
    data = prepare(data_folder, student.with_name("prepared-mel64"), MelEncoder())
    usual = quick(LCM_SYNC)
    task = make_task(usual, data, TaskSetup(teacher / "weights"))
    taught = load_system(DDIM, teacher / "weights").network.state_dict()
    for name, tensor in task.network.state_dict().items():
        assert torch.equal(tensor, taught[name]), name
    with pytest.raises(CheckpointError, match=r"asynfusion-ddim\.json is missing"):
        make_task(usual, data, TaskSetup(tmp_path))
