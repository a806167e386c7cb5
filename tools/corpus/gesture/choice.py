"""What to gesture, and with which hand."""

from collections import deque
from collections.abc import Collection

import numpy as np

from tools.corpus.gesture.gestures import (
    GENERIC,
    KEYWORDS,
    LISTED,
    ONLY_WHEN_STRESSED,
    Gesture,
)
from tools.corpus.people.rig import SIDES
from tools.corpus.people.speaker import Speaker
from tools.corpus.words.prosody import Word

FAVOURITE = 4.0  # times as often
LISTED_SHARE = 0.6  # of the items of a list
OWN_SIDE_SHARE = 0.75  # of one-handed gestures of a contrast are made by the nearer hand
STALE = 5  # a gesture that a word called for is not called again by this many chunks


class Choice:
    """Draws gestures and hands for one speaker, and remembers the last ones."""

    def __init__(self, speaker: Speaker, rng: np.random.Generator):
        self._speaker = speaker
        self._rng = rng
        self._recent: deque[str] = deque(maxlen=STALE)
        self._free_hands: list[str] | None = None

    def gesture(
        self, chunk: range, words: tuple[Word, ...], listed: Collection[int] = ()
    ) -> tuple[str, int]:
        """The gesture's name and the word it lands on: a word that calls for it, or an accent.

        ``listed`` are the words of lists, whose items are set down one by one.
        """
        called = self._called_for(chunk, words)
        strongest = max(chunk, key=lambda k: words[k].accent)
        if called is not None:
            name, index = called
        elif strongest in listed and self._rng.random() < LISTED_SHARE:
            name, index = LISTED[self._rng.integers(len(LISTED))], strongest
        else:
            name, index = self._generic(), strongest
        self._recent.append(name)
        return name, index

    def hands(self, gesture: Gesture, aside_m: float, contrasts: bool = False) -> list[str]:
        """The hands that take part, the leading one first; a place aside may call its own hand.

        Where two sides are contrasted, it mostly does.
        """
        rng, speaker = self._rng, self._speaker
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
        """After a rest the hands of free gestures are drawn anew."""
        self._free_hands = None

    def _called_for(self, chunk: range, words: tuple[Word, ...]) -> tuple[str, int] | None:
        """A gesture with the word that calls for it; stressed words are obeyed more often."""
        rng = self._rng
        candidates = []
        for k in chunk:
            for name in KEYWORDS.get(words[k].text, ()):
                if name in self._recent:
                    continue
                common = name in ONLY_WHEN_STRESSED
                stress = min(words[k].accent, 1.0)
                share = 0.3 + 0.55 * stress if not common else 0.1 + 0.6 * stress
                candidates.append((share * rng.uniform(0.7, 1.0), name, k))
        if not candidates:
            return None
        share, name, k = max(candidates)
        return (name, k) if rng.random() < self._speaker.literal * share else None

    def _generic(self) -> str:
        names = list(GENERIC)
        last = self._recent[-1] if self._recent else ""
        weights = np.array([GENERIC[n] for n in names])
        weights *= [FAVOURITE if n in self._speaker.favourites else 1.0 for n in names]
        weights *= [0.4 if n == last else 1.0 for n in names]
        return names[self._rng.choice(len(names), p=weights / weights.sum())]
