"""Signed links: made by the command, carried by answers, looked at by the analysis."""

import csv
import io
import json
from collections.abc import Callable
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest

from app.commands.cli import main
from app.study.analyse import analyse
from app.study.design.key import read_key, write_key
from app.study.design.links import list_of, new_secret, token_of
from app.study.design.plan import read_plan
from app.study.export import export_study
from app.study.statistics.answers import Participant, collect
from app.study.statistics.screening import screen
from tests.app.study.made import made_files, made_key, made_participants, written_study
from tests.app.study.made_study import draw_noise, make_study, write_plan

KEY = replace(made_key(num_clips=6), video_s=2.0, link_secret=new_secret())


def signed(key=KEY, count: int = 4) -> list[Participant]:
    """Participants who each came by a link of their own, on the list that goes with it."""
    people = made_participants(key, count)
    numbers = {list_of(key, number): number for number in range(len(key.lists))}
    return [
        replace(one, link=token_of(key, numbers[one.list_number] + len(key.lists) * place))
        for place, one in enumerate(people)
    ]


def test_good_links_count_and_without_a_secret_nobody_needs_one() -> None:
    assert len(screen(signed(), KEY).kept) == 4
    assert len(screen(made_participants(KEY, 4), replace(KEY, link_secret=None)).kept) == 4


@pytest.mark.parametrize(
    ("forge", "words"),
    [
        (lambda token: None, "without a signed link"),
        (lambda token: token[:-1] + "x", "signature of the link is wrong"),
        (lambda token: "9" + token, "signature of the link is wrong"),
        (lambda token: "٣" + token, "signature of the link is wrong"),
        (lambda token: "no token", "signature of the link is wrong"),
        (lambda token: token_of(replace(KEY, link_secret=new_secret()), 0), "is wrong"),
        (lambda token: token_of(replace(KEY, study="0" * 16), 0), "is wrong"),
    ],
)
def test_forged_links_are_set_aside(forge: Callable[[str], str | None], words: str) -> None:
    first, *others = signed()
    assert first.link is not None
    screened = screen([replace(first, link=forge(first.link)), *others], KEY)
    assert [one.participant.id for one in screened.set_aside] == [first.id]
    assert words in screened.set_aside[0].why and len(screened.kept) == 3


def test_a_link_counts_once_for_whoever_finished_first() -> None:
    first, second, *_ = signed()
    assert first.finished is not None
    again = replace(second, list_number=first.list_number, link=first.link, id="thief")
    again = replace(again, answers=first.answers, finished=first.finished + timedelta(hours=1))
    (aside,) = screen([again, first], KEY).set_aside
    assert aside.participant.id == "thief" and f"used by {first.source} before" in aside.why


@pytest.mark.parametrize("finishes", [True, False])
@pytest.mark.parametrize("link", [None, "0-" + 32 * "0"])
def test_a_forged_ballot_of_a_later_time_displaces_no_signed_one(
    link: str | None, finishes: bool, tmp_path: Path
) -> None:
    """Someone sends other answers under the name of a participant, an hour after them."""
    files = made_files(KEY, 3)
    forged = {**files[0], "link": link, "answers": files[0]["answers"][:10]}
    forged["finished"] = "2100-01-01T00:00:00+00:00"
    if not finishes:
        files[0]["finished"] = None
    _, folder = written_study(tmp_path, KEY, files)
    (folder / "forged.json").write_text(json.dumps(forged))
    collected = collect([folder], KEY)
    kept = {one.id: one for one in collected.participants}
    assert len(kept) == 3 and kept[files[0]["participant"]].link == files[0]["link"]
    (sentence,) = collected.left_out
    assert sentence.startswith("forged.json is left out") and "a signed link" in sentence
    assert len(screen(collected.participants, KEY).kept) == 3 - (not finishes)


def test_a_link_is_good_for_its_own_list() -> None:
    first, *_ = signed()
    number = next(n for n in range(9) if list_of(KEY, n) != first.list_number)
    (aside,) = screen([replace(first, link=token_of(KEY, number))], KEY).set_aside
    assert "another list" in aside.why


def test_simulated_raters_come_by_links_and_the_report_counts_who_did_not(tmp_path: Path) -> None:
    files = made_files(KEY, 6)
    for content in files[:2]:
        del content["link"]
    key, answers = written_study(tmp_path, KEY, files)
    analyse([answers], key, tmp_path / "report")
    report = (tmp_path / "report" / "report.html").read_text()
    assert "2 finished participants are not in the results" in report
    assert report.count("came without a signed link") == 2


def test_the_command_gives_the_same_links_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "study" / "researcher_only" / "key.json"
    path.parent.mkdir(parents=True)
    write_key(replace(KEY, link_secret=None), path)
    command = ["study", "links", str(tmp_path / "study"), "--address", "https://lab.example/s/"]
    assert main([*command, "--participants", "5"]) == 0
    first = capsys.readouterr().out
    assert main([*command, "--participants", "5"]) == 0
    assert capsys.readouterr().out == first
    key = read_key(path)
    rows = list(csv.DictReader(io.StringIO(first)))
    assert [row["participant"] for row in rows] == list("01234")
    for number, row in enumerate(rows):
        query = parse_qs(urlsplit(row["link"]).query)
        assert query == {"p": [row["list"]], "t": [token_of(key, number)]}
    assert path.stat().st_mode & 0o777 == 0o600 and str(key.link_secret) not in first
    assert main([*command[:-1], "lab.example"]) != 0
    assert main([*command, "--participants", "0"]) != 0


def test_an_export_that_goes_on_keeps_the_secret(tmp_path: Path) -> None:
    systems, clips = ["localnet", "globalnet"], ["kitchen"]
    make_study(tmp_path, systems, clips)
    path = tmp_path / "study" / "researcher_only" / "key.json"
    assert main(["study", "links", str(tmp_path / "study"), "--address", "https://a.example/"]) == 0
    before = path.read_bytes()
    export_study(
        read_plan(write_plan(tmp_path, systems, clips)), tmp_path / "study", draw=draw_noise
    )
    assert path.read_bytes() == before and read_key(path).link_secret is not None
