"""Words, phones and gestures with their times, from TextGrids and files of timed words.

TextGrids are those of BEAT2, forced aligners and our corpus; plain texts are aligned later.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isnan
from pathlib import Path
from typing import Literal, TypeVar

from model.plan import annotation_files
from model.plan.annotation_files import Interval, NamedTier
from model.speech.word_files import parse_captions, parse_ctm, parse_labels, parse_recogniser_json
from model.storage.files import read_within_limit

MAX_BYTES = 8 * 2**20
"""Size limit of a file in bytes; an hour of speech with all its phones has less than 4 MiB."""
MAX_PER_TIER = 50_000
"""Largest number of intervals in a tier."""
MAX_GESTURE_TIERS = 4
MATCHED_TIER_NAME_CHARS = 200
"""Number of characters of a tier's name that are matched."""
MAX_TEXT = 256 * 2**10
"""Largest number of characters of a plain text; an hour of speech has less than 80,000."""
ENDINGS = (".TextGrid", ".txt", ".tsv", ".json", ".srt", ".vtt", ".ctm", ".lab")
WORD_TIERS = ("words", "word", "ort-mau", "ort")
PHONE_TIERS = ("phones", "phone", "phonemes", "phoneme", "mau")
"""Names of word and phone tiers in files of the aligners of Montreal, FAVE and Munich."""
_SPEAKER = re.compile(r".*\S\s+-\s+")
"""Name of a speaker before that of a tier: "anna - words"."""
SPARE_S = 0.5
"""Time by which words and plans may be longer than the speech without a note (s)."""
MAX_MEAN_WORDS_PER_ROW = 1.5
"""Average number of words per row up to which rows count as words, not sentences."""
AnyInterval = TypeVar("AnyInterval", bound=Interval)
TranscriptSource = Literal["given", "aligned", "recognised"]
"""Source of words and times: a file with times, alignment of plain text, or speech recognition."""
GESTURE_TIER = re.compile(r"gesture|phase|stroke", re.IGNORECASE)
"""Pattern in the names of gesture tiers."""
ACCENT_TIER = "accents"
"""Name of our corpus's tier of points, each labelled with the strength of an accent."""
_ACCENT = re.compile(r"\d+(?:\.\d+)?")


class TranscriptError(ValueError):
    """A transcript that cannot be used; the message is one sentence for the user."""


@dataclass(frozen=True)
class Word(Interval):
    """A word with its times and a confidence."""

    confidence: float = 1.0
    """Confidence, 0 to 1; 1 for words from a file."""


@dataclass(frozen=True)
class Accent:
    """A point of stress, in seconds from the start of the speech."""

    time_s: float
    strength: float
    """Strength, 0 to 1."""


@dataclass(frozen=True)
class Transcript:
    """Words, phones and accents of speech, and annotated gestures if there are any."""

    words: tuple[Word, ...] = ()
    gestures: Mapping[str, tuple[Interval, ...]] = field(default_factory=dict)
    """Gesture intervals by tier name; a tier is one hand or one annotation scheme."""
    origin: TranscriptSource = "given"
    phones: tuple[Interval, ...] = ()
    """Phones of the words, if known."""
    accents: tuple[Accent, ...] = ()
    """Accents, if known."""


EMPTY_TRANSCRIPT = Transcript()


@dataclass(frozen=True)
class WordsFile:
    """Content of a file of words: words with times, or a text to be aligned with the speech."""

    transcript: Transcript = EMPTY_TRANSCRIPT
    text: str | None = None
    notes: tuple[str, ...] = ()
    """Sentences on how the file was read."""
    name: str = ""
    """Name of the file."""
    end_s: float = 0.0
    """End of the file's last word or tier (s); 0 for a text without times."""

    def within(self, speech_s: float) -> WordsFile:
        """Leave out, with a note, what lies beyond the end of the speech."""
        if self.end_s <= speech_s + SPARE_S:
            return self
        whole = self.transcript
        words = _before(speech_s, whole.words)
        note = (
            f"{self.name} ends at {self.end_s:.1f} s and the speech at {speech_s:.1f} s; the "
            "file may belong to another clip."
        )
        if num_beyond := len(whole.words) - len(words):
            note += (
                f" {num_beyond} of its {len(whole.words)} words lie after the end of the speech "
                "and are left out."
            )
        gestures = {name: _before(speech_s, rows) for name, rows in whole.gestures.items()}
        transcript = replace(
            whole,
            words=words,
            phones=_before(speech_s, whole.phones),
            gestures={name: rows for name, rows in gestures.items() if rows},
            accents=tuple(accent for accent in whole.accents if accent.time_s < speech_s),
        )
        return replace(self, transcript=transcript, notes=(*self.notes, note), end_s=speech_s)


