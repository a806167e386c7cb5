"""Training of the generator against the discriminator: two steps, and each loss by itself."""

import shutil
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from model.data.prepared import Batch, PreparedData, prepare
from model.speech.features import MelEncoder
from model.storage.cards import BUNDLED_WEIGHTS
from model.storage.checkpoint import load_weights
from model.systems.gan import task as module
from model.systems.gan.config import (
    TRAINING_STEP_COUNTS,
    WEIGHTS,
)
from model.systems.gan.network import Discriminator, Generator
from model.systems.gan.task import DenoisingBatch, GanTask, make_task
from model.systems.registry import load_system
from model.training.parallel import UNSHARDED, ShardedRandom
from model.training.task import Task, TaskSetup
from tests.model.training.made import (
    assert_equal_states,
    log_of,
    quick,
    run,
)


@pytest.fixture(scope="module")
def trained(tmp_path_factory, data_folder):
    """A whole training of two steps."""
    return run(quick(WEIGHTS), data_folder, tmp_path_factory.mktemp("gan") / "whole")


@pytest.fixture(scope="module")
def data(trained, data_folder) -> PreparedData:
    return prepare(data_folder, trained.with_name("prepared-mel64"), MelEncoder())


@pytest.fixture(scope="module")
def task(data) -> GanTask:
    """Never stepped."""
    return make_task(quick(WEIGHTS), data, TaskSetup(BUNDLED_WEIGHTS))


@pytest.fixture
def batch(data, task) -> Batch:
    rng, clips = np.random.default_rng(0), data.clips_of_split("train")
    return data.draw_windows(clips, 60, 8, rng, context=task.context_frames)


def networks_of(task: GanTask) -> tuple[Generator, Discriminator]:
    return task.network, task.discriminator


def drawn_by(task: GanTask, batch: Batch, seed: int) -> DenoisingBatch:
    draws = ShardedRandom(len(batch.clip_names), torch.Generator().manual_seed(seed), UNSHARDED)
    return task.draw(task.network, batch, draws)


@pytest.fixture
def changed(data, trained) -> Callable[..., GanTask]:
    """Tasks of other settings, which begin with the same weights."""
    setup = TaskSetup(BUNDLED_WEIGHTS, trained / "weights")
    return lambda **changes: make_task(quick(WEIGHTS, **changes), data, setup)


def test_each_network_descends_its_own_loss_at_its_own_rate(task, batch, changed):
    assert isinstance(task, Task)
    rates = [optimizer.param_groups[0]["lr"] for optimizer in (task.optimizer, task.judging)]
    assert rates == [task.config.learning_rate, task.config.discriminator_learning_rate]
    assert rates[0] != rates[1]
    for frozen, moving in ((0, 1), (1, 0)):
        name = "learning_rate" if frozen == 0 else "discriminator_learning_rate"
        other = changed(**{name: 0.0, "weight_decay": 0.0})
        before = [[p.clone() for p in network.parameters()] for network in networks_of(other)]
        other.step(0, batch, torch.Generator().manual_seed(0))
        after = [list(network.parameters()) for network in networks_of(other)]
        assert all(torch.equal(a, b) for a, b in zip(before[frozen], after[frozen], strict=True))
        assert any(
            not torch.equal(a, b) for a, b in zip(before[moving], after[moving], strict=True)
        )


def test_real_steps_are_the_chains_and_every_number_of_steps_is_trained(task, batch):
    seen = set()
    for seed in range(40):
        drawn = drawn_by(task, batch, seed)
        gaps = drawn.t - drawn.s
        seen |= {round(1 / float(gap)) for gap in gaps}
        assert (drawn.t <= 1).all() and (drawn.s >= -1e-6).all()
        ends = drawn.s.abs() < 1e-6
        torch.testing.assert_close(drawn.x_s[ends], drawn.x_0[ends], rtol=1e-3, atol=1e-3)
    assert seen == set(TRAINING_STEP_COUNTS)


def test_the_penalty_is_descended_by_the_discriminator_alone(task, batch, changed):
    usual = changed()
    without = changed(loss=replace(usual.config.loss, gradient_penalty=0.0))
    for one in (usual, without):
        one.step(0, batch, torch.Generator().manual_seed(0))
    assert_equal_states(usual.network.state_dict(), without.network.state_dict())
    weights = (one.discriminator.score.weight for one in (usual, without))
    assert not torch.equal(*weights)


def test_a_loss_that_is_no_number_changes_nothing(task, batch, monkeypatch, changed):
    task = changed()
    before = [p.clone() for network in networks_of(task) for p in network.parameters()]
    monkeypatch.setattr(module, "generator_loss", lambda fake: fake * float("nan"))
    with pytest.raises(FloatingPointError, match="adversarial is nan at step 0"):
        task.step(0, batch, torch.Generator().manual_seed(0))
    after = [p for network in networks_of(task) for p in network.parameters()]
    assert all(torch.equal(a, b) for a, b in zip(before, after, strict=True))


def test_training_leaves_weights_that_load_and_a_log_of_both_sides(trained, weights, tmp_path):
    for file in (*(trained / "weights").iterdir(), *weights.glob("expression.*")):
        shutil.copy(file, tmp_path)
    system = load_system("gan/10", tmp_path)
    assert system.speakers == {"ann": 1, "bob": 2}
    rows = log_of(trained, "train")
    for column in ("score_real", "score_fake", "accuracy_real", "accuracy_fake",
                   "gradient_penalty", "discriminator", "liveliness"):  # fmt: skip
        assert all(np.isfinite(float(row[column])) for row in rows)
    row = rows[0]
    terms = ["simple", "position", "velocity", "acceleration", "contact", "spread", "adversarial"]
    total = sum(float(row[name]) for name in terms)
    assert total == pytest.approx(float(row["total"]), rel=1e-4)
    card = system.card
    assert card["config"]["loss"]["terms"]["velocity"] == 15.0 and card["validation"]["total"] > 0
    assert not any("discriminator" in name for name in load_weights(tmp_path, WEIGHTS)[0])


def test_errors_on_a_batch_fall(batch, changed):
    task = changed(steps=10**6, learning_rate=2e-3)
    found = [task.step(k, batch, torch.Generator().manual_seed(0)) for k in range(8)]
    assert found[-1]["simple"] < 0.9 * found[0]["simple"]
    assert found[-1]["discriminator"] < found[0]["discriminator"]
