"""Sentences: the grammar is closed, varied, and split for good."""

import re

import numpy as np
import pytest

from model.corpus.texts import GRAMMAR, SPLITS, draw_sentence, split_of
from model.corpus.voice import words_of


def sentences(count: int, split: str, seed: int = 0) -> list[str]:
    rng = np.random.default_rng(seed)
    return [draw_sentence(rng, split) for _ in range(count)]  # type: ignore[arg-type]


def test_every_symbol_is_defined_and_every_rule_is_used() -> None:
    named = {
        symbol
        for expansions in GRAMMAR.values()
        for text in expansions
        for symbol in re.findall(r"{(\w+)}", text)
    }
    assert named | {"SENTENCE"} == set(GRAMMAR)


@pytest.mark.parametrize("split", SPLITS)
def test_a_sentence_belongs_to_the_split_it_was_drawn_for(split: str) -> None:
    drawn = sentences(50, split)
    assert {split_of(s) for s in drawn} == {split}
    assert all(re.fullmatch(r"[A-Z][A-Za-z', -]*[.!?]", s) for s in drawn)
    assert all(len(words_of(s)) >= 2 for s in drawn)


def test_sentences_hardly_repeat() -> None:
    drawn = sentences(1000, "train")
    assert len(set(drawn)) > 700


def test_the_shares_of_the_splits_are_eight_to_one_to_one() -> None:
    rng = np.random.default_rng(1)
    drawn = {draw_sentence(rng, s) for s in SPLITS for _ in range(300)}
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
