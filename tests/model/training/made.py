"""Trainings of two steps, also ended or shared, and what they leave."""

import csv
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from model.storage.cards import BUNDLED_WEIGHTS
from model.systems.registry import family_of
from model.training import losses
from model.training.config import TrainConfig
from model.training.loop import train
from tests.helpers import ROOT

QUICK = {"steps": 2, "save_every": 1, "validate_every": 2, "warmup_steps": 0, "batch_size": 2}


def quick(system: str, **changes) -> Any:
    config = family_of(system).config("smoke", system)
    return replace(config, **{**QUICK, "augmented_copies": 0, **changes})


def run(config: TrainConfig, data: Path, out: Path, helpers=BUNDLED_WEIGHTS, **options) -> Path:
    torch.set_num_threads(1)  # also where it is made once, before a test: sums depend on it
    train(config, family_of(config.system).make_task, data, out, helper_weights=helpers, **options)
    return out


def state_of(out: Path) -> dict[str, Any]:
    return torch.load(out / "state.pt", weights_only=True)


def assert_equal_states(one: Any, other: Any) -> None:
    """To the last bit, whatever they hold."""
    assert type(one) is type(other)
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            assert_equal_states(one[key], other[key])
    elif isinstance(one, list):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            assert_equal_states(a, b)
    else:
        assert torch.equal(one, other) if isinstance(one, torch.Tensor) else one == other


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


def train_in_processes(count: int, arguments: list[str], out: Path) -> None:
    """``python -m model.train`` under torchrun, without what fixtures change."""
    launched = ["-m", "torch.distributed.run", "--standalone", f"--nproc_per_node={count}"]
    done = subprocess.run(
        [sys.executable, *launched, "-m", "model.train", *arguments, "--out", out],
        cwd=ROOT,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
