import errno
import json
import logging
from dataclasses import replace

import numpy as np
import pytest
import torch

from model.data.prepared import prepare
from model.data.recordings import DataError, read_split
from model.motion.packing import to_vectors
from model.networks.autoencoder import load_encoder
from model.speech.features import MelEncoder
from model.storage.cards import BUNDLED_WEIGHTS, CheckpointError, to_json
from model.storage.checkpoint import load_weights, save_weights
from model.systems.globaldiff.config import BEST
from model.systems.registry import family_of, load_system
from model.train import main
from model.training.config import TrainConfig
from model.training.loop import train as train_task
from model.training.parallel import WHOLE
from model.training.run_folder import TrainingError
from model.training.task import Start, TaskSetup, learning_rate_factor
from tests.model.made import make_data_folder
from tests.model.training.made import killed_at, log_of

QUICK = {"steps": 6, "save_every": 3, "validate_every": 6, "warmup_steps": 2, "batch_size": 2}


def quick(system: str, **changes) -> TrainConfig:
    return replace(family_of(system).config("smoke", system), **{**QUICK, **changes})


def train(config: TrainConfig, data, out, *, helpers=BUNDLED_WEIGHTS, **options) -> None:
    make_task = family_of(config.system).make_task
    train_task(config, make_task, data, out, helpers=helpers, **options)


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """A data folder, and beside it a trained expression network."""
    root = tmp_path_factory.mktemp("training")
    make_data_folder(root / "data")
    train(quick("expression"), root / "data", root / "expression")
    return root


def run(root, name: str, config: TrainConfig, **options) -> dict:
    train(config, root / "data", root / name, helpers=root / "expression" / "weights", **options)
    return torch.load(root / name / "state.pt", weights_only=True)


def same_weights(a: dict, b: dict) -> bool:
    return all(torch.equal(a["average"][k], b["average"][k]) for k in a["average"])


@pytest.mark.parametrize(
    "system", ["globaldiff/local", "globaldiff/global", BEST, "asynfusion/ddim"]
)
def test_training_leaves_weights_that_load(root, system):
    run(root, system.replace("/", "-"), quick(system))
    weights = root / system.replace("/", "-") / "weights"
    for ending in (".json", ".safetensors"):
        source = root / "expression" / "weights" / f"expression{ending}"
        (weights / source.name).write_bytes(source.read_bytes())
    loaded = load_system(system, weights)
    assert loaded.speakers == {"ann": 1, "bob": 2}
    assert loaded.card["steps"] == 6 and loaded.card["validation"]["total"] > 0
    rows = log_of(root / system.replace("/", "-"))
    assert [(r["step"], r["split"]) for r in rows] == [("3", "train"), ("6", "val"), ("6", "train")]


@pytest.mark.parametrize("system", ["globaldiff/global", BEST, "expression"])
def test_a_killed_and_resumed_run_equals_one_that_was_not(root, system):
    config = quick(system)
    name = f"killed-{system.replace('/', '-')}"
    whole = run(root, f"whole-{name}", config)

    with killed_at(5):
        run(root, name, config)
    resumed = run(root, name, config, resume=True)
    assert resumed["step"] == whole["step"] == 6
    assert same_weights(whole, resumed)


def test_resuming_with_other_settings_names_them(root):
    run(root, "first", quick("globaldiff/local"))
    changed = quick("globaldiff/local", learning_rate=1.0, batch_size=3)
    with pytest.raises(TrainingError, match=r"\(batch_size, learning_rate\)"):
        run(root, "first", changed, resume=True)
    with pytest.raises(TrainingError, match="holds a run already"):
        run(root, "first", quick("globaldiff/local"))
    with pytest.raises(TrainingError, match=r"no .* to resume"):
        run(root, "nothing", quick("globaldiff/local"), resume=True)


