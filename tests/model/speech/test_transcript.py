"""TextGrids as aligners write them, texts as people do, and files that are none."""

import json
from pathlib import Path

import numpy as np
import pytest

from app.run.examples import CLEAN
from model.motion.motion import load_motion
from model.plan.annotation_files import Interval, NamedTier, format_textgrid
from model.speech.audio import load_speech
from model.speech.transcript import (
    MAX_GESTURE_TIERS,
    MAX_TEXT,
    TranscriptError,
    Word,
    read_textgrid_transcript,
    read_words_file,
)
from model.speech.word_alignment import pronounce_text, spell_out_number
from tests.helpers import reported_folder

SPOKEN = [(0.1, 0.4, "hello"), (0.5, 1.25, 'so-called "art"')]
PHONES = [(0.1, 0.2, "h"), (0.2, 0.4, "o")]


def grid(*tiers: tuple[str, list]) -> str:
    named = [NamedTier(name, tuple(Interval(*row) for row in rows)) for name, rows in tiers]
    return format_textgrid(named, 2.0)


def refusal(path: Path) -> str:
    with pytest.raises(TranscriptError) as caught:
        read_textgrid_transcript(path)
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
            said = read_textgrid_transcript(path)
            assert said.words == (Word(0.1, 0.4, "hello"), Word(0.5, 1.25, 'so-called "art"'))
            assert said.origin == "given" and {word.confidence for word in said.words} == {1.0}
            assert said.phones == (Interval(0.1, 0.2, "h"), Interval(0.2, 0.4, "o"))
            assert said.gestures == {}
    path.write_text(grid(("maus", SPOKEN)))  # the only tier may have any name
    assert read_textgrid_transcript(path).words[0].text == "hello"
    path.write_text(grid(*tiers).replace("xmin = 0.2000", "xmin = 9"))
    said = read_textgrid_transcript(path)  # damaged phones do not spoil the words
    assert len(said.words) == 2 and said.phones == ()


def test_tiers_of_gestures_are_known_by_their_names_and_read_up_to_a_limit(tmp_path):
    path = tmp_path / "a.TextGrid"
    phases = [(0.0, 0.5, "preparation"), (0.5, 0.75, "stroke beat")]
    found = tuple(Interval(*phase) for phase in phases)
    for name in ("gesture_left", "G-Phase", "Strokes RH"):
        tiers = (("words", SPOKEN), ("phones", PHONES), (name, phases), ("gesture", []))
        path.write_text(grid(*tiers))
        assert read_textgrid_transcript(path).gestures == {name: found}
    names = [f"gesture {number}" for number in range(MAX_GESTURE_TIERS + 1)]
    path.write_text(grid(("words", SPOKEN), *((name, PHONES) for name in names)))
    assert list(read_textgrid_transcript(path).gestures) == names[:-1]


def test_a_gesture_that_ends_before_it_begins_is_refused(tmp_path):
    path = tmp_path / "a.TextGrid"
    good = grid(("words", SPOKEN), ("gesture", [(0.25, 0.5, "stroke")]))
    path.write_text(good.replace("xmin = 0.2500", "xmin = 0.7500"))
    assert "has the gesture 'stroke' from 0.75 to 0.5 s; a gesture must end" in refusal(path)


def test_the_example_s_tiers_belong_to_its_speech_and_motion():
    said = read_textgrid_transcript(CLEAN.with_suffix(".TextGrid"))
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
    assert "is not a TextGrid" in refusal(path)
    path.write_bytes(b"\xff\xff\x00\xd8")
    assert "not text in UTF-8, UTF-16 or Latin-1" in refusal(path)
    path.write_text(grid(("phones", PHONES), ("other", PHONES)))
    assert "no tier called words; it has phones, other" in refusal(path)
    path.write_text(grid(("words", []), ("phones", PHONES)))
    assert "holds no words" in refusal(path)
    path.write_text(grid(("words", SPOKEN)).replace("xmax = 0.4000", "xmax = 0.0500"))
    assert "a word must end after it begins" in refusal(path)
    with path.open("wb") as file:
        file.truncate(9 * 2**20)
    assert "larger than the limit of 8 MiB" in refusal(path)


