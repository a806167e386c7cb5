"""Sentences from a small grammar, disjoint between the splits; topics come from ``topics.py``.

A symbol in braces is replaced by one of its expansions; within a sentence the same symbol does not
give the same words twice. Rules have no end mark; their kind does.
"""

import zlib
from collections.abc import Iterator
from typing import Literal

import numpy as np

from tools.corpus.words.topics import TOPICS, Topic

Rules = dict[str, tuple[str, ...]]

END_MARKS = {"QUESTION": "?", "SURPRISE": "!"}

KINDS: dict[str, float] = {
    **{"CLAIM": 3.0, "STORY": 4.0, "LIST": 2.0, "CONTRAST": 2.6, "QUESTION": 2.0},
    **{"HESITATION": 1.6, "EXPLAIN": 2.0, "REFUSAL": 1.6, "SURPRISE": 1.4, "FEELING": 1.6},
    **{"SIZE": 1.2, "DIRECTION": 1.0, "TIME": 1.6, "QUOTE": 1.0},
}
"""Weights of the kinds of sentences."""

AFTER_A_QUESTION = "ANSWER"

GRAMMAR: Rules = {
    "CLAIM": (
        "{OPENER} {CLAUSE}, {TAIL}",
        "{CLAUSE}, and {CLAUSE}",
        "{CLAUSE}, because {CLAUSE}",
        "{OPENER} you have to {DO} before you {DO}",
        "they {DO} and {DO} all the time, {TAIL}",
        "{WHO} is always {DOING}, {TAIL}",
        "{CLAUSE}, even if {WHO} says that {CLAUSE}",
        "{OPENER} {CLAUSE}, so let us {DO} together",
    ),
    "STORY": (
        "{PAST} we were {AT}, and suddenly {WHO} {DID}",
        "{PAST} {WHO} {DID}, {DID}, and {REACTION}",
        "I was driving home from {PLACE} when {WHO} called, {CALLED}",
        "we {DID} {AT}, and then {WHO} {DID}",
        "{WHO} stopped {DOING}, turned round, and {REACTION}",
        "so there I was, {AT}, and nobody wanted to {DO}, nobody except {WHO}",
        "I sat {AT} for {NUMBER} {UNIT}, and in the end {WHO} {DID}",
        "{WHO} opened the door, said hello, and told us that {CLAUSE}",
        "I picked up the phone, told {WHO} that {CLAUSE}, and {REACTION}",
        "first {WHO} {DID}, then I {DID}, and then we were driving in circles",
        "while {WHO} was {DOING}, I {DID}, and {REACTION}",
        "{PAST} I told {WHO} about {THING}, and {REACTION}",
        "{WHO} was driving all the time, {CALLED}",
        "after {NUMBER} {UNIT} of {DOING}, {WHO} finally {DID}",
    ),
    "LIST": (
        "first you {DO}, second you {DO}, and third you {DO}",
        "there are two reasons, one, {CLAUSE}, and two, {CLAUSE}",
        "you need {MANY}, {MANY}, and {NUMBER} {UNIT} of time to {DO}",
        "I like {DOING}, {DOING}, and most of all {DOING}",
        "{THING} was {ADJ}, {THING} was {ADJ}, and everybody was happy",
        "there were {MANY} here, {MANY} over there, and {REACTION}",
        "{WHO} brought {MANY}, {WHO} brought {MANY}, and I had to {DO}",
        "{NUMBER} {MANY}, {NUMBER} {MANY}, and nobody to {DO}",
        "we {DID}, {DID}, {DID}, and so on",
        "one, {CLAUSE}, two, {CLAUSE}, and three, {CLAUSE}",
        "all I need is {MANY}, {MANY}, {MANY}, and a little time to {DO}",
        "you {DO}, I {DO}, {WHO} is {DOING}, and everybody is happy",
    ),
    "CONTRAST": (
        "on the one hand {CLAUSE}, but on the other hand {CLAUSE}",
        "some people {DO} {AT}, others would rather {DO}",
        "{DOING} is one thing, {DOING} is another, {TAIL}",
        "either we {DO}, or {WHO} will have to {DO}",
        "{WHO} wants to {DO}, but {WHO} would rather {DO}",
        "{OPENER} it is not about {MANY}, but about {DOING}",
        "before, we had {MANY}, and now {CLAUSE}",
        "here you have {THING}, and over there you have {THING}, {TAIL}",
        "I used to {DO}, but now I would rather {DO} {AT}",
        "{THING} is {DEGREE} {ADJ}, but {THING} is {DEGREE} {ADJ}",
        "not {WHO}, but {WHO} {DID}, {TAIL}",
        "up there you have {MANY}, and down here there are only {MANY}",
        "you want to {DO}, but I want to {DO}, {TAIL}",
        "here we have small {MANY}, and over there big {MANY}, {TAIL}",
        "the more {MANY} you have, the harder it is to {DO}",
    ),
    "QUOTE": (
        "{WHO} said, and I quote, {CLAUSE}, {TAIL}",
        "that was the famous {MANY} {AT}, in quotes, and {REACTION}",
        "{WHO} calls it, quote, {DEGREE} {ADJ}, {TAIL}",
        "my favourite quote is, {CLAUSE}, and {CLAUSE}",
    ),
    "QUESTION": (
        "{ASK} do you ever {DO}, or do you just {DO}",
        "{ASK} have you ever tried to {DO} {AT}",
        "why would anybody {DO} when {CLAUSE}",
        "do you remember the day when {WHO} {DID}, and {REACTION}",
        "{ASK} who is going to {DO} if {WHO} is not there",
        "{ASK} would you rather {DO} or {DO}",
        "is {THING} really that {ADJ}, or is it just me who wants to {DO}",
        "what would you do if {WHO} {DID} {AT}",
        "{CLAUSE}, you know what I mean",
        "how long does it take to {DO}, {NUMBER} {UNIT}, {NUMBER} {UNIT}",
        "and what if {WHO} never {DID}, because {CLAUSE}",
        "have you seen {THING} {AT}, or only the {MANY}",
    ),
    "ANSWER": (
        "yes, exactly, {CLAUSE}",
        "right, and {CLAUSE}, {TAIL}",
        "no, not really, {CLAUSE}",
        "good question, {CLAUSE}",
        "who knows, maybe {WHO} {DID}, or maybe {CLAUSE}",
        "of course not, because {CLAUSE}",
        "well, I would say that {CLAUSE}",
    ),
    "HESITATION": (
        "um, I think {CLAUSE}, {TAIL}",
        "{THING} was, um, how should I say, {DEGREE} {ADJ}, and {REACTION}",
        "well, let me think, {CLAUSE}, {TAIL}",
        "you could, um, {DO}, or something like that, {TAIL}",
        "{WHO}, no, wait, {WHO} {DID} {AT}",
        "I mean, it is not that {CLAUSE}, it is just that {CLAUSE}",
        "we were, what was it, {NUMBER} or {NUMBER} {UNIT} {AT}, {DOING}",
        "I do not know, maybe {CLAUSE}, or maybe {CLAUSE}",
        "I am not sure, but I believe that {WHO} {DID} {AT}",
    ),
    "EXPLAIN": (
        "the idea is to {DO} before you {DO}, {TAIL}",
        "step by step, we {DO}, then we {DO}, and in the end {CLAUSE}",
        "what I mean is that {CLAUSE}, {TAIL}",
        "imagine you want to {DO}, but {CLAUSE}",
        "the point is, {CLAUSE}, {TAIL}",
        "if you {DO}, you do not have to {DO}, {TAIL}",
        "{OPENER} the best way to {DO} is to {DO} first",
        "it all comes down to {DOING}, because {CLAUSE}",
        "the whole secret of {DOING} is that {CLAUSE}",
    ),
    "REFUSAL": (
        "no, stop, that is not how you {DO}, {TAIL}",
        "please stop {DOING}, {CLAUSE}",
        "stop, you are exaggerating, {CLAUSE}",
        "{WHO} is exaggerating, {CLAUSE}",
        "I am not exaggerating, {WHO} {DID} {AT}",
        "do not {DO} {AT}, just {DO}",
        "I have no idea how to {DO} {AT}, {TAIL}",
        "forget about {THING}, {CLAUSE}",
        "I told myself, never again, and then {WHO} and I {DID}, and {REACTION}",
        "no, wait, please do not {DO}, {CLAUSE}",
    ),
    "SURPRISE": (
        "wow, {WHO} {DID} {AT}, {TAIL}",
        "wow, {CLAUSE}, and {REACTION}",
        "{NUMBER} {MANY}, can you believe it, and {REACTION}",
        "I could not believe it, {WHO} {DID}, and {REACTION}",
        "what a day, {WHO} {DID}, and {WHO} {DID}",
        "look at {THING}, {CLAUSE}",
        "it was incredible, {WHO} {DID}, just like that, {TAIL}",
    ),
    "FEELING": (
        "I love {DOING} {AT}, {TAIL}",
        "I want you to see {THING}, because {CLAUSE}",
        "I was so proud when {WHO} {DID}, and {REACTION}",
        "I always feel at home {AT}, {DOING} or just {DOING}",
        "in my heart I just want to {DO} and {DO}, {TAIL}",
        "for me, {CLAUSE}, {TAIL}",
        "I was afraid that we would have to {DO} {AT}, {TAIL}",
        "it makes me {MOOD} when people {DO} and {DO}",
        "I believe that everybody should {DO} {AT}, {TAIL}",
    ),
    "SIZE": (
        "it was this big, from here to over there, {CLAUSE}, and {REACTION}",
        "there was a huge number of {MANY} {AT}, {TAIL}",
        "a long line of {MANY}, all the way from {PLACE} to {PLACE}",
        "a tiny, tiny mistake, and suddenly there were {NUMBER} {MANY} {AT}",
        "there is only a small gap between {PLACE} and {PLACE}, about this wide, {TAIL}",
        "{MANY} as far as you could see, {MANY} everywhere, and {REACTION}",
    ),
    "DIRECTION": (
        "go past {PLACE}, turn {SIDE} at the {LANDMARK}, and {WHO} will show you the way",
        "from {PLACE} you go straight ahead for {NUMBER} minutes, and {THING} is on the {SIDE}",
        "{WHO} lives behind the {LANDMARK}, on the {SIDE}, not far from {PLACE}",
    ),
    "TIME": (
        "{PAST} nobody wanted to {DO}, and now {WHO} wants to {DO}",
        "next {WEEKDAY} we will {DO} {AT}, {TAIL}",
        "in the future nobody will have to {DO}, because {CLAUSE}",
        "every {WEEKDAY} I {DO}, and every {WEEKDAY} I {DO}",
        "it takes {NUMBER} {UNIT} to {DO}, and only {NUMBER} seconds to {DO}",
        "right now {WHO} is {DOING} {AT}, {TAIL}",
    ),
    "CLAUSE": (
        "{THING} is {DEGREE} {ADJ}",
        "{THING} was {DEGREE} {ADJ} {PAST_END}",
        "{DOING} is {EVALUATION}",
        "{DOING} {AT} is {EVALUATION}",
        "{WHO} never wants to {DO}",
        "nobody has time to {DO} {AT}",
        "you can {DO} without {DOING}",
        "there are too many {MANY} {AT}",
        "{WHO} {DID} {PAST_END}",
        "everyone wants to {DO}",
        "we all have to {DO} one day",
        "{WHO} likes {DOING} more than {DOING}",
    ),
    "OPENER": (
        *("well,", "you know,", "honestly,", "so,", "to be fair,", "look,", "okay,"),
        *("actually,", "by the way,", "of course", "in the end", "as I said,", "seriously,"),
        *("believe me,", "sometimes", "the funny thing is,", "as far as I can tell,"),
    ),
    "ASK": (
        *("tell me,", "so,", "and,", "okay,", "honestly,", "now,", "be honest,", "I wonder,"),
        *("just one question,", "wait,"),
    ),
    "TAIL": (
        *("and that is the whole point", "and I mean it", "at least for me", "if you ask me"),
        *("believe it or not", "and nobody told me", "which is exactly what I wanted"),
        *("and it goes on and on", "so we just have to wait", "and I would do it again"),
        *("and everybody was exaggerating", "or am I wrong", "and that is all there is to it"),
        *("but do not tell {WHO}", "and {WHO} knows it", "just ask {WHO}", "and I am serious"),
        *("as {WHO} used to say", "and there is nothing you can do", "and that was only Monday"),
        *("whatever {WHO} says", "and you can see why", "and it works every time"),
    ),
    "REACTION": (
        *("everybody laughed", "I could not stop laughing", "nobody said a word"),
        *("I just stood there", "{WHO} shook hands with everyone", "we all cheered"),
        *("I had no idea what to say", "the whole room went quiet", "{WHO} looked at me"),
        *("I thought, this is it", "{WHO} started to laugh", "I never forgot it"),
        *("it changed everything", "{WHO} pointed at the door", "we went home in the rain"),
    ),
    "CALLED": (
        *("and all I heard was, {CLAUSE}", "and said, stop, {CLAUSE}", "and {REACTION}"),
        *("just to tell me that {CLAUSE}", "so I turned the wheel, and {REACTION}"),
    ),
    "PAST": (
        *("last summer", "yesterday evening", "a long time ago", "two weeks ago", "one morning"),
        *("last Friday", "two years ago", "after the holidays", "on the first day"),
        *("the other day", "in the middle of the night", "just before breakfast"),
    ),
    "PAST_END": (
        *("last year", "yesterday", "this morning", "in the beginning", "on the last day"),
        *("last winter", "the week before", "at the weekend", "back then", "last time"),
    ),
    "DEGREE": (
        *("really", "very", "quite", "a little", "rather", "surprisingly", "far too", "so"),
        *("incredibly", "not very", "always a bit", "unusually"),
    ),
    "EVALUATION": (
        *("harder than it looks", "easier than people think", "the best part of the week"),
        *("not as simple as it sounds", "worth the trouble", "good for you", "pure joy"),
        *("exhausting", "more fun with friends", "a question of patience", "half of the work"),
        *("something you never forget", "a real art", "my idea of a good day", "overrated"),
        *("the most natural thing in the world", "a waste of time", "only the first step"),
    ),
    "MOOD": ("happy", "sad", "angry", "nervous", "proud", "hopeful"),
    "NUMBER": (
        *("two", "three", "four", "five", "six", "ten", "twelve", "twenty", "fifty"),
        *("a hundred", "a thousand"),
    ),
    "UNIT": ("minutes", "hours", "days", "weeks", "months", "years"),
    "WEEKDAY": ("Monday", "Tuesday", "Wednesday", "Friday", "Saturday", "Sunday"),
    "SIDE": ("left", "right"),
    "LANDMARK": ("church", "fountain", "big tree", "town hall", "old tower", "round window"),
}


