"""The table of an evaluation: its rows, what is left out, and what its numbers do not depend on."""

import csv
import json
import shutil
import tempfile
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
import torch

from model.data.recordings import DataError, read_motion_and_speech
from model.evaluate import evaluate, main
from model.evaluation.classifiers import (
    NO_MATCHING_CLASSIFIER,
    NO_SPEAKER_CLASSIFIER,
    SPEAKERS_NOT_COMPARED,
    calm_and_lively_wrist_speeds,
)
from model.evaluation.clips import ClipRow, EvaluationModels, clip_metrics_table
from model.evaluation.frechet import ENCODER_NAMES
from model.evaluation.tables import (
    as_csv,
    as_markdown,
    bootstrap_mean,
    bootstrap_ratio,
)
from model.motion.motion import first_frames, load_motion, save_motion
from model.motion.packing import Normaliser
from model.networks.autoencoder import FrozenMotionEncoder, MotionAutoencoder
from model.storage.checkpoint import save_weights
from model.systems.helpers.config import AUTOENCODERS, MATCHING_NETWORK
from model.systems.registry import load_system
from processes.pool import JobPool
from tests.model.made import make_data_folder

ROW = ClipRow(
    measures={"tip_jerk_m_s3": 1.0},
    arrays={"windows": np.zeros((0, 30, 217), np.float32)},
)
CLIPS, NAME = ["1_ann_0_0_0", "2_bob_0_1_1"], "globaldiff/local"


def table_of(data, *systems, clips=CLIPS, seeds=1, judges=MappingProxyType({}), matching=None,
             **options) -> dict:  # fmt: skip
    cast = partial(EvaluationModels, systems, judges, matching)
    with tempfile.TemporaryDirectory() as folder:
        return evaluate(cast, data, clips, seeds, **{"resume_folder": Path(folder), **options})


def of_test_split(folder):
    split = folder / "train_test_split.csv"
    split.write_text(split.read_text().replace("train\n", "test\n"))
    return folder


@pytest.fixture(scope="module", autouse=True)
def _faces_of_two_steps():
    torch.set_num_threads(1)  # also for what is made once here: sums depend on it
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("model.systems.face.face.FACE_STEPS", 2)
        yield


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return of_test_split(make_data_folder(tmp_path_factory.mktemp("data") / "data", seconds=3))


@pytest.fixture(scope="module")
def system(weights):
    """Of one step."""
    found = load_system(NAME, weights)
    return replace(found, samplers=(replace(found.samplers[0], default_steps=1),))


@pytest.fixture(scope="module")
def judges() -> dict[str, FrozenMotionEncoder]:
    """Untrained."""
    torch.manual_seed(0)
    found = {}
    for measure, name in ENCODER_NAMES.items():
        small = replace(AUTOENCODERS[name], width=16, latent_dim=8)
        network = MotionAutoencoder(small).eval().requires_grad_(False)
        channels = AUTOENCODERS[name].channels
        statistics = Normaliser(torch.zeros(channels), torch.ones(channels))
        found[measure] = FrozenMotionEncoder(network, statistics, "")
    return found


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    return tmp_path_factory.mktemp("kept")


@pytest.fixture(scope="module")
def plain(data, system, kept) -> dict:
    """Of one system, one seed and no judge."""
    return table_of(data, system, resume_folder=kept)


@pytest.fixture(scope="module")
def judged(data, system, judges) -> dict:
    """The same with three judges."""
    return table_of(data, system, judges=judges)


