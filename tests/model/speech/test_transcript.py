"""TextGrids as aligners write them, texts as people do, and files that are none."""

from pathlib import Path

import numpy as np
import pytest

from app.run.examples import CLEAN
from model.motion.motion import load_motion
from model.plan.tier_files import Interval, NamedTier, textgrid_of
from model.speech.audio import load_speech
from model.speech.listener import number_words, words_to_say
from model.speech.transcript import (
    MAX_GESTURE_TIERS,
    MAX_TEXT,
    TranscriptError,
    Word,
    read_transcript,
    read_words,
)

SPOKEN = [(0.1, 0.4, "hello"), (0.5, 1.25, 'so-called "art"')]
PHONES = [(0.1, 0.2, "h"), (0.2, 0.4, "o")]


def grid(*tiers: tuple[str, list]) -> str:
    named = [NamedTier(name, tuple(Interval(*row) for row in rows)) for name, rows in tiers]
    return textgrid_of(named, 2.0)


def refusal(path: Path) -> str:
    with pytest.raises(TranscriptError) as caught:
        read_transcript(path)
    sentence = str(caught.value)
    assert path.name in sentence and sentence.endswith(".") and "\n" not in sentence
    return sentence


ENCODINGS = ("utf-8", "utf-8-sig", "utf-16")


def test_words_come_with_their_times_and_without_pauses(tmp_path):
    path = tmp_path / "a.TextGrid"
    tiers = [("words", SPOKEN), ("phones", PHONES)]
    for encoding in ENCODINGS:
        for order in (tiers, tiers[::-1]):
            path.write_text(grid(*order), encoding=encoding)
            said = read_transcript(path)
            assert said.words == (Word(0.1, 0.4, "hello"), Word(0.5, 1.25, 'so-called "art"'))
            assert said.origin == "given" and {word.confidence for word in said.words} == {1.0}
            assert said.phones == (Interval(0.1, 0.2, "h"), Interval(0.2, 0.4, "o"))
            assert said.gestures == {}
    path.write_text(grid(("maus", SPOKEN)))  # the only tier may have any name
    assert read_transcript(path).words[0].text == "hello"
    path.write_text(grid(*tiers).replace("xmin = 0.2000", "xmin = 9"))
    said = read_transcript(path)  # damaged phones do not spoil the words
    assert len(said.words) == 2 and said.phones == ()


def test_tiers_of_gestures_are_known_by_their_names_and_read_up_to_a_limit(tmp_path):
    path = tmp_path / "a.TextGrid"
    phases = [(0.0, 0.5, "preparation"), (0.5, 0.75, "stroke beat")]
    found = tuple(Interval(*phase) for phase in phases)
    for name in ("gesture_left", "G-Phase", "Strokes RH"):
        tiers = (("words", SPOKEN), ("phones", PHONES), (name, phases), ("gesture", []))
        path.write_text(grid(*tiers))
        assert read_transcript(path).gestures == {name: found}
    names = [f"gesture {number}" for number in range(MAX_GESTURE_TIERS + 1)]
    path.write_text(grid(("words", SPOKEN), *((name, PHONES) for name in names)))
    assert list(read_transcript(path).gestures) == names[:-1]


def test_a_gesture_that_ends_before_it_begins_is_refused(tmp_path):
    path = tmp_path / "a.TextGrid"
    good = grid(("words", SPOKEN), ("gesture", [(0.25, 0.5, "stroke")]))
    path.write_text(good.replace("xmin = 0.2500", "xmin = 0.7500"))
    assert "has the gesture 'stroke' from 0.75 to 0.5 s; a gesture must end" in refusal(path)


def test_the_example_s_tiers_belong_to_its_speech_and_motion():
    said = read_transcript(CLEAN.with_suffix(".TextGrid"))
    speech = load_speech(CLEAN.with_suffix(".wav"))
    assert speech.duration_s == load_motion(CLEAN).num_frames / 30
    assert list(said.gestures) == ["gesture_left", "gesture_right"]
    ends = [each[-1].end_s for each in (said.words, *said.gestures.values())]
    assert all(13 < end <= speech.duration_s for end in ends)
    # Words are louder than what is between them, so they stand where they are said.
    loud = np.zeros(len(speech.waveform), bool)
    for word in said.words:
        loud[int(16_000 * word.start_s) : int(16_000 * word.end_s)] = True
    assert np.abs(speech.waveform[loud]).mean() > 3 * np.abs(speech.waveform[~loud]).mean()


