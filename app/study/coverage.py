"""Do the report's 95 % intervals hold the truth 95 times in 100?

``python -m app.study.coverage`` simulates whole studies, runs each through the reading
and the analysis of the report, and prints how often intervals held what they claim to hold. Four
claims are tested, each pair of systems apart:

- same: the share that all raters of the population would give on the clips of the study;
- other: the share over all raters and all clips;
- strength: the difference of log-strengths with all raters on the clips of the study;
- rank: in rankings, the difference of mean ranks, the same way.

The truth is computed from the simulation, not estimated from its votes. "alike" has no differences
between raters or clips, so that the truth is the strengths that were set; "varied" has both, and
raters who tie more or less often. Pairs have ties and a favoured side in either.
"""

from __future__ import annotations

import argparse
import json
import sys
from itertools import combinations
from typing import Literal

import numpy as np
import pandas as pd
from jaxtyping import Float

from app.study.design.checked import checked
from app.study.design.key import KIND_OF_PROTOCOL, AttentionRule, Key, Question, Trial, Video
from app.study.simulate import ALIKE, RaterModel, World, answers_file, davidson
from app.study.statistics.answers import Participant, fitting
from app.study.statistics.models import fit_strengths
from app.study.statistics.results import analyse_participants

RATERS = 28
CLIPS = 10
STRENGTHS = {"real": 0.9, "global": 0.3, "local": -0.2, "rival": -1.0}
"""From close to clear: the pairs' shares run from .57 to .80."""
POPULATION = 20_000
"""Raters, or clips, over which the truth is averaged; its error is under .002."""

Protocol = Literal["pairwise", "ranking"]
Pair = tuple[str, str]
PAIRS: list[Pair] = list(combinations(STRENGTHS, 2))


def design(protocol: Protocol, num_clips: int = CLIPS) -> Key:
    """A study where everybody sees every clip: all pairs of systems, or all systems to rank."""
    clips = [f"clip{number:02d}" for number in range(num_clips)]
    together = PAIRS if protocol == "pairwise" else [tuple(STRENGTHS)]
    kind = KIND_OF_PROTOCOL[protocol]
    trials = {
        f"{clip}-{n}": Trial(kind, clip, tuple(f"{clip}-{name}" for name in shown), ("realism",))
        for clip in clips
        for n, shown in enumerate(together)
    }
    asks = "choice" if protocol == "pairwise" else "ranking"
    return Key(
        study="0" * 16,
        title="Coverage",
        protocol=protocol,
        systems=tuple(STRENGTHS),
        questions=(Question("realism", "Which moves more like a real person?", asks),),
        videos={
            f"{clip}-{name}": Video(name, clip, None, "front", "0" * 64)
            for clip in clips
            for name in STRENGTHS
        },
        trials=trials,
        lists={number: tuple(trials) for number in range(RATERS)},
        attention_rule=AttentionRule(0),
        participants=RATERS,
    )


def coverage(
    protocol: Protocol, model: RaterModel, studies: int, seed: int, num_clips: int = CLIPS
) -> pd.DataFrame:
    """Over so many simulated studies, by claim and pair: how often intervals held the truth, and
    how wide they were."""
    key = design(protocol, num_clips)
    anywhere = share_over_clips(key, model)
    rows = []
    for study in range(studies):
        world = World(key, STRENGTHS, model, np.random.default_rng([seed, study]))
        files = [json.dumps(answers_file(world, rater)) for rater in range(RATERS)]
        people = [fitting(checked(content, Participant), key)[0] for content in files]
        (result,) = analyse_participants(people, key)
        chances = {pair: chances_of(world, pair) for pair in PAIRS}
        strengths, ranks = population_strengths(chances), population_ranks(chances)
        for pair in PAIRS:
            first, second = pair
            for claim, measure, truth in (
                ("same", "share", float(chances[pair].mean(0) @ [1, 0.5, 0])),
                ("other", "share_also_over_clips", anywhere[pair]),
                ("strength", "log_strength_gap", strengths[first] - strengths[second]),
                ("rank", "mean_rank_gap", ranks[first] - ranks[second]),
            ):
                if (one := result.one(measure, *pair)) is not None:
                    assert one.low is not None and one.high is not None
                    held = one.low <= truth <= one.high
                    rows.append((claim, " - ".join(pair), held, one.high - one.low))
    table = pd.DataFrame(rows, columns=["claim", "pair", "held", "width"])
    return pd.DataFrame(table.groupby(["claim", "pair"], sort=False).mean())


