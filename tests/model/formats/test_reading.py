"""Assumptions as sentences and for programs, and what users may say."""

from pathlib import Path

import pytest

from model.formats.reading import (
    Assumption,
    ImportedMotion,
    assumption_difference_notes,
    length_notes,
    parse_import_overrides,
)
from model.storage.npz import MotionError
from tests.helpers import smooth_motion_example

MOTION = smooth_motion_example(4)
UP = Assumption("up", "z", "it stands along it", "unsure", ("y", "x"))
USUAL = Assumption("rate", "30", "as stated", "stated", is_own_convention=True)


def test_a_note_names_file_value_reason_and_the_way_out():
    reading = ImportedMotion(MOTION, (UP, USUAL), "a.npz")
    (note,) = reading.notes
    assert note == "a.npz: up axis z, it stands along it (if this is wrong, use --assume up=y|x)."
    assert reading.assumption_of("up") is UP and reading.assumption_of("hands") is None
    assert UP.as_json() == {
        "kind": "up",
        "value": "z",
        "reason": "it stands along it",
        "confidence": "unsure",
        "alternatives": ["y", "x"],
    }


def test_what_differs_between_compared_motions_is_told():
    slow = Assumption("rate", "15", "as stated")
    one = ImportedMotion(MOTION, (slow,), missing_parts=frozenset({"detail", "face"}))
    other = ImportedMotion(MOTION, (USUAL,), missing_parts=frozenset({"face"}))
    first, second = assumption_difference_notes({"a": one, "b": other})
    assert "differ in frame rate (a 15, b 30)" in first
    assert second.startswith("a was upsampled from a lower frame rate")
    assert assumption_difference_notes({"a": one, "b": one}) == []


def test_a_rate_at_which_the_speech_would_fit_is_told():
    assert length_notes(10.0, {"a": 10.9, "b": 9.1}) == []
    (note,) = length_notes(10.0, {"a": 5.0, "b": 20.0})
    assert "but 2 of the motions last 5.0 to 20.0 s" in note and "as long as the speech" not in note
    (note,) = length_notes(10.0, {"a": 5.0})
    assert "but a lasts 5.0 s" in note and "At 15 fps it would be as long as the" in note
    (note,) = length_notes(14.06, {"a": 17.5}, {"a": 24.0})  # a BVH whose Frame Time is wrong
    assert "At 30 fps it would" in note and "(--assume rate=30)" in note
    assert "At" not in length_notes(14.06, {"a": 17.5}, {"a": 30.0})[0]


def test_what_is_said_of_one_file_comes_before_what_is_said_of_all():
    said = "up=z, b, c.npz:up=x,*.npz:up=y,*.npz:hands=mean,reference:rate=25,units=cm"
    told = parse_import_overrides(f"{said},motions:rate=24")
    assert told.for_file("a.bvh", "motions") == {"up": "z", "units": "cm", "rate": "24"}
    assert told.for_file("B.NPZ") == {"up": "y", "units": "cm", "hands": "mean"}
    assert told.for_file("b, c.npz")["up"] == "x"
    assert told.for_file("reference")["rate"] == "25"
    assert parse_import_overrides("").entries == ()
    assert (
        told.unknown_file_error([Path("x/b, c.npz")]) == ""
        and told.restricted_to([]).for_file("a.npz")["up"] == "z"
    )
    assert (
        "up=x is for a file 'b, c.npz', which does not exist; the files are a"
        in told.unknown_file_error([Path("a.npz")], "a")
    )


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("up", "is not a valid import setting"),
        ("colour=red", "is not a valid import setting"),
        ("up=w", "up must be one of y, -y"),
        ("rate=fast", "rate must be a number"),
        ("hands=big", "hands must be one of flat, mean"),
    ],
)
def test_what_nobody_can_say_is_refused(written: str, said: str):
    with pytest.raises(MotionError, match=said):
        parse_import_overrides(written)
