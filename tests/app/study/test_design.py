"""Protocols become the right trials, every participant a fair list, and no order tells."""

import itertools
import math
from collections import Counter
from pathlib import Path

import pytest

from app.errors import RunError
from app.study.design import blinding
from app.study.design.blinding import (
    agreement_p_value,
    blind_id_leaks,
    make_key,
    stimulus_ids,
    value_leaks,
)
from app.study.design.key import Stimulus
from app.study.design.plan import StudyPlan, read_study_plan
from app.study.design.trials import (
    ANSWER_S,
    INTRO_S,
    Design,
    Page,
    is_first_left,
    make_design,
    measure_balance,
    study_minutes_and_summary,
    williams_square,
)
from tests.app.study.made_study import write_plan

SYSTEMS = ["ann", "bob", "cleo", "dora"]
CLIPS = ["one", "two", "three"]
PROTOCOLS = ("pairwise", "matched", "ranking", "rating")


def design_of(
    folder: Path, protocol: str, extra: str = "", participants: int = 36
) -> tuple[StudyPlan, Design]:
    settings = f'protocol = "{protocol}"\nparticipants = {participants}\n{extra}'
    plan = read_study_plan(write_plan(folder, SYSTEMS, CLIPS, settings))
    return plan, make_design(plan)


def test_a_williams_square_balances_position_and_succession():
    for size in [1, 2, 3, 4, 5, 6, 9, 18]:
        rows = williams_square(size)
        assert len(rows) == (size if size % 2 == 0 else 2 * size)
        assert all(sorted(row) == list(range(size)) for row in rows)
        positions = Counter((place, name) for row in rows for place, name in enumerate(row))
        assert len(set(positions.values())) == 1
        follows = Counter(pair for row in rows for pair in itertools.pairwise(row))
        assert len(follows) == size * (size - 1)
        assert len(set(follows.values())) <= 1


def test_each_system_is_left_as_often_as_right():
    for num_systems in [2, 3, 4, 5, 6]:
        for num_scenes in [1, 2, 4]:
            lefts = Counter()
            for scene in range(num_scenes):
                for first, second in itertools.combinations(range(num_systems), 2):
                    is_left = is_first_left(first, second, num_systems, scene)
                    assert is_left != is_first_left(second, first, num_systems, scene)
                    lefts[first if is_left else second] += 1
            fair = num_scenes * (num_systems - 1) / 2
            # An odd number of trials cannot be halved; everything else can.
            limit = 0.5 if num_scenes % 2 and num_systems % 2 == 0 else 0.0
            assert all(abs(lefts[system] - fair) <= limit for system in range(num_systems))


def test_the_balance_of_lists_is_told_as_it_is():
    one, two = (Stimulus(name, "a", None, "front") for name in ("one", "two"))
    three, four = (Stimulus(name, "b", None, "front") for name in ("one", "two"))
    first, second, check = Page(0, (one, two)), Page(1, (three, four)), Page(2, ())

    def balance(*lists):
        return measure_balance(Design((), (), lists))

    fair = balance((first, check, Page(1, (four, three))), (second, Page(0, (two, one))))
    assert fair.trial_position_spread == fair.succession_spread == fair.appearances_spread == 0
    assert fair.first_place_spread_within_trial == 0
    assert fair.first_place_unfairness == 0.0
    assert fair.first_place_shares == {"one": 0.5, "two": 0.5}
    unfair = balance((first, second), (first, second))
    assert unfair.trial_position_spread == unfair.succession_spread == 2
    assert unfair.first_place_spread_within_trial == 2
    assert unfair.first_place_unfairness == 1.0
    assert unfair.first_place_shares == {"one": 1.0, "two": 0.0}


def test_pairs_are_silent_and_complete(tmp_path):
    _, design = design_of(tmp_path, "pairwise", 'views = ["front", "side"]')
    pairs = [trial for trial in design.trials if trial.kind == "pair"]
    assert len({frozenset(trial.stimuli) for trial in pairs}) == len(pairs) == 6 * 3 * 2
    assert len(design.stimuli) == 4 * 3 * 2
    assert all(stimulus.speech_clip is None for stimulus in design.stimuli)
    for left, right in (trial.stimuli for trial in pairs):
        assert left.system != right.system
        assert (left.clip, left.view) == (right.clip, right.view)


