"""Trainings by the command and by the loop: what they leave, how they go on, what they refuse."""

import errno
import json
import shutil
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.utils._pytree import tree_leaves

from model.data.prepared import PreparedData, prepare
from model.data.recordings import DataError
from model.networks.autoencoder import load_motion_encoder
from model.speech.encoder import SpeechEncoderConfig
from model.speech.features import MelEncoder
from model.storage.cards import BUNDLED_WEIGHTS, CheckpointError, to_json
from model.storage.checkpoint import load_weights, save_weights
from model.systems.globaldiff.config import PRIORFLOW
from model.systems.helpers.config import MOTION_VAE
from model.systems.planned.config import PLANNED, PLANNER
from model.systems.registry import family_of, load_system
from model.train import main
from model.training.loop import TrainingError
from model.training.parallel import UNSHARDED, Shard, ShardedRandom
from model.training.task import SingleNetworkTask, TaskSetup
from tests.model.training.made import (
    assert_equal_states,
    killed_at,
    log_of,
    quick,
    run,
    state_of,
)

SLOW = pytest.mark.slow


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("training")


@pytest.fixture(scope="module")
def trained(root, annotated_folder) -> Callable[[str], Path]:
    """The folder of a whole training of two steps by its system, made once."""
    return cache(
        lambda system: run(quick(system), annotated_folder, root / system.replace("/", "-"))
    )


@pytest.fixture(scope="module")
def data(root, annotated_folder) -> PreparedData:
    return prepare(annotated_folder, root / "prepared-mel64", MelEncoder())


@pytest.mark.parametrize("system", ["globaldiff/global", pytest.param(PRIORFLOW, marks=SLOW)])
def test_a_training_leaves_weights_that_load_a_card_and_a_log(trained, weights, tmp_path, system):
    for file in (*(trained(system) / "weights").iterdir(), *weights.glob("expression.*")):
        shutil.copy(file, tmp_path)
    loaded = load_system(system, tmp_path)
    assert loaded.speakers == {"ann": 1, "bob": 2}
    card = loaded.card
    assert card["config"] == json.loads(to_json(quick(system)))
    assert card["steps"] == 2 and card["training_hours"] == 0.002  # 240 frames
    assert card["started_from"] is None and not card["started_from_bundled_weights"]
    rows = log_of(trained(system))
    assert [(r["step"], r["split"]) for r in rows] == [("1", "train"), ("2", "val"), ("2", "train")]
    assert card["validation"]["total"] == pytest.approx(float(rows[1]["total"]), abs=1e-6) != 0


@pytest.mark.parametrize(
    "system",
    [
        "globaldiff/global",
        *(pytest.param(s, marks=SLOW) for s in (PRIORFLOW, "expression", "gan/20")),
    ],
)
def test_a_killed_and_resumed_run_equals_one_that_was_not(trained, root, annotated_folder, system):
    out = root / f"killed-{system.replace('/', '-')}"
    with killed_at(1):
        run(quick(system), annotated_folder, out)
    assert state_of(out)["step"] == 1
    run(quick(system), annotated_folder, out, resume=True)
    assert state_of(out)["step"] == 2
    assert_equal_states(state_of(out), state_of(trained(system)))
    assert log_of(out) == log_of(trained(system))


def test_other_settings_and_folders_are_not_resumed(trained, root, annotated_folder):
    out = trained("globaldiff/global")
    changed = quick("globaldiff/global", learning_rate=1.0, batch_size=3)
    with pytest.raises(TrainingError, match=r"\(batch_size, learning_rate\)"):
        run(changed, annotated_folder, out, resume=True)
    with pytest.raises(TrainingError, match="holds a run already"):
        run(quick("globaldiff/global"), annotated_folder, out)
    with pytest.raises(TrainingError, match=r"no .* to resume"):
        run(quick("globaldiff/global"), annotated_folder, root / "nothing", resume=True)


