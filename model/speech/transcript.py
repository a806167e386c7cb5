"""Words and gestures with their times, from a Praat TextGrid as BEAT2, forced aligners and our
corpus write them."""

import codecs
import re
from dataclasses import dataclass
from pathlib import Path

MAX_BYTES = 8 * 2**20
"""An hour of speech with all its phones has less than 4 MiB."""
MAX_WORDS = 50_000
"""Intervals of a tier."""
MAX_GESTURE_TIERS = 4
WORD_TIERS = ("words", "word")
GESTURE_TIER = re.compile(r"gesture|phase|stroke", re.IGNORECASE)
"""Part of the name of a tier that says what hands do."""
_ITEM = re.compile(r"^[ \t]*item \[\d+\]:", re.MULTILINE)
_TIER = re.compile(r'class = "IntervalTier"\s+name = "(?P<name>(?:[^"]|"")*)"')
_INTERVAL = re.compile(
    r'xmin = (?P<start>[\d.eE+-]+)\s+xmax = (?P<end>[\d.eE+-]+)\s+text = "(?P<text>(?:[^"]|"")*)"'
)


class TranscriptError(ValueError):
    """A transcript that cannot be used; the message is one sentence for a person."""


@dataclass(frozen=True)
class Interval:
    """A word or part of a gesture, and when it comes, in seconds from the start of the speech."""

    start_s: float
    end_s: float
    text: str


@dataclass(frozen=True)
class GestureTier:
    """What somebody has called the parts of gestures, by one name for each hand or scheme."""

    name: str
    phases: tuple[Interval, ...]


@dataclass(frozen=True)
class Transcript:
    """What was said, and what hands did meanwhile where that was written down, too."""

    words: tuple[Interval, ...] = ()
    gestures: tuple[GestureTier, ...] = ()


NOTHING_SAID = Transcript()


def read_transcript(path: str | Path) -> Transcript:
    """The words and gestures of a TextGrid in Praat's long text format, pauses left out.

    Words are taken from the tier called words or word, or from the only interval tier there is;
    gestures from the first `MAX_GESTURE_TIERS` that `GESTURE_TIER` finds in their names.

    Raises:
        TranscriptError: if the file is missing, too large, no such TextGrid, or has no words.
    """
    path = Path(path)
    text = _read_text(path)
    if "ooTextFile" not in text[:200] or "TextGrid" not in text[:200]:
        raise TranscriptError(f"{path.name} is no TextGrid; save one in Praat's long text format.")
    tiers = {}
    for part in _ITEM.split(text)[1:]:
        header = _TIER.search(part)
        if header:
            tiers[header["name"].replace('""', '"')] = part[header.end() :]
    named = [name for name in tiers if name.lower() in WORD_TIERS]
    if not named and len(tiers) != 1:
        found = ", ".join(name[:40] for name in list(tiers)[:8]) or "no interval tier"
        raise TranscriptError(f"{path.name} has no tier called words; it has {found}.")
    of_words = named[0] if named else next(iter(tiers))
    words = _intervals(tiers[of_words], "word", path.name)
    if not words:
        raise TranscriptError(f"{path.name} holds no words.")
    of_gestures = [name for name in tiers if name != of_words and GESTURE_TIER.search(name)]
    found_gestures = [
        GestureTier(name, _intervals(tiers[name], "gesture", path.name))
        for name in of_gestures[:MAX_GESTURE_TIERS]
    ]
    return Transcript(words, tuple(tier for tier in found_gestures if tier.phases))


def _intervals(tier: str, what: str, name: str) -> tuple[Interval, ...]:
    """Those with a label, in time."""
    found = []
    for interval in _INTERVAL.finditer(tier):
        label = interval["text"].replace('""', '"').strip()
        if label:
            found.append(_interval(interval["start"], interval["end"], label, what, name))
    if len(found) > MAX_WORDS:
        raise TranscriptError(f"{name} holds {len(found)} {what}s; at most {MAX_WORDS} are read.")
    return tuple(sorted(found, key=lambda interval: interval.start_s))


def _interval(start: str, end: str, text: str, what: str, name: str) -> Interval:
    try:
        start_s, end_s = float(start), float(end)
    except ValueError:
        start_s = end_s = float("nan")
    if not 0 <= start_s < end_s < float("inf"):
        raise TranscriptError(
            f"{name} has the {what} '{text[:40]}' from {start[:20]} to {end[:20]} s; a {what} must "
            "end after it begins."
        )
    return Interval(start_s, end_s, text)


def _read_text(path: Path) -> str:
    """Praat writes UTF-8, or UTF-16 with a byte order mark."""
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise TranscriptError(
            f"{path.name} could not be read: {(error.strerror or str(error)).lower()}."
        ) from error
    if len(data) > MAX_BYTES:
        raise TranscriptError(
            f"{path.name} is larger than {MAX_BYTES // 2**20} MiB, the most that is read."
        )
    is_utf16 = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        return data.decode("utf-16" if is_utf16 else "utf-8-sig")
    except UnicodeDecodeError as error:
        raise TranscriptError(f"{path.name} is no text in UTF-8 or UTF-16.") from error