def _before(end_s: float, rows: Iterable[AnyInterval]) -> tuple[AnyInterval, ...]:
    return tuple(replace(row, end_s=min(row.end_s, end_s)) for row in rows if row.start_s < end_s)


def read_textgrid_transcript(path: str | Path) -> Transcript:
    """Read the words, phones, gestures and accents of a TextGrid in one of Praat's text formats.

    Pauses are left out. Words are taken from the tier with a name in `WORD_TIERS`, or from the only
    one with a speaker's name ("anna - words"), or from the only interval tier; phones from the tier
    with a name in `PHONE_TIERS`, if it is valid; gestures from the first `MAX_GESTURE_TIERS` with a
    name that matches `GESTURE_TIER`. Raises TranscriptError if the file is missing, too large, no
    such TextGrid, or has no words.
    """
    path = Path(path)
    text, _ = _text_in(path)
    return _of_grid(text, path.name).transcript


def read_words_file(path: str | Path) -> WordsFile:
    """Read a TextGrid, a file of timed words or captions (`ENDINGS`), or a plain text (.txt, .lab).

    Captions and segments of several words are read as a text without times. Raises TranscriptError
    as `read_textgrid_transcript`, or if another file is too large, damaged, or has no words.
    """
    path = Path(path)
    name, ending = path.name, path.suffix.lower()
    text, notes = _text_in(path)
    if annotation_files.is_textgrid(text):
        words_file = _of_grid(text, name)
        return replace(words_file, notes=(*notes, *words_file.notes))
    rows: list[Interval] | None = None
    match ending:
        case ".json":
            rows, num_untimed = parse_recogniser_json(text, name, TranscriptError)
            if num_untimed:
                notes += (f"{num_untimed} words of {name} have no times and are left out.",)
        case ".srt" | ".vtt":
            rows = parse_captions(text)
        case ".ctm":
            rows = parse_ctm(text, name, TranscriptError)
        case ".tsv" | ".lab" | ".txt":
            rows = parse_labels(text, ending == ".lab")
            if rows is None and ending == ".tsv":
                raise TranscriptError(
                    f"{name} is not a table of start, end and word, separated by tabs."
                )
        case _:
            raise TranscriptError(
                f"{name} is not a TextGrid and has none of the suffixes of word files "
                f"({', '.join(ENDINGS)})."
            )
    words_file = WordsFile(text=_plain(text, name)) if rows is None else _of_rows(rows, name)
    return replace(words_file, notes=(*notes, *words_file.notes), name=name)


def _text_in(path: Path) -> tuple[str, tuple[str, ...]]:
    return annotation_files.decode_text(
        read_within_limit(path, MAX_BYTES, TranscriptError), path.name, TranscriptError
    )


def _plain(text: str, name: str) -> str:
    """Return a plain text unchanged, after a check that it is one."""
    if len(text) > MAX_TEXT:
        raise TranscriptError(f"{name} holds more than {MAX_TEXT} characters.")
    if any(ord(sign) < 32 and not sign.isspace() for sign in text):
        raise TranscriptError(f"{name} is not plain text; save it as UTF-8.")
    if not any(sign.isalnum() for sign in text):
        raise TranscriptError(f"{name} holds no words.")
    return text


def _of_rows(rows: Sequence[Interval], name: str, are_words: bool = False) -> WordsFile:
    """Make words, if most rows hold one each, or else the text of all rows, to be aligned."""
    intervals = _intervals(rows, "word", name)
    end_s = max((row.end_s for row in intervals), default=0.0)
    count = sum(len(row.text.split()) for row in intervals)
    if are_words or count <= MAX_MEAN_WORDS_PER_ROW * len(intervals):
        if not intervals:
            raise TranscriptError(f"{name} holds no words.")
        words = tuple(Word(row.start_s, row.end_s, row.text) for row in intervals)
        return WordsFile(Transcript(words), name=name, end_s=end_s)
    text = _plain(" ".join(row.text for row in intervals), name)
    note = f"{name} has times for sentences only; the times of its words are found by alignment."
    return WordsFile(text=text, notes=(note,), name=name)


