import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from model.data.prepared import Batch, prepare
from model.speech.features import MelEncoder
from model.storage.cards import BUNDLED_WEIGHTS, CheckpointError
from model.storage.checkpoint import load_weights
from model.systems.gan import adversary
from model.systems.gan.config import STEP_COUNTS, WEIGHTS, GanConfig, named_config
from model.systems.gan.task import GanTask, make_task
from model.systems.registry import family_of, load_system
from model.train import main
from model.training.config import TrainConfig
from model.training.loop import train
from model.training.parallel import WHOLE
from model.training.run_folder import TrainingError
from model.training.task import Start, Task, TaskSetup
from tests.model.made import make_data_folder
from tests.model.systems.gan.made_generator import make_gan_weights
from tests.model.training.made import killed_at, log_of, train_in_two_processes


def quick(**changes) -> GanConfig:
    few = {"steps": 6, "save_every": 3, "validate_every": 6, "warmup_steps": 2, "batch_size": 2}
    return replace(named_config("smoke", WEIGHTS), **{**few, **changes})


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    root = tmp_path_factory.mktemp("training")
    make_data_folder(root / "data")
    return root


def run(root, name: str, config: TrainConfig, **options) -> dict:
    family = family_of(config.system)
    train(config, family.make_task, root / "data", root / name, helpers=BUNDLED_WEIGHTS, **options)
    return torch.load(root / name / "state.pt", weights_only=True)


def task_of(root, config: GanConfig) -> tuple[GanTask, Batch]:
    data = prepare(root / "data", root / "prepared-mel64", MelEncoder())
    task = make_task(config, data, TaskSetup(BUNDLED_WEIGHTS))
    batch = data.window_batch(
        data.of_split("train"), 60, 8, np.random.default_rng(0), context=task.context
    )
    return task, batch


def test_training_leaves_weights_that_load_and_a_log_of_both_sides(root):
    run(root, "first", quick())
    weights = root / "first" / "weights"
    for file in make_gan_weights(root / "others").glob("expression.*"):
        (weights / file.name).write_bytes(file.read_bytes())
    assert load_system("gan/10", weights).speakers == {"ann": 1, "bob": 2}
    rows = log_of(root / "first", "train")
    for column in ("score_real", "score_fake", "accuracy_real", "accuracy_fake",
                   "gradient_penalty", "discriminator", "adversarial", "liveliness"):  # fmt: skip
        assert all(np.isfinite(float(row[column])) for row in rows)
    terms = ["simple", "position", "velocity", "acceleration", "contact", "spread", "adversarial"]
    total = sum(float(rows[0][name]) for name in terms)
    assert total == pytest.approx(float(rows[0]["total"]), rel=1e-4)
    card = json.loads((weights / "gan-20.json").read_text())
    assert card["config"]["loss"]["terms"]["velocity"] == 15.0 and card["validation"]["total"] > 0
    assert not any("discriminator" in name for name in load_weights(weights, WEIGHTS)[0])


def test_a_killed_and_resumed_run_equals_one_that_was_not(root):
    """In fp32: bf16 would blow the order in which sums are taken up to something that is seen."""
    config, shard = quick(), replace(WHOLE, bf16=False)
    whole = run(root, "whole", config, shard=shard)

    with killed_at(5):
        run(root, "killed", config, shard=shard)
    resumed = run(root, "killed", config, resume=True, shard=shard)
    assert resumed["step"] == whole["step"] == 6
    for part in ("generator", "discriminator", "average"):
        assert all(torch.equal(whole[part][k], resumed[part][k]) for k in whole[part])
    for one, other in zip(whole["optimizers"], resumed["optimizers"], strict=True):
        for k, moments in one["state"].items():
            assert all(torch.equal(moments[m], other["state"][k][m]) for m in moments)
    assert whole["watch"] == resumed["watch"] and whole["watch"]["accuracy_real"] != 0.5


