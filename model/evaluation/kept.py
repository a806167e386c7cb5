"""Numbers of one clip on disk, so that an evaluation that was stopped goes on where it was, and
its clips can be measured anywhere."""

import json
from pathlib import Path

import numpy as np

from model.evaluation.clips import ClipRow
from model.storage.files import written_atomically

_NUMBERS = ("measures", "by_depth", "couplings", "errors")


def save_rows(path: Path, rows: dict[str, ClipRow]) -> None:
    """Write a clip's rows, whole or not at all: numbers as JSON, arrays as they are."""
    arrays: dict[str, np.ndarray] = {}
    told = {}
    for place, (name, row) in enumerate(rows.items()):
        own = {f"features.{key}": value for key, value in row.features.items()}
        own |= {f"positions.{seed}": joints for seed, joints in enumerate(row.positions)}
        own["windows"] = row.windows
        arrays |= {f"{place}.{key}": array for key, array in own.items()}
        told[name] = {key: getattr(row, key) for key in _NUMBERS}
    text = json.dumps(told).encode()
    with written_atomically(path) as part:
        np.savez(part, rows=np.frombuffer(text, np.uint8), **arrays)  # type: ignore[arg-type]


def load_rows(path: Path) -> dict[str, ClipRow]:
    """What `save_rows` wrote."""
    with np.load(path, allow_pickle=False) as archive:
        told = json.loads(archive["rows"].tobytes())
        rows = {}
        for place, (name, numbers) in enumerate(told.items()):
            start = f"{place}."
            own = {key[len(start) :]: archive[key] for key in archive if key.startswith(start)}
            features = {k.partition(".")[2]: v for k, v in own.items() if k.startswith("features.")}
            seeds = sum(key.startswith("positions.") for key in own)
            rows[name] = ClipRow(
                **numbers,
                features=features,
                positions=[own[f"positions.{seed}"] for seed in range(seeds)],
                windows=own["windows"],
            )
    return rows
