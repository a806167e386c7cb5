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
import sys
from collections import defaultdict
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from jaxtyping import Float

from app.study.design.fields import Fields
from app.study.design.key import Key, Question, Trial, Video
from app.study.simulate import ALIKE, RaterModel, World, answers_file, davidson
from app.study.statistics.answers import participant_of
from app.study.statistics.bradley_terry import fit_strengths
from app.study.statistics.preference import Interval
from app.study.statistics.results import analyse_participants
from app.study.statistics.votes import Votes

RATERS = 28
CLIPS = 10
STRENGTHS = {"real": 0.9, "global": 0.3, "local": -0.2, "rival": -1.0}
"""From close to clear: the pairs' shares run from .57 to .80."""
POPULATION = 20_000
"""Raters, or clips, over which the truth is averaged; its error is under .002."""

Protocol = Literal["pairwise", "ranking"]


def design(protocol: Protocol, num_clips: int = CLIPS, systems: tuple[str, ...] = ()) -> Key:
    """A study where everybody sees every clip: all pairs of systems, or all systems to rank."""
    systems = systems or tuple(STRENGTHS)
    clips = [f"clip{number:02d}" for number in range(num_clips)]
    videos = {
        f"{clip}-{system}": Video(system, clip, None, "front", "0" * 64)
        for clip in clips
        for system in systems
    }
    together = list(combinations(systems, 2)) if protocol == "pairwise" else [systems]
    trials = {
        f"{clip}-{number}": Trial(
            kind="pair" if protocol == "pairwise" else "rank",
            clip=clip,
            videos=tuple(f"{clip}-{system}" for system in shown),
            questions=("realism",),
        )
        for clip in clips
        for number, shown in enumerate(together)
    }
    kind = "choice" if protocol == "pairwise" else "ranking"
    return Key(
        study="0" * 16,
        title="Coverage",
        protocol=protocol,
        systems=systems,
        questions=(Question("realism", "Which moves more like a real person?", kind),),
        videos=videos,
        trials=trials,
        lists={number: tuple(trials) for number in range(RATERS)},
        max_failed=0,
        participants=RATERS,
    )


@dataclass
class Tally:
    """How often intervals of one claim held the truth, by pair, and how wide they were."""

    held: dict[tuple[int, int], int]
    width: float = 0.0

    def add(self, pair: tuple[int, int], interval: Interval, truth: float) -> None:
        self.held[pair] += interval.holds(truth)
        self.width += interval.high - interval.low


def coverage(
    protocol: Protocol, model: RaterModel, studies: int, seed: int, num_clips: int = CLIPS
) -> dict[str, Tally]:
    """Tallies by claim over so many simulated studies."""
    key = design(protocol, num_clips)
    pairs = list(combinations(range(len(key.systems)), 2))
    claims = ("same", "other", "strength", *(("rank",) if protocol == "ranking" else ()))
    tallies = {claim: Tally(defaultdict(int)) for claim in claims}
    anywhere = _share_over_clips(key, model, pairs)
    for study in range(studies):
        world = World(key, STRENGTHS, model, np.random.default_rng([seed, study]))
        files = [answers_file(world, rater) for rater in range(RATERS)]
        people = [participant_of(Fields(content), key, "simulated")[0] for content in files]
        result = analyse_participants(people, key)[0]
        assert result.strengths is not None
        chances = {pair: _chances(world, protocol, pair) for pair in pairs}
        log_strength = _population_strengths(chances, len(key.systems))
        for pair_result in result.pairs:
            pair = (pair_result.first, pair_result.second)
            truth = float(chances[pair].mean(0) @ [1, 0.5, 0])
            tallies["same"].add(pair, pair_result.share.interval, truth)
            if pair_result.share.over_clips is not None:
                tallies["other"].add(pair, pair_result.share.over_clips, anywhere[pair])
            gap = float(log_strength[pair[0]] - log_strength[pair[1]])
            tallies["strength"].add(pair, result.strengths.differences[pair][1], gap)
        if result.means is not None:
            ranks = _population_ranks(chances, len(key.systems))
            for test in result.means.pairs:
                gap = float(ranks[test.first] - ranks[test.second])
                tallies["rank"].add((test.first, test.second), test.interval, gap)
    return tallies


