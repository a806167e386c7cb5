"""What to gesture, and with which hand."""

from collections import deque

import numpy as np

from model.corpus.gesture.gestures import GENERIC, KEYWORDS, ONLY_WHEN_STRESSED, Gesture
from model.corpus.people.rig import SIDES
from model.corpus.people.speaker import Speaker
from model.corpus.words.prosody import Word

FAVOURITE = 4.0  # times as often
STALE = 5  # a gesture that a word called for is not called again by this many chunks


class Choice:
    """Draws gestures and hands for one speaker, and remembers the last ones."""

    def __init__(self, speaker: Speaker, rng: np.random.Generator):
        self._speaker = speaker
        self._rng = rng
        self._recent: deque[str] = deque(maxlen=STALE)
        self._free_hands: list[str] | None = None

    def gesture(self, chunk: range, words: tuple[Word, ...]) -> tuple[str, int]:
        """The gesture's name and the word it lands on: a word that calls for it, or an accent."""
        called = self._called_for(chunk, words)
        if called is not None:
            name, index = called
        else:
            name, index = self._generic(), max(chunk, key=lambda k: words[k].accent)
        self._recent.append(name)
        return name, index

    def hands(self, gesture: Gesture, aside_m: float) -> list[str]:
        """The hands that take part, the leading one first; a place aside may call its own hand."""
        rng, speaker = self._rng, self._speaker
        nearest = SIDES[0] if aside_m > 0 else SIDES[1]
        second = nearest if aside_m else speaker.other_hand
        one = speaker.dominant if rng.random() < speaker.dominance else second
        two = [speaker.dominant, speaker.other_hand]
        if gesture.hands == "one":
            return [one]
        if gesture.hands == "two":
            return two
        if gesture.hands == "dominant":
            return [speaker.dominant]
        if gesture.hands == "other":
            return [speaker.other_hand]
        if self._free_hands is None or rng.random() < 0.35:
            self._free_hands = two if rng.random() < speaker.two_hands else [one]
        return self._free_hands

    def hands_rested(self) -> None:
        """After a rest the hands of free gestures are drawn anew."""
        self._free_hands = None

    def _called_for(self, chunk: range, words: tuple[Word, ...]) -> tuple[str, int] | None:
        """A gesture with the word that calls for it; words are not always obeyed."""
        rng = self._rng
        candidates = []
        for k in chunk:
            for name in KEYWORDS.get(words[k].text, ()):
                if name in self._recent:
                    continue
                unstressed = name in ONLY_WHEN_STRESSED and words[k].accent <= 0
                weight = 0.25 if unstressed else 0.9
                candidates.append((weight * rng.uniform(0.5, 1.0), name, k))
        if not candidates:
            return None
        weight, name, k = max(candidates)
        obeys = rng.random() < self._speaker.literal * (0.1 + 0.55 * weight)
        return (name, k) if obeys else None

    def _generic(self) -> str:
        names = list(GENERIC)
        last = self._recent[-1] if self._recent else ""
        weights = np.array([GENERIC[n] for n in names])
        weights *= [FAVOURITE if n in self._speaker.favourites else 1.0 for n in names]
        weights *= [0.4 if n == last else 1.0 for n in names]
        return names[self._rng.choice(len(names), p=weights / weights.sum())]
