import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from app.errors import RunError
from app.study.statistics.answers import MAX_FILE_BYTES, collect
from tests.app.study.made import made_files, made_key, written_study

KEY = made_key()


def edited(
    tmp_path: Path, edit: Callable[[dict[str, Any]], object], protocol: str = "pairwise"
) -> tuple[list[int], tuple[str, ...]]:
    """Numbers of answers that remain, and the sentences, after the first of two files is edited."""
    key = made_key(protocol)
    files = made_files(key, 2)
    files[0]["participant"] = "edited"
    edit(files[0])
    _, folder = written_study(tmp_path, key, files)
    collected = collect([folder], key)
    return [len(one.answers) for one in collected.participants], collected.left_out


def test_whole_files_are_read_and_the_truth_of_a_simulation_is_passed_over(tmp_path: Path) -> None:
    _, folder = written_study(tmp_path, KEY, made_files(KEY, 3))
    (folder / "truth.json").write_text("{}")
    collected = collect([folder, *folder.glob("simulated*")], KEY)
    assert [len(one.answers) for one in collected.participants] == [14, 14, 14]
    assert collected.left_out == ()


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (lambda f: f.update(study="f" * 16), "is left out: it belongs to another study."),
        (lambda f: f.pop("study"), "is left out: it is no answers file of a study."),
        (lambda f: f.update(format="1"), "is left out: it is no answers file of a study."),
        (lambda f: f.update(list=99), "is left out: the study has no list 99."),
        (lambda f: f.update(list=True), "`list` must be a whole number"),
        (lambda f: f.update(answers={}), "`answers` must be a list of objects"),
        (lambda f: f.update(answers=[1]), "`answers` must be a list of objects"),
        (lambda f: f.update(finished="yesterday"), "`finished` must be a time in ISO form"),
        (lambda f: f.update(answers=[{}] * 10_001), "`answers` has 10001 items; at most 10000"),
    ],
)
def test_a_file_that_cannot_be_used_costs_one_sentence_and_nothing_else(
    tmp_path: Path, edit: Callable[[dict[str, Any]], object], says: str
) -> None:
    counts, left_out = edited(tmp_path, edit)
    assert counts == [14]
    assert len(left_out) == 1
    assert left_out[0].startswith("edited.json ")
    assert says in left_out[0]


@pytest.mark.parametrize(
    ("protocol", "edit", "says"),
    [
        ("pairwise", {"value": "clip3-rival"}, "the answer is not among the videos shown (1)"),
        ("pairwise", {"value": None}, "the answer is not among the videos shown (1)"),
        ("pairwise", {"value": ["clip0-local"]}, "the answer is not among the videos shown (1)"),
        ("pairwise", {"shown": ["clip0-local"] * 2}, "the videos shown are not those of its trial"),
        ("pairwise", {"trial": "clip9/0"}, "its trial is not on the participant's list"),
        ("pairwise", {"question": "beauty"}, "its trial does not ask that question"),
        ("pairwise", {"watched": 0}, "a video was not watched to its end"),
        ("pairwise", {"trial": "clip0/1"}, "the videos shown are not those of its trial"),
        ("pairwise", {"reasons": "smoothness"}, "`reasons` must be a list of texts"),
        ("ranking", {"value": ["clip0-local"] * 3}, "does not hold each video shown once"),
        ("ranking", {"value": [1, 2, 3]}, "does not hold each video shown once"),
        ("ranking", {"value": "tie"}, "does not hold each video shown once"),
        ("rating", {"value": {"clip0-local": 3}}, "not those of the videos shown"),
        (
            "rating",
            {"value": {"clip0-local": 3, "clip0-global": 101, "clip0-rival": 0}},
            "a rating is not between 0 and 100",
        ),
        (
            "rating",
            {"value": {"clip0-local": 3, "clip0-global": 10**400, "clip0-rival": 0}},
            "a rating is not between 0 and 100",
        ),
        (
            "rating",
            {"value": {"clip0-local": 3, "clip0-global": True, "clip0-rival": 0}},
            "a rating is not between 0 and 100",
        ),
    ],
)
def test_an_edited_answer_is_left_out_and_the_others_count(
    tmp_path: Path, protocol: str, edit: dict[str, Any], says: str
) -> None:
    whole = 14 if protocol == "pairwise" else 6
    counts, left_out = edited(tmp_path, lambda file: file["answers"][0].update(edit), protocol)
    assert counts == [whole - 1, whole]
    assert len(left_out) == 1
    assert left_out[0].startswith(
        f"edited.json: 1 of {whole} answers is left out, the others count"
    )
    assert says in left_out[0]


def test_the_same_question_answered_twice_counts_once_as_first_given(tmp_path: Path) -> None:
    def double(file: dict[str, Any]) -> None:
        file["answers"].append(file["answers"][0] | {"value": "tie"})

    counts, left_out = edited(tmp_path, double)
    assert counts == [14, 14]
    assert "the question was answered before (1)" in left_out[0]


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b'{"format": 1, "study"', "it is no whole JSON file (cut off or damaged)"),
        (b"", "it is no whole JSON file (cut off or damaged)"),
        (b"[" * 50_000, "it is nested too deeply"),
        (b" " * (MAX_FILE_BYTES + 1), "it is larger than the 4,194,304 bytes that are read"),
    ],
)
def test_damaged_files_are_named(tmp_path: Path, content: bytes, says: str) -> None:
    _, folder = written_study(tmp_path, KEY, made_files(KEY, 1))
    (folder / "broken.json").write_bytes(content)
    collected = collect([folder], KEY)
    assert len(collected.participants) == 1
    assert collected.left_out == (f"broken.json is left out: {says}.",)


def test_of_doubles_the_finished_then_the_later_counts(tmp_path: Path) -> None:
    first, second, half = made_files(KEY, 3)
    for file in (first, second, half):
        file["participant"] = "same"
    second["finished"] = "2030-01-01T00:00:00Z"
    half.update(finished=None, started="2031-01-01T00:00:00")
    _, folder = written_study(tmp_path, KEY, [])
    for name, file in (("a", first), ("b", second), ("c", half)):
        (folder / f"{name}.json").write_text(json.dumps(file))
    collected = collect([folder], KEY)
    assert [one.source for one in collected.participants] == ["b.json"]
    assert collected.left_out == (
        "a.json is left out: its participant also sent b.json, which is later.",
        "c.json is left out: its participant also sent b.json, which is finished.",
    )


def test_a_path_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="There are no answers at"):
        collect([tmp_path / "none"], KEY)