def test_each_network_descends_its_own_loss_at_its_own_rate(root):
    task, batch = task_of(root, quick(warmup_steps=0))
    assert isinstance(task, Task)
    rates = [optimizer.param_groups[0]["lr"] for optimizer in task.optimizers]
    assert rates == [task.config.learning_rate, task.config.discriminator_learning_rate]
    assert rates[0] != rates[1]
    for frozen, moving in ((0, 1), (1, 0)):
        name = "learning_rate" if frozen == 0 else "discriminator_learning_rate"
        task, batch = task_of(root, quick(**{name: 0.0, "weight_decay": 0.0}))
        before = [[p.clone() for p in network.parameters()] for network in task.networks]
        task.step(0, batch, torch.Generator().manual_seed(0))
        after = [list(network.parameters()) for network in task.networks]
        assert all(torch.equal(a, b) for a, b in zip(before[frozen], after[frozen], strict=True))
        assert any(
            not torch.equal(a, b) for a, b in zip(before[moving], after[moving], strict=True)
        )


def test_real_steps_are_the_chains_and_every_number_of_steps_is_trained(root):
    task, batch = task_of(root, quick())
    seen = set()
    for seed in range(40):
        drawn = task.draw(task.generator, batch, torch.Generator().manual_seed(seed))
        gaps = drawn.now - drawn.before
        seen |= {round(1 / float(gap)) for gap in gaps}
        assert (drawn.now <= 1).all() and (drawn.before >= -1e-6).all()
        ends = drawn.before.abs() < 1e-6
        torch.testing.assert_close(drawn.x_before[ends], drawn.x_0[ends], rtol=1e-3, atol=1e-3)
    assert seen == set(STEP_COUNTS)


def test_the_right_answer_steps_back_to_the_data(root):
    """With x_0 itself for the generator's, fake and real steps have the same mean and spread."""
    task, batch = task_of(root, quick())
    errors = []
    for seed in range(30):
        drawn = task.draw(task.generator, batch, torch.Generator().manual_seed(seed))
        errors.append((task.step_back(drawn.x_0, drawn) - drawn.x_before).mean((1, 2)))
    found = torch.cat(errors)
    assert abs(float(found.mean())) < 4 * float(found.std()) / len(found) ** 0.5


def test_weight_zero_leaves_the_adversary_alone(root):
    loss = replace(GanConfig(WEIGHTS).loss, geometric=0.0)
    task, batch = task_of(root, quick(loss=loss))
    logged = task.step(0, batch, torch.Generator().manual_seed(0))
    assert "simple" not in logged and logged["total"] == pytest.approx(logged["adversarial"])
    assert logged["gradient_norm"] > 0


def test_without_branches_latent_or_differences_it_trains_too(root):
    shape = replace(quick().generator, decoupled=False, latent=False)
    terms = replace(
        GanConfig(WEIGHTS).loss.terms, position=0.0, velocity=0.0, acceleration=0.0, contact=0.0
    )
    config = quick(generator=shape, loss=replace(GanConfig(WEIGHTS).loss, terms=terms), steps=2)
    run(root, "plain", config)
    (row, *_) = log_of(root / "plain")
    assert float(row["total"]) == pytest.approx(float(row["simple"]))


def test_errors_on_a_batch_fall(root):
    task, batch = task_of(root, quick(warmup_steps=0, steps=60, learning_rate=2e-3))
    errors = []
    for number in range(30):
        generator = torch.Generator().manual_seed(number % 3)
        errors.append(task.step(number, batch, generator)["simple"])
    assert np.mean(errors[-3:]) < 0.8 * np.mean(errors[:3])