def test_the_command_begins_with_given_weights_and_their_statistics_and_keeps_them(
    trained, root, annotated_folder
):
    """Also when it is resumed without being told again."""
    given, card = load_weights(trained("globaldiff/global") / "weights", "globaldiff/global")
    given["normaliser.std"] *= 1.5  # as of another corpus
    old = {"config": card["config"], "steps": 9}
    save_weights(root / "other-corpus", "globaldiff/global", given, old)
    out = root / "onward"
    command = ["smoke", "--system", "globaldiff/global", "--no-compile"]
    command += ["--data", str(annotated_folder), "--out", str(out)]
    settings = "steps=2 learning_rate=0.0 weight_decay=0.0 batch_size=2 save_every=1"
    for setting in settings.split():
        command += ["--set", setting]
    with killed_at(1):
        main([*command, "--start-from", str(root / "other-corpus")])
    assert main([*command, "--resume"]) == 0
    found, card = load_weights(out / "weights", "globaldiff/global")
    for name, tensor in given.items():
        torch.testing.assert_close(found[name], tensor, rtol=1e-6, atol=1e-7)
    assert not card["started_from_bundled_weights"] and card["steps"] == 2
    origin = card["started_from"]
    assert (origin["system"], origin["steps"]) == ("globaldiff/global", 9)


def made_task(config, data: PreparedData, size: int = 4):
    task = family_of(config.system).make_task(config, data, TaskSetup(BUNDLED_WEIGHTS))
    rng = np.random.default_rng(0)
    clips = data.clips_of_split("train")
    return task, data.draw_windows(
        clips, task.window_frames, size, rng, context=task.context_frames
    )


class Told(Exception):
    """Holds what a network was told."""


class Asked(torch.nn.Module):
    def forward(self, *args, **kwargs):
        raise Told(args, kwargs)


EVERY = (
    "globaldiff/full",
    PRIORFLOW,
    "expression",
    "asynfusion/ddim",
    MOTION_VAE,
    PLANNER,
    PLANNED,
)


@pytest.mark.parametrize("system", [*EVERY, "gan/20", "hearing-judge"])
def test_shares_of_processes_add_up_on_their_device_and_a_loss_is_descended(
    data, system, monkeypatch
):
    """``meta`` stands for a GPU: it mixes with the processor as little."""
    config = quick(system, learning_rate=3e-3, steps=10**6)
    if system == PLANNER:
        config = replace(config, planner=replace(config.planner, codes=SpeechEncoderConfig.codes))
    task, batch = made_task(config, data, size=2)
    assert isinstance(task, SingleNetworkTask)

    def parts(shard: Shard) -> dict[str, torch.Tensor]:
        generator = torch.Generator().manual_seed(0)
        return task.loss_from_generator(task.network.train(), batch, generator, shard).parts

    if system in EVERY:
        whole, *shares = (parts(shard) for shard in (UNSHARDED, Shard(0, 2), Shard(1, 2)))
        for name, value in whole.items():
            mean = (shares[0][name] + shares[1][name]) / 2
            torch.testing.assert_close(mean, value, rtol=1e-3, atol=1e-6)
        found = [
            task.step(k, batch, torch.Generator().manual_seed(0))["total"]
            for k in range(3)  # the same draws each time
        ]
        assert found[-1] < found[0]
    monkeypatch.setattr(SingleNetworkTask, "make_optimizer", lambda *_: None)
    monkeypatch.setattr(Shard, "autocast", lambda _: nullcontext())
    shard = replace(UNSHARDED, device=torch.device("meta"))
    remote = family_of(system).make_task(config, data, TaskSetup(BUNDLED_WEIGHTS, shard=shard))
    assert isinstance(remote, SingleNetworkTask)
    with pytest.raises(Told) as caught:
        remote.loss_from_generator(Asked(), batch, torch.Generator().manual_seed(0), shard)
    told = [each for each in tree_leaves(caught.value.args) if isinstance(each, torch.Tensor)]
    assert told and all(each.is_meta for each in told)


def test_flow_times_are_a_power_of_uniform_ones():
    one, cubed = (
        ShardedRandom(500, torch.Generator().manual_seed(0), UNSHARDED).flow_times(power)
        for power in (1.0, 3.0)
    )
    assert one.min() < 0.02 and one.max() > 0.98 and abs(float(one.mean()) - 0.5) < 0.05
    torch.testing.assert_close(cubed, one**3)