def test_validation_loss_falls(root):
    config = quick("globaldiff/global", steps=60, learning_rate=1e-3, validate_every=12,
                   batch_size=4, ema_decay=0.8)  # fmt: skip
    run(root, "falling", config)
    rows = log_of(root / "falling", "val")
    assert float(rows[-1]["simple"]) < 0.9 * float(rows[0]["simple"])


def test_start_from_begins_with_given_weights(root):
    run(root, "base", quick("globaldiff/local"))
    before, _ = load_weights(root / "base" / "weights", "globaldiff/local")
    config = quick("globaldiff/local", steps=1, learning_rate=0.0, weight_decay=0.0)
    run(root, "onward", config, start=Start(root / "base" / "weights", "globaldiff/local"))
    after, card = load_weights(root / "onward" / "weights", "globaldiff/local")
    assert card["started_from_bundled_weights"]
    assert all(torch.equal(before[k], after[k]) for k in before)


def test_vectors_are_in_the_systems_rotation_space(root):
    data = prepare(root / "data", root / "prepared-mel64", MelEncoder())
    batch = data.window_batch(data.of_split("train"), 60, 2, np.random.default_rng(0))
    local = to_vectors("local", batch.poses, batch.transl)
    other = to_vectors("global", batch.poses, batch.transl)
    torch.testing.assert_close(local[..., :6], other[..., :6])  # the pelvis is the root of both
    assert (local[..., 6:330] - other[..., 6:330]).abs().max() > 0.1
    torch.testing.assert_close(local[..., 330:], other[..., 330:])


@pytest.mark.parametrize(("power", "median"), [(1.0, 0.5), (2.0, 0.25), (3.0, 0.125)])
def test_flow_times_are_early_as_often_as_the_config_says(root, power, median):
    config = quick("globaldiff/global", flow_time_power=power)
    data = prepare(root / "data", root / "prepared-mel64", MelEncoder())
    make_task = family_of(config.system).make_task
    task = make_task(config, data, TaskSetup(root / "expression" / "weights"))
    batch = data.window_batch(data.of_split("train"), 60, 8, np.random.default_rng(0))
    times = []
    task.network.register_forward_pre_hook(lambda module, args: times.append(args[1]))
    with torch.no_grad():
        for seed in range(60):
            task.step_loss(task.network, batch, torch.Generator().manual_seed(seed), WHOLE)
    assert float(torch.cat(times).median()) == pytest.approx(median, abs=0.06)


def test_full_trains_against_a_frozen_encoder_and_begins_with_another_rung(root, tmp_path):
    helpers = root / "expression" / "weights"
    train(quick("motion-vae"), root / "data", root / "vae")
    for file in (root / "vae" / "weights").iterdir():
        (helpers / file.name).write_bytes(file.read_bytes())
    run(root, "ground", quick("globaldiff/global"))
    start = Start(root / "ground" / "weights", "globaldiff/global")
    run(root, "full", quick("globaldiff/full"), start=start)
    row = log_of(root / "full")[0]
    parts = {"simple", "seed", "position", "velocity", "acceleration", "joint", "skeleton",
             "motion"}  # fmt: skip
    assert sum(float(row[part]) for part in parts) == pytest.approx(float(row["total"]), rel=1e-4)
    assert all(float(row[part]) > 0 for part in parts)
    card = json.loads((root / "full" / "weights" / "globaldiff-full.json").read_text())
    assert card["started_from"]["system"] == "globaldiff/global"
    assert card["started_from"]["steps"] == 6
    given, found = (
        load_weights(root / run_ / "weights", f"globaldiff/{rung}")[0]["normaliser.std"]
        for run_, rung in (("ground", "global"), ("full", "full"))
    )
    assert torch.equal(given, found)  # statistics go with the weights that learned with them


