"""Texts as people write them, taken apart into what can be looked for in speech."""

import pytest

from model.speech.pronouncing import number_words, words_to_say

KNOWN = {"hello": "HH AH L OW", "it's": "IH T S", "five": "F AY V", "and": "AE N D", "cafe": "K"}


@pytest.mark.parametrize(
    ("written", "words"),
    [
        ('Hello, (it\'s) "hello"!', ["Hello", "it's", "hello"]),
        ("hello\u2014hello / it\u2019s - ...", ["hello", "hello", "it's"]),
        ("Caf\u00e9 \u4e2d\u6587 [and]", ["Caf\u00e9", "and"]),
    ],
)
def test_words_keep_their_letters_and_lose_what_is_around_them(
    written: str, words: list[str]
) -> None:
    found = words_to_say(written, KNOWN.get)
    assert [word.text for word in found] == words
    assert all(word.known in KNOWN and word.phones == KNOWN[word.known] for word in found)


@pytest.mark.parametrize(
    ("written", "phones"),
    [
        ("5", "F AY V"),
        ("NLX", "EH N EH L EH K S"),
        ("five-&", "F AY V AE N D"),
        ("Shipstone", "SH IH P S T AA N"),
        ("phight", "F AY T"),
    ],
)
def test_what_no_dictionary_has_is_said_by_rules(written: str, phones: str) -> None:
    (word,) = words_to_say(written, KNOWN.get)
    assert (word.text, word.known, word.phones) == (written, None, phones)


@pytest.mark.parametrize(
    ("digits", "said"),
    [
        ("0", "zero"),
        ("13", "thirteen"),
        ("40", "forty"),
        ("1,250.05", "twelve fifty point zero five"),
        ("2005", "two thousand five"),
        ("1999", "nineteen ninety nine"),
        ("1900", "nineteen hundred"),
        ("120300", "one hundred twenty thousand three hundred"),
        ("1234567", "one two three four five six seven"),
    ],
)
def test_numbers_are_read_out(digits: str, said: str) -> None:
    assert " ".join(number_words(digits)) == said
