"""Forged and careless answers are set aside; those of people are not."""

from collections.abc import Callable
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import pytest

from app.study.analyse import analyse
from app.study.statistics.answers import Participant
from app.study.statistics.screening import doubts, screen
from tests.app.study.made import made_files, made_key, made_participants, written_study

KEY = replace(made_key(num_clips=6), video_s=2.0)
PEOPLE = made_participants(KEY, 8)


def each(change: Callable[[int], dict]) -> Callable[[Participant], Participant]:
    """A participant with every answer changed, by its number."""
    return lambda who: replace(
        who,
        answers=tuple(replace(one, **change(number)) for number, one in enumerate(who.answers)),
    )


def always_left(who: Participant) -> Participant:
    return replace(
        who,
        answers=tuple(
            replace(one, value=one.shown[0]) if KEY.trials[one.trial].expected is None else one
            for one in who.answers
        ),
    )


def ended_first(who: Participant) -> Participant:
    return replace(who, finished=who.started - timedelta(seconds=1))


def in_a_minute(who: Participant) -> Participant:
    return replace(who, finished=who.started + timedelta(seconds=60))


def turned_around(who: Participant) -> Participant:
    return replace(who, answers=who.answers[::-1])


def test_nobody_is_doubted_who_answers_as_people_do() -> None:
    assert doubts(PEOPLE, KEY) == {}
    for protocol in ("matched", "ranking", "rating"):
        key = replace(made_key(protocol, num_clips=6), video_s=2.0)
        assert doubts(made_participants(key, 8), key) == {}


@pytest.mark.parametrize(
    ("forge", "words"),
    [
        (ended_first, "finished before"),
        (each(lambda number: {"ms": 1}), "sooner than their videos last"),
        (each(lambda number: {"ms": 1 if number % 5 == 0 else 9_000}), "sooner than"),
        (in_a_minute, "in 60 s from beginning to end"),
        (turned_around, "another order"),
        (always_left, "same place"),
    ],
)
def test_impossible_answers_are_set_aside(
    forge: Callable[[Participant], Participant], words: str
) -> None:
    forged = forge(PEOPLE[3])
    screened = screen([*PEOPLE[:3], forged, *PEOPLE[4:]], KEY)
    assert [one.participant.id for one in screened.set_aside] == [forged.id]
    assert words in screened.set_aside[0].why and len(screened.kept) == 7


def test_copies_are_set_aside_but_the_first() -> None:
    copy = replace(PEOPLE[0], id="another", source="another.json")
    first = PEOPLE[0].source
    assert doubts([*PEOPLE, copy], KEY) == {
        "another": f"the same answers in the same times as {first}"
    }


def test_one_reload_at_a_bad_moment_is_forgiven() -> None:
    hasty = each(lambda number: {"ms": 100 if number == 2 else 9_000})(PEOPLE[0])
    assert doubts([hasty], KEY) == {}


def test_twenty_forged_files_change_nothing_and_the_report_shows_what_they_would(
    tmp_path: Path,
) -> None:
    files = made_files(KEY, 6)
    forged = []
    for number in range(20):
        content = made_files(KEY, 1)[0] | {"participant": f"forged{number}"}
        content["finished"], content["started"] = content["started"], content["finished"]
        for answer in content["answers"]:
            is_check = KEY.trials[answer["trial"]].expected is not None
            wins = next((v for v in answer["shown"] if v.endswith("rival")), None)
            answer |= {"ms": 1} | ({} if is_check or wins is None else {"value": wins})
        forged.append(content)
    key, answers = written_study(tmp_path / "with", KEY, files + forged)
    analyse([answers], key, tmp_path / "with report")
    key, answers = written_study(tmp_path / "clean", KEY, files)
    analyse([answers], key, tmp_path / "clean report")
    assert (tmp_path / "with report" / "results.csv").read_bytes() == (
        tmp_path / "clean report" / "results.csv"
    ).read_bytes()
    report = (tmp_path / "with report" / "report.html").read_text()
    assert "20 finished participants are not in the results" in report
    assert "Results without and with those set aside" in report
    assert "Set aside" not in (tmp_path / "clean report" / "report.html").read_text()
