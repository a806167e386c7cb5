"""Trainings that are ended, or shared, and what they leave."""

import csv
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from model.training import losses
from tests.helpers import ROOT


def log_of(out: Path, split: str | None = None) -> list[dict[str, str]]:
    """The rows of a training's log, or those of one split."""
    with (out / "log.csv").open() as file:
        return [row for row in csv.DictReader(file) if split in (None, row["split"])]


@contextmanager
def killed_at(step: int) -> Iterator[None]:
    """A training inside ends as a process that is killed at this step, before it is saved."""

    class Killed(Exception):
        pass

    real = losses.finite_or_raise

    def dying(numbers: dict, at: int, clips: object) -> None:
        if at == step:
            raise Killed
        real(numbers, at, clips)

    with pytest.MonkeyPatch.context() as patch, pytest.raises(Killed):
        patch.setattr(losses, "finite_or_raise", dying)
        yield


def train_in_two_processes(arguments: list[str], out: Path) -> None:
    """``python -m model.train`` under torchrun."""
    launched = ["-m", "torch.distributed.run", "--standalone", "--nproc_per_node=2"]
    done = subprocess.run(
        [sys.executable, *launched, "-m", "model.train", *arguments, "--out", out],
        cwd=ROOT,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
