"""Sentences: the grammar is closed, varied, and split for good."""

import re
from itertools import islice, pairwise

import numpy as np
import pytest

from tools.corpus.people.voice import words_of
from tools.corpus.words.grammar import (
    AFTER_A_QUESTION,
    END_MARKS,
    GRAMMAR,
    KINDS,
    SPLITS,
    Split,
    split_of,
    talk,
)
from tools.corpus.words.topics import TOPICS


def sentences(count: int, split: Split, seed: int = 0) -> list[str]:
    rng = np.random.default_rng(seed)
    return list(islice(talk(rng, split), count))


def test_every_symbol_is_defined_and_every_rule_is_used() -> None:
    named = {
        symbol
        for expansions in GRAMMAR.values()
        for text in expansions
        for symbol in re.findall(r"{(\w+)}", text)
    }
    kinds = {*KINDS, AFTER_A_QUESTION}
    for topic in TOPICS.values():
        assert named | kinds == set(GRAMMAR) | set(topic)
        assert not set(GRAMMAR) & set(topic)
    assert set(END_MARKS) <= kinds


@pytest.mark.parametrize("name", TOPICS)
def test_a_topic_has_enough_to_say_and_says_nothing_twice(name: str) -> None:
    for symbol, phrases in TOPICS[name].items():
        assert len(set(phrases)) == len(phrases) >= 4, symbol
    assert len(TOPICS[name]["DO"]) >= 8


@pytest.mark.parametrize("split", SPLITS)
def test_a_sentence_belongs_to_the_split_it_was_drawn_for(split: str) -> None:
    drawn = sentences(50, split)
    assert {split_of(s) for s in drawn} == {split}
    assert all(re.fullmatch(r"[A-Z][A-Za-z', -]*[.!?]", s) for s in drawn)
    assert all(len(words_of(s)) >= 2 for s in drawn)


def test_ten_hours_hardly_repeat_a_sentence() -> None:
    rng = np.random.default_rng(5)
    drawn = [
        sentence
        for split, count in (("train", 8000), ("val", 1000), ("test", 1000))
        for sentence in islice(talk(rng, split), count)  # type: ignore[arg-type]
    ]
    assert len(set(drawn)) > 0.99 * len(drawn)


def test_talk_stays_on_a_topic_for_a_while() -> None:
    drawn = list(islice(talk(np.random.default_rng(2), "train"), 400))

    def people(sentence: str) -> set[str]:
        return {n for n, topic in TOPICS.items() if any(who in sentence for who in topic["WHO"])}

    shared = [bool(people(a) & people(b)) for a, b in pairwise(drawn) if people(a) and people(b)]
    assert 0.6 < np.mean(shared) < 0.95


def test_only_a_question_is_followed_by_an_answer() -> None:
    drawn = list(islice(talk(np.random.default_rng(4), "train"), 2000))
    after = [b.startswith(("Yes, exactly", "Good question")) for b in drawn[1:]]
    asked = np.array([a.endswith("?") for a in drawn[:-1]])
    assert np.mean(np.array(after)[asked]) > 0.08
    assert not np.any(np.array(after)[~asked])


def test_the_shares_of_the_splits_are_eight_to_one_to_one() -> None:
    rng = np.random.default_rng(1)
    drawn = {text for split in SPLITS for text in islice(talk(rng, split), 300)}
    # Disjoint by construction: what a sentence is, no draw can change.
    assert not {s for s in drawn if split_of(s) == "train"} & {
        s for s in drawn if split_of(s) == "test"
    }
    keys = [f"sentence number {k}." for k in range(4000)]
    shares = [np.mean([split_of(k) == s for k in keys]) for s in SPLITS]
    np.testing.assert_allclose(shares, [0.8, 0.1, 0.1], atol=0.03)


@pytest.mark.parametrize("phrase", ["stop", "exaggerating", "wow", "driving", "all the time"])
def test_the_phrases_of_the_papers_figure_are_spoken(phrase: str) -> None:
    text = " ".join(sentences(1500, "train", seed=3)).lower()
    assert len(re.findall(rf"\b{phrase}\b", text)) >= 5
