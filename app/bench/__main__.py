"""``python -m app.bench``: what each stage costs here, as a table and bench.json."""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from app.bench import browser, runs
from app.bench.measured import Figure, served_page
from app.config import BUNDLED_WEIGHTS, EXAMPLES
from app.run.body_motion import body_motion
from app.run.models import warm_up
from app.run.output.provenance import versions
from conventions.names import file_stem
from model.systems.registry import usual_systems

CLIP_S = 10.0


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print the table, write the file."""
    parser = argparse.ArgumentParser(prog="python -m app.bench", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("bench.json"), metavar="FILE")
    parser.add_argument("--weights", type=Path, default=BUNDLED_WEIGHTS, metavar="DIR")
    parser.add_argument("--speech", type=Path, metavar="WAV", help="default: an example clip")
    parser.add_argument(
        "--no-memory", action="store_true", help="leave out the ten-minute clip, which takes long"
    )
    parser.add_argument(
        "--short",
        action="store_true",
        help="a few minutes: without training, families, busy cores, a run of all systems, "
        "browser, stages of drawing and memory",
    )
    options = parser.parse_args(argv)
    figures = []
    with tempfile.TemporaryDirectory(prefix="bench-") as name:
        for figure in _figures(options, Path(name)):
            sys.stdout.write(figure.line() + "\n")
            sys.stdout.flush()
            figures.append(figure)
    record = {
        "figures": [asdict(figure) for figure in figures],
        "machine": {"cores": os.cpu_count(), "processor": platform.processor() or "unknown"},
        "versions": versions(),
    }
    options.out.write_text(json.dumps(record, indent=1) + "\n")
    return 0


def _figures(options: argparse.Namespace, folder: Path) -> Iterator[Figure]:
    from app.bench import drawing
    from model.motion.motion import load_motion

    weights, is_short = options.weights, options.short
    speech = options.speech or min(EXAMPLES.glob("*.wav"))
    clip = runs.repeat_speech(speech, CLIP_S, folder / "clip.wav")
    started = time.monotonic()
    with served_page(weights, folder):
        yield Figure("page start", time.monotonic() - started, "s", "at most 8 s")
    warm_up(weights, None)
    yield from runs.time_motion(clip, weights)
    if not is_short:
        yield from runs.time_families()
        yield from runs.time_training(weights)
        yield from runs.time_beside_busy_cores(clip, weights, folder)
        yield from runs.time_run(clip, weights, folder)
    yield from runs.time_page_run(clip, weights, folder)
    if not is_short:
        yield from browser.time_browser(clip, weights, folder)
    made = folder / ("page" if is_short else "run")
    yield from runs.time_measures(made / f"{file_stem(usual_systems('bench-busy')[0])}.npz")
    motion = body_motion(load_motion(min(made.glob("*.npz"))))
    rows: Iterable = (drawing.video_rates,) if is_short else drawing.ALL
    for row in rows:
        yield from row(motion, folder)
    if not (options.no_memory or is_short):
        yield from runs.measure_memory(speech, weights, folder)


if __name__ == "__main__":
    sys.exit(main())