Split = Literal["train", "val", "test"]
SPLITS: tuple[Split, ...] = ("train", "val", "test")

MIN_SENTENCES, MAX_LISTED_EXCLUSIONS = 3, 7  # sentences on one topic
ANSWER_SHARE = 0.6  # share of answered questions
_KIND_NAMES = tuple(KINDS)
_KIND_SHARES = np.array(list(KINDS.values())) / sum(KINDS.values())
_TOPIC_NAMES = tuple(TOPICS)


def split_of(sentence: str) -> Split:
    """Return the split of a sentence, by its hash: eight tenths train, one tenth each other."""
    bucket = zlib.crc32(sentence.encode()) % 10
    return "val" if bucket == 8 else "test" if bucket == 9 else "train"


def generate_sentences(rng: np.random.Generator, split: Split) -> Iterator[str]:
    """Yield endless sentences of the split by topic; questions may be answered after a pause."""
    while True:
        topic = TOPICS[_TOPIC_NAMES[rng.integers(len(_TOPIC_NAMES))]]
        kind = _draw_kind(rng)
        for _ in range(rng.integers(MIN_SENTENCES, MAX_LISTED_EXCLUSIONS + 1)):
            yield _sentence(rng, split, topic, kind)
            answers = kind == "QUESTION" and rng.random() < ANSWER_SHARE
            kind = AFTER_A_QUESTION if answers else _draw_kind(rng)


def _draw_kind(rng: np.random.Generator) -> str:
    return _KIND_NAMES[rng.choice(len(_KIND_NAMES), p=_KIND_SHARES)]


def _sentence(rng: np.random.Generator, split: Split, topic: Topic, kind: str) -> str:
    """Draw sentences of one kind, with capital and end mark, until one belongs to the split."""
    while True:
        text = _expand(kind, topic, rng, set())
        sentence = text[0].upper() + text[1:] + END_MARKS.get(kind, ".")
        if split_of(sentence) == split:
            return sentence


def _expand(symbol: str, topic: Topic, rng: np.random.Generator, used: set[str]) -> str:
    """Expand a symbol to words, without the expansions already used in the sentence."""
    every = topic.get(symbol) or GRAMMAR[symbol]
    choices = [text for text in every if text not in used] or every
    text = choices[rng.integers(len(choices))]
    used.add(text)
    while "{" in text:
        start, end = text.index("{"), text.index("}")
        text = text[:start] + _expand(text[start + 1 : end], topic, rng, used) + text[end + 1 :]
    return text
