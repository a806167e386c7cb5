import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from app.errors import RunError
from app.study.design.fields import FieldError
from app.study.design.key import Expected, Key, Question, Trial, Video, read_key, write_key

KEY = Key(
    study="0123456789abcdef",
    title="Zwei Systeme \u2013 ein Versuch",
    protocol="pairwise",
    systems=("local", "global"),
    questions=(Question("realism", "Which moves more like a person?", "choice"),),
    videos={
        "a" * 16: Video("local", "clip1", None, "front", "0" * 64),
        "b" * 16: Video("global", "clip1", "clip2", "front", "1" * 64),
    },
    trials={
        "00000001": Trial("pair", "clip1", ("a" * 16, "b" * 16), ("realism",)),
        "00000002": Trial(
            "attention", "clip1", ("a" * 16, "b" * 16), ("check",), Expected("check", "left")
        ),
    },
    lists={0: ("00000001", "00000002"), 11: ("00000002", "00000001")},
    max_failed=1,
    participants=2,
)


def test_a_key_that_is_written_reads_back_the_same_and_is_private(tmp_path: Path) -> None:
    path = tmp_path / "key.json"
    write_key(KEY, path)
    assert read_key(path) == KEY
    assert path.stat().st_mode & 0o777 == 0o600
    assert [file.name for file in tmp_path.iterdir()] == ["key.json"]


def test_the_file_has_the_agreed_form(tmp_path: Path) -> None:
    path = tmp_path / "key.json"
    write_key(KEY, path)
    written = json.loads(path.read_text("utf-8"))
    assert written["format"] == 1
    assert written["attention_rule"] == {"max_failed": 1}
    assert written["lists"] == {"0": ["00000001", "00000002"], "11": ["00000002", "00000001"]}
    assert "expected" not in written["trials"]["00000001"]
    assert written["trials"]["00000002"]["expected"] == {"question": "check", "value": "left"}
    assert written["videos"]["a" * 16]["speech"] is None


def test_speech_of_another_clip_is_a_mismatch_and_so_is_none() -> None:
    assert Video("s", "c", "c", "front", "0").is_matched
    assert not Video("s", "c", "d", "front", "0").is_matched
    assert not Video("s", "c", None, "front", "0").is_matched


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (lambda key: key.pop("systems"), "`systems` must be a list"),
        (lambda key: key.update(format=2), "`format` must be 1"),
        (lambda key: key.update(protocol="duel"), "`protocol` must be one of"),
        (lambda key: key.update(systems=["local", "local"]), "different names"),
        (lambda key: key.update(systems=["global"]), "'local', which is no system"),
        (lambda key: key["videos"].pop("a" * 16), "shows a video that the key does not have"),
        (lambda key: key["trials"].pop("00000001"), "list 0 names a trial"),
        (lambda key: key["trials"]["00000002"].pop("expected"), "attention checks, and only they"),
        (lambda key: key["trials"]["00000001"].update(questions=["x"]), "asks a question"),
        (lambda key: key["attention_rule"].update(max_failed=True), "`max_failed` must be a whole"),
        (lambda key: key.update(participants=10_001), "from 1 to 10000"),
        (lambda key: key.update(lists={"one": []}), "`lists` must have"),
        (lambda key: key["questions"][0].update(id=7), "`id` must be a text"),
        (lambda key: key.update(title="\ud800"), "`title` must be a text"),
        (lambda key: key.update(title="x" * 2001), "`title` must be a text of 1 to 2000"),
    ],
)
def test_a_key_that_contradicts_itself_is_refused(
    tmp_path: Path, edit: Callable[[dict[str, Any]], object], says: str
) -> None:
    path = tmp_path / "key.json"
    write_key(KEY, path)
    values = json.loads(path.read_text())
    edit(values)
    path.write_text(json.dumps(values))
    with pytest.raises(RunError, match="not the key of a study") as refusal:
        read_key(path)
    assert says in str(refusal.value)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "no whole JSON"),
        (b'{"format": 1, "study": "0', "no whole JSON"),
        (b"\xff\xfe\x00{", "no whole JSON"),
        (b"[1]", "no JSON object"),
        (b'{"format": NaN}', "NaN"),
        (b'{"format": 1, "format": 1}', "twice"),
        (b"[" * 100_000, "nested too deeply"),
        (b'{"format": ' + b"9" * 5000 + b"}", "no whole JSON"),
    ],
)
def test_a_damaged_file_is_refused_in_one_sentence(
    tmp_path: Path, content: bytes, says: str
) -> None:
    path = tmp_path / "key.json"
    path.write_bytes(content)
    with pytest.raises(RunError, match=says):
        read_key(path)


def test_a_missing_key_is_named(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="There is no key at"):
        read_key(tmp_path / "key.json")


def test_a_key_cannot_be_made_inconsistent() -> None:
    with pytest.raises(FieldError, match="shows a video"):
        replace(KEY, videos={})
