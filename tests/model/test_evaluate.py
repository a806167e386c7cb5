import csv
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from model.data.prepared import DataError
from model.evaluate import evaluate, main
from model.evaluation.clips import ClipRow, as_table
from model.evaluation.intervals import bootstrap, bootstrap_difference, bootstrap_ratio
from model.networks.autoencoder import FrozenEncoder, MotionAutoencoder
from model.speech.features import MelEncoder
from model.systems.autoencoders.config import JUDGE
from model.systems.registry import load_system
from model.training.parallel import Shard
from tests.model.made import make_data_folder, make_weights

ROW = ClipRow(
    measures={"tip_jerk_m_s3": 1.0},
    by_depth={},
    couplings=dict.fromkeys(("right", "shifted", "foreign"), 0.0),
    features=None,
    positions=[],
)
CLIPS = ["1_ann_0_0_0", "2_bob_0_1_1"]


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    root = tmp_path_factory.mktemp("evaluation")
    data = make_data_folder(root / "data", seconds=8)
    split = (data / "train_test_split.csv").read_text()
    (data / "train_test_split.csv").write_text(split.replace("train\n", "test\n"))
    return data, make_weights(root / "weights")


@pytest.fixture(scope="module")
def system(folders):
    return load_system("globaldiff/local", folders[1])


def untrained_judge(system) -> FrozenEncoder:
    network = MotionAutoencoder(JUDGE).eval()
    return FrozenEncoder(network, system.normaliser, "")


def test_table_has_recorded_and_generated_rows_with_intervals(folders, tmp_path, capsys):
    data, weights = folders
    status = main(["--data", str(data), "--weights", str(weights), "--out", str(tmp_path),
                   "--seeds", "1"])  # fmt: skip
    assert status == 0
    table = json.loads((tmp_path / "evaluation.json").read_text())
    assert table["clips"] == CLIPS  # eve's clip is of no known speaker
    assert list(table["motion"]) == ["recorded", "globaldiff/local", "globaldiff/global"]
    jerk = table["motion"]["recorded"]["tip_jerk_m_s3"]
    assert 0 < jerk["low"] <= jerk["mean"] <= jerk["high"]
    assert table["motion"]["recorded"]["tip_jerk_m_s3_ratio"]["mean"] == 1
    assert "face_mse" not in table["motion"]["recorded"]
    assert table["motion"]["globaldiff/local"]["face_mse"]["mean"] > 0
    assert "fgd" not in table["motion"]["globaldiff/local"]  # no encoder among these weights
    text = (tmp_path / "evaluation.md").read_text()
    assert text == capsys.readouterr().out and "globaldiff/global" in text
    ratio = table["wrong_speech"]["globaldiff/local"]["shifted"]["mean"]
    assert f"| globaldiff/local | {100 * (ratio - 1):.3g} [" in text
    with (tmp_path / "evaluation.csv").open() as file:
        values = {(r["part"], r["row"], r["measure"]): r["mean"] for r in csv.DictReader(file)}
    assert float(values["motion", "recorded", "tip_jerk_m_s3"]) == jerk["mean"]
    latex = (tmp_path / "evaluation.tex").read_text().splitlines()
    cells = [line.count("&") for line in latex if line.endswith(r"\\")]
    assert len(cells) > 10 and set(cells) == {3}
    assert "power $>$ 5 Hz" in "\n".join(latex)


def test_recorded_motion_is_at_no_distance_from_itself_and_the_floor_is_above(folders, system):
    table = evaluate(folders[0], CLIPS, [system], 1, judge=untrained_judge(system))
    assert table["motion"]["globaldiff/local"]["fgd"]["mean"] > 0
    assert table["fgd_floor"]["mean"] > 0 and "fgd" not in table["motion"]["recorded"]


def test_an_untrained_network_gains_nothing_from_the_right_speech(folders, system):
    table = evaluate(folders[0], CLIPS, [system], 1)
    for kind in ("shifted", "foreign"):
        assert table["wrong_speech"]["globaldiff/local"][kind]["mean"] == pytest.approx(1, abs=0.02)


def test_numbers_do_not_depend_on_batches_nor_on_processes(folders, system):
    data, _ = folders
    whole = evaluate(data, CLIPS, [system], 1)
    assert_close(whole, evaluate(data, CLIPS, [system], 1, batch_windows=1))

    class TwoInTurn(Shard):
        """The second process, which hands the table what the first one found."""

        def gather(self, value):
            return [found.pop(), value] if found else kept.append(value) or [value] * 2

    kept: list[dict] = []
    found: list[dict] = []
    with pytest.raises(KeyError):  # the first process has one clip of two
        evaluate(data, CLIPS, [system], 1, shard=TwoInTurn(0, 2))
    found.append(kept.pop())
    assert_close(whole, evaluate(data, CLIPS, [system], 1, shard=TwoInTurn(1, 2)))


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


def test_each_system_hears_through_its_own_encoder(folders, system):
    other = replace(system, name="globaldiff/global", encoder=OtherEncoder())
    together = evaluate(folders[0], CLIPS, [system, other], 1)
    for one in (system, other):
        alone = evaluate(folders[0], CLIPS, [one], 1)
        assert_close(together["wrong_speech"][one.name], alone["wrong_speech"][one.name])
    right = [together["by_depth"][name]["position_error_m"] for name in together["wrong_speech"]]
    assert right[0] != right[1]


def test_spread_at_will_needs_two_of_a_kind(folders, system):
    once, twice = (evaluate(folders[0], CLIPS, [system], seeds)["motion"] for seeds in (1, 2))
    assert "spread_at_will_m" not in once["globaldiff/local"]
    assert twice["globaldiff/local"]["spread_at_will_m"]["mean"] > 0
    assert "spread_at_will_m" not in once["recorded"]  # two clips of two speakers


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
