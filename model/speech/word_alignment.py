"""Child process that recognises or aligns English words and their phones with pocketsphinx.

The recogniser is C code that cannot be interrupted, so a crash or a timeout must end only this
process. It receives the text, or None, and 16-bit samples at 16 kHz, and sends words with phones.
"""

from __future__ import annotations

import ctypes
import math
import os
import re
import signal
import unicodedata
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Int16

from conventions.rates import SAMPLE_RATE
from model.plan.annotation_files import Interval
from model.speech.transcript import Word
from processes.child import parent_channel

Lookup = Callable[[str], str | None]
"""Function from a lower-case word to its phones, separated by spaces; None for an unknown word."""

_ONES = (
    "zero one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen "
    "sixteen seventeen eighteen nineteen"
).split()
_TENS = "twenty thirty forty fifty sixty seventy eighty ninety".split()
_SIGNS = {"&": "and", "%": "percent", "+": "plus", "@": "at", "=": "equals"}
_MAX_DIGITS = 6
"""Most digits of a number that is read as one; longer numbers are read digit by digit."""
_OUTER = re.compile(r"^[^\w&%+@=]+|[^\w&%+@=]+$|_+$|^_+")
"""Punctuation around a word."""
_MAX_ABBREVIATION = 5
"""Number of letters of the longest word in capitals that is read as an abbreviation."""
_LETTER_NAMES = dict(
    zip(
        "abcdefghijklmnopqrstuvwxyz",
        "EY|B IY|S IY|D IY|IY|EH F|JH IY|EY CH|AY|JH EY|K EY|EH L|EH M|EH N|OW|P IY|K Y UW|AA R|"
        "EH S|T IY|Y UW|V IY|D AH B AH L Y UW|EH K S|W AY|Z IY".split("|"),
        strict=True,
    )
)
_SOUNDS = {
    "tion": "SH AH N", "sion": "ZH AH N", "igh": "AY", "tch": "CH", "dge": "JH", "sch": "SH",
    "ph": "F", "sh": "SH", "ch": "CH", "th": "TH", "wh": "W", "ck": "K", "ng": "NG", "qu": "K W",
    "kn": "N", "wr": "R", "ee": "IY", "ea": "IY", "oo": "UW", "ou": "AW", "ow": "OW", "oa": "OW",
    "ai": "EY", "ay": "EY", "ey": "IY", "oi": "OY", "oy": "OY", "au": "AO", "aw": "AO", "ew": "UW",
    "er": "ER", "ir": "ER", "ur": "ER", "ar": "AA R", "or": "AO R", "ie": "IY", "ei": "AY",
    "bb": "B", "dd": "D", "ff": "F", "gg": "G", "ll": "L", "mm": "M", "nn": "N", "pp": "P",
    "rr": "R", "ss": "S", "tt": "T", "zz": "Z", "cc": "K", "ce": "S", "ci": "S IH", "ge": "JH",
    "a": "AE", "b": "B", "c": "K", "d": "D", "e": "EH", "f": "F", "g": "G", "h": "HH", "i": "IH",
    "j": "JH", "k": "K", "l": "L", "m": "M", "n": "N", "o": "AA", "p": "P", "q": "K", "r": "R",
    "s": "S", "t": "T", "u": "AH", "v": "V", "w": "W", "x": "K S", "y": "IY", "z": "Z",
}  # fmt: skip
"""Usual phones of the letters of an unknown word; the longest match is used."""
_LONGEST = max(map(len, _SOUNDS))


@dataclass(frozen=True)
class Pronunciation:
    """A word of a text with its pronunciation."""

    text: str
    dictionary_key: str | None
    """Key of the word in the pronunciation dictionary, which may list several pronunciations;
    None if the word is not in it."""
    phones: str
    """One pronunciation, phones separated by spaces."""


def pronounce_text(text: str, lookup: Lookup) -> list[Pronunciation]:
    """Return the words of a text in order, without punctuation and what cannot be pronounced."""
    phones = []
    for chunk in text.replace("\u2019", "'").split():
        # A dash separates words; a hyphen joins them.
        for piece in re.split("[\u2014\u2013\u2026/]|--+", chunk):
            spoken = _pronounce(piece, lookup)
            if spoken is not None:
                phones.append(spoken)
    return phones


def _pronounce(piece: str, lookup: Lookup) -> Pronunciation | None:
    written = _OUTER.sub("", piece)
    plain = _without_accents(written).lower()
    if re.fullmatch(r"[a-z']+", plain) and (phones := lookup(plain)):
        return Pronunciation(written, plain, phones)
    parts = [
        _sound_of(part, lookup)
        for part in re.findall(
            r"\d[\d,]*(?:\.\d+)?|[A-Z]+(?![a-z])|[A-Za-z'][a-z']*|[&%+@=]",
            _without_accents(written),
        )
    ]
    phones = " ".join(part for part in parts if part)
    return Pronunciation(written, None, phones) if phones else None


