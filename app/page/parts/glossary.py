"""Words of the field that the page uses, each explained where a person points at it."""

from __future__ import annotations

import re
from html import escape

WORDS = {
    "jerk": "Change of acceleration: how much it trembles and jolts. Lower is smoother.",
    "depth": "Number of bones between the pelvis and a joint; the fingertips are deepest.",
    "frequency": "How fast something goes back and forth, in Hz: times a second.",
    "trajectory": "The way that a point takes through space.",
    "seam": "Where two windows of generated motion join.",
    "seams": "Where two windows of generated motion join.",
    "closed form": "Worked out with a formula, rather than measured.",
    "chance level": "What unrelated speech and motion would reach.",
    "power": "How much of the movement there is at each frequency.",
    "noise": "Random numbers; generators begin with them, and disturbed motion holds them.",
    "local rotations": "Of each joint relative to the joint before it.",
    "global rotations": "Of each joint as it stands in the world.",
    "samples": "Motions for the same speech from other random numbers.",
}
_WORDS = re.compile(
    r"\b(" + "|".join(sorted(map(re.escape, WORDS), key=len, reverse=True)) + r")\b", re.IGNORECASE
)


def explained(sentence: str) -> str:
    """HTML of a sentence whose words of the field can be pointed at, each the first time."""
    seen: set[str] = set()

    def mark(found: re.Match[str]) -> str:
        word = found[1].lower()
        if WORDS[word] in seen:
            return found[1]
        seen.add(WORDS[word])
        return f'<abbr title="{escape(WORDS[word])}">{found[1]}</abbr>'

    return _WORDS.sub(mark, escape(sentence))
