"""Sentences from a small grammar, disjoint between the training, validation and test splits."""

import zlib
from typing import Literal

import numpy as np

Split = Literal["train", "val", "test"]
SPLITS: tuple[Split, ...] = ("train", "val", "test")

# A symbol in braces is replaced by one of its expansions.
GRAMMAR: dict[str, tuple[str, ...]] = {
    "SENTENCE": (
        *("{OPENER} {CLAIM}.", "{CLAIM}, {ADDITION}.", "{STORY}.", "{STORY}, {ADDITION}."),
        *("{QUESTION}?", "{LIST}.", "{SIZE}.", "{SELF}.", "{REFUSAL}.", "{CONTRAST}."),
        *("{SURPRISE}!", "{OPENER} {STORY}.", "{TIME}, {CLAIM}.", "{HEDGE}, {CLAIM}."),
        *("{EXPLAIN}.", "{CLAIM}, {ADDITION}, {ADDITION}.", "{DIRECTION}.", "{FEELING}."),
    ),
    "OPENER": (
        *("Well,", "You know,", "Honestly,", "So,", "To be fair,", "Look,", "Okay,"),
        *("Actually,", "By the way,", "Of course,", "In the end,", "As I said,", "Seriously,"),
    ),
    "CLAIM": (
        "{SUBJECT} {IS} {ADVERB} {ADJECTIVE}",
        "{SUBJECT} can {VERB} {OBJECT} in a {ADJECTIVE} way",
        "everyone in {PLACE} wants {OBJECT}",
        "the {ADJECTIVE} part is {OBJECT}",
        "you have to {VERB} {OBJECT} every day",
        "nobody at {PLACE} wanted to {VERB} {OBJECT}",
        "{SUBJECT} {IS} a bit more {ADJECTIVE} than {SUBJECT}",
        "it takes {NUMBER} {UNIT} to {VERB} {OBJECT}",
        "they {VERB} {OBJECT} all the time",
        "we should {VERB} {OBJECT} together",
    ),
    "SUBJECT": (
        *("the whole project", "this small idea", "my brother", "the music", "a good teacher"),
        *("the city", "our garden", "cooking at home", "that long meeting", "the new building"),
        *("learning a language", "the weather", "your sister", "the old bridge", "this book"),
        *("the last chapter", "my neighbour", "the science museum", "public transport"),
        *("a walk in the park", "the team", "her answer", "that film", "the river"),
    ),
    "IS": ("is", "was", "feels", "looks", "sounds", "became"),
    "ADVERB": ("really", "very", "so", "always", "never", "quite", "a little", "completely"),
    "ADJECTIVE": (
        *("important", "difficult", "beautiful", "strange", "huge", "tiny", "wonderful"),
        *("boring", "simple", "expensive", "quiet", "brilliant", "round", "careful", "gentle"),
        *("honest", "surprising", "practical", "heavy", "colourful", "complicated", "flat"),
    ),
    "VERB": (
        *("understand", "change", "improve", "share", "carry", "explain", "protect", "repeat"),
        *("connect", "compare", "discover", "forget", "support", "measure", "open", "build"),
    ),
    "OBJECT": (
        *("the plan", "a better answer", "their own story", "the big picture", "the money"),
        *("all of the details", "every little step", "the future", "a long conversation"),
        *("the problem", "a different point of view", "the rules", "one simple question"),
        *("the results", "something new", "the difference", "a few good friends", "the map"),
    ),
    "PLACE": (
        *("the office", "my town", "the kitchen", "that street over there", "the mountains"),
        *("our school", "the whole world", "the station", "the library", "a small village"),
    ),
    "NUMBER": ("two", "three", "four", "five", "ten", "twenty", "a hundred"),
    "UNIT": ("minutes", "hours", "days", "weeks", "years", "people", "attempts"),
    "TIME": (
        *("last year", "every morning", "in the summer", "next week", "yesterday evening"),
        *("a long time ago", "right now", "after the concert", "before breakfast"),
    ),
    "HEDGE": (
        *("I am not sure, but", "as far as I can tell", "maybe I am wrong, but"),
        *("if you ask me", "let me think", "um, in a way"),
    ),
    "ADDITION": (
        *("and I think {CLAIM}", "but {CLAIM}", "because {CLAIM}", "and it goes on and on"),
        *("and that is all there is to it", "which is exactly what you want"),
        *("so we just have to wait", "even if {CLAIM}", "and so on", "and then {STORY}"),
        *("although {SUBJECT} {IS} {ADJECTIVE}", "and everybody was exaggerating"),
    ),
    "STORY": (
        *("last summer I was driving to {PLACE}", "then I turned the wheel and stopped the car"),
        *("one morning my father walked into {PLACE}", "we carried a huge box up the stairs"),
        *("I sat there for {NUMBER} hours and waited", "somebody opened the door and said hello"),
        *("I picked up the phone and called my mother", "they ran across {PLACE} in the rain"),
        *("she looked at me and started to laugh", "the dog jumped over the fence"),
        *("we put {OBJECT} on the table and talked about {OBJECT}", "he was driving all the time"),
        *("my friend came down from {PLACE} with {NUMBER} bags", "I wrote {OBJECT} on a wall"),
    ),
    "QUESTION": (
        *("what do you think about {OBJECT}", "have you ever seen {PLACE}", "who knows"),
        *("why would anybody {VERB} {OBJECT}", "do you remember {OBJECT}", "are you sure"),
        *("how can {SUBJECT} be so {ADJECTIVE}", "where did {SUBJECT} come from"),
    ),
    "LIST": (
        "first you {VERB} {OBJECT}, second you {VERB} {OBJECT}, and third you go home",
        "there are two reasons, one is {OBJECT}, and two is {OBJECT}",
        "we had bread, cheese, and a lot of coffee",
        "I like {SUBJECT}, {SUBJECT}, and {SUBJECT}",
        "you need {OBJECT}, {OBJECT}, and {NUMBER} {UNIT} of time",
        "it is {ADJECTIVE}, it is {ADJECTIVE}, and it is {ADJECTIVE}",
    ),
    "SIZE": (
        *("it was this big, from here to over there", "it is a round table, about this long"),
        *("a tiny, tiny mistake", "the fish was huge, really huge", "a wide and open field"),
        *("it was as tall as {SUBJECT}", "there is only a small gap between {OBJECT} and us"),
    ),
    "SELF": (
        *("I love {OBJECT}", "for me, {CLAIM}", "I think you should try it", "I believe {CLAIM}"),
        *("I told myself, never again", "I want you to see {PLACE}", "in my heart {CLAIM}"),
    ),
    "REFUSAL": (
        *("no, stop, that is not what I mean", "forget about {OBJECT}", "I have no idea"),
        *("I do not know, maybe {CLAIM}", "please wait a minute", "stop, you are exaggerating"),
        *("do not {VERB} {OBJECT}", "that can never {VERB} {OBJECT}", "I am not exaggerating"),
    ),
    "CONTRAST": (
        "on the one hand, {CLAIM}, but on the other hand, {CLAIM}",
        "some people {VERB} {OBJECT}, others never do",
        "{SUBJECT} {IS} {ADJECTIVE}, but {SUBJECT} {IS} {ADJECTIVE}",
        "not {OBJECT}, but {OBJECT}",
        "either we {VERB} {OBJECT}, or we {VERB} {OBJECT}",
    ),
    "SURPRISE": (
        *("wow, that is amazing", "I could not believe it", "what a crazy day"),
        *("it was incredible", "wow, {SUBJECT} {IS} {ADVERB} {ADJECTIVE}", "look at {OBJECT}"),
    ),
    "EXPLAIN": (
        "the idea behind {OBJECT} is to {VERB} {OBJECT}",
        "step by step we {VERB} {OBJECT} and {VERB} {OBJECT}",
        "what I mean is that {CLAIM}",
        "imagine that {CLAIM}",
        "the point is, {CLAIM}",
    ),
    "DIRECTION": (
        "go straight ahead, turn left at {PLACE}, and cross the bridge",
        "it is behind {PLACE}, on the right side",
        "from {PLACE} you go up to {PLACE}",
    ),
    "FEELING": (
        *("{SUBJECT} makes me {ADVERB} happy", "I was afraid of {OBJECT}", "we felt at home"),
        *("it hurts when people {VERB} {OBJECT}", "I am so proud of {SUBJECT}"),
    ),
}


def split_of(sentence: str) -> Split:
    """The split a sentence belongs to for good: eight tenths train, one tenth each other."""
    bucket = zlib.crc32(sentence.encode()) % 10
    return "val" if bucket == 8 else "test" if bucket == 9 else "train"


def draw_sentence(rng: np.random.Generator, split: Split) -> str:
    """A sentence with a capital and a full stop, question mark or exclamation mark."""
    while True:
        sentence = _expand("SENTENCE", rng)
        sentence = sentence[0].upper() + sentence[1:]
        if split_of(sentence) == split:
            return sentence


def _expand(symbol: str, rng: np.random.Generator) -> str:
    choices = GRAMMAR[symbol]
    text = choices[rng.integers(len(choices))]
    while "{" in text:
        start, end = text.index("{"), text.index("}")
        text = text[:start] + _expand(text[start + 1 : end], rng) + text[end + 1 :]
    return text
