"""Command ``python -m app.bench``: cost of each step on this machine, as a table and bench.json."""

from __future__ import annotations

import json
import os
import platform
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import tyro

from app.bench import runs
from app.config import BUNDLED_WEIGHTS
from app.run.bodies import body_motion
from app.run.models import warm_up_steps
from app.run.output.provenance import versions

CLIP_S = 10.0


def measure(short: bool = False, out: Path = Path("bench.json")) -> None:
    """Measure the cost of each step on this machine; print a table and write a file.

    Args:
        short: skip drawing stages, figures, speech effect, training and memory.
    """
    figures = []
    with tempfile.TemporaryDirectory(prefix="bench-") as name:
        for figure in _figures(short, Path(name)):
            sys.stdout.write(figure.line() + "\n")
            sys.stdout.flush()
            figures.append(figure)
    record = {
        "figures": [asdict(figure) for figure in figures],
        "machine": {"cores": os.cpu_count(), "processor": platform.processor() or "unknown"},
        "versions": versions(),
    }
    out.write_text(json.dumps(record, indent=1) + "\n")


def _figures(short: bool, folder: Path) -> Iterator[runs.Figure]:
    from app.bench import drawing
    from model.motion.motion import load_motion

    yield runs.time_page_start(folder)
    list(warm_up_steps(BUNDLED_WEIGHTS, None))
    clip = runs.speech_of(CLIP_S, folder)
    yield from runs.time_motion(clip)
    yield from runs.time_page_run(clip, folder)
    motion = load_motion(min((folder / "page").glob("*.npz")))
    yield runs.time_measures(motion)
    yield from drawing.video_rates(body_motion(motion), folder)
    if not short:
        yield from drawing.stages(body_motion(motion), folder)
        yield from runs.time_figures(clip, folder)
        yield runs.time_speech_effect(folder)
        yield from runs.time_training()
        yield from runs.measure_memory(folder)


if __name__ == "__main__":
    tyro.cli(measure, prog="python -m app.bench")