def test_matched_trials_change_the_speech_alone(tmp_path):
    _, design = design_of(tmp_path, "matched")
    matches = [trial for trial in design.trials if trial.kind == "match"]
    assert len(matches) == 4 * 3
    for trial in matches:
        first, second = trial.stimuli
        assert (first.system, first.clip, first.view) == (second.system, second.clip, second.view)
        assert sorted(s.speech_clip == s.clip for s in trial.stimuli) == [False, True]
    heard = Counter(s.speech_clip for s in design.stimuli if s.speech_clip != s.clip)
    assert set(heard.values()) == {4}  # each speech is as often wrong as right


def test_whole_groups_are_shown_with_their_speech(tmp_path):
    for protocol in ["ranking", "rating"]:
        _, design = design_of(tmp_path, protocol)
        groups = [trial for trial in design.trials if trial.kind in ("rank", "rate")]
        assert len(groups) == 3
        for trial in groups:
            assert {stimulus.system for stimulus in trial.stimuli} == set(SYSTEMS)
            assert all(stimulus.speech_clip == stimulus.clip for stimulus in trial.stimuli)


def test_lists_are_balanced_in_order_and_side(tmp_path):
    for protocol in PROTOCOLS:
        _, design = design_of(tmp_path, protocol)
        balance = measure_balance(design)
        # 36 participants are whole squares of 18, 12 and 3 trials.
        assert (
            balance.trial_position_spread
            == balance.succession_spread
            == balance.appearances_spread
            == 0
        )
        assert balance.first_place_spread_within_trial == 0
        assert balance.first_place_unfairness <= 1.0
        fair = 0.25 if protocol in ("ranking", "rating") else 0.5
        assert all(share == pytest.approx(fair) for share in balance.first_place_shares.values())


def test_at_most_one_page_in_ten_is_an_attention_check_and_a_short_study_ends_with_it(
    tmp_path: Path,
) -> None:
    for trials, checks in [(2, 1), (4, 1), (8, 1), (9, 1), (17, 1), (18, 2), (36, 2)]:
        settings = f'views = ["front", "side"]\ntrials_per_participant = {trials}'
        plan, design = design_of(tmp_path, "pairwise", settings)
        assert design.num_checks == checks and design.max_failed(plan) == checks // 2
        for pages in design.lists:
            kinds = [design.trials[page.trial_index].kind for page in pages]
            assert len(kinds) == trials + checks and kinds.count("attention") == checks
            assert checks == 1 or 10 * checks <= len(kinds)
            assert ("attention", "attention") not in itertools.pairwise(kinds)
            assert trials > 8 or kinds.index("attention") == trials
    settings = 'views = ["front", "side"]\nattention_checks = 4'
    _, design = design_of(tmp_path, "pairwise", settings)
    for pages in design.lists:
        kinds = [design.trials[page.trial_index].kind for page in pages]
        assert kinds.count("attention") == 4
        assert ("attention", "attention") not in itertools.pairwise(kinds)
        assert {design.trials[page.trial_index].required_answer for page in pages} == {
            None,
            "left",
            "right",
        }
    with pytest.raises(RunError, match="for 12 trials per participant; the limit is 1,"):
        design_of(tmp_path, "pairwise", "attention_checks = 2\ntrials_per_participant = 12")
    assert design_of(tmp_path, "pairwise", "attention_checks = 0")[1].num_checks == 0


def test_shorter_lists_share_the_trials_evenly(tmp_path):
    _, design = design_of(tmp_path, "pairwise", "trials_per_participant = 6")
    shown = [[page.trial_index for page in pages if page.stimuli] for pages in design.lists]
    assert all(len(set(pages)) == len(pages) == 6 for pages in shown)
    counts = Counter(trial for pages in shown for trial in pages)
    assert len(counts) == 18 and set(counts.values()) == {12}
    _, design = design_of(tmp_path, "pairwise", "trials_per_participant = 6", participants=6)
    balance = measure_balance(design)  # three see all trials, the next three with sides swapped
    assert balance.first_place_spread_within_trial == 0
    assert set(balance.first_place_shares.values()) == {0.5}


