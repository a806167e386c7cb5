"""Protocols become the right trials, and every participant a fair list."""

import itertools
from collections import Counter
from pathlib import Path

import pytest

from app.study.design.blinding import blinding_of, draw_blinding, make_key
from app.study.design.plan import read_plan
from app.study.design.trials import Design, make_design, other_speech
from app.study.make.records import reached_balance
from tests.app.study.made_study import write_plan

SYSTEMS = ["ann", "bob", "cleo", "dora"]
CLIPS = ["one", "two", "three"]


def design_of(folder: Path, protocol: str, participants: int = 36, extra: str = "") -> Design:
    settings = f'protocol = "{protocol}"\nparticipants = {participants}\n{extra}'
    return make_design(read_plan(write_plan(folder, SYSTEMS, CLIPS, settings)))


def test_pairs_are_silent_and_complete(tmp_path: Path) -> None:
    design = design_of(tmp_path, "pairwise", extra='views = ["front", "side"]')
    pairs = [trial for trial in design.trials if trial.kind == "pair"]
    assert len(pairs) == 6 * 3 * 2
    assert len(design.stimuli) == 4 * 3 * 2
    assert all(stimulus.speech is None for stimulus in design.stimuli)
    for trial in pairs:
        left, right = trial.stimuli
        assert left.system != right.system
        assert (left.clip, left.view) == (right.clip, right.view)


def test_matched_trials_change_the_speech_alone(tmp_path: Path) -> None:
    design = design_of(tmp_path, "matched")
    matches = [trial for trial in design.trials if trial.kind == "match"]
    assert len(matches) == 4 * 3
    for trial in matches:
        first, second = trial.stimuli
        assert (first.system, first.clip, first.view) == (second.system, second.clip, second.view)
        assert Counter(s.speech == s.clip for s in trial.stimuli) == {True: 1, False: 1}
    heard = Counter(s.speech for s in design.stimuli if s.speech != s.clip)
    assert set(heard.values()) == {4}  # each speech is as often wrong as right
    plan = read_plan(tmp_path / "plan.toml")
    assert all(clip != wrong for clip, wrong in other_speech(plan).items())


@pytest.mark.parametrize("protocol", ["ranking", "rating"])
def test_whole_groups_are_shown_with_their_speech(tmp_path: Path, protocol: str) -> None:
    design = design_of(tmp_path, protocol)
    groups = [trial for trial in design.trials if trial.kind in ("rank", "rate")]
    assert len(groups) == 3
    for trial in groups:
        assert {stimulus.system for stimulus in trial.stimuli} == set(SYSTEMS)
        assert all(stimulus.speech == stimulus.clip for stimulus in trial.stimuli)


@pytest.mark.parametrize("protocol", ["pairwise", "matched", "ranking", "rating"])
def test_lists_are_balanced_in_order_and_side(tmp_path: Path, protocol: str) -> None:
    design = design_of(tmp_path, protocol)
    balance = reached_balance(design, draw_blinding(design))
    # 36 participants are whole squares of 18, 12 and 3 trials.
    assert balance.position_spread == balance.follows_spread == balance.appearances_spread == 0
    assert balance.first_place_spread_within_trial == 0
    assert balance.first_place_unfairness <= 1.0
    fair = 0.25 if protocol in ("ranking", "rating") else 0.5
    assert balance.first_place_shares.values() == pytest.approx(
        [fair] * len(balance.first_place_shares)
    )


def test_every_participant_gets_all_attention_checks_spread_out(tmp_path: Path) -> None:
    design = design_of(tmp_path, "pairwise", extra="attention_checks = 3")
    for pages in design.lists:
        places = [i for i, page in enumerate(pages) if design.trials[page.trial].press]
        assert len(places) == 3
        assert min(b - a for a, b in itertools.pairwise(places)) > 2
        assert {design.trials[pages[i].trial].press for i in places} == {"left", "right"}


def test_shorter_lists_share_the_trials_evenly(tmp_path: Path) -> None:
    design = design_of(tmp_path, "pairwise", extra="trials_per_participant = 6")
    shown = [[page.trial for page in pages if page.shown] for pages in design.lists]
    assert all(len(set(pages)) == len(pages) == 6 for pages in shown)
    counts = Counter(trial for pages in shown for trial in pages)
    assert len(counts) == 18
    assert set(counts.values()) == {12}


def test_a_plan_gives_the_same_design_each_time_and_its_seed_another(tmp_path: Path) -> None:
    first = design_of(tmp_path, "pairwise")
    assert design_of(tmp_path, "pairwise") == first
    assert design_of(tmp_path, "pairwise", extra="seed = 1").lists != first.lists


@pytest.mark.parametrize("protocol", ["pairwise", "matched", "ranking", "rating"])
def test_a_key_gives_its_names_back(tmp_path: Path, protocol: str) -> None:
    design = design_of(tmp_path, protocol, participants=5)
    plan = read_plan(tmp_path / "plan.toml")
    blinding = draw_blinding(design)
    other = draw_blinding(design)
    assert not set(blinding.videos.values()) & set(other.videos.values())
    key = make_key(plan, design, blinding, {})
    assert blinding_of(key, plan, design) == blinding
    assert len(key.lists) == 5