def test_a_plain_text_is_taken_as_it_is_and_a_grid_by_what_it_holds(tmp_path):
    path = tmp_path / "said.txt"
    for encoding in ENCODINGS:
        path.write_text("Hello,\nworld!", encoding=encoding)
        assert read_words_file(path).text == "Hello,\nworld!"
        path.write_text(grid(("words", SPOKEN)), encoding=encoding)
        assert read_words_file(path).transcript == read_textgrid_transcript(path)


def test_what_is_no_plain_text(tmp_path):
    path = tmp_path / "said.txt"
    with pytest.raises(TranscriptError, match=r"said.txt could not be read: no such file"):
        read_words_file(path)
    for content, sentence in (
        (b" \n...", "said.txt holds no words."),
        (b"RIFF\0\0\0\1", "said.txt is not plain text; save it as UTF-8."),
        (b"\xff\xff\x00\xd8", "said.txt is not text in UTF-8, UTF-16 or Latin-1."),
        (b"a" * (MAX_TEXT + 1), "said.txt holds more than 262144 characters."),
    ):
        path.write_bytes(content)
        with pytest.raises(TranscriptError) as caught:
            read_words_file(path)
        assert str(caught.value) == sentence
    path = tmp_path / "said.doc"
    path.write_text("hello world")
    with pytest.raises(TranscriptError, match="is not a TextGrid"):
        read_words_file(path)


TIMED = [(0.3, 0.72, "There"), (0.72, 1.14, "are"), (1.2, 1.5, "reasons")]
"""As each of these files tells it."""
SEGMENT = {"start": 0.3, "end": 1.5, "text": " There are reasons"}
WHISPER = [{"word": f" {word}", "start": a, "end": b, "probability": 0.9} for a, b, word in TIMED]
FILES = {
    "genea.tsv": "0.3\t0.72\tThere\n0.72\t1.14\tare\n\n1.2\t1.5\treasons\n",
    "whisper.tsv": "start\tend\ttext\n300\t720\tThere\n720\t1140\tare\n1200\t1500\treasons\n",
    "audacity.txt": "0.300000\t0.720000\tThere\n0.72\t1.14\tare\n1.2\t1.5\treasons\n",
    "htk.lab": "0 3000000 sil\n3000000 7200000 There\n7200000 11400000 are\n"
    "12000000 15000000 reasons\n",
    "seconds.lab": "0.3 0.72 There\n0.72 1.14 are\n1.2 1.5 reasons\n",
    "kaldi.ctm": ";; made by\na 1 0.3 0.42 There 0.98\na 1 0.72 0.42 are\na 1 1.2 .3 reasons\n",
    "words.srt": "1\n00:00:00,300 --> 00:00:00,720\nThere\n\n2\n00:00:00,720 --> 00:00:01,140\n"
    "<i>are</i>\n\n3\n00:00:01,200 --> 00:00:01,500\nreasons\n",
    "words.vtt": "WEBVTT\n\n00:00.300 --> 00:00.720 align:start\nThere\n\nNOTE no cue\n\n"
    "00:00.720 --> 00:01.140\n<c.x>are</c>\n\n00:01.200 --> 00:01.500\nreasons",
    "whisper.json": json.dumps({"text": "There are", "segments": [{**SEGMENT, "words": WHISPER}]}),
    "whisperx.json": json.dumps({"segments": [SEGMENT], "word_segments": WHISPER}),
    "gentle.json": json.dumps({"transcript": "", "words": WHISPER}),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_words_of_recognisers_corpora_and_subtitles(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(FILES[name])
    given = read_words_file(tmp_path / name)
    assert given.text is None and given.notes == () and given.transcript.phones == ()
    words = given.transcript.words
    assert [word.text for word in words] == ["There", "are", "reasons"]
    times = [(word.start_s, word.end_s) for word in words]
    np.testing.assert_allclose(times, [row[:2] for row in TIMED])
    assert given.end_s == pytest.approx(1.5)


def test_times_of_sentences_are_no_times_of_words(tmp_path: Path) -> None:
    for name, content in {
        "a.json": json.dumps({"segments": [SEGMENT, SEGMENT]}),
        "a.srt": "1\n00:00:00,300 --> 00:00:01,500\nThere are\nreasons\n",
        "a.tsv": "0.3\t1.5\tThere are reasons\n",
        "a.TextGrid": grid(("anna", [(0.3, 1.5, "There are reasons")])),
    }.items():
        (tmp_path / name).write_text(content)
        given = read_words_file(tmp_path / name)
        assert given.text is not None and given.text.startswith("There are reasons")
        assert given.transcript.words == ()
        (note,) = given.notes
        assert note == (
            f"{name} has times for sentences only; the times of its words are found by alignment."
        )
    (tmp_path / "said.lab").write_text("There are reasons")  # as Montreal's aligner takes it
    assert read_words_file(tmp_path / "said.lab").text == "There are reasons"


def test_words_without_times_are_left_out_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"segments": [{"words": [*WHISPER, {"word": "2024"}]}]}))
    given = read_words_file(path)
    assert len(given.transcript.words) == 3
    assert given.notes == ("1 words of a.json have no times and are left out.",)