def test_a_resumed_run_keeps_the_statistics_it_began_with(root):
    run(root, "plain", quick("globaldiff/global"))
    tensors, card = load_weights(root / "plain" / "weights", "globaldiff/global")
    tensors["normaliser.std"] *= 1.5  # as of another corpus
    save_weights(
        root / "other-corpus", "globaldiff/global", tensors, {"config": card["config"], "steps": 9}
    )
    start = Start(root / "other-corpus", "globaldiff/global")
    config = quick("globaldiff/joint")
    run(root, "piecewise", replace(config, steps=3), start=start)
    (root / "piecewise" / "config.json").write_text(to_json(config))
    assert run(root, "piecewise", config, resume=True)["step"] == 6
    found, card = load_weights(root / "piecewise" / "weights", "globaldiff/joint")
    assert torch.equal(found["normaliser.std"], tensors["normaliser.std"])
    assert card["started_from"]["steps"] == 9


@pytest.mark.parametrize(
    ("system", "dim"), [("fgd-encoder", 333), ("fmd-encoder", 385), ("fed-encoder", 52)]
)
def test_encoders_of_distances_train_and_load(root, system, dim):
    train(quick(system, steps=60, learning_rate=1e-2), root / "data", root / system)
    rows = log_of(root / system, "train")
    parts = {name for name, value in rows[0].items() if value} - {"step", "split", "total"}
    assert ("position" in parts) == (dim > 52) and ("face" in parts) == (dim != 333)
    assert "kl" not in parts
    for part in {"simple", "face", "total"} & {*parts, "total"}:
        early, late = (np.mean([float(r[part]) for r in some]) for some in (rows[:3], rows[-3:]))
        assert late < (0.9 if part == "total" else 0.95) * early
    encoder = load_encoder(root / system / "weights", system)
    (codes,) = encoder.codes(torch.randn(2, 24, dim))
    assert codes.shape == (2, 3, 32)


def test_an_encoder_of_faces_refuses_data_without_them(root):
    data = prepare(root / "data", root / "prepared-mel64", MelEncoder())
    faceless = replace(data, expression=np.zeros_like(data.expression))
    for system in ("fmd-encoder", "fed-encoder"):
        with pytest.raises(DataError, match=f"{system} learns from faces in ARKit's units"):
            family_of(system).make_task(quick(system), faceless, TaskSetup(BUNDLED_WEIGHTS))


def test_the_missing_encoder_is_named(root, tmp_path):
    with pytest.raises(CheckpointError, match="motion-vae"):
        train(quick("globaldiff/full"), root / "data", tmp_path / "full", helpers=tmp_path)


def test_a_loss_that_is_no_number_stops_and_keeps_the_last_good_state(root, monkeypatch):
    import model.systems.autoencoders.task as module

    real, calls = module.losses.simple_loss, []

    def nan_in_the_end(x_1, target):
        calls.append(1)
        return real(x_1, target) * (float("nan") if len(calls) > 4 else 1.0)

    monkeypatch.setattr(module.losses, "simple_loss", nan_in_the_end)
    config = quick("motion-vae", validate_every=99)
    with pytest.raises(FloatingPointError, match=r"simple is nan at step 4; clips: [12]_"):
        train(config, root / "data", root / "nan")
    state = torch.load(root / "nan" / "state.pt", weights_only=True)
    assert state["step"] == 3
    assert all(tensor.isfinite().all() for tensor in state["network"].values())
    assert (root / "nan" / "weights" / "motion-vae.safetensors").is_file()


def test_a_full_disk_is_told_in_one_sentence(root, monkeypatch, capsys):
    import model.training.run_folder as module

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(module.torch, "save", full)
    status = main(["smoke", "--system", "motion-vae", "--steps", "1", "--data",
                   str(root / "data"), "--out", str(root / "full-disk")])  # fmt: skip
    assert status == 1
    message = capsys.readouterr().err.splitlines()[-1]
    assert "the disk is full" in message and "last saved state is kept" in message
    assert not (root / "full-disk" / "state.pt").exists()


