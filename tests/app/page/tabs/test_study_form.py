"""What the page's tab is given becomes the plan that the command line reads."""

from dataclasses import replace
from pathlib import Path

import pytest

from app.errors import RunError
from app.page.tabs.study_run import (
    PROTOCOLS,
    QUESTIONS,
    StudyForm,
    collect_files,
    plan_text,
)
from app.study.design.plan import read_plan
from model.plan.style import StyleWish
from model.systems.planned.config import PLANNED

FORM = StudyForm(
    title='A "title" with\nlines',
    protocol="ranking",
    speeches=["/cache/1/one.wav", "/cache/2/two.wav"],
    systems=["globaldiff/local"],
    motions=["/cache/3/theirs--one.npz", "/cache/4/theirs--two.npz"],
    length_s=8,
    participants=12,
    seed=3,
    views=["front", "side"],
    post_to="",
)


def test_the_form_becomes_a_plan(tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    path.write_text(plan_text(FORM), "utf-8")
    plan = read_plan(path)
    assert plan.title == FORM.title
    assert (plan.protocol, plan.participants, plan.seed) == ("ranking", 12, 3)
    assert (plan.length_s, plan.views) == (8.0, ("front", "side"))
    assert [clip.speech for clip in plan.clips] == [tmp_path / "one.wav", tmp_path / "two.wav"]
    assert plan.systems[1].motions == {
        "one": tmp_path / "theirs--one.npz",
        "two": tmp_path / "theirs--two.npz",
    }


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"speeches": None}, "There is no speech yet"),
        ({"length_s": None}, "The length of the videos is missing"),
        ({"motions": ["/cache/one.npz"]}, "must be named <system>--<clip>.npz"),
        ({"length_s": 300}, "40 minutes of video; the page makes at most 30"),
        ({"speeches": [f"/cache/{i}.wav" for i in range(61)]}, "At most 60 files"),
    ],
)
def test_what_is_missing_is_said(changes: dict, words: str) -> None:
    with pytest.raises(RunError) as caught:
        plan_text(replace(FORM, **changes))
    assert words in str(caught.value)


def test_what_a_program_leaves_out_is_as_if_empty(tmp_path: Path) -> None:
    bare = replace(FORM, title=None, seed=None, post_to=None)
    (tmp_path / "plan.toml").write_text(plan_text(bare), "utf-8")
    plan = read_plan(tmp_path / "plan.toml")
    assert (plan.seed, plan.post_to, plan.return_to) == (0, None, None)


def test_a_completion_link_comes_into_the_plan(tmp_path: Path) -> None:
    link = "https://app.prolific.com/submissions/complete?cc=C0DE"
    (tmp_path / "plan.toml").write_text(plan_text(replace(FORM, return_to=f" {link} ")), "utf-8")
    assert read_plan(tmp_path / "plan.toml").return_to == link


@pytest.mark.parametrize("question", QUESTIONS)
def test_changes_of_gestures_become_systems(tmp_path: Path, question: str) -> None:
    protocol, changed = QUESTIONS[question]
    form = StudyForm.of(
        [*("t", protocol, ["/cache/one.wav", "/cache/two.wav"], [PLANNED], None, 8, 4, 0),
         ["front"], "", "", changed]
    )  # fmt: skip
    (tmp_path / "plan.toml").write_text(plan_text(form), "utf-8")
    plan = read_plan(tmp_path / "plan.toml")
    assert plan.protocol == PROTOCOLS[protocol] and plan.has_sound
    found = {each.name: each.generator for each in plan.systems}
    assert list(found) == [PLANNED, *(f"{PLANNED} {name}" for name in changed)]
    assert {each.system for each in found.values() if each} == {PLANNED}
    styles = [each.style for each in found.values() if each]
    assert styles[0] is None and all(each not in (None, StyleWish()) for each in styles[1:])


def test_a_change_that_there_is_not_is_refused_and_each_counts_as_a_system() -> None:
    with pytest.raises(RunError, match="There is no change 'slower'; there are on wrong words, "):
        plan_text(replace(FORM, changed=["slower"]))
    with pytest.raises(RunError, match="36 minutes of video"):
        plan_text(replace(FORM, length_s=135, changed=["smaller", "larger"]))


def test_a_text_cannot_become_settings(tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    path.write_text(plan_text(replace(FORM, title='x"\nface = "moving"\ny = "')), "utf-8")
    assert read_plan(path).face == "still"


def test_uploads_are_put_beside_the_plan(tmp_path: Path) -> None:
    uploads = []
    for number, name in enumerate(("one.wav", "one.wav")):
        (tmp_path / str(number)).mkdir()
        uploads.append(tmp_path / str(number) / name)
        uploads[-1].write_bytes(b"sound")
    out = tmp_path / "out"
    out.mkdir()
    form = replace(FORM, motions=None)
    collect_files(replace(form, speeches=[str(uploads[0])]), out)
    assert (out / "one.wav").read_bytes() == b"sound"
    with pytest.raises(RunError, match=r"Two uploads have the name one\.wav"):
        collect_files(replace(form, speeches=[str(uploads[1])]), out)
