"""Plans: what is read, and one clear sentence for everything that cannot be."""

import time
from pathlib import Path

import pytest

from app.errors import RunError
from app.study.design.plan import Generator, read_plan
from model.plan.style import StyleWish
from tests.app.study.made_study import write_plan

MINIMAL = """
title = "T"
protocol = "pairwise"
participants = 28
[[clips]]
name = "one"
speech = "one.wav"
[[systems]]
name = "globaldiff/local"
[[systems]]
name = "theirs"
motion = "theirs/{clip}.npz"
"""


def read(folder: Path, text: str):
    path = folder / "plan.toml"
    path.write_text(text)
    return read_plan(path)


def test_a_minimal_plan_has_sensible_defaults(tmp_path: Path) -> None:
    plan = read(tmp_path, MINIMAL)
    assert (plan.views, plan.length_s, plan.size, plan.face) == (("front",), None, 512, "still")
    assert (plan.attention_checks, plan.max_failed, plan.has_sound) == (2, 1, False)
    assert plan.clips[0].speech == tmp_path / "one.wav"
    assert plan.systems[0].generator == Generator("globaldiff/local")
    assert plan.systems[1].motions == {"one": tmp_path / "theirs" / "one.npz"}


def test_one_system_can_take_part_with_several_settings(tmp_path: Path) -> None:
    text = MINIMAL + '[[systems]]\nname = "smoothed"\nsystem = "globaldiff/local"\n'
    plan = read(tmp_path, text + 'post_filter = "savgol"\nseed = 3\n')
    expected = Generator("globaldiff/local", seed=3, post_filter="savgol")
    assert plan.systems[2].generator == expected
    with pytest.raises(RunError, match=r"'globaldiff/local' and 'smoothed' are the same"):
        read(tmp_path, text)


def test_motion_can_be_a_table_by_clip(tmp_path: Path) -> None:
    text = MINIMAL.replace('motion = "theirs/{clip}.npz"', 'motion = { one = "a b.npz" }')
    assert read(tmp_path, text).systems[1].motions == {"one": tmp_path / "a b.npz"}


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('title = "T"', "", "`title`"),
        ('title = "T"', 'titel = "T"', "no key `titel`"),
        ('"pairwise"', '"beauty"', "`protocol` must be one of pairwise, matched"),
        ("participants = 28", "participants = 0", "`participants` must be a whole number from 1"),
        ("participants = 28", "participants = 28\nlength_s = nan", "`length_s` must be a number"),
        ("participants = 28", 'participants = 28\nviews = ["top"]', "`views` must be a list"),
        ("participants = 28", 'participants = 28\nface = "hidden"', "`face` must be one of still"),
        (
            "participants = 28",
            'participants = 28\npost_to = "ftp://x"',
            "`post_to` must be an http",
        ),
        (
            "participants = 28",
            'participants = 28\nreturn_to = "javascript:alert(1)"',
            "`return_to` must be an http",
        ),
        (
            "participants = 28",
            'participants = 28\npost_to = "https://x.org/;script-src *"',
            "`post_to` must be an http",
        ),
        ("participants = 28", "participants = 28\nreasons = 1", "`reasons` must be true or false"),
        ('name = "theirs"', 'name = "globaldiff/local"', "Two systems of the plan have the name"),
        ('speech = "one.wav"', "", "has no `speech`"),
        ('name = "theirs"', 'name = "a, b"', "no comma or =; 'a, b' is none"),
        ('speech = "one.wav"', 'speech = "one.wav"\nstart_s = -1', "`start_s` must be a number"),
        ("theirs/{clip}.npz", "theirs/one.npz", "must hold {clip}"),
        ('"theirs/{clip}.npz"', '{ two = "x.npz" }', "has no motion for the clip 'one'"),
        ('"theirs/{clip}.npz"', '{ one = "x", two = "y" }', "'two', which is no clip"),
        ('{clip}.npz"', '{clip}.npz"\nseed = 1', "has `motion`, so it cannot have `seed`"),
        ('[[systems]]\nname = "globaldiff/local"\n', "", "compares at least 2 systems"),
        ("[[clips]]", "[[clips", "is no TOML file"),
    ],
)
def test_a_bad_plan_gives_one_sentence(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in MINIMAL
    with pytest.raises(RunError) as caught:
        read(tmp_path, MINIMAL.replace(old, new, 1))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_plan_gives_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="There is no plan at"):
        read_plan(tmp_path / "plan.toml")


