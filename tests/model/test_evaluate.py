import csv
import json
import shutil
from dataclasses import asdict, replace

import numpy as np
import pytest
import torch

from model.data.recordings import DataError
from model.evaluate import evaluate, main
from model.evaluation import speakers
from model.evaluation.clips import ClipRow, as_table
from model.evaluation.few_clips import UNKNOWN_SPEAKERS
from model.evaluation.frechet import ENCODERS
from model.evaluation.matching import left_out
from model.evaluation.tables import (
    as_csv,
    as_markdown,
    bootstrap,
    bootstrap_difference,
    bootstrap_ratio,
)
from model.motion.motion import first_frames, load_motion, save_motion
from model.motion.packing import Normaliser
from model.networks.autoencoder import FrozenEncoder, MotionAutoencoder
from model.speech.features import MelEncoder
from model.storage.checkpoint import save_weights
from model.systems.autoencoders.config import JUDGES
from model.systems.registry import load_system
from processes.pool import JobPool
from tests.model.made import make_data_folder, make_weights

ROW = ClipRow(
    measures={"tip_jerk_m_s3": 1.0},
    by_depth={},
    couplings=dict.fromkeys(("right", "shifted", "foreign"), 0.0),
    features={},
    positions=[],
    windows=np.zeros((0, 30, 217), np.float32),
)
CLIPS = ["1_ann_0_0_0", "2_bob_0_1_1"]


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    root = tmp_path_factory.mktemp("evaluation")
    data = make_data_folder(root / "data", seconds=4)
    split = (data / "train_test_split.csv").read_text()
    (data / "train_test_split.csv").write_text(split.replace("train\n", "test\n"))
    return data, make_weights(root / "weights")


@pytest.fixture(scope="module")
def system(folders):
    return load_system("globaldiff/local", folders[1])


def untrained_judges() -> dict[str, FrozenEncoder]:
    torch.manual_seed(0)
    judges = {}
    for measure, name in ENCODERS.items():
        small = replace(JUDGES[name], width=16, latent_dim=8)
        network = MotionAutoencoder(small).eval().requires_grad_(False)
        channels = JUDGES[name].channels
        statistics = Normaliser(torch.zeros(channels), torch.ones(channels))
        judges[measure] = FrozenEncoder(network, statistics, "")
    return judges


@pytest.fixture(scope="module")
def plain(folders, system) -> dict:
    """Of one system, one seed and no judge."""
    return evaluate(folders[0], CLIPS, [system], 1)


@pytest.fixture(scope="module")
def judged(folders, system) -> dict:
    """The same with three judges."""
    return evaluate(folders[0], CLIPS, [system], 1, judges=untrained_judges())


def test_table_has_recorded_and_generated_rows_with_intervals(folders, tmp_path, capsys):
    data, weights = folders
    status = main(
        ["--data", str(data), "--weights", str(weights), "--out", str(tmp_path), "--seeds", "1"]
    )
    assert status == 0
    table = json.loads((tmp_path / "evaluation.json").read_text())
    assert table["clips"] == CLIPS  # eve's clip is of no known speaker
    assert list(table["motion"]) == ["recorded", "globaldiff/local", "globaldiff/global"]
    jerk = table["motion"]["recorded"]["tip_jerk_m_s3"]
    assert 0 < jerk["low"] <= jerk["mean"] <= jerk["high"]
    assert table["motion"]["recorded"]["tip_jerk_m_s3_ratio"]["mean"] == 1
    assert "face_mse" not in table["motion"]["recorded"]
    assert table["motion"]["globaldiff/local"]["face_mse"]["mean"] > 0
    for measure in ENCODERS:  # no encoder among these weights
        assert measure not in table["motion"]["globaldiff/local"]
        assert f"{measure}_floor" not in table
    for row in table["motion"].values():
        assert row["div"]["mean"] > 0 and row["div_gesture"]["mean"] > 0
    text = (tmp_path / "evaluation.md").read_text()
    assert text == capsys.readouterr().out and "globaldiff/global" in text
    for sentence in (
        "FMD is left out: its encoder fmd-encoder is not among the weights.",
        "FED is left out: its encoder fed-encoder is not among the weights.",
        "FGD is left out: its encoder fgd-encoder is not among the weights.",
    ):
        assert f"\n{sentence}\n" in text
    ratio = table["wrong_speech"]["globaldiff/local"]["shifted"]["mean"]
    assert f"| globaldiff/local | {100 * (ratio - 1):.3g} [" in text
    with (tmp_path / "evaluation.csv").open() as file:
        values = {(r["part"], r["row"], r["measure"]): r["mean"] for r in csv.DictReader(file)}
    assert float(values["motion", "recorded", "tip_jerk_m_s3"]) == jerk["mean"]
    latex = (tmp_path / "evaluation.tex").read_text().splitlines()
    cells = [line.count("&") for line in latex if line.endswith(r"\\")]
    assert len(cells) > 10 and set(cells) == {3}
    assert r"power \textgreater{} 5 Hz" in "\n".join(latex)