def test_the_tier_of_words_is_that_of_the_one_speaker(tmp_path: Path) -> None:
    path = tmp_path / "a.TextGrid"
    for words, phones in (
        ("anna - words", "anna - phones"),
        ("Anna May - word", "Anna May - phone"),
    ):
        path.write_text(grid((words, SPOKEN), (phones, PHONES), ("ben - phones", SPOKEN)))
        said = read_textgrid_transcript(path)
        assert [word.text for word in said.words] == ["hello", 'so-called "art"']
        assert [phone.text for phone in said.phones] == ["h", "o"]
    path.write_text(grid(("anna - words", SPOKEN), ("ben - words", [])))
    assert len(read_textgrid_transcript(path).words) == 2  # ben says nothing
    path.write_text(grid(("anna - words", SPOKEN), ("ben - words", SPOKEN)))
    assert "several tiers of words ('anna - words', 'ben - words'); keep only" in refusal(path)


def test_tiers_that_are_no_words_or_have_one_name_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "a.TextGrid"
    for name in ("phones", "anna - phone", "gesture_left"):
        path.write_text(grid((name, PHONES)))
        assert f"has no tier called words; it has {name}" in refusal(path)
    for name in ("words", "phones", "gesture"):
        tiers = {"words": SPOKEN, "phones": PHONES, "gesture": SPOKEN}
        path.write_text(grid(*tiers.items(), (name, SPOKEN)))
        assert f"has 2 tiers called '{name}'; rename or delete" in refusal(path)


def test_a_textgrid_that_is_cut_off_anywhere_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.TextGrid"
    whole = grid(("phones", PHONES), ("words", SPOKEN))
    last = whole.rindex('"')
    for length in range(0, last, 7):
        path.write_text(whole[:length])
        refusal(path)
    path.write_text(whole[: last + 1])
    assert len(read_textgrid_transcript(path).words) == 2


def test_latin_1_is_read_and_told(tmp_path: Path) -> None:
    path = tmp_path / "a.TextGrid"
    path.write_bytes(grid(("words", [(0.1, 0.4, "na\u00efve")])).encode("latin-1"))
    given = read_words_file(path)
    assert [word.text for word in given.transcript.words] == ["na\u00efve"]
    (note,) = given.notes
    assert note.startswith("a.TextGrid is not UTF-8; it was read as Latin-1")