def test_a_plan_gives_the_same_design_each_time_and_its_seed_another(tmp_path):
    first, again, other = (
        design_of(tmp_path, "pairwise", extra)[1] for extra in ("", "", "seed = 1")
    )
    assert again == first and other.lists != first.lists


def test_names_are_drawn_anew_and_a_key_gives_them_back(tmp_path):
    for protocol in PROTOCOLS:
        plan, design = design_of(tmp_path, protocol, participants=5)
        key, other = make_key(plan, design), make_key(plan, design)
        assert not key.videos.keys() & other.videos.keys()
        assert set(stimulus_ids(key)) == set(design.stimuli) and len(key.lists) == 5
        assert [t.kind for t in key.trials.values()] == [t.kind for t in design.trials]


def test_names_that_would_tell_the_system_by_their_order_are_drawn_again(tmp_path, monkeypatch):
    plan, design = design_of(tmp_path, "rating")
    by_system = sorted(design.stimuli, key=lambda stimulus: stimulus.system)
    telling = [f"{by_system.index(stimulus):016x}" for stimulus in design.stimuli]
    first, distinct = [telling], blinding._distinct
    monkeypatch.setattr(
        blinding,
        "_distinct",
        lambda count, size: first.pop() if size == 8 and first else distinct(count, size),
    )
    names = stimulus_ids(make_key(plan, design))
    assert blind_id_leaks(dict(zip(design.stimuli, telling, strict=True))) and not first
    assert not set(names.values()) & set(telling) and not blind_id_leaks(names)


def test_what_a_study_asks_is_counted_as_by_hand(tmp_path):
    """Each of 6 pairs, 4 matches or 1 group on 3 clips, by 10 people."""
    for protocol, pages, shown, votes in [
        ("pairwise", 6 * 3, 2, "30 votes for each pair of systems"),
        ("matched", 4 * 3, 2, "30 votes for each system"),
        ("ranking", 3, 4, "30 rankings for each system"),
        ("rating", 3, 4, "30 ratings for each system"),
    ]:
        settings = "attention_checks = 0\nlength_s = 6"
        found = study_minutes_and_summary(*design_of(tmp_path, protocol, settings, participants=10))
        minutes = math.ceil((INTRO_S + pages * (shown * 6 + ANSWER_S)) / 60)
        sentence = f"{minutes} minutes and {pages} pages for each participant; {votes} if all"
        assert found == (minutes, f"About {sentence} participants finish.")
    one = "attention_checks = 0\ntrials_per_participant = 1"
    _, sentence = study_minutes_and_summary(*design_of(tmp_path, "pairwise", one, participants=1))
    assert " 1 page for each participant; 0 to 1 vote for each pair of systems if" in sentence


def test_the_probability_of_perfect_agreement_is_exact():
    scene = {"a": 1.0, "b": 2.0, "c": 3.0}
    assert agreement_p_value([scene]) == 1.0
    assert agreement_p_value([scene] * 2) == pytest.approx(1 / 6)
    assert agreement_p_value([scene] * 4) == pytest.approx(1 / 6**3)
    assert agreement_p_value([{"a": 1.0, "b": 2.0}] * 8) == pytest.approx(1 / 2**7)
    assert agreement_p_value([dict.fromkeys("abc", 5.0)] * 6) == 1.0  # equal values tell nothing


def test_an_order_by_match_is_seen_even_when_systems_are_mixed():
    values = {
        Stimulus(system, clip, speech, "front"): float(speech == clip)
        for system in ("a", "b")
        for clip, wrong in (("1", "2"), ("2", "3"), ("3", "4"), ("4", "1"))
        for speech in (clip, wrong)
    }
    (tell,) = value_leaks(values, "size")
    assert "which speech is matched" in tell
