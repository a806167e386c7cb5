from dataclasses import replace

import pytest

from app.study.design.key import Expected, Key
from app.study.statistics.answers import Participant
from app.study.statistics.screening import failed_checks, screen
from tests.app.study.made import LEFT_CHECK, made_key, made_participants

KEY = made_key()


def with_checks(key: Key, *values: object) -> Participant:
    """A participant who answered the checks so; None leaves one unanswered."""
    (whole,) = made_participants(key, 1)
    others = tuple(answer for answer in whole.answers if not answer.trial.startswith("check"))
    (check,) = (answer for answer in whole.answers if answer.trial == "check0")
    given = tuple(
        replace(check, trial=f"check{number}", value=value)
        for number, value in enumerate(values)
        if value is not None
    )
    return replace(whole, answers=others + given)


@pytest.mark.parametrize(
    ("values", "failed"),
    [(("left", "left"), 0), (("left", "right"), 1), (("tie", "right"), 2), (("left", None), 1)],
)
def test_checks_count_as_failed_when_wrong_or_missing(
    values: tuple[object, ...], failed: int
) -> None:
    participant = with_checks(KEY, *values)
    assert failed_checks(participant, KEY) == failed
    assert bool(screen([participant], KEY).kept) == (failed <= 1)


def test_the_rule_of_the_key_decides_and_is_told() -> None:
    (dropped,) = screen([with_checks(KEY, "tie", "tie")], KEY).dropped
    assert dropped.why == "attention checks: 2 failed, 1 allowed"
    assert screen([with_checks(KEY, "tie", "tie")], replace(KEY, max_failed=2)).kept


def test_half_finished_participants_are_listed_and_not_counted() -> None:
    half = replace(with_checks(KEY, "left", None), finished=None)
    screened = screen([half, with_checks(KEY, "left", "left")], KEY)
    assert [dropped.why for dropped in screened.dropped] == ["not finished (13 of 14 trials)"]
    assert len(screened.kept) == 1


@pytest.mark.parametrize(
    ("protocol", "given", "is_failed"),
    [
        ("rating", 75, False),
        ("rating", 76, True),
        ("rating", True, True),
        ("rating", "70", True),
        ("pairwise", 70, False),
        ("pairwise", 71, True),
    ],
)
def test_a_slider_may_stand_a_little_off(protocol: str, given: object, is_failed: bool) -> None:
    key = made_key(protocol)
    check = replace(LEFT_CHECK, expected=Expected("c", 70))
    key = replace(key, trials={**key.trials, "check0": check, "check1": check})
    assert failed_checks(with_checks(key, given, 70), key) == is_failed
