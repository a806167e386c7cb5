"""Where a speaker puts ideas: sides of a contrast, items of a list, places come back to."""

from collections.abc import Collection, Sequence
from itertools import groupby

import numpy as np

from tools.corpus.people.rig import SIDE_SIGN
from tools.corpus.people.speaker import Speaker
from tools.corpus.words.prosody import Phrase, Word

ASIDE_M = 0.065
CONTRAST_ASIDE_M = 0.085
MIN_ITEMS = 3  # of a list
FIRST_MARKS = frozenset("one some either before here not rather".split())
SECOND_MARKS = frozenset("but other others or now there another".split())
NEW_PLACE_SHARE = 0.3  # of the stressed words that have no place yet


class Places:
    """Remembers on which side of the gesture space an idea was put.

    The first half of a contrast goes to the side of the other hand, the second to that of the
    dominant hand.
    """

    def __init__(
        self,
        words: Sequence[Word],
        phrases: Sequence[Phrase],
        speaker: Speaker,
        rng: np.random.Generator,
    ):
        self._words = words
        self._rng = rng
        self._known: dict[str, float] = {}
        first = SIDE_SIGN[speaker.other_hand]
        halves = contrast_halves(words) | directions(words, first)
        self._contrast = {k: half * first for k, half in halves.items()}
        self._items = {k: place * first for k, place in list_items(words, phrases).items()}

    def contrasts(self, index: int) -> bool:
        """Whether the word belongs to one of two sides."""
        return index in self._contrast

    @property
    def listed(self) -> Collection[int]:
        """The words of lists."""
        return self._items.keys()

    def aside_m(self, index: int) -> float:
        """Metres to the speaker's left for a gesture on this word; 0 for the middle."""
        word = self._words[index]
        if index in self._items and index not in self._contrast:
            return ASIDE_M * self._items[index]
        known = self._known.get(word.text, 0.0)
        side = self._contrast.get(index, 0.0) or known
        fresh = not side and word.is_content and self._rng.random() < NEW_PLACE_SHARE
        if fresh:
            side = float(self._rng.choice([-1.0, 1.0]))
        if side and word.is_content:
            self._known[word.text] = side
        distance_m = CONTRAST_ASIDE_M if index in self._contrast else ASIDE_M
        return distance_m * side * float(self._rng.uniform(0.7, 1.2))


def contrast_halves(words: Sequence[Word]) -> dict[int, float]:
    """+1 for words of the first half of a contrast, -1 for the second; others are left out.

    A sentence is a contrast where a word such as "but" follows one such as "some".
    """
    halves: dict[int, float] = {}
    sentences: dict[int, list[int]] = {}
    for k, word in enumerate(words):
        sentences.setdefault(word.sentence, []).append(k)
    for members in sentences.values():
        opens = next((k for k in members if words[k].text in FIRST_MARKS), None)
        turns = [k for k in members if words[k].text in SECOND_MARKS]
        turn = next((k for k in turns if opens is not None and k > opens + 1), None)
        if opens is not None and turn is not None:
            halves |= {k: 1.0 if k < turn else -1.0 for k in members if k >= opens}
    return halves


def directions(words: Sequence[Word], first: float) -> dict[int, float]:
    """The words "left", and "right" after "the" or "turn", as +1 or -1 times ``first``."""
    found = {k: first for k, word in enumerate(words) if word.text == "left"}
    for k in range(1, len(words)):
        if words[k].text == "right" and words[k - 1].text in ("the", "turn"):
            found[k] = -first
    return found


def list_items(words: Sequence[Word], phrases: Sequence[Phrase]) -> dict[int, float]:
    """For the words of a list's items their place: from +1 for the first item to -1 for the last.

    A sentence is a list where three or more phrases follow each other, the last begun by "and".
    """
    places: dict[int, float] = {}
    for _, members in groupby(phrases, key=lambda phrase: words[phrase.words.start].sentence):
        items = [phrase for phrase in members if len(phrase.words) > 1]
        if len(items) >= MIN_ITEMS and words[items[-1].words.start].text == "and":
            for place, item in zip(np.linspace(1.0, -1.0, len(items)), items, strict=True):
                places |= {k: float(place) for k in item.words}
    return places