def chances_of(world: World, pair: Pair) -> Float[np.ndarray, "2 3"]:
    """Chances of first, tie and second over the population, on the left and on the right."""
    count = POPULATION // len(world.clip_strength)
    seen = world.clip_strength[:, None] + world.tastes(count)  # (C, R, K)
    return _mean_chances(seen, world.ties(count), world, pair)


def _mean_chances(
    seen: np.ndarray, tie: np.ndarray, world: World, pair: Pair
) -> Float[np.ndarray, "2 3"]:
    first, second = map(world.key.systems.index, pair)
    gap = seen[..., first] - seen[..., second]
    is_ranking = world.key.protocol == "ranking"
    tie = np.zeros_like(tie) if is_ranking else tie
    side = 0.0 if is_ranking else world.model.left_advantage
    return np.stack([davidson(gap + sign * side, tie).reshape(-1, 3).mean(0) for sign in (1, -1)])


def share_over_clips(key: Key, model: RaterModel) -> dict[Pair, float]:
    """The first's share with every vote by another rater on another clip."""
    rng = np.random.default_rng(0)
    world = World(key, STRENGTHS, model, rng)
    seen = np.array(list(STRENGTHS.values())) + world.tastes(POPULATION)
    seen = seen + rng.normal(0, model.clip_sd, seen.shape)
    ties = world.ties(POPULATION)
    return {
        pair: float(_mean_chances(seen, ties, world, pair).mean(0) @ [1, 0.5, 0]) for pair in PAIRS
    }


def population_ranks(chances: dict[Pair, np.ndarray]) -> dict[str, float]:
    """Mean ranks: one more than how many others are expected before each system."""
    ranks = dict.fromkeys(STRENGTHS, 1.0)
    for (first, second), both_sides in chances.items():
        first_before = float(both_sides[0] @ [1, 0.5, 0])
        ranks[second] += first_before
        ranks[first] += 1 - first_before
    return ranks


def population_strengths(chances: dict[Pair, np.ndarray], each: int = 4000) -> dict[str, float]:
    """What the model becomes with votes in exact proportion to their chances."""
    parts = []
    for pair, both_sides in chances.items():
        for (left, right), row in zip((pair, pair[::-1]), both_sides, strict=True):
            counts = np.diff(np.round(np.cumsum([0, *row]) * each)).astype(int)
            score = np.repeat([1.0, 0.5, 0.0] if left == pair[0] else [0.0, 0.5, 1.0], counts)
            parts.append(pd.DataFrame({"rater": 0, "left": left, "right": right, "score": score}))
    votes = pd.concat(parts)
    fit = fit_strengths(votes, list(STRENGTHS), has_sides=bool((votes.score == 0.5).any()))
    return dict(zip(STRENGTHS, map(float, fit.best), strict=False))


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description="Coverage of the report's intervals.")
    parser.add_argument("--studies", type=int, default=200)
    parser.add_argument("--clips", type=int, default=CLIPS)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    parts = []
    for protocol in ("pairwise", "ranking"):
        for raters, model in (("alike", ALIKE), ("varied", RaterModel())):
            found = coverage(protocol, model, arguments.studies, arguments.seed, arguments.clips)
            parts.append(found.reset_index().assign(protocol=protocol, raters=raters))
    table = pd.concat(parts).groupby(["protocol", "raters", "claim"], sort=False)
    held = table.held.agg(["mean", "min", "max"]).assign(width=table.width.mean())
    sys.stdout.write(held.round(3).to_string() + "\n")


if __name__ == "__main__":
    main()
