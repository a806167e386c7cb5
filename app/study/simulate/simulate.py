"""Answers of simulated raters whose preferences are known, to try the whole analysis."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from app.errors import RunError
from app.study.design.key import Key, read_key
from app.study.design.links import token_of
from app.study.simulate.raters import RaterModel, World
from app.study.statistics.answers import FORMAT, TRUTH_NAME
from model.storage.files import written_atomically

MAX_RATERS = 10_000
MAX_LOG_STRENGTH = 20.0

_START = datetime(2026, 1, 1, tzinfo=UTC)
"""Fixed, so that the same seed writes the same files."""


def simulate(
    study_dir: Path, raters: int, strengths: dict[str, float], seed: int, out: Path
) -> None:
    """Write an answers file for each rater and ``truth.json`` with what they were made from.

    Args:
        study_dir: folder of an export; its `researcher_only/key.json` is read.
        strengths: log-strength (natural logarithm) of every system.

    Raises:
        RunError: if a number is out of range, a system is missing or unknown, or ``out`` holds
            answers of an earlier run.
    """
    key = read_key(study_dir / "researcher_only" / "key.json")
    if not 1 <= raters <= MAX_RATERS:
        raise RunError(f"Raters must be 1 to {MAX_RATERS}; got {raters}.")
    if seed < 0:
        raise RunError(f"The seed must not be negative; got {seed}.")
    _check_strengths(strengths, key)
    if out.is_dir() and any(out.glob("*.json")):
        raise RunError(f"{out} holds answers already, which would mix; choose another folder.")
    out.mkdir(parents=True, exist_ok=True)
    model = RaterModel()
    world = World(key, strengths, model, np.random.default_rng(seed))
    for rater in range(raters):
        content = answers_file(world, rater)
        _write(content, out / f"{content['participant']}.json")
    truth = {"strengths": dict(strengths), "seed": seed, "raters": raters, "model": asdict(model)}
    _write(truth, out / TRUTH_NAME)


def answers_file(world: World, rater: int) -> dict[str, Any]:
    """What the page would send for one more rater, who works on one list after the other."""
    lists = sorted(world.key.lists)
    list_number = lists[rater % len(lists)]
    answers = world.answers(list_number)
    duration = timedelta(milliseconds=sum(answer["ms"] for answer in answers))
    return {
        "format": FORMAT,
        "study": world.key.study,
        "participant": f"simulated{rater:05d}",
        "list": list_number,
        "started": _START.isoformat(),
        "finished": (_START + duration).isoformat(),
        "device": {"width": 1280, "height": 900, "touch": False},
        "headphones": "skipped",
        **({"link": token_of(world.key, rater)} if world.key.link_secret else {}),
        "answers": answers,
    }


def _check_strengths(strengths: Mapping[str, float], key: Key) -> None:
    if set(strengths) != set(key.systems):
        raise RunError(
            f"Strengths are needed for exactly {', '.join(key.systems)}; "
            f"got {', '.join(strengths) or 'none'}."
        )
    for name, value in strengths.items():
        if not (math.isfinite(value) and abs(value) <= MAX_LOG_STRENGTH):
            raise RunError(
                f"The strength of {name} must be within ±{MAX_LOG_STRENGTH:g} "
                f"(natural logarithm); got {value}."
            )


def _write(content: Mapping[str, Any], path: Path) -> None:
    with written_atomically(path) as part:
        part.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", "utf-8")
