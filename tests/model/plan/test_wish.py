"""Style files: read, done to plans, and refused."""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from model.plan.editing import Edited, Gesture, added, gestures, on_word
from model.plan.plan import GesturePlan, PlanError
from model.plan.style import AWAY_S, StyleWish, on_wrong_words, read_wish, style_of, wish_of
from tests.model.plan.made import phase

LONG_S = 20.0


@dataclass(frozen=True)
class Said:
    start_s: float
    end_s: float
    text: str


WORDS = [Said(0.5 * k, 0.5 * k + 0.4, f"W{k}") for k in range(40)]


def plan_of(lands: tuple[float, ...], kind: str = "beat") -> GesturePlan:
    still = (phase(0.0, LONG_S, "rest"),)
    plan = GesturePlan(LONG_S, left=still, right=still)
    for at_s in lands:
        plan = added(plan, kind, at_s, "both" if kind == "shrug" else "right", "here").plan
    return plan


def landings(plan: GesturePlan, side: str = "right") -> list[float]:
    return [one.lands_s for one in gestures(plan, side)]  # pyright: ignore[reportArgumentType]


def written(tmp_path: Path, text: str) -> StyleWish:
    path = tmp_path / "style.toml"
    path.write_text(text)
    return read_wish(path)


def test_numbers_are_as_told_or_so_many_times_what_each_plan_asks_for(tmp_path: Path) -> None:
    wish = written(tmp_path, "height_m = 0.05\n[times]\ngestures_per_min = 0.5\nsize_m = 1.5\n")
    for lands in ((2.0, 5.0, 8.0, 11.0), (3.0, 6.0)):
        plan = plan_of(lands)
        made = style_of(wish.done(plan).plan)
        assert len(landings(wish.done(plan).plan)) == len(lands) / 2
        assert made.height_m == pytest.approx(0.05, abs=1e-3)
        assert style_of(plan).height_m < 0
    bare = style_of(written(tmp_path, "[times]\nsize_m = 1.5").done(plan_of((2.0, 5.0))).plan)
    assert bare.size_m == pytest.approx(1.5 * style_of(plan_of((2.0, 5.0))).size_m, rel=0.02)
    assert bare.gestures_per_min == style_of(plan_of((2.0, 5.0))).gestures_per_min


def test_excitement_is_done_after_the_numbers_and_nothing_changes_nothing(tmp_path: Path) -> None:
    plan = plan_of((2.0, 5.0, 8.0))
    assert written(tmp_path, "").done(plan) == Edited(plan)
    wild = style_of(written(tmp_path, "size_m = 0.2\nexcite = 1").done(plan).plan)
    assert wild.size_m == pytest.approx(0.26, abs=0.02)


def test_more_gestures_go_onto_words_and_without_words_that_is_said(tmp_path: Path) -> None:
    wish = written(tmp_path, "gestures_per_min = 24")
    plan = plan_of((3.0, 15.0))
    assert len(landings(wish.done(plan, WORDS).plan)) == 8
    assert wish.done(plan).notes == ("There is room for 6 gestures a minute.",)


@pytest.mark.parametrize("kind", ["beat", "shrug"])
def test_on_wrong_words_no_stroke_lands_where_one_was_called_for(kind: str) -> None:
    right = (2.06, 5.1, 8.06, 11.1, 14.06)
    plan = plan_of(right, kind)
    for words in ([], WORDS):
        made = on_wrong_words(plan, words)
        assert made.notes == ()
        found = landings(made.plan)
        assert len(found) == len(right) and found == sorted(found)
        off = np.abs(np.subtract.outer(found, right)).min(axis=1)
        assert off.min() >= AWAY_S - 1e-6
        if kind == "shrug":
            assert landings(made.plan, "left") == found
        said = [one.word for one in made.plan.right if one.phase == "stroke"]
        if words:
            assert all(any(abs(on_word(w) - at) < 1e-6 for w in words) for at in found)
            assert all(word.startswith("w") for word in said)
        else:
            assert said == [""] * 5
        old = [one for one in plan.right if one.phase == "stroke"]
        new = [one for one in made.plan.right if one.phase == "stroke"]
        assert [one.goal for one in old] == [one.goal for one in new]


def test_a_gesture_without_room_stays_and_is_counted() -> None:
    plan = plan_of(tuple(np.arange(1.0, 19.5, 0.72).round(2)))
    made = on_wrong_words(plan, [Said(at, at + 0.01, "x") for at in landings(plan)])
    assert made.plan == plan and made.notes == ("26 of 26 gestures stay on their words.",)
    assert len(landings(plan)) == 26
    assert all(b > a for a, b in pairwise(landings(plan)))
    assert Gesture("right", landings(plan)[0]) in gestures(plan, "right")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("often = 3", "a style has no 'often'"),
        ("gestures_per_min = 900", "gestures_per_min is a number from 0 to 90; got 900."),
        ("size_m = nan", "size_m is a number from 0.05 to 0.6; got nan."),
        ("size_m = true", "size_m is a number"),
        ("excite = 2", "excite is a number from -1 to 1; got 2."),
        ("wrong_words = 1", "`wrong_words` is true or false."),
        ("[times]\nheight_m = 2", "`times` is a table of some of gestures_per_min"),
        ("times = 2", "`times` is a table"),
        ("[times]\nsmile = -1", "times.smile is a number from 0 to 10; got -1."),
        ("size_m = 0.2\n[times]\nsize_m = 2", "size_m is given twice, alone and in `times`"),
        ("size_m =", "style.toml is no TOML file."),
        ("\x00", "style.toml is no TOML file."),
        ("a." * 3000 + "b = 1", "a style has no 'a'"),
        ("#" * 20_000, "style.toml is larger than 10 kB."),
    ],
)
def test_what_is_no_style_is_refused_in_a_sentence(
    tmp_path: Path, text: str, sentence: str
) -> None:
    with pytest.raises(PlanError, match=r"^style\.toml") as told:
        written(tmp_path, text)
    assert sentence in str(told.value)
    with pytest.raises(PlanError, match=r"there\.toml could not be read: no such file"):
        read_wish(tmp_path / "there.toml")


def test_a_wish_is_read_from_tables_alike() -> None:
    told = {"times": {"gestures_per_min": 0.5}, "wrong_words": True, "excite": -0.5}
    assert wish_of(told) == StyleWish({}, {"gestures_per_min": 0.5}, -0.5, True)
