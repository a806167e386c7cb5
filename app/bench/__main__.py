"""Command ``python -m app.bench``: cost of each step on this machine, as a table and bench.json."""

from __future__ import annotations

import json
import os
import platform
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Literal

import tyro

from app.bench import runs
from app.config import BUNDLED_WEIGHTS
from app.run.bodies import body_motion
from app.run.models import warm_up_in_steps
from app.run.output.provenance import software_versions

CLIP_S = 10.0


BenchRow = Literal["figures", "speech-effect", "steps", "training", "memory"]


def run_benchmark(
    short: bool = False, only: tuple[BenchRow, ...] = (), out: Path = Path("bench.json")
) -> None:
    """Measure the cost of each step on this machine; print a table and write a file.

    Args:
        short: skip drawing stages, and the rows that can be selected by ``only``.
        only: measure these rows alone.
    """
    figures = []
    with tempfile.TemporaryDirectory(prefix="bench-") as name:
        for figure in _selected(short, only, Path(name)):
            sys.stdout.write(figure.line() + "\n")
            sys.stdout.flush()
            figures.append(figure)
    record = {
        "figures": [asdict(figure) for figure in figures],
        "machine": {"cores": os.cpu_count(), "processor": platform.processor() or "unknown"},
        "versions": software_versions(),
    }
    out.write_text(json.dumps(record, indent=1) + "\n")


def _selected(short: bool, only: tuple[BenchRow, ...], folder: Path) -> Iterator[runs.BenchResult]:
    if not only:
        yield from _figures(short, folder)
    clip = runs.write_example_of_duration(CLIP_S, folder)
    rows: dict[BenchRow, Callable[[], Iterable[runs.BenchResult]]] = {
        "figures": lambda: runs.measure_figure_cpu_time(clip, folder),
        "speech-effect": lambda: [runs.time_speech_effect(folder)],
        "steps": lambda: [runs.time_step_sweep(clip, folder)],
        "training": runs.measure_training_rates,
        "memory": lambda: runs.measure_run_peak_memory(folder),
    }
    for row in only or (() if short else rows):
        yield from rows[row]()


def _figures(short: bool, folder: Path) -> Iterator[runs.BenchResult]:
    from app.bench import drawing
    from model.motion.motion import load_motion

    yield runs.time_page_start(folder)
    list(warm_up_in_steps(BUNDLED_WEIGHTS, None))
    clip = runs.write_example_of_duration(CLIP_S, folder)
    yield from runs.time_features_and_generation(clip)
    yield from runs.time_run_with_page_settings(clip, folder)
    motion = load_motion(min((folder / "page").glob("*.npz")))
    yield runs.time_metrics(motion)
    yield from drawing.measure_video_rates(body_motion(motion), folder)
    if not short:
        yield from drawing.measure_render_stages(body_motion(motion), folder)


if __name__ == "__main__":
    tyro.cli(run_benchmark, prog="python -m app.bench")
