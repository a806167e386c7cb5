"""``python -m app.bench``: what each step costs here, as a table and bench.json."""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from app.bench import runs
from app.bench.measured import Figure, served_page
from app.config import BUNDLED_WEIGHTS, EXAMPLES
from app.run.body_motion import body_motion
from app.run.models import warm_up
from app.run.output.provenance import versions

CLIP_S = 10.0


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print the table, write the file."""
    parser = argparse.ArgumentParser(prog="python -m app.bench", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("bench.json"), metavar="FILE")
    parser.add_argument("--weights", type=Path, default=BUNDLED_WEIGHTS, metavar="DIR")
    parser.add_argument("--speech", type=Path, metavar="WAV", help="default: an example clip")
    parser.add_argument(
        "--short",
        action="store_true",
        help="a few minutes: without stages of drawing, training and memory",
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

    weights = options.weights
    speech = options.speech or min(EXAMPLES.glob("*.wav"))
    clip = runs.repeat_speech(speech, CLIP_S, folder / "clip.wav")
    started = time.monotonic()
    with served_page(weights, folder):
        yield Figure("page start", time.monotonic() - started, "s", "at most 8 s")
    warm_up(weights, None)
    yield from runs.time_motion(clip, weights)
    yield from runs.time_page_run(clip, weights, folder)
    motion = load_motion(min((folder / "page").glob("*.npz")))
    yield runs.time_measures(motion)
    yield from drawing.video_rates(body_motion(motion), folder)
    if not options.short:
        yield from drawing.stages(body_motion(motion), folder)
        yield from runs.time_training(weights)
        yield from runs.measure_memory(speech, weights, folder)


if __name__ == "__main__":
    sys.exit(main())