def test_each_distance_has_an_interval_and_the_floor_of_its_own_encoder(folders, system, judged):
    judges, table = untrained_judges(), judged
    assert table["left_out"] == [
        *left_out(None),
        UNKNOWN_SPEAKERS,
        speakers.LEFT_OUT,
    ]  # no distance
    for measure in ENCODERS:
        found = table["motion"]["globaldiff/local"][measure]
        assert 0 < found["low"] <= found["high"] and found["mean"] > 0
        assert table[f"{measure}_floor"]["mean"] > 0
        assert measure not in table["motion"]["recorded"]
        heading = f"{measure.upper()} of recorded halves against each other"
        assert heading in as_markdown(table) and f"recorded,{measure}_floor," in as_csv(table)
        alone = evaluate(folders[0], CLIPS, [system], 1, judges={measure: judges[measure]})
        assert len(alone["left_out"]) == 5
        assert alone["motion"]["globaldiff/local"][measure] == found
        assert alone[f"{measure}_floor"] == table[f"{measure}_floor"]


def test_encoders_are_read_from_the_folder_of_weights(folders, tmp_path, capsys):
    data, weights = folders
    weights = shutil.copytree(weights, tmp_path / "weights")
    judge = untrained_judges()["fed"]
    tensors = {f"network.{name}": t for name, t in judge.network.state_dict().items()}
    card = {"config": {"autoencoder": asdict(judge.network.config)}, "speakers": {}}
    save_weights(weights, "fed-encoder", tensors | judge.normaliser.tensors(), card)
    status = main(["--data", str(data), "--weights", str(weights), "--out", str(tmp_path),
                   "--seeds", "1", "--systems", "globaldiff/local"])  # fmt: skip
    assert status == 0
    text = capsys.readouterr().out
    assert "| FED | - |" in text and "| FMD |" not in text
    assert "FMD is left out" in text and "FED is left out" not in text


def test_faces_in_other_units_are_left_out_of_what_sees_faces(folders, system, tmp_path):
    data = shutil.copytree(folders[0], tmp_path / "flame")
    for path in (data / "smplxflame_30").iterdir():
        save_motion(replace(load_motion(path), expression_basis="flame100"), path)
    table = evaluate(data, CLIPS, [system], 1, judges=untrained_judges())
    row = table["motion"]["globaldiff/local"]
    assert "fgd" in row and not {"fmd", "fed", "fmd_floor", "fed_floor"} & {*row, *table}
    assert "div" not in table["motion"]["recorded"] and "div_gesture" in table["motion"]["recorded"]
    sentence, *others = table["left_out"]
    assert "ARKit" in sentence and others == [*left_out(None), UNKNOWN_SPEAKERS, speakers.LEFT_OUT]


def test_an_untrained_network_gains_nothing_from_the_right_speech(plain):
    for kind in ("shifted", "foreign"):
        assert plain["wrong_speech"]["globaldiff/local"][kind]["mean"] == pytest.approx(1, abs=0.02)


def test_numbers_do_not_depend_on_batches_nor_on_processes(folders, system, plain, judged):
    data, _ = folders
    assert_close(plain, evaluate(data, CLIPS, [system], 1, batch_windows=1))

    shared = evaluate(data, CLIPS, [system], 1, pool=JobPool(2), judges=untrained_judges())
    assert shared == judged


def test_a_stopped_evaluation_goes_on_with_what_is_not_measured(folders, system, tmp_path):
    data = shutil.copytree(folders[0], tmp_path / "data")
    kept = tmp_path / "clips"
    whole = evaluate(data, CLIPS, [system], 1, kept=kept)
    files = sorted(kept.iterdir())
    assert [path.name.rpartition("-")[0] for path in files] == CLIPS
    times = [path.stat().st_mtime_ns for path in files]
    files[0].unlink()
    assert evaluate(data, CLIPS, [system], 1, kept=kept) == whole
    after = [path.stat().st_mtime_ns for path in sorted(kept.iterdir())]
    assert after[1] == times[1] and after[0] > times[0]
    assert sorted(kept.iterdir()) == files
    evaluate(data, CLIPS, [system], 2, kept=kept)  # other seeds, other numbers
    assert len(list(kept.iterdir())) == 4
    motion = load_motion(data / "smplxflame_30" / f"{CLIPS[0]}.npz")
    save_motion(first_frames(motion, 100), data / "smplxflame_30" / f"{CLIPS[0]}.npz")
    assert evaluate(data, CLIPS, [system], 1, kept=kept) != whole