def _without_accents(written: str) -> str:
    return "".join(letter for letter in unicodedata.normalize("NFKD", written) if letter.isascii())


def _sound_of(part: str, lookup: Lookup) -> str:
    if part in _SIGNS:
        return _phones_of(_SIGNS[part], lookup)
    if part[0].isdigit():
        return " ".join(_phones_of(word, lookup) for word in spell_out_number(part))
    if part.isupper() and 1 < len(part) <= _MAX_ABBREVIATION:
        return " ".join(_LETTER_NAMES[letter] for letter in part.lower())
    return _phones_of(part.lower(), lookup)


def _phones_of(word: str, lookup: Lookup) -> str:
    return lookup(word) or _by_rules(word)


def spell_out_number(digits: str) -> list[str]:
    """Return the words with which a number is read out: ``1,250.5`` as twelve fifty point five."""
    whole, _, fraction = digits.replace(",", "").partition(".")
    words = (
        _whole_words(int(whole)) if len(whole) <= _MAX_DIGITS else [_ONES[int(d)] for d in whole]
    )
    return words + (["point", *(_ONES[int(digit)] for digit in fraction)] if fraction else [])


def _whole_words(number: int) -> list[str]:
    if number < 20:
        return [_ONES[number]]
    if number < 100:
        ones = [_ONES[number % 10]] if number % 10 else []
        return [_TENS[number // 10 - 2], *ones]
    if number < 1000:
        rest = _whole_words(number % 100) if number % 100 else []
        return [_ONES[number // 100], "hundred", *rest]
    if 1100 <= number < 2100 and number % 1000 >= 100:  # as years are read
        rest = _whole_words(number % 100) if number % 100 else ["hundred"]
        return [*_whole_words(number // 100), *rest]
    rest = _whole_words(number % 1000) if number % 1000 else []
    return [*_whole_words(number // 1000), "thousand", *rest]


def _by_rules(word: str) -> str:
    letters = re.sub("[^a-z]", "", word)
    if len(letters) > 3 and letters.endswith("e") and letters[-2] not in "aeiou":
        letters = letters[:-1]  # it is silent there
    sounds, at = [], 0
    while at < len(letters):
        for length in range(min(_LONGEST, len(letters) - at), 0, -1):
            sound = _SOUNDS.get(letters[at : at + length])
            if sound is not None:
                sounds.append(sound)
                at += length
                break
    return " ".join(sounds)


PIECE_S = (8.0, 16.0)
"""Shortest and longest piece that is decoded at once (s): memory and time grow with it."""
FRAMES_PER_S = 100
"""Frame rate of the recogniser (Hz)."""
_LOUDNESS_S = 0.2
"""Window over which loudness is averaged to find a place to cut (s)."""
_MARGIN_S = 0.15
"""Margin of sound around the words of an aligned piece (s)."""
_WIDE_BEAMS = {"beam": 1e-150, "pbeam": 1e-150, "wbeam": 1e-150}
"""Beam widths that let alignment skip words of the text that are missing in the speech."""
_SCORE_MIDPOINT, _FIT_WIDTH, _FIT_WORDS = -45.0, 8.0, 5
"""Logistic model of a word's confidence: the score of a frame (0 is the best of any phone) at which
the probability is 0.5, the width, and the number of words over which scores are averaged, since
single words may be pronounced oddly. Right words average -10 to -35, others -50 to -130."""
_NO_FIT = -200.0
_PARENT_DEATH_SIGNAL = 1
_FILLERS = "<[+"
"""First characters of the names of silence and noise."""


@dataclass
class RecogniserWord:
    """A word with its times in frames of the recogniser (100 Hz), and its phones."""

    text: str
    start_frame: int
    end_frame: int
    """First frame after the word."""
    phones: list[tuple[str, int, int]] = field(default_factory=list)
    confidence: float = 0.0
    """Probability, 0 to 1."""
    fit: float = _NO_FIT
    """Mean score of the frames of its phones; 0 is the best."""

    def delayed(self, frames: int) -> RecogniserWord:
        """Return the word delayed by a number of frames."""
        phones = [(name, start + frames, end + frames) for name, start, end in self.phones]
        return replace(
            self, start_frame=self.start_frame + frames, end_frame=self.end_frame + frames,
            phones=phones,
        )  # fmt: skip

    def as_intervals(self) -> tuple[Word, tuple[Interval, ...]]:
        """Convert the word and its phones to seconds, for the parent process."""
        phones = tuple(
            Interval(start / FRAMES_PER_S, end / FRAMES_PER_S, name)
            for name, start, end in self.phones
        )
        start_s, end_s = self.start_frame / FRAMES_PER_S, self.end_frame / FRAMES_PER_S
        return Word(start_s, end_s, self.text, round(self.confidence, 3)), phones


def piece_ranges(waveform: Int16[np.ndarray, " N"]) -> Iterator[tuple[int, int]]:
    """Yield ranges of samples within `PIECE_S` (the last may be shorter), cut in quiet places."""
    step = SAMPLE_RATE // FRAMES_PER_S
    shortest, longest = (round(FRAMES_PER_S * seconds) for seconds in PIECE_S)
    frames = len(waveform) // step
    if frames <= longest:
        yield 0, len(waveform)
        return
    energy = np.square(waveform[: frames * step].astype(np.float32)).reshape(frames, step).mean(1)
    width = round(FRAMES_PER_S * _LOUDNESS_S)
    loudness = np.convolve(energy, np.ones(width) / width, mode="same")
    start = 0
    while frames - start > longest:
        cut = start + shortest + int(loudness[start + shortest : start + longest].argmin())
        yield start * step, cut * step
        start = cut
    yield start * step, len(waveform)


def recognise(waveform: Int16[np.ndarray, " N"]) -> list[RecogniserWord]:
    """Return the most likely words of the speech, however unlikely they are."""
    decoder = _decoder()
    words = []
    for start, stop in piece_ranges(waveform):
        sound = waveform[start:stop].tobytes()
        _decode(decoder, sound)
        segments = [segment for segment in decoder.seg() or () if segment.word[0] not in _FILLERS]
        fitted = _align_phones(decoder, sound) if segments else []
        decoder.activate_search()
        at = start * FRAMES_PER_S // SAMPLE_RATE
        for number, segment in enumerate(segments):
            word = RecogniserWord(
                segment.word.split("(")[0],
                segment.start_frame,
                segment.end_frame + 1,
                confidence=segment.prob,
            )
            if len(fitted) == len(segments):
                word.phones = fitted[number].phones
            words.append(word.delayed(at))
    return words


def align(waveform: Int16[np.ndarray, " N"], text: str) -> list[RecogniserWord]:
    """Align a text with the speech and return its words; none if no alignment exists."""
    decoder = _decoder(lm=None)
    spoken = pronounce_text(text, decoder.lookup_word)
    if not spoken:
        return []
    names = _dictionary_names(decoder, spoken)
    rough = _initial_alignment(decoder, waveform, names)
    if len(rough) != len(spoken):
        rough = _initial_alignment(_wide(spoken), waveform, names)
    if len(rough) != len(spoken):
        return []
    aligned = []
    for first, last, start, stop in _parts(rough, len(waveform) * FRAMES_PER_S // SAMPLE_RATE):
        aligned += _align_part(decoder, waveform, names[first:last], rough[first:last], start, stop)
    for word, each in zip(aligned, spoken, strict=True):
        word.text = each.text
    for word, likelihood in zip(aligned, _likelihoods(aligned), strict=True):
        word.confidence = likelihood
    return aligned


def _align_part(
    decoder: Any,
    waveform: Int16[np.ndarray, " N"],
    names: list[str],
    rough: list[tuple[int, int]],
    start: int,
    stop: int,
) -> list[RecogniserWord]:
    """Return the aligned words of a part, with their fit but no confidence.

    If the alignment fails, each half is tried alone, so that one wrong sentence spoils little.
    """
    step = SAMPLE_RATE // FRAMES_PER_S
    sound = waveform[start * step : stop * step].tobytes()
    decoder.set_align_text(" ".join(names))
    _decode(decoder, sound)
    fitted = _align_phones(decoder, sound) if decoder.hyp() is not None else []
    if len(fitted) == len(names):
        return [word.delayed(start) for word in fitted]
    if len(names) == 1:
        return [RecogniserWord("", *rough[0])]
    cut = max(
        range(1 + (len(names) - 1) // 3, 1 + 2 * len(names) // 3),
        key=lambda number: rough[number][0] - rough[number - 1][1],
    )
    before, after = rough[cut - 1][1], rough[cut][0]
    margin = round(FRAMES_PER_S * _MARGIN_S)
    return [
        *_align_part(
            decoder, waveform, names[:cut], rough[:cut], start, min(after, before + margin)
        ),
        *_align_part(
            decoder, waveform, names[cut:], rough[cut:], max(before, after - margin), stop
        ),
    ]


def _wide(spoken: list[Pronunciation]) -> Any:
    decoder = _decoder(lm=None, **_WIDE_BEAMS)
    _dictionary_names(decoder, spoken)
    return decoder


def _dictionary_names(decoder: Any, spoken: list[Pronunciation]) -> list[str]:
    """Return each word's name in the dictionary, to which missing words are added."""
    names, added = [], {}
    for word in spoken:
        if word.dictionary_key is not None:
            names.append(word.dictionary_key)
            continue
        if word.phones not in added:
            added[word.phones] = f"unknown_{len(added)}"
            decoder.add_word(added[word.phones], word.phones, False)
        names.append(added[word.phones])
    return names


def _initial_alignment(
    decoder: Any, waveform: Int16[np.ndarray, " N"], names: list[str]
) -> list[tuple[int, int]]:
    """Return the frames [start, end) of each word; nothing if the alignment fails."""
    decoder.set_align_text(" ".join(names))
    _decode(decoder, waveform.tobytes())
    if decoder.hyp() is None:
        return []
    return [
        (segment.start_frame, segment.end_frame + 1)
        for segment in decoder.seg() or ()
        if segment.word[0] not in _FILLERS
    ]


def _parts(times: list[tuple[int, int]], end: int) -> Iterator[tuple[int, int, int, int]]:
    """Yield ranges of words with the range of frames that holds them, cut at the longest pauses."""
    shortest, longest = (round(FRAMES_PER_S * seconds) for seconds in PIECE_S)
    margin = round(FRAMES_PER_S * _MARGIN_S)
    first = 0
    while first < len(times):
        begin = times[first][0]
        last = first + 1
        while last < len(times) and times[last][1] - begin <= longest:
            last += 1
        if last < len(times):
            # A pause before a word; a word alone may be longer than a piece.
            cuts = [n for n in range(first + 1, last + 1) if times[n][0] - begin >= shortest]
            last = max(cuts or [last], key=lambda n: times[n][0] - times[n - 1][1])
        before = times[first - 1][1] if first else 0
        after = times[last][0] if last < len(times) else end
        yield first, last, max(before, begin - margin), min(after, times[last - 1][1] + margin)
        first = last


def _align_phones(decoder: Any, sound: bytes) -> list[RecogniserWord]:
    """Align the words that were just decoded again, for phones and scores; none if this fails."""
    try:
        decoder.set_alignment()
        _decode(decoder, sound)
    except RuntimeError:  # no path through this sound reaches the end of its words
        return []
    spans = []
    for word in decoder.get_alignment() or ():
        # The phone objects are only valid during this iteration.
        phones = [(phone.name, phone.start, phone.duration, phone.score) for phone in word]
        if word.name[0] in _FILLERS or not phones:
            continue
        start, end = phones[0][1], phones[-1][1] + phones[-1][2]
        fit = sum(score for *_, score in phones) / max(1, end - start)
        spans.append(
            RecogniserWord(
                word.name,
                start,
                end,
                [(name, begin, begin + length) for name, begin, length, _ in phones],
                fit=fit,
            )
        )
    return spans


def _likelihoods(words: list[RecogniserWord]) -> list[float]:
    """Convert each word's fit, averaged with those of its neighbours, to a likelihood."""
    fits = np.array([word.fit for word in words])
    frames = np.array([word.end_frame - word.start_frame for word in words], np.float64)
    reach = _FIT_WORDS // 2
    batches = []
    for number in range(len(words)):
        near = slice(max(0, number - reach), number + reach + 1)
        fit = float(np.average(fits[near], weights=frames[near]))
        batches.append(1.0 / (1.0 + math.exp((_SCORE_MIDPOINT - fit) / _FIT_WIDTH)))
    return batches


def _decode(decoder: Any, sound: bytes) -> None:
    decoder.start_utt()
    try:
        decoder.process_raw(sound, full_utt=True)
    finally:
        decoder.end_utt()


def _decoder(**options: Any) -> Any:
    from pocketsphinx import Decoder

    return Decoder(loglevel="FATAL", **options)


def main() -> None:
    """Recognise or align the speech that the parent process sends."""
    os.nice(10)
    # End with the parent process: no Python code runs during the recognition.
    ctypes.CDLL(None).prctl(_PARENT_DEATH_SIGNAL, signal.SIGKILL)
    channel, _ = parent_channel()
    text, waveform = channel.recv()
    words = recognise(waveform) if text is None else align(waveform, text)
    channel.send([word.as_intervals() for word in words])


if __name__ == "__main__":
    main()
