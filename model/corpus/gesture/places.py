"""Where a speaker puts ideas: two sides of a contrast, and places that are come back to."""

from collections.abc import Sequence

import numpy as np

from model.corpus.people.rig import SIDE_SIGN
from model.corpus.people.speaker import Speaker
from model.corpus.words.prosody import Word

ASIDE_M = 0.065
FIRST_MARKS = frozenset("one some either before here not rather".split())
SECOND_MARKS = frozenset("but other others or now there another".split())
NEW_PLACE_SHARE = 0.3  # of the stressed words that have no place yet


class Places:
    """Remembers on which side of the gesture space an idea was put.

    The first half of a contrast goes to the side of the other hand, the second to that of the
    dominant hand.
    """

    def __init__(self, words: Sequence[Word], speaker: Speaker, rng: np.random.Generator):
        self._words = words
        self._rng = rng
        self._known: dict[str, float] = {}
        first = SIDE_SIGN[speaker.other_hand]
        self._contrast = {k: half * first for k, half in contrast_halves(words).items()}

    def aside_m(self, index: int) -> float:
        """Metres to the speaker's left for a gesture on this word; 0 for the middle."""
        word = self._words[index]
        known = self._known.get(word.text, 0.0)
        side = self._contrast.get(index, 0.0) or known
        fresh = not side and word.is_content and self._rng.random() < NEW_PLACE_SHARE
        if fresh:
            side = float(self._rng.choice([-1.0, 1.0]))
        if side and word.is_content:
            self._known[word.text] = side
        return ASIDE_M * side * float(self._rng.uniform(0.7, 1.2))


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
