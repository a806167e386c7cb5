import json

import numpy as np
import pytest

from model.data import DataError
from model.evaluate import bootstrap, bootstrap_ratio, evaluate, main
from model.systems import load_system
from tests.model.made import make_data_folder, make_weights


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    root = tmp_path_factory.mktemp("evaluation")
    data = make_data_folder(root / "data")
    split = (data / "train_test_split.csv").read_text()
    (data / "train_test_split.csv").write_text(split.replace("train\n", "test\n"))
    return data, make_weights(root / "weights")


def test_table_has_recorded_and_generated_rows_with_intervals(folders, tmp_path, capsys):
    data, weights = folders
    status = main(["--data", str(data), "--weights", str(weights), "--out", str(tmp_path),
                   "--seeds", "1"])  # fmt: skip
    assert status == 0
    table = json.loads((tmp_path / "evaluation.json").read_text())
    assert table["clips"] == ["1_ann_0_0_0", "2_bob_0_1_1"]  # eve's clip is of no known speaker
    assert list(table["motion"]) == ["recorded", "globaldiff/local", "globaldiff/global"]
    jerk = table["motion"]["recorded"]["tip_jerk_m_s3"]
    assert 0 < jerk["low"] <= jerk["mean"] <= jerk["high"]
    assert "globaldiff/global" in capsys.readouterr().out


def test_an_untrained_network_gains_nothing_from_the_right_speech(folders):
    data, weights = folders
    clips = ["1_ann_0_0_0", "2_bob_0_1_1"]
    table = evaluate(data, clips, [load_system("globaldiff/local", weights)], 1)
    for kind in ("shifted", "foreign"):
        assert table["wrong_speech"]["globaldiff/local"][kind]["mean"] == pytest.approx(1, abs=0.02)


def test_bootstrap_covers_the_mean_and_narrows_with_more_clips():
    rng = np.random.default_rng(1)
    few, many = (bootstrap(list(rng.normal(5, 1, n))) for n in (10, 1000))
    assert few.low < 5 < few.high and many.low < 5 < many.high
    assert (many.high - many.low) < (few.high - few.low) / 4
    ratio = bootstrap_ratio([2.0, 4.0], [1.0, 2.0])  # in pairs the ratio is the same every draw
    assert ratio.mean == ratio.low == ratio.high == 2.0


def test_too_few_clips_are_refused(folders):
    data, weights = folders
    with pytest.raises(DataError, match="at least 2"):
        evaluate(data, ["1_ann_0_0_0"], [load_system("globaldiff/local", weights)], 1)
