"""Words, phones and gestures with their times, from a Praat TextGrid as BEAT2, forced aligners and
our corpus write them; and plain texts, whose times are still to be found."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Literal

from model.plan.tier_files import Interval, NamedTier, is_textgrid, text_of, textgrid_tiers
from model.storage.files import bytes_within

MAX_BYTES = 8 * 2**20
"""An hour of speech with all its phones has less than 4 MiB."""
MAX_WORDS = 50_000
"""Intervals of a tier."""
MAX_GESTURE_TIERS = 4
MAX_TEXT = 256 * 2**10
"""Characters of a plain text; what is said in an hour has less than 80,000."""
TEXT_SUFFIX = ".txt"
WORD_TIERS = ("words", "word")
PHONE_TIERS = ("phones", "phone")
Origin = Literal["given", "aligned", "recognised"]
"""Where words and their times come from: a TextGrid; a plain text, looked for in the speech; or the
speech alone."""
GESTURE_TIER = re.compile(r"gesture|phase|stroke", re.IGNORECASE)
"""Part of the name of a tier that says what hands do."""
ACCENT_TIER = "accents"
"""Name of our corpus's tier of points, each labelled with how strong an accent is."""
_ACCENT = re.compile(r"\d+(?:\.\d+)?")


class TranscriptError(ValueError):
    """A transcript that cannot be used; the message is one sentence for a person."""


@dataclass(frozen=True)
class Word(Interval):
    """A word, and how sure it is that it was said there."""

    confidence: float = 1.0
    """0 to 1; 1 of what a person has given."""


@dataclass(frozen=True)
class Accent:
    """A moment of stress, in seconds from the start of the speech."""

    time_s: float
    strength: float
    """0 to 1."""


@dataclass(frozen=True)
class Transcript:
    """What was said, and what hands did meanwhile where that was written down, too."""

    words: tuple[Word, ...] = ()
    gestures: Mapping[str, tuple[Interval, ...]] = field(default_factory=dict)
    """What somebody has called the parts of gestures, by one name for each hand or scheme."""
    origin: Origin = "given"
    phones: tuple[Interval, ...] = ()
    """Sounds of the words, where they are known."""
    accents: tuple[Accent, ...] = ()
    """Where they are known."""


NOTHING_SAID = Transcript()


def read_transcript(path: str | Path) -> Transcript:
    """The words, phones, gestures and accents of a TextGrid in one of Praat's text formats, pauses
    left out.

    Words are taken from the tier called words or word, or from the only interval tier there is;
    phones from that called phones or phone, if it can be read; gestures from the first
    `MAX_GESTURE_TIERS` that `GESTURE_TIER` finds in their names.

    Raises:
        TranscriptError: if the file is missing, too large, no such TextGrid, or has no words.
    """
    path = Path(path)
    return _of_grid(_text_in(path), path.name)


def read_words(path: str | Path) -> Transcript | str:
    """A TextGrid as a transcript, or a plain text (.txt) as it is, without any times.

    Raises:
        TranscriptError: as `read_transcript`, or if a plain text is too large or has no words.
    """
    path = Path(path)
    text = _text_in(path)
    if path.suffix.lower() != TEXT_SUFFIX or is_textgrid(text):
        return _of_grid(text, path.name)
    if len(text) > MAX_TEXT:
        raise TranscriptError(f"{path.name} holds more than {MAX_TEXT} characters.")
    if any(ord(sign) < 32 and not sign.isspace() for sign in text):
        raise TranscriptError(f"{path.name} is no plain text; save it as UTF-8.")
    if not any(sign.isalnum() for sign in text):
        raise TranscriptError(f"{path.name} holds no words.")
    return text


def _text_in(path: Path) -> str:
    return text_of(bytes_within(path, MAX_BYTES, TranscriptError), path.name, TranscriptError)


def _of_grid(text: str, name: str) -> Transcript:
    found, _ = textgrid_tiers(text, name, TranscriptError)
    tiers = {tier.name: tier for tier in found if not tier.has_points}
    named = [each for each in tiers if each.lower() in WORD_TIERS]
    if not named and len(tiers) != 1:
        there = ", ".join(each[:40] for each in list(tiers)[:8]) or "no interval tier"
        raise TranscriptError(f"{name} has no tier called words; it has {there}.")
    of_words = named[0] if named else next(iter(tiers))
    words = _intervals(tiers[of_words], "word", name)
    if not words:
        raise TranscriptError(f"{name} holds no words.")
    of_gestures = [each for each in tiers if each != of_words and GESTURE_TIER.search(each)]
    gestures = {
        each: _intervals(tiers[each], "gesture", name) for each in of_gestures[:MAX_GESTURE_TIERS]
    }
    return Transcript(
        tuple(Word(word.start_s, word.end_s, word.text) for word in words),
        {each: phases for each, phases in gestures.items() if phases},
        phones=_phones(tiers, name),
        accents=_accents(found),
    )


def _phones(tiers: dict[str, NamedTier], name: str) -> tuple[Interval, ...]:
    """Of the tier that has them; one that is damaged is left out, and the words are not."""
    for each, tier in tiers.items():
        if each.lower() in PHONE_TIERS:
            try:
                return _intervals(tier, "phone", name)
            except TranscriptError:
                return ()
    return ()


def _accents(tiers: list[NamedTier]) -> tuple[Accent, ...]:
    """Of the tier that has them, in time; what is no number is left out."""
    rows = next((t.rows for t in tiers if t.has_points and t.name == ACCENT_TIER), ())
    found = [Accent(r.start_s, float(r.text)) for r in rows if _ACCENT.fullmatch(r.text)]
    told = (accent for accent in found[:MAX_WORDS] if 0 <= accent.time_s < inf)
    return tuple(sorted(told, key=lambda accent: accent.time_s))


def _intervals(tier: NamedTier, what: str, name: str) -> tuple[Interval, ...]:
    """Those with a label, in time."""
    found = []
    for row in tier.rows:
        label = row.text.strip()
        if label and not 0 <= row.start_s < row.end_s < inf:
            raise TranscriptError(
                f"{name} has the {what} '{label[:40]}' from {row.start_s:g} to {row.end_s:g} s; a "
                f"{what} must end after it begins."
            )
        if label:
            found.append(Interval(row.start_s, row.end_s, label))
    if len(found) > MAX_WORDS:
        raise TranscriptError(f"{name} holds {len(found)} {what}s; at most {MAX_WORDS} are read.")
    return tuple(sorted(found, key=lambda interval: interval.start_s))
