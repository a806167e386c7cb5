"""Diagnostics on disk: the public JSON, and the same scalars as a table."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from app.run.request import REFERENCE_NAME

CSV_HEADER = ("name", "post_filter", "measure", "index", "value")


def write_diagnostics(diagnostics: Mapping[str, Any], json_path: Path, csv_path: Path) -> None:
    """Write both files. The CSV has one row for each number; arrays are told apart by ``index``."""
    json_path.write_text(json.dumps(diagnostics, indent=1, allow_nan=False) + "\n")
    with csv_path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(CSV_HEADER)
        writer.writerows(_rows(diagnostics))


def _rows(diagnostics: Mapping[str, Any]) -> Iterator[tuple[str, str, str, str, float]]:
    motions = dict(diagnostics["systems"])
    if diagnostics["reference"] is not None:
        motions[REFERENCE_NAME] = diagnostics["reference"]
    for name, measures in motions.items():
        for post_filter, values in measures.items():
            for measure, value in values.items():
                for index, number in _numbers(value):
                    yield name, post_filter, measure, index, number


def _numbers(value: Any, index: str = "") -> Iterator[tuple[str, float]]:
    """Every number inside nested lists and mappings, with the way to it as ``a/b``."""
    if isinstance(value, Mapping):
        items = value.items()
    elif isinstance(value, list | tuple):
        items = enumerate(value)
    elif isinstance(value, bool) or not isinstance(value, int | float):
        return
    else:
        yield index, value
        return
    for key, inner in items:
        yield from _numbers(inner, f"{index}/{key}" if index else str(key))