def test_the_command_writes_rows_with_intervals_in_four_ways(
    data, weights, judges, tmp_path, capsys
):
    weights = shutil.copytree(weights, tmp_path / "weights")
    judge = judges["fed"]
    tensors = {f"network.{name}": t for name, t in judge.network.state_dict().items()}
    card = {"config": {"autoencoder": asdict(judge.network.config)}, "speakers": {}}
    save_weights(weights, "fed-encoder", tensors | judge.normaliser.tensors(), card)
    command = ["--data", str(data), "--weights", str(weights), "--out", str(tmp_path)]
    command += ["--systems", NAME, "--guidance", "1", "--seeds", "1", "--processes", "1"]
    assert main([*command, "--speakers", "bob,ann"]) == 0
    table = json.loads((tmp_path / "evaluation.json").read_text())
    assert table["clips"] == CLIPS  # eve's clip is of no known speaker
    assert list(table["motion"]) == ["recorded", NAME] and table["guidance"] == {NAME: 1.0}
    recorded, generated = (table["motion"][row] for row in ("recorded", NAME))
    jerk = recorded["tip_jerk_m_s3"]
    assert 0 < jerk["low"] <= jerk["mean"] <= jerk["high"]
    assert recorded["tip_jerk_m_s3_ratio"]["mean"] == 1
    assert "face_mse" not in recorded and generated["face_mse"]["mean"] > 0
    assert "fgd" not in generated and "fgd_floor" not in table and generated["fed"]["mean"] > 0
    for row in table["motion"].values():
        assert row["div"]["mean"] > 0 and row["div_gesture"]["mean"] > 0
    text = (tmp_path / "evaluation.md").read_text()
    assert text == capsys.readouterr().out
    for sentence in (
        "FMD is left out: its encoder fmd-encoder is not among the weights.",
        "FGD is left out: its encoder fgd-encoder is not among the weights.",
    ):
        assert f"\n{sentence}\n" in text
    assert f"Matched-speech accuracy is omitted: the classifier {MATCHING_NETWORK} is not" in text
    assert "FED is left out" not in text and "| FED · fed/workbench | - |" in text
    assert "wrist speed, calm / lively speaker" in text
    with (tmp_path / "evaluation.csv").open() as file:
        rows = list(csv.DictReader(file))
    values = {(r["row"], r["measure"]): float(r["mean"]) for r in rows}
    protocols = {r["measure"]: r["protocol"] for r in rows}
    assert (
        protocols["tip_jerk_m_s3"] == "workbench/1" and protocols["l1_to_mean_m"] == "l1div/emage"
    )
    assert protocols["beat_align_motion_to_audio_chance"] == "beats/asynfusion"
    assert values["recorded", "tip_jerk_m_s3"] == jerk["mean"]
    own, foreign, less = (
        values[NAME, f"wrists_loudness{wrong}"] for wrong in ("", "_foreign", "_less_foreign")
    )
    assert own - foreign == pytest.approx(less) != 0
    latex = (tmp_path / "evaluation.tex").read_text().splitlines()
    cells = [line.count("&") for line in latex if line.endswith(r"\\")]
    assert len(cells) > 10 and set(cells) == {2}
    assert r"power \textgreater{} 5 Hz" in "\n".join(latex)


def test_what_cannot_be_evaluated_is_told(data, weights, system, tmp_path, capsys):
    odd = shutil.copytree(data, tmp_path / "odd")
    with (odd / "train_test_split.csv").open("a") as file:
        file.write("nonsense,test\n")
    command = ["--data", str(odd), "--weights", str(weights), "--out", str(tmp_path)]
    assert main(command) == 1
    assert "nonsense does not start with a speaker number" in capsys.readouterr().err
    for wrong in ("ann", "ann,ann", ",bob"):
        assert main([*command, "--speakers", wrong]) == 1
        assert "CALM,LIVELY" in capsys.readouterr().err
    with pytest.raises(DataError, match="at least 2"):
        table_of(data, system, clips=CLIPS[:1])


def test_each_distance_has_an_interval_and_the_floor_of_its_own_encoder(judged):
    others = [NO_MATCHING_CLASSIFIER, SPEAKERS_NOT_COMPARED, NO_SPEAKER_CLASSIFIER]
    assert judged["left_out"] == others  # no distance
    assert len({judged[f"{measure}_floor"]["mean"] for measure in ENCODER_NAMES}) == 3
    for measure in ENCODER_NAMES:
        found = judged["motion"][NAME][measure]
        assert 0 < found["low"] <= found["high"] and found["mean"] > 0
        assert judged[f"{measure}_floor"]["mean"] > 0
        assert measure not in judged["motion"]["recorded"]
        heading = f"{measure.upper()} · {measure}/workbench between two halves of the recordings"
        assert heading in as_markdown(judged) and f"recorded,{measure}_floor," in as_csv(judged)


@pytest.mark.slow  # a whole evaluation each
def test_faces_in_other_units_are_left_out_of_what_sees_faces(data, system, judges, tmp_path):
    data = shutil.copytree(data, tmp_path / "flame")
    for path in (data / "smplxflame_30").iterdir():
        save_motion(replace(load_motion(path), expression_basis="flame100"), path)
    table = table_of(data, system, judges=judges)
    assert "fgd" in table["motion"][NAME]
    assert not {"fmd", "fed", "fmd_floor", "fed_floor"} & {*table["motion"][NAME], *table}
    assert "div" not in table["motion"]["recorded"] and "div_gesture" in table["motion"]["recorded"]
    sentence, *others = table["left_out"]
    assert "ARKit" in sentence and others == [
        NO_MATCHING_CLASSIFIER,
        SPEAKERS_NOT_COMPARED,
        NO_SPEAKER_CLASSIFIER,
    ]


@pytest.mark.slow
def test_numbers_do_not_depend_on_processes(data, system, judges, monkeypatch):
    monkeypatch.setattr("model.systems.face.face.FACE_STEPS", 12)  # as in another process
    alone, shared = (table_of(data, system, pool=JobPool(count), judges=judges) for count in (1, 2))
    assert alone == shared


