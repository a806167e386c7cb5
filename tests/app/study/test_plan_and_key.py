"""Plans and keys: what is read, and one clear sentence for everything that cannot be."""

import json
from pathlib import Path

import pytest

from app.errors import RunError
from app.study.design.key import read_key, write_key
from app.study.design.plan import Condition, StudyPlan, read_study_plan
from model.plan.style import StyleChange
from tests.app.study.made import made_key

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


KEY = made_key()


def read(folder: Path, text: str) -> StudyPlan:
    (folder / "style.toml").write_text("wrong_words = true")
    (folder / "plan.toml").write_text(text)
    return read_study_plan(folder / "plan.toml")


def test_a_minimal_plan_has_sensible_defaults(tmp_path):
    plan = read(tmp_path, MINIMAL)
    assert (plan.views, plan.video_s, plan.video_size_px, plan.face) == (
        ("front",),
        None,
        512,
        "still",
    )
    assert (plan.attention_checks, plan.max_failed, plan.has_sound) == (None, None, False)
    assert plan.clips[0].speech == tmp_path / "one.wav"
    local = "globaldiff/local"
    assert plan.conditions[0] == Condition(local, system=local, steps=10, sampler="euler")
    assert plan.conditions[1].motion == {"one": tmp_path / "theirs" / "one.npz"}
    by_clip = MINIMAL.replace('motion = "theirs/{clip}.npz"', 'motion = { one = "a b.npz" }')
    assert read(tmp_path, by_clip).conditions[1].motion == {"one": tmp_path / "a b.npz"}


def test_one_system_can_take_part_with_several_settings(tmp_path):
    text = MINIMAL + '[[systems]]\nname = "smoothed"\nsystem = "globaldiff/local"\n'
    plan = read(tmp_path, text + 'post_filter = "savgol"\nseed = 3\n')
    third = plan.conditions[2]
    assert (third.system, third.seed, third.post_filter) == ("globaldiff/local", 3, "savgol")
    with pytest.raises(RunError, match=r"'globaldiff/local' and 'smoothed' have the same settings"):
        read(tmp_path, text)


def test_a_condition_may_be_a_plan_or_a_change_of_it(tmp_path):
    plan = read(tmp_path, PLANNED_STUDY)
    styles = [system.style for system in plan.conditions]
    half, wrong = StyleChange(factors={"gestures_per_min": 0.5}), StyleChange(is_misaligned=True)
    assert styles == [None, half, wrong, None]
    plans = [system.plan for system in plan.conditions]
    assert plans == [None, None, None, {"one": tmp_path / "plans" / "one.eaf"}]


PEOPLE = "participants = 28"
BAD_PLANS = [
    ('title = "T"', "", "`title`"),
    ('title = "T"', 'titel = "T"', "`titel` is not a known key"),
    (
        '"pairwise"',
        '"beauty"',
        "`protocol` cannot be 'beauty': input should be 'pairwise', 'matched'",
    ),
    ('"pairwise"', '"matched"', "at least 2 clips"),
    (PEOPLE, f"{PEOPLE}\nlength_s = nan", "`length_s` cannot be nan"),
    (PEOPLE, f'{PEOPLE}\npanel_ids = ["t"]', "'t', which is a URL parameter of the page"),
    (PEOPLE, f'{PEOPLE}\npanel_ids = ["a", "a"]', "`panel_ids` contains 'a' twice"),
    (PEOPLE, f'{PEOPLE}\npanel_ids = ["a b"]', "`panel_ids.0` cannot be 'a b'"),
    (PEOPLE, f'{PEOPLE}\nreturn_to = "javascript:alert(1)"', "is not a valid URL"),
    (PEOPLE, f'{PEOPLE}\npost_to = "https://x.org/;script-src *"', "is not a valid URL"),
    ('name = "theirs"', 'name = "globaldiff/local"', "two systems have the name"),
    ('speech = "one.wav"', "", "has no `speech`"),
    ('name = "theirs"', 'name = "a, b"', "without commas or equals signs"),
    ("theirs/{clip}.npz", "theirs/one.npz", "`motion` must be a path with {clip}"),
    ('"theirs/{clip}.npz"', '{ two = "x.npz" }', "has no path for the clip 'one'"),
    ('"theirs/{clip}.npz"', '{ one = "x", two = "y" }', "'two', which is not a clip"),
    (
        '{clip}.npz"',
        '{clip}.npz"\nseed = 1',
        "has motion files (`motion`), so it cannot have `seed`",
    ),
    ('[[systems]]\nname = "globaldiff/local"\n', "", "needs at least 2 systems"),
    ("[[clips]]", "[[clips", "is not a TOML file"),
    (PEOPLE, f"{PEOPLE}\nlength_s = {'9' * 400}", "`length_s` cannot be 999"),
    (PEOPLE, f"{PEOPLE}\nseed = {'9' * 5000}", "is not a TOML file: Exceeds the limit"),
    (PEOPLE, f"{PEOPLE}\nviews = {'[' * 4000}{']' * 4000}", "is not a TOML file: tables or arrays"),
    (PEOPLE, f"{PEOPLE}\n{'a.' * 50_000}b = 1", "is not a TOML file: a key has more than 32 parts"),
    (PEOPLE, f"{PEOPLE}\n#{'a' * 2**21}", "plan.toml is larger than the limit of 2 MiB"),
]
BAD_CONDITIONS = [
    (
        "gestures_per_min = 0.5",
        "often = 2",
        "`style` of 'half as many' cannot be used: `times`",
    ),
    ('"style.toml"', '"none.toml"', "none.toml could not be read: no such file"),
    ("plans/{clip}.eaf", "plans/one.eaf", "`plan` must be a path with {clip}"),
    ('plan = "plans/{clip}.eaf"', "", "'as planned' and 'by hand' have the same settings"),
    ('style = "style.toml"', "style = 3", "`style` must name a file"),
    (
        'system = "workbench/planned"\nplan',
        'system = "globaldiff/full"\nplan',
        "the system 'by hand' does not follow gesture plans, so it cannot have `plan`",
    ),
]


