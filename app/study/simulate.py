"""Simulated raters with known preferences, for testing a study and its whole analysis.

Every system has a log-strength; a rater perceives it plus an individual taste for the system.
Choices follow Davidson's model (`app.study.statistics.models`), rankings Plackett-Luce (strength
plus Gumbel noise, so that any two systems follow Bradley-Terry), sliders are linear in strength. In
matched trials the log-strength is that of the matched video against 0 for the other.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from app.errors import RunError
from app.study.design.key import StudyKey, Trial, read_key
from app.study.statistics.answers import HIGHEST_RATING, SIMULATION_TRUTH_FILE, TIE
from app.study.statistics.votes import SMOOTHNESS
from model.storage.files import write_atomically

MAX_RATERS = 10_000
MAX_LOG_STRENGTH = 20.0
RATING_PER_LOG_STRENGTH, RATING_NOISE_SD = 12.0, 10.0
_START = datetime(2026, 1, 1, tzinfo=UTC)
"""Fixed start time, so that the same seed writes the same files."""


@dataclass(frozen=True)
class RaterModel:
    """Variation and errors of raters."""

    taste_sd: float = 0.5
    """Standard deviation of raters' tastes for each system, in log-strength."""
    tie_parameter: float = 0.5
    """Davidson's tie parameter: with 0.5, 1 in 5 choices between equals is a tie."""
    left_advantage: float = 0.1
    """Log-strength added to the video on the left."""
    check_failure_probability: float = 0.02
    """Probability of failing an attention check."""
    smoothness_reason_probability: float = 0.3
    """Probability of naming motion smoothness as a reason."""


UNIFORM_RATERS = RaterModel(taste_sd=0)
"""Raters without individual tastes: exactly Davidson's model."""


def simulate(
    study_dir: Path, raters: int, strengths: dict[str, float], seed: int, out: Path
) -> None:
    """Write an answers file for each rater, and ``truth.json`` with the parameters.

    Args:
        study_dir: folder of an export; its `researcher_only/key.json` is read.
        strengths: log-strength (natural logarithm) of every system.

    Raises:
        RunError: if a number is out of range, a system is missing or unknown, or ``out`` holds
            answers
            of an earlier run.
    """
    key = read_key(study_dir / "researcher_only" / "key.json")
    if not 1 <= raters <= MAX_RATERS:
        raise RunError(f"The number of raters must be from 1 to {MAX_RATERS}; got {raters}.")
    if seed < 0:
        raise RunError(f"The seed must not be negative; got {seed}.")
    if set(strengths) != set(key.systems):
        raise RunError(
            "--strengths must name each system of the study "
            f"({', '.join(key.systems)}) once, and nothing else; got "
            f"{', '.join(strengths) or 'none'}."
        )
    for name, value in strengths.items():
        if not (math.isfinite(value) and abs(value) <= MAX_LOG_STRENGTH):
            raise RunError(
                "--strengths gives log-strengths (natural logarithm), which must be from "
                f"{-MAX_LOG_STRENGTH:g} to {MAX_LOG_STRENGTH:g}; got {value} for {name}."
            )
    if out.is_dir() and any(out.glob("*.json")):
        raise RunError(f"{out} already contains answers; choose another folder.")
    out.mkdir(parents=True, exist_ok=True)
    model = RaterModel()
    for content in simulate_answers(key, strengths, raters, model, np.random.default_rng(seed)):
        _write(content, out / f"{content['participant']}.json")
    truth = {"strengths": dict(strengths), "seed": seed, "raters": raters, "model": asdict(model)}
    _write(truth, out / SIMULATION_TRUTH_FILE)


def _write(content: Mapping[str, Any], path: Path) -> None:
    write_atomically(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def simulate_answers(
    key: StudyKey,
    strengths: Mapping[str, float],
    raters: int,
    model: RaterModel,
    rng: np.random.Generator,
) -> Iterator[dict[str, Any]]:
    """Yield each rater's answers as the page sends them; lists in turn, positions rotated."""
    lists = sorted(key.lists)
    for rater in range(raters):
        number = lists[rater % len(lists)]
        perceived = {name: strengths[name] + rng.normal(0, model.taste_sd) for name in key.systems}
        answers = []
        for trial_id in key.lists[number]:
            trial = key.trials[trial_id]
            turn = number % max(1, len(trial.videos))
            shown = (*trial.videos[turn:], *trial.videos[:turn])
            watching_ms = round(1000 * (key.video_s or 0.0) * len(shown))
            for question in trial.questions:
                is_named = (
                    trial.kind == "pair" and rng.random() < model.smoothness_reason_probability
                )
                answers.append(
                    {
                        "trial": trial_id,
                        "question": question,
                        "shown": list(shown),
                        "value": _value(key, trial, shown, perceived, model, rng),
                        "reasons": [SMOOTHNESS] if is_named else [],
                        "watched": 1,
                        "ms": int(rng.integers(2_000, 20_000)) + watching_ms,
                    }
                )
        duration = timedelta(milliseconds=sum(answer["ms"] for answer in answers))
        yield {
            "format": 1,
            "study": key.study_id,
            "participant": f"simulated{rater:05d}",
            "list": number,
            "started": _START.isoformat(),
            "finished": (_START + duration).isoformat(),
            "device": {"width": 1280, "height": 900, "touch": False},
            "headphones": "skipped",
            **({"link": key.token(rater)} if key.link_secret else {}),
            "answers": answers,
        }


def _value(
    key: StudyKey,
    trial: Trial,
    ids: tuple[str, ...],
    strengths: Mapping[str, float],
    model: RaterModel,
    rng: np.random.Generator,
) -> Any:
    if trial.expected is not None:
        return "missed" if rng.random() < model.check_failure_probability else trial.expected.value
    videos = [key.videos[video] for video in ids]
    strength = np.array([strengths[video.system] for video in videos])
    if trial.kind == "match":
        strength = strength * [video.has_own_speech for video in videos]
    if trial.kind in ("pair", "match"):
        chances = davidson(strength[0] - strength[1] + model.left_advantage, model.tie_parameter)
        return (ids[0], TIE, ids[1])[rng.choice(3, p=chances)]
    if trial.kind == "rank":
        order = np.argsort(-(strength + rng.gumbel(size=len(ids))))
        return [ids[place] for place in order]
    noise = rng.normal(0, RATING_NOISE_SD, len(ids))
    rating = HIGHEST_RATING / 2 + RATING_PER_LOG_STRENGTH * strength + noise
    rounded = np.clip(np.round(rating), 0, HIGHEST_RATING)
    return {video: int(value) for video, value in zip(ids, rounded, strict=True)}


def davidson(
    difference: Float[np.ndarray, " *many"] | float, tie_parameter: float
) -> Float[np.ndarray, "*many 3"]:
    """Compute the probabilities of left, tie and right for log-strengths left minus right."""
    half = np.asarray(difference, float) / 2
    weights = np.stack([np.exp(half), np.full_like(half, tie_parameter), np.exp(-half)], axis=-1)
    return weights / weights.sum(-1, keepdims=True)
