"""Simulated raters do what their model says, and the truth they are held against is theirs."""

import json
from collections import Counter

import numpy as np
import pytest

from app.errors import RunError
from app.study import coverage
from app.study.simulate import ALIKE, RaterModel, World, davidson, simulate
from app.study.statistics.answers import collect
from app.study.statistics.screening import screen
from app.study.statistics.votes import MISMATCHED, between, votes_of
from tests.app.study.made import STRENGTHS, made_key, made_participants, written_study

FOUR = coverage.STRENGTHS


@pytest.mark.parametrize("protocol", ["pairwise", "matched", "ranking", "rating"])
def test_what_is_simulated_reads_back_whole(tmp_path, protocol):
    key = made_key(protocol)
    written_study(tmp_path, key, [])
    out = tmp_path / "simulated"
    simulate(tmp_path / "study", 9, STRENGTHS, 4, out)
    collected = collect([out], key)
    assert collected.left_out == ()
    assert len(collected.participants) == 9
    on_lists = Counter(one.list_number for one in collected.participants)
    assert on_lists == {0: 3, 1: 2, 2: 2, 3: 2}
    truth = json.loads((out / "truth.json").read_text())
    assert truth["strengths"] == STRENGTHS
    assert truth["model"]["tie"] == RaterModel().tie


def test_a_seed_makes_the_same_answers_and_two_runs_do_not_mix(tmp_path):
    written_study(tmp_path, made_key(), [])
    texts = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        simulate(tmp_path / "study", 2, STRENGTHS, seed, tmp_path / name)
        texts.append((tmp_path / name / "simulated00001.json").read_text())
    assert texts[0] == texts[1] != texts[2]
    with pytest.raises(RunError, match="holds answers already"):
        simulate(tmp_path / "study", 1, STRENGTHS, 2, tmp_path / "a")


@pytest.mark.parametrize(
    ("raters", "strengths", "seed", "says"),
    [
        (0, STRENGTHS, 0, "Raters must be 1 to 10000; got 0"),
        (1, STRENGTHS, -1, "seed must not be negative"),
        (1, {"local": 1.0}, 0, "exactly local, global, rival; got local"),
        (1, STRENGTHS | {"other": 1.0}, 0, "exactly local, global, rival"),
        (1, STRENGTHS | {"local": float("nan")}, 0, "strength of local must be within ±20"),
        (1, STRENGTHS | {"local": 21.0}, 0, "strength of local must be within ±20"),
    ],
)
def test_what_cannot_be_simulated_is_refused(tmp_path, raters, strengths, seed, says):
    written_study(tmp_path, made_key(), [])
    with pytest.raises(RunError, match=says):
        simulate(tmp_path / "study", raters, strengths, seed, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_raters_choose_as_often_as_the_model_says():
    key = made_key(num_clips=10)
    votes = votes_of(made_participants(key, 300, ALIKE), key, "realism")
    score = votes[(votes.left == "local") & (votes.right == "global")].score
    seen = [(score == value).mean() for value in (1, 0.5, 0)]
    assert seen == pytest.approx(list(davidson(-1.0 + ALIKE.left_advantage, 0.5)), abs=0.03)


def test_matched_strength_is_the_log_odds_of_the_right_choice():
    key = made_key("matched", num_clips=10)
    votes = votes_of(made_participants(key, 200, ALIKE), key, "match")
    for name in STRENGTHS:
        score = between(votes, name, name + MISMATCHED).score
        odds = (score == 1).mean() / (score == 0).mean()
        assert np.log(odds) == pytest.approx(STRENGTHS[name], abs=0.15)


def test_lapses_fail_checks_as_often_as_said():
    key = made_key()
    screened = screen(made_participants(key, 200, RaterModel(lapse=0.5)), key)
    assert len(screened.dropped) == pytest.approx(50, abs=20)  # both of two checks failed
    assert not screen(made_participants(key, 200, RaterModel(lapse=0)), key).dropped


def test_the_truth_of_equal_raters_is_what_was_set():
    world = World(coverage.design("pairwise"), FOUR, ALIKE, np.random.default_rng(0))
    chances = {pair: coverage.chances_of(world, pair) for pair in coverage.PAIRS}
    for (a, b), both_sides in chances.items():
        expected = davidson(FOUR[a] - FOUR[b] + ALIKE.left_advantage, ALIKE.tie)
        assert both_sides[0] == pytest.approx(expected)
    found = coverage.population_strengths(chances)
    # The prior and rounding to whole votes take a little.
    mean = np.mean(list(FOUR.values()))
    assert found == pytest.approx({name: v - mean for name, v in FOUR.items()}, abs=2e-3)


def test_the_truth_of_ranks_is_what_many_simulated_rankings_give():
    key = coverage.design("ranking", num_clips=2)
    world = World(key, FOUR, RaterModel(), np.random.default_rng(0))
    chances = {pair: coverage.chances_of(world, pair) for pair in coverage.PAIRS}
    places = dict.fromkeys(FOUR, 0.0)
    for _ in range(2000):
        for answer in world.answers(0):
            for place, video in enumerate(answer["value"], start=1):
                places[key.videos[video].system] += place / 4000
    ranks = coverage.population_ranks(chances)
    assert ranks == pytest.approx(places, abs=0.06)
    assert sum(ranks.values()) == pytest.approx(sum(range(1, 5)))


def test_differing_raters_pull_shares_to_the_middle():
    key = coverage.design("pairwise")
    alike = coverage.share_over_clips(key, ALIKE)
    varied = coverage.share_over_clips(key, RaterModel())
    assert all(0.5 < varied[pair] < alike[pair] for pair in coverage.PAIRS)
    wins = davidson(0.6 + np.array([0.1, -0.1]), ALIKE.tie).mean(0) @ [1, 0.5, 0]
    assert alike["real", "global"] == pytest.approx(wins)


def test_intervals_are_held_against_the_truth():
    found = coverage.coverage("ranking", RaterModel(), studies=2, seed=3)
    by_claim = found.groupby("claim").held
    assert set(by_claim.groups) == {"same", "other", "strength", "rank"}
    assert (by_claim.size() == 6).all() and (by_claim.mean() >= 0.75).all()
    assert (found.width > 0).all()
