"""What commands over many clips share: who works, and what is said while they do."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from app.commands.said import name_file, say
from app.errors import RunError
from app.run.requests.request import GenerateRequest
from processes.pool import JobPool


def add_pool(parser: argparse.ArgumentParser) -> None:
    """Flags that say who works on many clips."""
    parser.add_argument(
        "--processes",
        type=_count,
        metavar="N",
        help="many clips: processes on this machine, one thread each",
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="many clips: a Dask scheduler such as tcp://head:8786, whose workers see the same "
        "files (docs/many-clips.md)",
    )


def pool_of(options: argparse.Namespace) -> JobPool:
    """As the flags say."""
    if options.processes is not None and options.scheduler is not None:
        raise RunError("Give --processes or --scheduler; a cluster has workers of its own.")
    return JobPool(options.processes, options.scheduler)


def generate_over_many(request: GenerateRequest, pool: JobPool) -> None:
    """Do all runs, name each folder on standard output as it is there, and say what failed.

    Raises:
        RunError: at the end, if any failed.
    """
    from app.commands.said import ProgressBar
    from app.run.many.speeches import generate_many

    with ProgressBar("generate clips") as bar:

        def on_done(folder: Path, share: float) -> None:
            bar.show(share)
            name_file(folder)

        with told_if_stopped():
            runs = generate_many(request, pool, on_done)
    for path in runs.files:
        name_file(path)
    for clip, sentence in runs.failed.items():
        say(f"{clip}: {sentence}")
    if runs.kept:
        say(f"{runs.kept} clips had been made before and were kept.")
    if runs.failed:
        raise RunError(
            f"{len(runs.failed)} of {len(runs.failed) + len(runs.clips)} clips could not be made; "
            "the same command tries these again."
        )


@contextmanager
def told_if_stopped() -> Iterator[None]:
    """Say that work on many clips that a person stops goes on later.

    Raises:
        RunError: in place of KeyboardInterrupt.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise RunError("stopped; what is done is kept, and the same command goes on.") from None


def _count(value: str) -> int:
    if not value.isdecimal() or int(value) < 1:
        raise argparse.ArgumentTypeError(f"{value!r} is no number of processes")
    return int(value)
