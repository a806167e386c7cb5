"""Choice of gesture, hand and side of the gesture space."""

from collections import deque
from collections.abc import Sequence
from itertools import groupby

import numpy as np

from tools.corpus.gesture import gestures
from tools.corpus.people.rig import SIDE_SIGN, SIDES
from tools.corpus.people.speaker import Speaker
from tools.corpus.words.prosody import Phrase, SpokenWord

FAVOURITE = 4.0  # factor on the probability of a speaker's favourites
LISTED_SHARE = 0.6  # share of list items with a listing gesture
OWN_SIDE_SHARE = 0.75  # share of one-handed contrast gestures by the nearer hand
REPEAT_MEMORY = 5  # chunks before a literal gesture may be repeated


ASIDE_M = 0.065
CONTRAST_ASIDE_M = 0.085
MIN_ITEMS = 3  # fewest phrases of a list
FIRST_MARKS = frozenset("one some either before here not rather".split())
SECOND_MARKS = frozenset("but other others or now there another".split())
NEW_PLACE_SHARE = 0.3  # share of stressed words that get a new position


class GestureSelector:
    """Random choice of gestures, hands and positions for one speaker.

    It avoids the last gestures and reuses the side of an idea. The first half of a contrast goes to
    the side of the non-dominant hand, the second to that of the dominant hand; the items of a list
    are set down side by side.
    """

    def __init__(
        self,
        words: Sequence[SpokenWord],
        phrases: Sequence[Phrase],
        speaker: Speaker,
        rng: np.random.Generator,
    ):
        self._words = words
        self._speaker = speaker
        self._rng = rng
        self._recent: deque[str] = deque(maxlen=REPEAT_MEMORY)
        self._free_hands: list[str] | None = None
        self._side_by_word: dict[str, float] = {}
        first = SIDE_SIGN[speaker.other_hand]
        halves = contrast_halves(words) | directions(words, first)
        self._contrast = {k: half * first for k, half in halves.items()}
        self._items = {k: place * first for k, place in list_items(words, phrases).items()}

    def gesture(self, chunk: range) -> tuple[str, int]:
        """Choose a gesture and its word: a word with a literal gesture, or the strongest accent."""
        called = self._called_for(chunk)
        strongest = max(chunk, key=lambda k: self._words[k].accent)
        if called is not None:
            name, index = called
        elif strongest in self._items and self._rng.random() < LISTED_SHARE:
            name, index = gestures.LISTED[self._rng.integers(len(gestures.LISTED))], strongest
        else:
            name, index = self._generic(), strongest
        self._recent.append(name)
        return name, index

    def hands(self, gesture: gestures.GestureShape, aside_m: float, index: int) -> list[str]:
        """Choose the hands, the leading one first; a side, as in a contrast, prefers its hand."""
        rng, speaker, contrasts = self._rng, self._speaker, index in self._contrast
        nearest = SIDES[0] if aside_m > 0 else SIDES[1]
        second = nearest if aside_m else speaker.other_hand
        one = speaker.dominant if rng.random() < speaker.dominance else second
        if contrasts and rng.random() < OWN_SIDE_SHARE:
            one = nearest
        two = [speaker.dominant, speaker.other_hand]
        if gesture.hands == "one":
            return [one]
        if gesture.hands == "two":
            return two
        if gesture.hands == "dominant":
            return [speaker.dominant]
        if gesture.hands == "other":
            return [speaker.other_hand]
        if contrasts:
            return [one]
        if self._free_hands is None or rng.random() < 0.35:
            self._free_hands = two if rng.random() < speaker.two_hands else [one]
        return self._free_hands

    def hands_rested(self) -> None:
        """Forget the current hands, so that they are drawn again after a rest."""
        self._free_hands = None

    def _called_for(self, chunk: range) -> tuple[str, int] | None:
        """Draw a literal gesture with its word, more often for stressed words; None without one."""
        rng, words = self._rng, self._words
        candidates = []
        for k in chunk:
            for name in gestures.GESTURES_BY_WORD.get(words[k].text, ()):
                if name in self._recent:
                    continue
                common = name in gestures.ONLY_WHEN_STRESSED
                stress = min(words[k].accent, 1.0)
                share = 0.3 + 0.55 * stress if not common else 0.1 + 0.6 * stress
                candidates.append((share * rng.uniform(0.7, 1.0), name, k))
        if not candidates:
            return None
        share, name, k = max(candidates)
        return (name, k) if rng.random() < self._speaker.keyword_gesture_rate * share else None

    def _generic(self) -> str:
        names = list(gestures.GENERIC)
        last = self._recent[-1] if self._recent else ""
        weights = np.array([gestures.GENERIC[n] for n in names])
        weights *= [FAVOURITE if n in self._speaker.favourites else 1.0 for n in names]
        weights *= [0.4 if n == last else 1.0 for n in names]
        return names[self._rng.choice(len(names), p=weights / weights.sum())]

    def aside_m(self, index: int) -> float:
        """Return the offset (m) to the speaker's left for a gesture on a word; 0 is the middle."""
        word = self._words[index]
        if index in self._items and index not in self._contrast:
            return ASIDE_M * self._items[index]
        aside_m = self._side_by_word.get(word.text, 0.0)
        side = self._contrast.get(index, 0.0) or aside_m
        fresh = not side and word.is_content and self._rng.random() < NEW_PLACE_SHARE
        if fresh:
            side = float(self._rng.choice([-1.0, 1.0]))
        if side and word.is_content:
            self._side_by_word[word.text] = side
        distance_m = CONTRAST_ASIDE_M if index in self._contrast else ASIDE_M
        return distance_m * side * float(self._rng.uniform(0.7, 1.2))


def contrast_halves(words: Sequence[SpokenWord]) -> dict[int, float]:
    """Return +1 for words of the first half of a contrast, -1 for the second; others are left out.

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


def directions(words: Sequence[SpokenWord], first: float) -> dict[int, float]:
    """Return the words "left", and "right" after "the" or "turn", as +1 or -1 times ``first``."""
    firsts = {k: first for k, word in enumerate(words) if word.text == "left"}
    for k in range(1, len(words)):
        if words[k].text == "right" and words[k - 1].text in ("the", "turn"):
            firsts[k] = -first
    return firsts


def list_items(words: Sequence[SpokenWord], phrases: Sequence[Phrase]) -> dict[int, float]:
    """Return the positions of list items' words: from +1 for the first item to -1 for the last.

    A sentence is a list where three or more phrases follow each other, the last begun by "and".
    """
    places: dict[int, float] = {}
    for _, members in groupby(phrases, key=lambda phrase: words[phrase.words.start].sentence):
        items = [phrase for phrase in members if len(phrase.words) > 1]
        if len(items) >= MIN_ITEMS and words[items[-1].words.start].text == "and":
            for place, item in zip(np.linspace(1.0, -1.0, len(items)), items, strict=True):
                places |= {k: float(place) for k in item.words}
    return places