def test_matched_speech_needs_a_second_clip(tmp_path: Path) -> None:
    path = write_plan(tmp_path, ["one"], ["only"], 'protocol = "matched"')
    with pytest.raises(RunError, match="at least 2 clips"):
        read_plan(path)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (f"length_s = {'9' * 400}", "`length_s` must be a number"),
        (f"seed = {'9' * 5000}", "too many digits"),
        (f"views = {'[' * 4000}{']' * 4000}", "nested too deeply"),
        (f"a{'.a' * 50_000} = 1", "over 20 parts"),
        ("x = { a" + ' . "a"' * 50_000 + " = 1 }", "over 20 parts"),
    ],
)
def test_what_no_parser_bears_is_refused_at_once(tmp_path: Path, line: str, words: str) -> None:
    start = time.monotonic()
    with pytest.raises(RunError, match=words):
        read(tmp_path, f"{line}\n{MINIMAL}")
    assert time.monotonic() - start < 2


def test_looking_for_deep_keys_takes_no_time(tmp_path: Path) -> None:
    start = time.monotonic()
    for text in ("a" * 900_000, "a." * 450_000, '"' * 900_000, "a \t" * 300_000):
        with pytest.raises(RunError):
            read(tmp_path, text)
    assert time.monotonic() - start < 5


PLANNED_STUDY = """
title = "Timing"
protocol = "ranking"
participants = 4
[[clips]]
name = "one"
speech = "one.wav"
[[systems]]
name = "as planned"
system = "workbench/planned"
[[systems]]
name = "half as many"
system = "workbench/planned"
style = { times = { gestures_per_min = 0.5 } }
[[systems]]
name = "from a file"
system = "workbench/planned"
style = "style.toml"
[[systems]]
name = "by hand"
system = "workbench/planned"
plan = "plans/{clip}.eaf"
"""


def test_a_condition_may_be_a_plan_or_a_change_of_it(tmp_path: Path) -> None:
    (tmp_path / "style.toml").write_text("wrong_words = true")
    plan = read(tmp_path, PLANNED_STUDY)
    styles = [system.generator and system.generator.style for system in plan.systems]
    half, wrong = StyleWish(times={"gestures_per_min": 0.5}), StyleWish(wrong_words=True)
    assert styles == [None, half, wrong, None]
    assert plan.systems[3].plans == {"one": tmp_path / "plans" / "one.eaf"}
    assert plan.systems[0].plans is None


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "gestures_per_min = 0.5",
            "often = 2",
            "the style of 'half as many' cannot be used: `times`",
        ),
        ('"style.toml"', '"none.toml"', "none.toml could not be read: no such file"),
        ("plans/{clip}.eaf", "plans/one.eaf", "the plan of 'by hand' must hold {clip}"),
        ('plan = "plans/{clip}.eaf"', "", "The systems 'as planned' and 'by hand' are the same"),
        ('style = "style.toml"', "style = 3", "`style` must be a text"),
        (
            'system = "workbench/planned"\nplan',
            'system = "globaldiff/full"\nplan',
            "the system 'by hand' performs no plans, so it cannot have `plan`",
        ),
    ],
)
def test_conditions_that_cannot_be_are_refused(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    (tmp_path / "style.toml").write_text("wrong_words = true")
    assert old in PLANNED_STUDY
    with pytest.raises(RunError) as caught:
        read(tmp_path, PLANNED_STUDY.replace(old, new))
    assert words in str(caught.value)