def test_what_is_no_file_of_words(tmp_path: Path) -> None:
    for name, content, says in (
        ("a.json", "[" * 99_999, "is not a JSON file of Whisper"),
        ("a.json", '{"segments": [{"start": 1e999, "end": {}, "text": "a"}]}', "no words or segm"),
        ("a.json", '{"words": [{"word": "a", "start": 2, "end": 1}]}', "must end after it begins"),
        ("a.json", '{"words": [{"word": "a", "start": -2, "end": 1}]}', "must end after it begins"),
        ("a.tsv", "one\ttwo\tthree", "is not a table of start, end and word"),
        ("a.ctm", "a 1 0.3 word", "Line 1 of a.ctm must hold recording, channel"),
        ("a.ctm", "a 1 0 1 x\na 2 0 1 y", "words of 2 recordings or channels (a 1, a 2)"),
        ("a.srt", "nothing", "holds no words"),
        ("a.doc", "hello world", "has none of the suffixes of word files (.TextGrid, .txt"),
    ):
        (tmp_path / name).write_text(content)
        with pytest.raises(TranscriptError) as caught:
            read_words_file(tmp_path / name)
        assert says in str(caught.value) and name in str(caught.value)


def test_what_lies_beyond_the_speech_is_left_out_and_told(tmp_path: Path) -> None:
    path = tmp_path / "a.TextGrid"
    tiers = [("words", SPOKEN), ("phones", PHONES), ("gesture", [(0.2, 0.9, "stroke")])]
    path.write_text(grid(*tiers))
    given = read_words_file(path)
    assert given.within(1.6) == given  # of 2.0 s
    cut = given.within(0.45)
    assert [word.text for word in cut.transcript.words] == ["hello"]
    assert cut.transcript.phones == given.transcript.phones
    assert cut.transcript.gestures == {"gesture": (Interval(0.2, 0.45, "stroke"),)}
    assert cut.notes == (
        "a.TextGrid ends at 2.0 s and the speech at 0.5 s; the file may belong to another clip. "
        "1 of its 2 words lie after the end of the speech and are left out.",
    )
    assert cut.within(0.45) == cut


def test_files_that_were_once_read_wrongly() -> None:
    folder = reported_folder()
    expected = read_words_file(folder / "genea.tsv").transcript.words
    assert len(expected) == 32 and (expected[0].start_s, expected[-1].end_s) == (0.3, 13.755)
    for name in ("whisper.json", "words.srt", "fave_one_speaker.TextGrid"):
        given = read_words_file(folder / name)
        assert given.transcript.words == expected and given.notes == ()
    latin = read_words_file(folder / "latin1.TextGrid")
    assert latin.transcript.words[0].text == "na\u00efve" and len(latin.notes) == 1
    longer = read_words_file(folder / "other_clip_longer.TextGrid").within(14.0554)
    assert all(word.end_s <= 14.0554 for word in longer.transcript.words)
    assert "ends at 42.2 s and the speech at 14.1 s" in longer.notes[0]


KNOWN = {"hello": "HH AH L OW", "it's": "IH T S", "five": "F AY V", "and": "AE N D", "cafe": "K"}


def test_words_keep_their_letters_and_lose_what_is_around_them():
    for written, words in (
        ('Hello, (it\'s) "hello"!', ["Hello", "it's", "hello"]),
        ("hello\u2014hello / it\u2019s - ...", ["hello", "hello", "it's"]),
        ("Caf\u00e9 \u4e2d\u6587 [and]", ["Caf\u00e9", "and"]),
    ):
        found = pronounce_text(written, KNOWN.get)
        assert [word.text for word in found] == words
        assert all(
            word.dictionary_key in KNOWN and word.phones == KNOWN[word.dictionary_key]
            for word in found
        )


def test_what_no_dictionary_has_is_said_by_rules_and_numbers_are_read_out():
    for written, phones in {
        "5": "F AY V",
        "NLX": "EH N EH L EH K S",
        "five-&": "F AY V AE N D",
        "Shipstone": "SH IH P S T AA N",
        "phight": "F AY T",
    }.items():
        (word,) = pronounce_text(written, KNOWN.get)
        assert (word.text, word.dictionary_key, word.phones) == (written, None, phones)
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
        assert " ".join(spell_out_number(digits)) == said