def test_half_a_compiled_file_is_told_with_what_to_do(root, monkeypatch, capsys):
    from torch._inductor.exc import InductorError

    def fail(*_, **__):
        raise InductorError(ImportError("c7.main.so: file too short"), None)  # type: ignore[arg-type]

    monkeypatch.setattr("model.train.train", fail)
    status = main(["smoke", "--data", str(root / "data"), "--out", str(root / "uncompiled")])
    assert status == 1
    message = capsys.readouterr().err
    assert "c7.main.so: file too short" in message and "train with --no-compile" in message


def test_speakers_beyond_the_table_are_named(root):
    config = quick("globaldiff/local")
    small = replace(config, network=replace(config.network, num_speakers=3))
    with pytest.raises(DataError, match=r"speakers 3 \(eve\) do not fit the table of 3"):
        run(root, "beyond", small)


def test_the_papers_encoder_is_asked_for_by_name(root, monkeypatch, capsys):
    monkeypatch.delenv("WAVLM_DIR", raising=False)
    assert main(["paper", "--data", str(root / "data"), "--out", str(root / "paper")]) == 1
    assert "set WAVLM_DIR" in capsys.readouterr().err


def test_learning_rate_warms_up_and_decays():
    config = TrainConfig("any", steps=1000, warmup_steps=100)
    factors = [learning_rate_factor(step, config) for step in range(1000)]
    assert factors[0] == 0.01 and factors[99] == 1.0 and max(factors) == 1.0
    assert factors[-1] < 0.03 and all(np.diff(factors[99:]) <= 0)


def test_bad_clips_are_named_skipped_and_counted(tmp_path, caplog):
    folder = make_data_folder(tmp_path / "data")
    (folder / "smplxflame_30" / "1_ann_0_0_0.npz").write_bytes(b"no npz")
    (folder / "wave16k" / "3_eve_0_3_3.wav").write_bytes(b"")
    with caplog.at_level(logging.WARNING):
        data = prepare(folder, tmp_path / "cache", MelEncoder())
    assert [clip.name for clip in data.clips] == ["1_ann_0_2_2", "2_bob_0_1_1"]
    assert "1_ann_0_0_0" in caplog.text and "2 of 4 clips were skipped" in caplog.text
    with pytest.raises(DataError, match="names no usable test clip"):
        data.of_split("test")


def test_arrays_are_cut_to_the_shorter_of_motion_and_sound(tmp_path):
    from model.speech.audio import write_wav
    from tests.model.made import made_waveform

    folder = make_data_folder(tmp_path / "data")
    write_wav(folder / "wave16k" / "1_ann_0_0_0.wav", made_waveform(16_000 * 3))
    data = prepare(folder, tmp_path / "cache", MelEncoder())
    assert {clip.name: clip.num_frames for clip in data.clips}["1_ann_0_0_0"] == 90
    assert len(data.poses) == len(data.speech) == len(data.expression) == 90 + 3 * 120


def test_folders_of_another_layout_are_refused(tmp_path):
    with pytest.raises(DataError, match=r"train_test_split\.csv is missing"):
        read_split(tmp_path)
    (tmp_path / "train_test_split.csv").write_text("a,b\n1,2\n")
    with pytest.raises(DataError, match="columns id and type"):
        read_split(tmp_path)


def test_command_reports_one_sentence_and_status(tmp_path, capsys):
    status = main(["smoke", "--data", str(tmp_path), "--out", str(tmp_path / "out")])
    assert status == 1 and "train_test_split.csv is missing" in capsys.readouterr().err
    with pytest.raises(SystemExit) as exit_:
        main(["smoke"])
    assert exit_.value.code == 2


def test_cards_hold_the_whole_config(root):
    run(root, "carded", quick("globaldiff/local"))
    card = json.loads((root / "carded" / "weights" / "globaldiff-local.json").read_text())
    assert card["config"]["network"]["rotation_space"] == "local"
    assert card["training_hours"] == pytest.approx(240 / 30 / 3600, abs=1e-3)
