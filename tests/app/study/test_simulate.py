"""Simulated raters do what their model says, and the truth they are held against is theirs."""

import json
from collections import Counter
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from app.errors import RunError
from app.study.simulate import UNIFORM_RATERS, RaterModel, davidson, simulate
from app.study.statistics.answers import collect_answers
from app.study.statistics.results import analyse_participants
from app.study.statistics.votes import MISMATCHED_SUFFIX, votes_between, votes_of
from tests.app.study.made import (
    STRENGTHS,
    made_key,
    made_participants,
    written_study,
)


@pytest.mark.parametrize("protocol", ["pairwise", "matched", "ranking", "rating"])
def test_what_is_simulated_reads_back_whole(tmp_path, protocol):
    key = made_key(protocol)
    written_study(tmp_path, key, [])
    out = tmp_path / "simulated"
    simulate(tmp_path / "study", 9, STRENGTHS, 4, out)
    collected = collect_answers(
        [out, *out.glob("simulated*")], key
    )  # each file once, the truth aside
    assert collected.left_out_sentences == ()
    assert len(collected.participants) == 9
    on_lists = Counter(one.list_number for one in collected.participants)
    assert on_lists == {0: 3, 1: 2, 2: 2, 3: 2}
    truth = json.loads((out / "truth.json").read_text())
    assert truth["strengths"] == STRENGTHS
    assert truth["model"]["tie_parameter"] == RaterModel().tie_parameter


def test_a_seed_makes_the_same_answers_and_two_runs_do_not_mix(tmp_path):
    written_study(tmp_path, made_key(), [])
    texts = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        simulate(tmp_path / "study", 2, STRENGTHS, seed, tmp_path / name)
        texts.append((tmp_path / name / "simulated00001.json").read_text())
    assert texts[0] == texts[1] != texts[2]
    with pytest.raises(RunError, match="already contains answers"):
        simulate(tmp_path / "study", 1, STRENGTHS, 2, tmp_path / "a")


@pytest.mark.parametrize(
    ("raters", "strengths", "seed", "says"),
    [
        (0, STRENGTHS, 0, "The number of raters must be from 1 to 10000; got 0"),
        (1, STRENGTHS, -1, "seed must not be negative"),
        (1, {"local": 1.0}, 0, "once, and nothing else; got local"),
        (
            1,
            STRENGTHS | {"other": 1.0},
            0,
            "once, and nothing else; got local, global, rival, other",
        ),
        (1, STRENGTHS | {"local": float("nan")}, 0, "from -20 to 20; got .* for local"),
        (1, STRENGTHS | {"local": 21.0}, 0, "from -20 to 20; got .* for local"),
    ],
)
def test_what_cannot_be_simulated_is_refused(tmp_path, raters, strengths, seed, says):
    written_study(tmp_path, made_key(), [])
    with pytest.raises(RunError, match=says):
        simulate(tmp_path / "study", raters, strengths, seed, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_raters_choose_as_often_as_the_model_says():
    key = made_key(num_clips=10)
    votes = votes_of(made_participants(key, 300, UNIFORM_RATERS), key, "realism")
    assert votes.is_smooth.mean() == pytest.approx(
        UNIFORM_RATERS.smoothness_reason_probability, abs=0.05
    )
    score = votes[(votes.left == "local") & (votes.right == "global")].score
    seen = [(score == value).mean() for value in (1, 0.5, 0)]
    assert seen == pytest.approx(
        list(davidson(-1.0 + UNIFORM_RATERS.left_advantage, 0.5)), abs=0.03
    )


def test_matched_strength_is_the_log_odds_of_the_right_choice():
    key = made_key("matched", num_clips=10)
    votes = votes_of(made_participants(key, 200, UNIFORM_RATERS), key, "match")
    for name in STRENGTHS:
        score = votes_between(votes, name, name + MISMATCHED_SUFFIX).score
        odds = (score == 1).mean() / (score == 0).mean()
        assert np.log(odds) == pytest.approx(STRENGTHS[name], abs=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("protocol", ["pairwise", "ranking"])
def test_intervals_hold_the_truth_about_as_often_as_they_claim(protocol):
    """Of raters and clips all alike, whose truth is the strengths that were set."""
    key = replace(made_key(protocol, num_clips=10, num_lists=28), video_s=2.0)
    side = UNIFORM_RATERS.left_advantage if protocol == "pairwise" else 0.0
    tie = UNIFORM_RATERS.tie_parameter if protocol == "pairwise" else 0.0
    held = []
    for study in range(100):
        (result,) = analyse_participants(
            made_participants(key, 28, UNIFORM_RATERS, seed=study), key
        )
        for first, second in combinations(key.systems, 2):
            gap = STRENGTHS[first] - STRENGTHS[second]
            share = davidson(gap + np.array([side, -side]), tie).mean(0) @ [1, 0.5, 0]
            for measure, truth in (("share", share), ("log_strength_gap", gap)):
                number = result.find_estimate(measure, first, second)
                assert number is not None
                _, low, high = number.value_and_limits
                held.append((measure, low <= truth <= high))
    for measure in ("share", "log_strength_gap"):
        assert np.mean([is_held for name, is_held in held if name == measure]) > 0.89
