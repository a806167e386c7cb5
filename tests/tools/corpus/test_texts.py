"""Sentences: the grammar is closed, varied, and split for good."""

import re
from itertools import islice

import numpy as np
import pytest

from tools.corpus.people.speaker import words_of
from tools.corpus.words.grammar import (
    AFTER_A_QUESTION,
    END_MARKS,
    GRAMMAR,
    KINDS,
    SPLITS,
    Split,
    generate_sentences,
    split_of,
)
from tools.corpus.words.topics import TOPICS


def sentences(count: int, split: Split, seed: int = 0) -> list[str]:
    rng = np.random.default_rng(seed)
    return list(islice(generate_sentences(rng, split), count))


def test_every_symbol_is_defined_and_every_rule_is_used():
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


def test_a_sentence_belongs_to_the_split_it_was_drawn_for():
    for split in SPLITS:
        drawn = sentences(50, split)
        assert {split_of(s) for s in drawn} == {split}
        assert all(re.fullmatch(r"[A-Z][A-Za-z', -]*[.!?]", s) for s in drawn)
        assert all(len(words_of(s)) >= 2 for s in drawn)


@pytest.mark.slow
def test_ten_hours_hardly_repeat_a_sentence():
    rng = np.random.default_rng(5)
    drawn = [
        sentence
        for split, count in (("train", 8000), ("val", 1000), ("test", 1000))
        for sentence in islice(generate_sentences(rng, split), count)  # type: ignore[arg-type]
    ]
    assert len(set(drawn)) > 0.99 * len(drawn)


def test_only_a_question_is_followed_by_an_answer():
    drawn = list(islice(generate_sentences(np.random.default_rng(4), "train"), 2000))
    after = [b.startswith(("Yes, exactly", "Good question")) for b in drawn[1:]]
    asked = np.array([a.endswith("?") for a in drawn[:-1]])
    assert np.mean(np.array(after)[asked]) > 0.08
    assert not np.any(np.array(after)[~asked])