def test_a_planted_collapse_stops_with_a_sentence_and_keeps_the_state(root, monkeypatch, capsys):
    """A generator that is wrecked after the first save is told apart at once."""
    monkeypatch.setattr(adversary, "PATIENCE", 20)
    monkeypatch.setattr(adversary, "MEMORY", 0.5)
    import model.systems.gan.task as module

    real = module.Generator.drawn

    def wrecked(self, mean, deviation, latent, has_seed):
        return real(self, mean, deviation, latent, has_seed) + 30.0

    monkeypatch.setattr(module.Generator, "drawn", wrecked)
    command = ["smoke", "--system", WEIGHTS, "--data", str(root / "data"), "--steps", "400"]
    assert main([*command, "--out", str(root / "collapsed"), "--no-compile"]) == 1
    message = capsys.readouterr().err.splitlines()[-1]
    assert "has collapsed at step" in message and "Lower its learning rate" in message
    state = torch.load(root / "collapsed" / "state.pt", weights_only=True)
    assert 0 < state["step"] < 400


def test_a_loss_that_is_no_number_changes_nothing(root, monkeypatch):
    task, batch = task_of(root, quick())
    before = [p.clone() for network in task.networks for p in network.parameters()]
    import model.systems.gan.task as module

    monkeypatch.setattr(module, "generator_loss", lambda fake: fake * float("nan"))
    with pytest.raises(FloatingPointError, match="adversarial is nan at step 0"):
        task.step(0, batch, torch.Generator().manual_seed(0))
    after = [p for network in task.networks for p in network.parameters()]
    assert all(torch.equal(a, b) for a, b in zip(before, after, strict=True))


def test_a_training_begins_with_given_weights_and_their_statistics(root):
    run(root, "base", quick())
    start = Start(root / "base" / "weights", WEIGHTS)
    frozen = {"learning_rate": 0.0, "weight_decay": 0.0, "steps": 1}
    run(root, "onward", quick(**frozen), start=start)
    before, after = (
        load_weights(root / name / "weights", WEIGHTS)[0] for name in ("base", "onward")
    )
    assert all(torch.equal(before[k], after[k]) for k in before)


def test_weights_of_another_size_are_refused(root):
    run(root, "small", quick(steps=1))
    wide = replace(quick().generator, width=64)
    with pytest.raises(CheckpointError, match="do not fit their card"):
        run(root, "wide", quick(generator=wide), start=Start(root / "small" / "weights", WEIGHTS))


def test_resuming_with_other_settings_names_them(root):
    run(root, "settled", quick())
    with pytest.raises(TrainingError, match=r"\(betas, loss.geometric\)"):
        changed = quick(betas=(0.0, 0.9), loss=replace(quick().loss, geometric=1.0))
        run(root, "settled", changed, resume=True)


@pytest.mark.slow  # as the motion autoencoder of tests/model/training/test_parallel.py
def test_two_processes_train_as_one_does(root):
    """Both networks' gradients are averaged: same losses, same weights, up to rounding."""
    arguments = ["smoke", "--system", WEIGHTS, "--steps", "4", "--data", str(root / "data")]
    arguments += ["--fp32", "--no-compile"]
    assert main([*arguments, "--out", str(root / "one")]) == 0
    train_in_two_processes(arguments, root / "two")
    for row, other in zip(log_of(root / "one"), log_of(root / "two"), strict=True):
        for column in ("total", "simple", "discriminator", "gradient_penalty", "score_real"):
            if row[column]:
                wanted = pytest.approx(float(row[column]), rel=1e-3, abs=1e-5)
                assert float(other[column]) == wanted
    states = [torch.load(root / name / "state.pt", weights_only=True) for name in ("one", "two")]
    for part in ("generator", "discriminator"):
        for key, tensor in states[0][part].items():
            torch.testing.assert_close(states[1][part][key], tensor, rtol=1e-2, atol=2e-4)


def test_presets_are_named():
    assert named_config("demo", WEIGHTS).generator.width == 96
    assert named_config("small", WEIGHTS).generator.width == 64
    with pytest.raises(ValueError, match="no config 'large'; choose one of demo, small, smoke"):
        named_config("large", WEIGHTS)
