import math
from dataclasses import replace

import pytest
import torch

from conventions.joints import FACE as FACE_JOINTS
from model.systems.asynfusion.config import DDIM, INTERACTIONS, LCM_SYNC, named_config
from model.systems.asynfusion.sampling import flow_times
from model.systems.asynfusion.task import (
    draw_steps,
    foot_terms,
    make_task,
    noise_terms,
    one_solver_step,
    pseudo_huber,
)
from model.systems.registry import load_system
from model.train import main
from model.training import losses
from model.training.loop import train
from tests.model.made import make_data_folder
from tests.model.systems.asynfusion.made import (
    BODY,
    made_conditions,
    made_pair,
    made_streams,
    tiny_network,
)
from tests.model.training.made import killed_at

MEAN_WEIGHT = math.atan(1 / math.sqrt(0.1)) / math.sqrt(0.1)
"""Of 1 / ((1 - t)^2 + .1) over t."""


def command(data, out, system, *more):
    return main(
        ["smoke", "--system", system, "--data", str(data), "--out", str(out), "--no-compile", *more]
    )


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Data, the teacher's run, and the student's."""
    root = tmp_path_factory.mktemp("trained")
    data = make_data_folder(root / "data")
    assert command(data, root / "teacher", DDIM, "--steps", "12") == 0
    helpers = ["--helpers", str(root / "teacher" / "weights")]
    assert command(data, root / "student", LCM_SYNC, "--steps", "6", *helpers) == 0
    return data, root / "teacher", root / "student"


def test_teacher_and_student_are_systems(trained):
    _, teacher, student = trained
    assert not load_system(DDIM, teacher / "weights").network.consistent
    for name in (LCM_SYNC, "asynfusion/lcm-async"):
        assert load_system(name, student / "weights").network.consistent


def test_the_student_begins_as_its_teacher(trained, tmp_path):
    data, teacher, _ = trained
    helpers = ["--helpers", str(teacher / "weights")]
    assert command(data, tmp_path / "run", LCM_SYNC, "--steps", "1", *helpers) == 0
    taught = load_system(DDIM, teacher / "weights").network.state_dict()
    begun = load_system(LCM_SYNC, tmp_path / "run" / "weights").network.state_dict()
    for name, tensor in taught.items():
        torch.testing.assert_close(begun[name], tensor, atol=1e-3, rtol=1e-2)


@pytest.mark.parametrize("system", [DDIM, LCM_SYNC])
def test_a_killed_and_resumed_run_equals_one_that_was_not(trained, tmp_path, system):
    data, teacher, _ = trained
    config = replace(named_config("smoke", system), steps=6, save_every=3, batch_size=2)

    def run(name: str, **options) -> dict:
        train(config, make_task, data, tmp_path / name, helpers=teacher / "weights", **options)
        return torch.load(tmp_path / name / "state.pt", weights_only=True)

    whole = run("whole")
    with killed_at(5):
        run("killed")
    resumed = run("killed", resume=True)
    assert resumed["step"] == whole["step"] == 6
    for name, tensor in whole["average"].items():
        assert torch.equal(resumed["average"][name], tensor), name


def test_a_student_without_a_teacher_is_told_what_is_missing(trained, tmp_path, capsys):
    data, _, _ = trained
    (tmp_path / "empty").mkdir()
    more = ["--helpers", str(tmp_path / "empty")]
    assert command(data, tmp_path / "run", LCM_SYNC, *more) == 1
    assert "asynfusion-ddim.json is missing" in capsys.readouterr().err


def test_branches_stand_at_steps_of_their_own_in_a_share_of_the_samples():
    generator = torch.Generator().manual_seed(0)
    config = named_config("demo", DDIM)
    face, body = draw_steps(4000, config, generator)
    assert 0.45 < float((face != body).float().mean()) < 0.55
    assert int(body.min()) == 0 and int(body.max()) == 999
    face, body = draw_steps(500, replace(config, apart=0.0), generator)
    assert torch.equal(face, body)
    assert int(draw_steps(4000, named_config("demo", LCM_SYNC), generator)[1].min()) == 20


def test_the_terms_are_equations_12_to_14():
    normaliser = made_streams()[1].normaliser
    weights = named_config("demo", DDIM).loss
    torch.manual_seed(0)
    x_1, noise, told = torch.randn(3, 2, 5, BODY)
    t = torch.tensor([0.25, 0.5])
    x_t = (1 - t)[:, None, None] * noise + t[:, None, None] * x_1
    terms = noise_terms(weights, normaliser, x_t, told, x_1, noise, t)
    for k in range(2):
        eps = (x_t[k] - t[k] * told[k]) / (1 - t[k])
        wanted = 10 * ((noise[k] - eps) ** 2).mean()
        torch.testing.assert_close(terms["noise"][k], wanted)
        error = (told[k] - x_1[k]) @ normaliser.unmix
        small = error.abs() < 1
        huber = torch.where(small, error**2 / 2, error.abs() - 0.5).mean()
        torch.testing.assert_close(terms["huber"][k], huber, rtol=1e-4, atol=1e-5)
        torch.testing.assert_close(terms["velocity"][k], (error.diff(dim=0) ** 2).mean())
    exact = noise_terms(weights, normaliser, x_t, x_1, x_1, noise, t)
    assert all(float(term.max()) < 1e-8 for term in exact.values())


def test_feet_are_held_where_they_stand_and_the_more_so_the_nearer_to_the_data():
    weights = replace(named_config("demo", DDIM).loss, feet=2.0, contact=3.0)
    recorded = torch.zeros(2, 5, 55, 3)
    slid = recorded.clone()
    slid[:, :, losses.FEET[0], 0] = 0.001 * torch.arange(5)  # a millimetre a frame
    terms = foot_terms(weights, slid, recorded, torch.tensor([0.0, 1.0]))
    early, late = (1 / ((1 - t) ** 2 + 0.1) / MEAN_WEIGHT for t in (0.0, 1.0))
    assert float(terms["contact"][0]) == pytest.approx(3 * 0.1**2 / 4 * early, rel=1e-3)
    assert float(terms["contact"][1]) == pytest.approx(3 * 0.1**2 / 4 * late, rel=1e-3)
    step = 0.001**2 / (2 * losses.SMOOTH_L1_BETA) / 12
    assert float(terms["feet"][1]) == pytest.approx(2 * step * late, rel=1e-3)
    other = recorded.clone()
    other[:, :, 20, 0] = 0.01 * torch.arange(5)  # a hand
    assert not any(t.any() for t in foot_terms(weights, other, recorded, torch.rand(2)).values())


@pytest.mark.parametrize("system", [DDIM, LCM_SYNC])
def test_the_terms_on_feet_are_a_switch(trained, tmp_path, system):
    data, teacher, _ = trained
    more = ["--helpers", str(teacher / "weights"), "--steps", "2"]
    assert command(data, tmp_path / "run", system, *more, "--set", "loss.contact=1") == 0
    told = (tmp_path / "run" / "log.csv").read_text().splitlines()[0]
    assert "contact" in told
    usual = (teacher / "log.csv").read_text().splitlines()[0]
    assert "contact" not in usual and "feet" not in usual


@pytest.mark.parametrize("strength", [1.0, 2.5])
def test_a_student_agrees_with_itself_after_a_step_of_its_guided_teacher(strength):
    config = replace(named_config("demo", LCM_SYNC), teacher_guidance=strength)
    teacher, student = tiny_network(), tiny_network(consistent=True)
    normaliser = made_streams()[1].normaliser
    x_t, seed = made_pair(), made_pair(seed=2)
    conditions = made_conditions() | {"seed": (seed[0][:, :8], seed[1][:, :8])}
    steps = torch.tensor([500, 700]), torch.tensor([500, 300])
    found = one_solver_step(config, student, teacher, normaliser, x_t, steps, conditions)

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


def test_every_interaction_is_a_setting():
    for interaction in INTERACTIONS:
        config = named_config("small", DDIM)
        assert replace(config.network, interaction=interaction).interaction == interaction
    with pytest.raises(ValueError, match="no config 'huge'; choose one of demo, small"):
        named_config("huge", DDIM)