@pytest.mark.parametrize(
    ("text", "old", "new", "words"),
    [(MINIMAL, *case) for case in BAD_PLANS] + [(PLANNED_STUDY, *case) for case in BAD_CONDITIONS],
)
def test_a_bad_plan_gives_one_sentence(tmp_path, text, old, new, words):
    assert old in text
    with pytest.raises(RunError) as caught:
        read(tmp_path, text.replace(old, new, 1))
    assert words in str(caught.value) and "\n" not in str(caught.value)
    with pytest.raises(RunError, match="There is no study plan at"):
        read_study_plan(tmp_path / "none.toml")


def test_a_key_that_is_written_reads_back_the_same_is_private_and_of_the_agreed_form(tmp_path):
    path = tmp_path / "key.json"
    with pytest.raises(RunError, match=r"There is no file .*key.json"):
        read_key(path)
    write_key(KEY, path)
    assert read_key(path) == KEY
    assert path.stat().st_mode & 0o777 == 0o600
    assert [file.name for file in tmp_path.iterdir()] == ["key.json"]
    written = json.loads(path.read_text("utf-8"))
    assert (written["format"], written["attention_rule"]) == (1, {"max_failed": 1})
    assert list(written["lists"]) == ["0", "1", "2", "3"] and "link_secret" not in written
    assert "expected" not in written["trials"]["clip0/0"]
    assert written["trials"]["check0"]["expected"] == {"question": "c", "value": "left"}
    assert written["videos"]["clip0-local"]["speech"] is None


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (lambda key: key.update(systems=["local"] * 3), "different names"),
        (lambda key: key.update(systems=["global"]), "'local', which is not a system of the study"),
        (lambda key: key["videos"].pop("clip0-local"), "shows a video that is not in the key"),
        (lambda key: key["trials"].pop("clip0/0"), "list 0 contains a trial"),
        (
            lambda key: key["trials"]["check0"].pop("expected"),
            "check0 has no expected answer",
        ),
        (lambda key: key["trials"]["clip0/0"].update(questions=["x"]), "asks a question"),
        (lambda key: key.update(lists={"one": []}), "`lists.one.[key]` cannot be 'one'"),
        (lambda key: key.update(title="\ud800"), "not a valid JSON file"),
    ],
)
def test_a_key_that_contradicts_itself_is_refused(tmp_path, edit, says):
    path = tmp_path / "key.json"
    write_key(KEY, path)
    values = json.loads(path.read_text())
    edit(values)
    path.write_text(json.dumps(values))
    with pytest.raises(RunError, match="not a valid study key") as refusal:
        read_key(path)
    assert says in str(refusal.value)