def test_what_is_no_transcript(tmp_path):
    path = tmp_path / "a.TextGrid"
    assert "could not be read: no such file" in refusal(path)
    path.write_text("hello world")
    assert "is no TextGrid" in refusal(path)
    path.write_bytes(b"\xff\xff\x00\xd8")
    assert "no text in UTF-8 or UTF-16" in refusal(path)
    path.write_text(grid(("phones", PHONES), ("other", PHONES)))
    assert "no tier called words; it has phones, other" in refusal(path)
    path.write_text(grid(("words", []), ("phones", PHONES)))
    assert "holds no words" in refusal(path)
    path.write_text(grid(("words", SPOKEN)).replace("xmax = 0.4000", "xmax = 0.0500"))
    assert "a word must end after it begins" in refusal(path)
    with path.open("wb") as file:
        file.truncate(9 * 2**20)
    assert "larger than 8 MiB" in refusal(path)


def test_a_plain_text_is_taken_as_it_is_and_a_grid_by_what_it_holds(tmp_path):
    path = tmp_path / "said.txt"
    for encoding in ENCODINGS:
        path.write_text("Hello,\nworld!", encoding=encoding)
        assert read_words(path) == "Hello,\nworld!"
        path.write_text(grid(("words", SPOKEN)), encoding=encoding)
        assert read_words(path) == read_transcript(path)


def test_what_is_no_plain_text(tmp_path):
    path = tmp_path / "said.txt"
    with pytest.raises(TranscriptError, match=r"said.txt could not be read: no such file"):
        read_words(path)
    for content, sentence in (
        (b" \n...", "said.txt holds no words."),
        (b"RIFF\0\0\0\1", "said.txt is no plain text; save it as UTF-8."),
        (b"\xff\xff\x00\xd8", "said.txt is no text in UTF-8 or UTF-16."),
        (b"a" * (MAX_TEXT + 1), "said.txt holds more than 262144 characters."),
    ):
        path.write_bytes(content)
        with pytest.raises(TranscriptError) as caught:
            read_words(path)
        assert str(caught.value) == sentence
    path = tmp_path / "said.doc"
    path.write_text("hello world")
    with pytest.raises(TranscriptError, match="is no TextGrid"):
        read_words(path)


KNOWN = {"hello": "HH AH L OW", "it's": "IH T S", "five": "F AY V", "and": "AE N D", "cafe": "K"}


def test_words_keep_their_letters_and_lose_what_is_around_them():
    for written, words in (
        ('Hello, (it\'s) "hello"!', ["Hello", "it's", "hello"]),
        ("hello\u2014hello / it\u2019s - ...", ["hello", "hello", "it's"]),
        ("Caf\u00e9 \u4e2d\u6587 [and]", ["Caf\u00e9", "and"]),
    ):
        found = words_to_say(written, KNOWN.get)
        assert [word.text for word in found] == words
        assert all(word.known in KNOWN and word.phones == KNOWN[word.known] for word in found)


def test_what_no_dictionary_has_is_said_by_rules_and_numbers_are_read_out():
    for written, phones in {
        "5": "F AY V",
        "NLX": "EH N EH L EH K S",
        "five-&": "F AY V AE N D",
        "Shipstone": "SH IH P S T AA N",
        "phight": "F AY T",
    }.items():
        (word,) = words_to_say(written, KNOWN.get)
        assert (word.text, word.known, word.phones) == (written, None, phones)
    for digits, said in {
        "0": "zero",
        "13": "thirteen",
        "40": "forty",
        "1,250.05": "twelve fifty point zero five",
        "2005": "two thousand five",
        "1999": "nineteen ninety nine",
        "1900": "nineteen hundred",
        "120300": "one hundred twenty thousand three hundred",
        "1234567": "one two three four five six seven",
    }.items():
        assert " ".join(number_words(digits)) == said