def _of_grid(text: str, name: str) -> WordsFile:
    parsed, end_s = annotation_files.parse_textgrid(text, name, TranscriptError)
    tiers = [tier for tier in parsed if not tier.has_points]
    of_words = _word_tier(tiers, name)
    is_named = _kind_of(of_words.name) == "words"  # then its rows are words, whatever they hold
    from_words = _of_rows(of_words.rows, name, is_named)
    of_gestures = [t for t in tiers if t is not of_words and GESTURE_TIER.search(t.name)]
    of_phones = [
        t
        for t in tiers
        if _kind_of(t.name) == "phones" and _speaker(t.name) == _speaker(of_words.name)
    ]
    for same in (of_gestures, of_phones):
        _refuse_same_names(same, name)
    gestures = {
        tier.name: _intervals(tier.rows, "gesture", name)
        for tier in of_gestures[:MAX_GESTURE_TIERS]
    }
    transcript = replace(
        from_words.transcript,
        gestures={each: phases for each, phases in gestures.items() if phases},
        phones=_phones(of_phones[:1], name),
        accents=_accents(parsed),
    )
    last_s = max((row.end_s for row in of_words.rows), default=0.0)
    end_s = last_s if isnan(end_s) else end_s
    return replace(from_words, transcript=transcript, end_s=end_s)


def _kind_of(name: str) -> Literal["words", "phones", ""]:
    """Classify a tier by its name, such as "words" or "anna - words"."""
    own = name.strip()[len(_speaker(name)) :].lower()
    return "words" if own in WORD_TIERS else "phones" if own in PHONE_TIERS else ""


def _speaker(name: str) -> str:
    match = _SPEAKER.match(name.strip()[:MATCHED_TIER_NAME_CHARS])
    return "" if match is None else match[0]


def _word_tier(tiers: Sequence[NamedTier], name: str) -> NamedTier:
    """Return the tier of words; raises TranscriptError unless there is exactly one."""
    named = [tier for tier in tiers if _kind_of(tier.name) == "words"]
    _refuse_same_names(named, name)
    plain = [tier for tier in named if not _speaker(tier.name)]
    if len(of_anyone := plain or [tier for tier in named if any(r.text for r in tier.rows)]) > 1:
        there = ", ".join(repr(tier.name[:40]) for tier in of_anyone[:8])
        raise TranscriptError(
            f"{name} has several tiers of words ({there}); keep only that of the recorded speaker."
        )
    if of_anyone or named:
        return (of_anyone or named)[0]
    only = tiers[0] if len(tiers) == 1 else None
    if only is None or _kind_of(only.name) == "phones" or GESTURE_TIER.search(only.name):
        there = ", ".join(tier.name[:40] for tier in tiers[:8]) or "no interval tier"
        raise TranscriptError(f"{name} has no tier called words; it has {there}.")
    return only


def _refuse_same_names(tiers: Sequence[NamedTier], name: str) -> None:
    names = [tier.name for tier in tiers]
    if twice := next((each for each in names if names.count(each) > 1), ""):
        raise TranscriptError(
            f"{name} has {names.count(twice)} tiers called {twice[:40]!r}; rename or delete all "
            "but one of them."
        )


def _phones(tiers: Sequence[NamedTier], name: str) -> tuple[Interval, ...]:
    """Return the phones of the tier; a damaged tier is left out, but not the words."""
    try:
        return tuple(row for tier in tiers for row in _intervals(tier.rows, "phone", name))
    except TranscriptError:
        return ()


def _accents(tiers: list[NamedTier]) -> tuple[Accent, ...]:
    """Return the accents in order of time, without labels that are not numbers."""
    rows = next((t.rows for t in tiers if t.has_points and t.name == ACCENT_TIER), ())
    accents = [Accent(r.start_s, float(r.text)) for r in rows if _ACCENT.fullmatch(r.text)]
    valid = (accent for accent in accents[:MAX_PER_TIER] if 0 <= accent.time_s < inf)
    return tuple(sorted(valid, key=lambda accent: accent.time_s))


def _intervals(rows: Sequence[Interval], noun: str, name: str) -> tuple[Interval, ...]:
    """Return the intervals with a label, in order of time."""
    intervals = []
    for row in rows:
        label = row.text.strip()
        if label and not 0 <= row.start_s < row.end_s < inf:
            raise TranscriptError(
                f"{name} has the {noun} '{label[:40]}' from {row.start_s:g} to {row.end_s:g} s; a "
                f"{noun} must end after it begins."
            )
        if label:
            intervals.append(Interval(row.start_s, row.end_s, label))
    if len(intervals) > MAX_PER_TIER:
        raise TranscriptError(
            f"{name} holds {len(intervals)} {noun}s; the limit is {MAX_PER_TIER}."
        )
    return tuple(sorted(intervals, key=lambda interval: interval.start_s))
