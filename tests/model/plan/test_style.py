"""Sliders and style files: read, done to plans, and refused."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from model.plan.editing import GestureKey, add_gesture, default_stroke_end_on_word, gestures
from model.plan.plan import GesturePlan, PlanError, PlanResult
from model.plan.style import (
    MIN_MISALIGNMENT_S,
    StyleChange,
    misalign_gestures,
    parse_style,
    read_style_file,
    style_of,
    with_arousal,
    with_style,
)
from tests.model.plan.made import resting, said
from tests.model.plan.test_editing import BUSY, lands

FEW_WORDS = [said(f"w{k}", 0.5 + k * 0.9, 1.0 + k * 0.9) for k in range(10)]
WORDS = [said(f"W{k}", 0.5 * k, 0.5 * k + 0.4) for k in range(40)]


def test_sliders_stand_where_the_plan_is_and_leave_it_there():
    style = style_of(BUSY)
    assert style.gestures_per_min == 18 and style.both == pytest.approx(1 / 3)
    assert with_style(BUSY, style, FEW_WORDS) == PlanResult(BUSY)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("gestures_per_min", (0.0, 6.0, 36.0)),
        ("size_m", (0.1, 0.25, 0.4)),
        ("height_m", (-0.25, -0.05, 0.1)),
        ("stroke_s", (0.22, 0.3, 0.45)),
        ("both", (0.0, 0.7, 1.0)),
        ("smile", (0.0, 0.2, 0.6)),
    ],
)
def test_sliders_bring_what_they_say(name, values):
    for value in values:
        new = with_style(BUSY, replace(style_of(BUSY), **{name: value}), FEW_WORDS).plan
        assert getattr(style_of(new), name) == pytest.approx(value, rel=0.12, abs=0.02)


def test_sliders_say_where_there_is_no_room():
    none = with_style(BUSY, replace(style_of(BUSY), gestures_per_min=0.0))
    assert lands(none.plan) == lands(none.plan, "left") == []
    more = with_style(BUSY, replace(style_of(BUSY), gestures_per_min=60.0))
    assert more.plan == BUSY and more.notes == ("There is room for only 18 gestures per minute.",)


def test_excitement_moves_all_sliders_one_way():
    style = style_of(BUSY)
    calm, wild = with_arousal(style, -1.0), with_arousal(style, 1.0)
    for name in ("gestures_per_min", "size_m", "height_m", "both"):
        assert getattr(calm, name) < getattr(style, name) < getattr(wild, name)
    assert wild.stroke_s < style.stroke_s < calm.stroke_s and with_arousal(style, 0.0) == style


def plan_of(lands: tuple[float, ...], kind: str = "beat") -> GesturePlan:
    plan = resting(20.0)
    for at_s in lands:
        plan = add_gesture(plan, kind, at_s, "both" if kind == "shrug" else "right", "here").plan
    return plan


def written(tmp_path: Path, text: str) -> StyleChange:
    path = tmp_path / "style.toml"
    path.write_text(text)
    return read_style_file(path)


def test_numbers_are_as_told_or_so_many_times_what_each_plan_asks_for(tmp_path):
    wish = written(tmp_path, "height_m = 0.05\n[times]\ngestures_per_min = 0.5\nsize_m = 1.5\n")
    for times in ((2.0, 5.0, 8.0, 11.0), (3.0, 6.0)):
        done = wish.apply(plan_of(times)).plan
        assert len(lands(done)) == len(times) / 2
        assert style_of(done).height_m == pytest.approx(0.05, abs=1e-3)
        assert style_of(plan_of(times)).height_m < 0
    plan = plan_of((2.0, 5.0))
    bare = style_of(written(tmp_path, "[times]\nsize_m = 1.5").apply(plan).plan)
    assert bare.size_m == pytest.approx(1.5 * style_of(plan).size_m, rel=0.02)
    assert bare.gestures_per_min == style_of(plan).gestures_per_min
    assert written(tmp_path, "").apply(plan) == PlanResult(plan)  # nothing changes nothing
    wild = style_of(written(tmp_path, "size_m = 0.2\nexcite = 1").apply(plan).plan)
    assert wild.size_m == pytest.approx(0.26, abs=0.02)  # done after the numbers


def test_more_gestures_go_onto_words_and_without_words_that_is_said(tmp_path):
    wish, plan = written(tmp_path, "gestures_per_min = 24"), plan_of((3.0, 15.0))
    assert len(lands(wish.apply(plan, WORDS).plan)) == 8
    assert wish.apply(plan).notes == ("There is room for only 6 gestures per minute.",)


@pytest.mark.parametrize("kind", ["beat", "shrug"])
@pytest.mark.parametrize("words", [[], WORDS], ids=["no words", "words"])
def test_on_wrong_words_no_stroke_lands_where_one_was_called_for(kind, words):
    right = (2.06, 5.1, 8.06, 11.1, 14.06)
    plan = plan_of(right, kind)
    made = misalign_gestures(plan, words)
    found = [one.stroke_end_s for one in gestures(made.plan, "right")]
    assert made.notes == () and len(found) == len(right) and found == sorted(found)
    assert np.abs(np.subtract.outer(found, right)).min() >= MIN_MISALIGNMENT_S - 1e-6
    if kind == "shrug":
        assert [one.stroke_end_s for one in gestures(made.plan, "left")] == found
    old, new = ([p for p in each.right if p.phase == "stroke"] for each in (plan, made.plan))
    if words:
        assert all(
            any(abs(default_stroke_end_on_word(w) - at) < 1e-6 for w in words) for at in found
        )
        assert all(one.word.startswith("w") for one in new)
    else:
        assert [one.word for one in new] == [""] * 5
    assert [one.goal for one in old] == [one.goal for one in new]


def test_a_gesture_without_room_stays_and_is_counted():
    plan = plan_of(tuple(np.arange(1.0, 19.5, 0.72).round(2)))
    times = [one.stroke_end_s for one in gestures(plan, "right")]
    made = misalign_gestures(plan, [said("x", at, at + 0.01) for at in times])
    assert made.plan == plan and made.notes == (
        "26 of 26 gestures could not be moved to another word or time.",
    )
    assert len(times) == 26 and all(b > a for a, b in pairwise(times))
    assert GestureKey("right", times[0]) in gestures(plan, "right")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("often = 3", "'often' is not a style key"),
        ("gestures_per_min = 900", "gestures_per_min must be a number from 0 to 90; got 900."),
        ("size_m = nan", "size_m must be a number from 0.05 to 0.6; got nan."),
        ("size_m = true", "size_m must be a number"),
        ("excite = 2", "excite must be a number from -1 to 1; got 2."),
        ("wrong_words = 1", "`wrong_words` must be true or false."),
        ("[times]\nheight_m = 2", "`times` must be a table with keys from gestures_per_min"),
        ("times = 2", "`times` must be a table"),
        ("[times]\nsmile = -1", "times.smile must be a number from 0 to 10; got -1."),
        (
            "size_m = 0.2\n[times]\nsize_m = 2",
            "size_m is set twice, as a value and as a factor in `times`",
        ),
        ("size_m =", "style.toml is not a TOML file."),
        ("\x00", "style.toml is not a TOML file."),
        ("a." * 3000 + "b = 1", "style.toml is not a TOML file."),
        ("#" * 20_000, "style.toml is larger than the limit of 10 kB"),
    ],
)
def test_what_is_no_style_is_refused_in_a_sentence(tmp_path, text, sentence):
    with pytest.raises(PlanError, match=r"^style\.toml") as told:
        written(tmp_path, text)
    assert sentence in str(told.value)


def test_a_missing_file_is_refused_and_tables_are_read_alike(tmp_path):
    with pytest.raises(PlanError, match=r"there\.toml could not be read: no such file"):
        read_style_file(tmp_path / "there.toml")
    told = {"times": {"gestures_per_min": 0.5}, "wrong_words": True, "excite": -0.5}
    assert parse_style(told) == StyleChange({}, {"gestures_per_min": 0.5}, -0.5, True)
