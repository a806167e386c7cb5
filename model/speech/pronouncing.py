"""A plain text as words that an aligner can look for: what stands in its dictionary, and by rules
what does not, such as names and numbers."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass

Lookup = Callable[[str], str | None]
"""From a word in small letters to its phones, parted by spaces; None of an unknown one."""

_ONES = (
    "zero one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen "
    "sixteen seventeen eighteen nineteen"
).split()
_TENS = "twenty thirty forty fifty sixty seventy eighty ninety".split()
_SIGNS = {"&": "and", "%": "percent", "+": "plus", "@": "at", "=": "equals"}
_MOST_DIGITS = 6
"""Longer numbers are read digit by digit."""
_OUTER = re.compile(r"^[^\w&%+@=]+|[^\w&%+@=]+$|_+$|^_+")
"""Punctuation around a word."""
_SPELT = 5
"""Letters of the longest word in capitals that is taken for an abbreviation."""
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
"""What letters of an unknown word usually sound like; of two that fit, the longer."""
_LONGEST = max(map(len, _SOUNDS))


@dataclass(frozen=True)
class Sayable:
    """A word of a text, as it is written, and how it may sound."""

    text: str
    known: str | None
    """Its form in the dictionary, which may have several ways to say it."""
    phones: str
    """One way to say it, for who does not know it."""


def words_to_say(text: str, lookup: Lookup) -> list[Sayable]:
    """The words of a text in its order; punctuation, and what nobody can say, is left out."""
    found = []
    for chunk in text.replace("\u2019", "'").split():
        # A dash parts words; a hyphen joins them.
        for piece in re.split("[\u2014\u2013\u2026/]|--+", chunk):
            spoken = _spoken(piece, lookup)
            if spoken is not None:
                found.append(spoken)
    return found


def _spoken(piece: str, lookup: Lookup) -> Sayable | None:
    written = _OUTER.sub("", piece)
    plain = _plain(written)
    if re.fullmatch(r"[a-z']+", plain) and (phones := lookup(plain)):
        return Sayable(written, plain, phones)
    parts = [
        _sound_of(part, lookup)
        for part in re.findall(
            r"\d[\d,]*(?:\.\d+)?|[A-Z]+(?![a-z])|[A-Za-z'][a-z']*|[&%+@=]",
            _without_accents(written),
        )
    ]
    phones = " ".join(part for part in parts if part)
    return Sayable(written, None, phones) if phones else None


def _plain(written: str) -> str:
    return _without_accents(written).lower()


def _without_accents(written: str) -> str:
    return "".join(letter for letter in unicodedata.normalize("NFKD", written) if letter.isascii())


def _sound_of(part: str, lookup: Lookup) -> str:
    if part in _SIGNS:
        return _said(_SIGNS[part], lookup)
    if part[0].isdigit():
        return " ".join(_said(word, lookup) for word in number_words(part))
    if part.isupper() and 1 < len(part) <= _SPELT:
        return " ".join(_LETTER_NAMES[letter] for letter in part.lower())
    return _said(part.lower(), lookup)


def _said(word: str, lookup: Lookup) -> str:
    return lookup(word) or _by_rules(word)


def number_words(digits: str) -> list[str]:
    """A number as it is read out: ``1,250.5`` as twelve fifty point five."""
    whole, _, fraction = digits.replace(",", "").partition(".")
    words = (
        _whole_words(int(whole)) if len(whole) <= _MOST_DIGITS else [_ONES[int(d)] for d in whole]
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
    if 1100 <= number < 2100 and number % 1000 >= 100:  # as years are said
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
