"""TextGrids as aligners write them, and files that are none."""

from pathlib import Path

import pytest

from model.corpus.layout import _interval_tier
from model.speech.transcript import TranscriptError, Word, read_words

HEAD = (
    'File type = "ooTextFile"\nObject class = "TextGrid"\n\nxmin = 0\nxmax = 2\n'
    "tiers? <exists>\nsize = 2\nitem []:\n"
)
SPOKEN = [(0.1, 0.4, "hello"), (0.5, 1.25, 'so-called ""art""')]
PHONES = [(0.1, 0.2, "h"), (0.2, 0.4, "o")]


def grid(*tiers: tuple[str, list]) -> str:
    return HEAD + "".join(
        f"    item [{number}]:\n{_interval_tier(name, intervals, 2.0)}"
        for number, (name, intervals) in enumerate(tiers, start=1)
    )


def refusal(path: Path) -> str:
    with pytest.raises(TranscriptError) as caught:
        read_words(path)
    sentence = str(caught.value)
    assert path.name in sentence and sentence.endswith(".") and "\n" not in sentence
    return sentence


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("is_first", [True, False])
def test_words_come_with_their_times_and_without_pauses(
    tmp_path: Path, encoding: str, is_first: bool
):
    tiers = [("words", SPOKEN), ("phones", PHONES)]
    path = tmp_path / "a.TextGrid"
    path.write_text(grid(*(tiers if is_first else tiers[::-1])), encoding=encoding)
    assert read_words(path) == (Word(0.1, 0.4, "hello"), Word(0.5, 1.25, 'so-called "art"'))


def test_the_only_tier_may_have_any_name(tmp_path: Path):
    path = tmp_path / "a.TextGrid"
    path.write_text(grid(("maus", SPOKEN)))
    assert read_words(path)[0].text == "hello"


def test_what_is_no_transcript(tmp_path: Path):
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
