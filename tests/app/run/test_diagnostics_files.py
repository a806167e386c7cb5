import csv
import json
from pathlib import Path

from app.run.diagnostics_files import write_diagnostics

DIAGNOSTICS = {
    "fps": 30,
    "systems": {"a/b": {"raw": {"tip": 1.5, "by_joint": [1.0, 2.0], "none": None, "yes": True}}},
    "reference": {"savgol": {"nested": {"x": {"y": 3}}}},
}


def test_the_json_is_what_was_measured_and_the_csv_has_each_number_once(tmp_path: Path) -> None:
    write_diagnostics(DIAGNOSTICS, tmp_path / "d.json", tmp_path / "d.csv")
    assert json.loads((tmp_path / "d.json").read_text()) == DIAGNOSTICS
    with (tmp_path / "d.csv").open() as file:
        assert list(csv.reader(file)) == [
            ["name", "post_filter", "measure", "index", "value"],
            ["a/b", "raw", "tip", "", "1.5"],
            ["a/b", "raw", "by_joint", "0", "1.0"],
            ["a/b", "raw", "by_joint", "1", "2.0"],
            ["reference", "savgol", "nested", "x/y", "3"],
        ]