def assert_close(a, b) -> None:
    """Equal structure, numbers within rounding."""
    assert type(a) is type(b)
    if isinstance(a, dict):
        assert list(a) == list(b)
        for key in a:
            assert_close(a[key], b[key])
    elif isinstance(a, list) and a and isinstance(a[0], float):
        np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-6)
    elif isinstance(a, float):
        assert a == pytest.approx(b, rel=1e-3, abs=1e-6)
    else:
        assert a == b


class OtherEncoder(MelEncoder):
    """As wide, and hears everything twice as loud."""

    name = "twice"

    def encode(self, waveform, num_frames):
        return 2 * super().encode(waveform, num_frames)


def test_each_system_hears_through_its_own_encoder(folders, system, plain):
    other = replace(system, name="globaldiff/global", encoder=OtherEncoder())
    together = evaluate(folders[0], CLIPS, [system, other], 1)
    for one, alone in (system, plain), (other, evaluate(folders[0], CLIPS, [other], 1)):
        assert_close(together["wrong_speech"][one.name], alone["wrong_speech"][one.name])
    right = [together["by_depth"][name]["position_error_m"] for name in together["wrong_speech"]]
    assert right[0] != right[1]


def test_spread_at_will_needs_two_of_a_kind(folders, system, plain):
    once, twice = plain["motion"], evaluate(folders[0], CLIPS, [system], 2)["motion"]
    assert "spread_at_will_m" not in once["globaldiff/local"]
    assert twice["globaldiff/local"]["spread_at_will_m"]["mean"] > 0
    assert "spread_at_will_m" not in once["recorded"]  # two clips of two speakers


def test_each_clip_has_noise_of_its_own_which_is_the_same_for_all_systems(
    folders, system, tmp_path
):
    data, first = shutil.copytree(folders[0], tmp_path / "twice"), CLIPS[0]
    twin = first.removesuffix("0_0") + "9_9"  # the same speech again
    for sub, ending in (("smplxflame_30", "npz"), ("wave16k", "wav")):
        shutil.copy(data / sub / f"{first}.{ending}", data / sub / f"{twin}.{ending}")
    twins = [replace(system, name=name) for name in ("one", "other")]
    motion = evaluate(data, [first, twin], twins, 1)["motion"]
    assert motion["recorded"]["pairwise_l1_m"]["mean"] == pytest.approx(0, abs=1e-6)
    assert motion["one"]["pairwise_l1_m"]["mean"] > 0.1
    assert motion["one"] == motion["other"]


def test_recorded_clips_are_paired_with_those_of_their_speaker():
    rng = np.random.default_rng(0)
    rows = [
        {"recorded": replace(ROW, positions=[at + rng.normal(0, 1e-3, (30, 55, 3))])}
        for at in (0.0, 0.1, 5.0)
    ]
    table = as_table(rows, ["ann", "ann", "bob"])
    found = table["motion"]["recorded"]["spread_at_will_m"]["mean"]
    assert found == pytest.approx(0.1 * 165, rel=0.05)


def test_a_clip_whose_name_says_no_speaker_is_named(folders, tmp_path, capsys):
    data = shutil.copytree(folders[0], tmp_path / "odd")
    with (data / "train_test_split.csv").open("a") as file:
        file.write("nonsense,test\n")
    status = main(["--data", str(data), "--weights", str(folders[1]), "--out", str(tmp_path)])
    assert (
        status == 1 and "nonsense does not start with a speaker number" in capsys.readouterr().err
    )


def test_bootstrap_covers_the_mean_and_narrows_with_more_clips():
    rng = np.random.default_rng(1)
    few, many = (bootstrap(list(rng.normal(5, 1, n))) for n in (10, 1000))
    assert few.low < 5 < few.high and many.low < 5 < many.high
    assert (many.high - many.low) < (few.high - few.low) / 4
    ratio = bootstrap_ratio([2.0, 4.0], [1.0, 2.0])  # in pairs the ratio is the same every draw
    assert ratio.mean == ratio.low == ratio.high == 2.0
    difference = bootstrap_difference([2.0, 9.0], [1.0, 8.0])
    assert difference.low == difference.high == 1.0


def test_too_few_clips_are_refused(folders, system):
    with pytest.raises(DataError, match="at least 2"):
        evaluate(folders[0], ["1_ann_0_0_0"], [system], 1)
