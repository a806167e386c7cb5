"""No two sentences of a report contradict each other, and none says more than its numbers."""

import itertools
import json
import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from app.study.design.key import Protocol
from app.study.report.report import headline
from app.study.simulate import RaterModel, simulate_answers
from app.study.statistics.answers import Participant, drop_invalid_answers
from app.study.statistics.proportions import ResultEstimate
from app.study.statistics.results import QuestionResult, analyse_participants
from model.storage.json_validation import parse_json
from tests.app.study.made import SYSTEMS, made_key
from tests.app.study.test_report import plain, say

INTERVAL = re.compile(r"95 % interval (\S+) to (\S+?)( %)?\)")
APART, OPEN = "the difference is significant", "the difference is not "
Pair = tuple[str, str]


def results_of(
    protocol: Protocol, strengths: list[float], ties: float, count: int, clips: int, seed: int
) -> QuestionResult:
    """What so many raters of a taste found."""
    key = made_key(protocol, num_clips=clips)
    model = RaterModel(taste_sd=1.0, tie_parameter=ties, check_failure_probability=0)
    taste = dict(zip(SYSTEMS, strengths, strict=True))
    files = simulate_answers(key, taste, count, model, np.random.default_rng(seed))
    sent = [parse_json(json.dumps(content), Participant) for content in files]
    people = [drop_invalid_answers(replace(one, file_name="made.json"), key)[0] for one in sent]
    (result,) = analyse_participants(people, key)
    return result


def compared(result: QuestionResult, protocol: str) -> Iterator[tuple[Pair, str]]:
    """Each sentence that compares two systems, the one named first ahead."""
    measure = {"ranking": "mean_rank_gap", "rating": "mean_rating_gap"}.get(protocol, "share")
    for number in result.estimates_of(measure):
        is_ranking = protocol == "ranking"
        told = plain(say("pair" if measure == "share" else "mean_gap", number, is_ranking))
        names = re.findall("|".join(SYSTEMS), told)
        yield (names[0], names[1]), told


def check_interval(told: str, chance: float) -> None:
    """What a sentence says follows from the interval that stands in it."""
    limits = INTERVAL.search(told)
    if limits is None:
        return
    low, high = (float(each.replace("\N{MINUS SIGN}", "-")) for each in limits.groups()[:2])
    leaves_out_chance = low > chance or high < chance
    if APART in told:
        assert leaves_out_chance, told
    elif OPEN in told:
        assert leaves_out_chance == ("the interval excludes" in told), told


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    protocol=st.sampled_from(["pairwise", "ranking", "rating"]),
    strengths=st.lists(st.sampled_from([-3.0, -0.5, 0.0, 0.3, 1.0, 4.0]), min_size=3, max_size=3),
    ties=st.sampled_from([0.0, 0.5, 50.0]),
    count=st.sampled_from([1, 3, 6, 7, 12, 28]),
    clips=st.integers(1, 6),
    seed=st.integers(0, 1000),
)
# Six raters of one clip: whole steps of Newton's method never end on some of their resamples.
@example(protocol="pairwise", strengths=[-0.5, 0.0, -3.0], ties=0.0, count=6, clips=1, seed=0)
def test_no_two_sentences_of_a_report_contradict_each_other(
    protocol: Protocol, strengths: list[float], ties: float, count: int, clips: int, seed: int
) -> None:
    result = results_of(protocol, strengths, ties, count, clips, seed)
    apart: set[Pair] = set()
    for names, told in compared(result, protocol):
        check_interval(told, 50.0 if protocol == "pairwise" else 0.0)
        if APART in told:
            apart.add(names)
    first = headline(result)
    alike = re.search(r": ([\w, ]+) do not differ significantly", first)
    if alike:
        for one, other in itertools.combinations(re.findall("|".join(SYSTEMS), alike[1]), 2):
            assert not {(one, other), (other, one)} & apart, (first, apart)
    won = re.search(r"(\w+) is significantly better than ([\w, ]+)", first)
    if won:
        for other in re.findall("|".join(SYSTEMS), won[2]):
            assert (won[1], other) in apart, (first, apart)
    if apart and alike:
        assert {name for pair in apart for name in pair} - set(
            re.findall("|".join(SYSTEMS), alike[1])
        ), (first, apart)
    agreement = result.find_estimate(f"krippendorff_alpha_{result.measurement_level}")
    told = plain(say("agreement", agreement, result.measurement_level, result.num_shared_items))
    if "not differ significantly from chance" not in told and agreement.value is not None:
        low, high = agreement.value_and_limits[1:]
        assert low > 0 or high < 0, told


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        # Ten prefer it by six votes of ten each: the sign test is sure, the interval is not.
        (
            [6.0, 4.0, 10, 0, 0.002, 0.497, 0.697],
            "p is below .05, but the interval includes 50 %",
        ),
        (
            [24.0, 4.0, 5, 0, 0.06, 0.6, 0.9],
            "the interval excludes 50 %, but p is not below .05",
        ),
    ],
)
def test_interval_and_test_have_to_agree(numbers: list[float], words: str) -> None:
    wins, losses, pro, con, p, low, high = numbers
    one = ResultEstimate(
        "share", "local", "global", wins / (wins + losses), low, high, p, p,
        int(wins), 0, int(losses), int(pro), int(con),
    )  # fmt: skip
    told = plain(say("pair", one, False))
    assert f"{OPEN}counted as significant: {words}" in told and APART not in told
