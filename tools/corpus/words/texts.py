"""Sentences from a small grammar, disjoint between the training, validation and test splits."""

import zlib
from collections.abc import Iterator
from typing import Literal

import numpy as np

from tools.corpus.words.grammar import AFTER_A_QUESTION, END_MARKS, GRAMMAR, KINDS
from tools.corpus.words.topics import TOPICS, Topic

Split = Literal["train", "val", "test"]
SPLITS: tuple[Split, ...] = ("train", "val", "test")

MIN_SENTENCES, MAX_SENTENCES = 3, 7  # on one topic
ANSWER_SHARE = 0.6  # of the questions
_KIND_NAMES = tuple(KINDS)
_KIND_SHARES = np.array(list(KINDS.values())) / sum(KINDS.values())
_TOPIC_NAMES = tuple(TOPICS)


def split_of(sentence: str) -> Split:
    """The split a sentence belongs to for good: eight tenths train, one tenth each other."""
    bucket = zlib.crc32(sentence.encode()) % 10
    return "val" if bucket == 8 else "test" if bucket == 9 else "train"


def talk(rng: np.random.Generator, split: Split) -> Iterator[str]:
    """Sentences of the split without end: a few on one topic, then on another.

    A question may be answered by the speaker, after a pause for the listener.
    """
    while True:
        topic = _draw_topic(rng)
        kind = _draw_kind(rng)
        for _ in range(rng.integers(MIN_SENTENCES, MAX_SENTENCES + 1)):
            yield _sentence(rng, split, topic, kind)
            answers = kind == "QUESTION" and rng.random() < ANSWER_SHARE
            kind = AFTER_A_QUESTION if answers else _draw_kind(rng)


def _draw_topic(rng: np.random.Generator) -> Topic:
    return TOPICS[_TOPIC_NAMES[rng.integers(len(_TOPIC_NAMES))]]


def _draw_kind(rng: np.random.Generator) -> str:
    return _KIND_NAMES[rng.choice(len(_KIND_NAMES), p=_KIND_SHARES)]


def _sentence(rng: np.random.Generator, split: Split, topic: Topic, kind: str) -> str:
    """A sentence of one kind with a capital and an end mark, drawn until it is the split's."""
    while True:
        text = _expand(kind, topic, rng, set())
        sentence = text[0].upper() + text[1:] + END_MARKS.get(kind, ".")
        if split_of(sentence) == split:
            return sentence


def _expand(symbol: str, topic: Topic, rng: np.random.Generator, used: set[str]) -> str:
    """Words for a symbol, without the expansions that the sentence has already."""
    every = topic.get(symbol) or GRAMMAR[symbol]
    choices = [text for text in every if text not in used] or every
    text = choices[rng.integers(len(choices))]
    used.add(text)
    while "{" in text:
        start, end = text.index("{"), text.index("}")
        text = text[:start] + _expand(text[start + 1 : end], topic, rng, used) + text[end + 1 :]
    return text