def test_the_full_systems_terms_add_up(data):
    task, batch = made_task(quick("globaldiff/full"), data)
    row = task.step(0, batch, torch.Generator().manual_seed(0))
    parts = ("simple", "seed", "position", "joint", "skeleton", "motion")
    assert sum(row[part] for part in parts) == pytest.approx(row["total"], rel=1e-4)
    assert all(row[part] > 0 for part in parts)


@pytest.mark.parametrize(
    ("system", "dim"), [("fgd-encoder", 333), ("fmd-encoder", 385), ("fed-encoder", 52)]
)
def test_encoders_of_distances_train_on_what_they_see(data, tmp_path, system, dim):
    task, batch = made_task(quick(system), data)
    parts = task.step(0, batch, torch.Generator().manual_seed(0))
    assert ("position" in parts) == (dim > 52) and ("face" in parts) == (dim != 333)
    assert "kl" not in parts
    save_weights(tmp_path, system, task.export(), {"config": json.loads(to_json(quick(system)))})
    (codes,) = load_motion_encoder(tmp_path, system).codes(torch.randn(2, 24, dim))
    assert codes.shape == (2, 3, 32)
    if "face" in parts:
        faceless = replace(data, arkit_weights=np.zeros_like(data.arkit_weights))
        with pytest.raises(DataError, match=f"{system} needs faces as ARKit blendshapes"):
            made_task(quick(system), faceless)


def test_the_missing_encoder_is_named(root, annotated_folder, tmp_path):
    with pytest.raises(CheckpointError, match="motion-vae"):
        run(quick("globaldiff/full"), annotated_folder, root / "lacking", helpers=tmp_path)


def test_a_loss_that_is_no_number_stops_and_keeps_the_last_good_state(
    root, annotated_folder, monkeypatch
):
    import model.systems.helpers.task as module

    real, calls = module.losses.simple_loss, []

    def nan_in_the_end(x_1, target):
        calls.append(1)
        return real(x_1, target) * (float("nan") if len(calls) > 1 else 1.0)

    monkeypatch.setattr(module.losses, "simple_loss", nan_in_the_end)
    with pytest.raises(FloatingPointError, match=r"simple is nan at step 1; .*: [12]_"):
        run(quick(MOTION_VAE), annotated_folder, root / "nan")
    state = state_of(root / "nan")
    assert state["step"] == 1
    assert all(tensor.isfinite().all() for tensor in state["network"].values())
    assert (root / "nan" / "weights" / "motion-vae.safetensors").is_file()


def test_a_full_disk_is_told_in_one_sentence(root, annotated_folder, monkeypatch, capsys):
    import model.training.loop as module

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(module.torch, "save", full)
    command = ["smoke", "--system", MOTION_VAE, "--set", "steps=1", "--no-compile"]
    out = root / "full-disk"
    assert main([*command, "--data", str(annotated_folder), "--out", str(out)]) == 1
    message = capsys.readouterr().err.splitlines()[-1]
    assert "the disk is full" in message and "last saved state is kept" in message
    assert not (out / "state.pt").exists()


def test_speakers_beyond_the_table_are_named(data):
    config = quick("globaldiff/local")
    small = replace(config, network=replace(config.network, num_speakers=3))
    with pytest.raises(DataError, match=r"speaker numbers 3 \(eve\) .*must be from 1 to 2"):
        made_task(small, data)


def test_what_cannot_be_trained_is_told_in_one_sentence(
    tmp_path, annotated_folder, monkeypatch, capsys
):
    monkeypatch.delenv("WAVLM_DIR", raising=False)
    out = ["--out", str(tmp_path / "out")]
    for preset, folder, told in (
        ("paper", annotated_folder, "set WAVLM_DIR"),
        ("smoke", tmp_path, "train_test_split.csv is missing"),
    ):
        assert main([preset, "--data", str(folder), *out]) == 1
        assert told in capsys.readouterr().err
    with pytest.raises(SystemExit) as exit_:
        main(["smoke"])
    assert exit_.value.code == 2
    with pytest.raises(TrainingError, match=r"batch_size is 4; it must be a multiple of .* \(3\)"):
        run(quick(MOTION_VAE, batch_size=4), tmp_path, tmp_path / "out", shard=Shard(0, 3))
