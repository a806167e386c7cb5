"""Raters of known taste, whose answers try a study and its whole analysis.

Every system has a log-strength; a rater sees it plus their own taste for that system plus what that
system did in that clip. Choices follow Davidson's model (`app.study.statistics.models`),
rankings Plackett-Luce (strength plus Gumbel noise, so that any two systems follow Bradley-Terry),
sliders a straight line in strength. In matched trials the log-strength is that of the matched video
against 0 for the other.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from app.errors import RunError
from app.study.design.key import Key, read_key
from app.study.statistics.answers import HIGHEST_RATING, TIE, TRUTH_NAME
from app.study.statistics.votes import SMOOTHNESS
from model.storage.files import written_atomically


@dataclass(frozen=True)
class RaterModel:
    """How raters and clips vary; standard deviations in log-strength."""

    taste_sd: float = 0.5
    """Of a rater's own taste for each system."""
    clip_sd: float = 0.3
    """Of what each system did in each clip."""
    tie: float = 0.5
    """Davidson's tie parameter of the middle rater: 0.5 makes 1 in 5 of equals a tie."""
    tie_log_sd: float = 0.5
    """Of the logarithm of a rater's own tie parameter."""
    left_advantage: float = 0.1
    """Log-strength that standing on the left adds."""
    lapse: float = 0.02
    """Chance to fail an attention check."""
    smoothness: float = 0.3
    """Chance to name motion smoothness as a reason."""


ALIKE = RaterModel(taste_sd=0, clip_sd=0, tie_log_sd=0)
"""All raters and clips alike: Davidson's model itself, without anything it leaves out."""

RATING_PER_LOG_STRENGTH = 12.0
RATING_OFFSET_SD = 8.0
RATING_NOISE_SD = 10.0


class World:
    """A study's clips as they turned out, from which raters are drawn."""

    def __init__(
        self,
        key: Key,
        strengths: Mapping[str, float],
        model: RaterModel,
        rng: np.random.Generator,
    ) -> None:
        self.key = key
        self.model = model
        self._rng = rng
        log_strength = np.array([strengths[name] for name in key.systems])
        whims = rng.normal(0, model.clip_sd, (len(key.clips), len(key.systems)))
        self.clip_strength: Float[np.ndarray, "C K"] = log_strength + whims

    def tastes(self, count: int) -> Float[np.ndarray, "R K"]:
        """What so many new raters add to each system's log-strength."""
        return self._rng.normal(0, self.model.taste_sd, (count, len(self.key.systems)))

    def ties(self, count: int) -> Float[np.ndarray, " R"]:
        """Tie parameters of so many new raters."""
        return self.model.tie * np.exp(self._rng.normal(0, self.model.tie_log_sd, count))

    def answers(self, list_number: int) -> list[dict[str, Any]]:
        """What one new rater answers to everything on a list, as in an answers file. Places turn
        with the list, so that sides are balanced over participants."""
        strength = self.clip_strength + self.tastes(1)
        tie = float(self.ties(1)[0])
        offset = float(self._rng.normal(0, RATING_OFFSET_SD))
        answers = []
        for trial_id in self.key.lists[list_number]:
            trial = self.key.trials[trial_id]
            turn = list_number % max(1, len(trial.videos))
            shown = (*trial.videos[turn:], *trial.videos[:turn])
            if trial.expected is not None:
                is_missed = self._rng.random() < self.model.lapse
                values = ["missed" if is_missed else trial.expected.value]
            else:
                seen = strength[self.key.clips.index(trial.clip)]
                values = [
                    self._value(trial.kind, shown, seen, tie, offset) for _ in trial.questions
                ]
            for question, value in zip(trial.questions, values, strict=True):
                is_named = trial.kind == "pair" and self._rng.random() < self.model.smoothness
                watching_ms = round(1000 * (self.key.video_s or 0.0) * len(shown))
                answers.append(
                    {
                        "trial": trial_id,
                        "question": question,
                        "shown": list(shown),
                        "value": value,
                        "reasons": [SMOOTHNESS] if is_named else [],
                        "watched": 1,
                        "ms": int(self._rng.integers(2_000, 20_000)) + watching_ms,
                    }
                )
        return answers

    def _value(
        self,
        kind: str,
        shown: tuple[str, ...],
        seen: Float[np.ndarray, " K"],
        tie: float,
        offset: float,
    ) -> Any:
        videos = [self.key.videos[video] for video in shown]
        strength = seen[[self.key.systems.index(video.system) for video in videos]]
        if kind == "match":
            strength = strength * [video.is_matched for video in videos]
        if kind in ("pair", "match"):
            chances = davidson(strength[0] - strength[1] + self.model.left_advantage, tie)
            return (shown[0], TIE, shown[1])[self._rng.choice(3, p=chances)]
        if kind == "rank":
            order = np.argsort(-(strength + self._rng.gumbel(size=len(shown))))
            return [shown[place] for place in order]
        noise = self._rng.normal(0, RATING_NOISE_SD, len(shown))
        rating = HIGHEST_RATING / 2 + RATING_PER_LOG_STRENGTH * strength + offset + noise
        rounded = np.clip(np.round(rating), 0, HIGHEST_RATING)
        return {video: int(value) for video, value in zip(shown, rounded, strict=True)}


def davidson(
    difference: Float[np.ndarray, " *many"] | float, tie: Float[np.ndarray, " *many"] | float
) -> Float[np.ndarray, "*many 3"]:
    """Chances of left, tie and right at a difference of log-strengths, left minus right."""
    difference, tie = np.broadcast_arrays(np.asarray(difference, float), np.asarray(tie, float))
    weights = np.stack([np.exp(difference / 2), tie, np.exp(-difference / 2)], axis=-1)
    return weights / weights.sum(-1, keepdims=True)


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
        "format": 1,
        "study": world.key.study,
        "participant": f"simulated{rater:05d}",
        "list": list_number,
        "started": _START.isoformat(),
        "finished": (_START + duration).isoformat(),
        "device": {"width": 1280, "height": 900, "touch": False},
        "headphones": "skipped",
        **({"link": world.key.token(rater)} if world.key.link_secret else {}),
        "answers": answers,
    }


def _write(content: Mapping[str, Any], path: Path) -> None:
    with written_atomically(path) as part:
        part.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", "utf-8")