@pytest.mark.slow
def test_a_stopped_evaluation_goes_on_with_what_is_not_measured(
    data, system, plain, kept, tmp_path
):
    data, kept = (shutil.copytree(one, tmp_path / one.name) for one in (data, kept))
    files = sorted(kept.iterdir())
    assert [path.name.rpartition("-")[0] for path in files] == CLIPS
    times = [path.stat().st_mtime_ns for path in files]
    files[0].unlink()
    assert table_of(data, system, resume_folder=kept) == plain
    after = [path.stat().st_mtime_ns for path in sorted(kept.iterdir())]
    assert after[1] == times[1] and after[0] > times[0]
    assert sorted(kept.iterdir()) == files
    motion = load_motion(data / "smplxflame_30" / f"{CLIPS[0]}.npz")
    save_motion(first_frames(motion, 100), data / "smplxflame_30" / f"{CLIPS[0]}.npz")
    twice = table_of(data, system, seeds=2, resume_folder=kept)  # other seeds, other recordings
    assert len(list(kept.iterdir())) == 4
    assert twice["motion"][NAME]["spread_at_will_m"]["mean"] > 0
    assert "spread_at_will_m" not in twice["motion"]["recorded"]  # two clips of two speakers


@pytest.mark.slow  # a whole evaluation each
def test_each_clip_has_noise_of_its_own_which_is_the_same_for_all_systems(data, system, tmp_path):
    data, first = shutil.copytree(data, tmp_path / "twice"), CLIPS[0]
    twin = first.removesuffix("0_0") + "9_9"  # the same speech again
    for sub, ending in (("smplxflame_30", "npz"), ("wave16k", "wav")):
        shutil.copy(data / sub / f"{first}.{ending}", data / sub / f"{twin}.{ending}")
    twins = [replace(system, name=name) for name in ("one", "other")]
    motion = table_of(data, *twins, clips=[first, twin])["motion"]
    assert motion["recorded"]["pairwise_l1_m"]["mean"] == pytest.approx(0, abs=1e-6)
    assert motion["one"]["pairwise_l1_m"]["mean"] > 0.1
    assert motion["one"] == motion["other"]


def test_manner_stands_beside_that_of_recordings_where_speakers_are_known(data, system, plain):
    table = table_of(data, system, speakers=("bob", "ann"))
    motion = table["motion"]
    lively, calm = (read_motion_and_speech(data, name)[0] for name in CLIPS)
    slow, fast = calm_and_lively_wrist_speeds(
        {("bob", 0): calm, ("ann", 0): lively}, ("bob", "ann")
    ).values()
    found = motion["recorded"]["calm_over_lively"]["mean"]
    assert found == pytest.approx(slow / fast, rel=1e-6)  # bob has one recording
    manner = {"calm_over_lively", "arms_by_speaker", "arm_rotations_other_speaker"}
    assert {*motion[NAME]} >= {*manner, "arms_in_silence"}
    assert "arms_in_silence" not in motion["recorded"], "no silence of 5 s is recorded"
    assert SPEAKERS_NOT_COMPARED not in table["left_out"]
    assert not manner & {*plain["motion"][NAME]}
    assert "spread_at_will_m" not in plain["motion"][NAME], "it needs two of a kind"
    assert plain["motion"][NAME]["arms_in_silence"]["mean"] > 0
    assert plain["left_out"][-2:] == [SPEAKERS_NOT_COMPARED, NO_SPEAKER_CLASSIFIER]


def test_recorded_clips_are_paired_with_those_of_their_speaker():
    rng = np.random.default_rng(0)
    rows = [
        {
            "recorded": replace(
                ROW, arrays=ROW.arrays | {"positions": at + rng.normal(0, 1e-3, (1, 30, 55, 3))}
            )
        }
        for at in (0.0, 0.1, 5.0)
    ]
    table = clip_metrics_table(rows, ["ann", "ann", "bob"])
    found = table["motion"]["recorded"]["spread_at_will_m"]["mean"]
    assert found == pytest.approx(0.1 * 165, rel=0.05)


def test_bootstrap_covers_the_mean_and_narrows_with_more_clips():
    rng = np.random.default_rng(1)
    few, many = (bootstrap_mean(list(rng.normal(5, 1, n))) for n in (10, 1000))
    assert few.low < 5 < few.high and many.low < 5 < many.high
    assert (many.high - many.low) < (few.high - few.low) / 4
    ratio = bootstrap_ratio([2.0, 4.0], [1.0, 2.0])  # in pairs the ratio is the same every draw
    assert ratio.mean == ratio.low == ratio.high == 2.0