def _chances(world: World, protocol: Protocol, pair: tuple[int, int]) -> Float[np.ndarray, "2 3"]:
    """Chances of first, tie and second over the population, on the left and on the right."""
    count = POPULATION // len(world.clip_strength)
    seen = world.clip_strength[:, None] + world.tastes(count)  # (C, R, K)
    return _mean_chances(
        seen[..., pair[0]] - seen[..., pair[1]], world.ties(count), world, protocol
    )


def _mean_chances(
    gap: np.ndarray, tie: np.ndarray, world: World, protocol: Protocol
) -> Float[np.ndarray, "2 3"]:
    is_ranking = protocol == "ranking"
    tie = np.zeros_like(tie) if is_ranking else tie
    side = 0.0 if is_ranking else world.model.left_advantage
    return np.stack([davidson(gap + sign * side, tie).reshape(-1, 3).mean(0) for sign in (1, -1)])


def _share_over_clips(
    key: Key, model: RaterModel, pairs: list[tuple[int, int]]
) -> dict[tuple[int, int], float]:
    """The first's share with every vote by another rater on another clip."""
    rng = np.random.default_rng(0)
    world = World(key, STRENGTHS, model, rng)
    log_strength = np.array([STRENGTHS[name] for name in key.systems])
    seen = log_strength + world.tastes(POPULATION)
    seen = seen + rng.normal(0, model.clip_sd, seen.shape)
    protocol: Protocol = "ranking" if key.protocol == "ranking" else "pairwise"
    ties = world.ties(POPULATION)
    return {
        (a, b): float(
            _mean_chances(seen[:, a] - seen[:, b], ties, world, protocol).mean(0) @ [1, 0.5, 0]
        )
        for a, b in pairs
    }


def _population_ranks(
    chances: dict[tuple[int, int], np.ndarray], num_systems: int
) -> Float[np.ndarray, " K"]:
    """Mean ranks: one more than how many others are expected before each system."""
    ranks = np.ones(num_systems)
    for (first, second), both_sides in chances.items():
        first_before = float(both_sides[0] @ [1, 0.5, 0])
        ranks[second] += first_before
        ranks[first] += 1 - first_before
    return ranks


def _population_strengths(
    chances: dict[tuple[int, int], np.ndarray], num_systems: int, votes_each: int = 4000
) -> Float[np.ndarray, " K"]:
    """What the model becomes with votes in exact proportion to their chances."""
    columns = []
    for (first, second), both_sides in chances.items():
        for is_left, row in zip((True, False), both_sides, strict=True):
            counts = np.diff(np.round(np.cumsum([0, *row]) * votes_each)).astype(int)
            score = np.repeat([1.0, 0.5, 0.0], counts)
            left, right = (first, second) if is_left else (second, first)
            columns.append(
                (
                    np.full_like(score, left),
                    np.full_like(score, right),
                    score if is_left else 1 - score,
                )
            )
    left, right, score = (np.concatenate(column) for column in zip(*columns, strict=True))
    nobody = np.zeros(len(score), dtype=int)
    votes = Votes(nobody, nobody, left.astype(int), right.astype(int), score, nobody.astype(bool))
    return fit_strengths(votes, num_systems, has_sides=bool((score == 0.5).any())).log_strength


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description="Coverage of the report's intervals.")
    parser.add_argument("--studies", type=int, default=200)
    parser.add_argument("--clips", type=int, default=CLIPS)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    sys.stdout.write("protocol  raters  claim     mean   lowest pair  highest pair  mean width\n")
    for protocol in ("pairwise", "ranking"):
        for name, model in (("alike", ALIKE), ("varied", RaterModel())):
            tallies = coverage(protocol, model, arguments.studies, arguments.seed, arguments.clips)
            for claim, tally in tallies.items():
                if tally.held:
                    line = _line(tally, arguments.studies)
                    sys.stdout.write(f"{protocol:9s} {name:7s} {claim:9s} {line}\n")
            sys.stdout.flush()


def _line(tally: Tally, studies: int) -> str:
    shares = np.array(list(tally.held.values())) / studies
    width = tally.width / studies / len(shares)
    return f"{shares.mean():.3f}  {shares.min():.3f}        {shares.max():.3f}         {width:.3f}"


if __name__ == "__main__":
    main()
