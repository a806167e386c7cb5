"""Whose answers count: damaged, edited, forged and careless ones are left out, each told why."""

import csv
import io
import json
import re
import secrets
from collections.abc import Callable
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest

from app.commands.cli import main
from app.errors import RunError
from app.study.analyse import AnalysisRequest, analyse
from app.study.design.key import AttentionRule, ExpectedAnswer, StudyKey, read_key, write_key
from app.study.statistics.answers import MAX_FILE_BYTES, TIE, Answer, Participant, collect_answers
from app.study.statistics.results import analyse_participants
from app.study.statistics.screening import failed_checks, implausibility_reasons, screen
from tests.app.study.made import (
    LEFT_CHECK,
    made_files,
    made_key,
    made_participants,
    written_study,
)
from tests.helpers import csv_rows

KEY = made_key()
LONG = replace(made_key(num_clips=6), video_s=2.0)
LINKED = replace(LONG, link_secret=secrets.token_hex(32))
PEOPLE = made_participants(LONG, 8)
Forge = Callable[[Participant], Participant]


def edited(
    tmp_path: Path, edit: Callable[[dict[str, Any]], object], protocol: str = "pairwise"
) -> tuple[list[int], tuple[str, ...]]:
    """Numbers of answers that remain, and the sentences, after the first of two files is edited."""
    key = made_key(protocol)
    files = made_files(key, 2)
    files[0]["participant"] = "edited"
    edit(files[0])
    _, folder = written_study(tmp_path, key, files)
    collected = collect_answers([folder], key)
    return [len(one.answers) for one in collected.participants], collected.left_out_sentences


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ({"study": "f" * 16}, "it belongs to another study."),
        ({"list": 99}, "the study has no participant list 99."),
        ({"finished": "yesterday"}, "`finished` cannot be 'yesterday'"),
        ({"answers": [{}] * 10_001}, "`answers` must be a list of at most 10000"),
        (b'{"format": 1, "study"', "it is not a valid JSON file (cut off or damaged)."),
        (b"", "it is not a valid JSON file (cut off or damaged)."),
        (b"[" * 50_000, "it is nested too deeply."),
        (b" " * (MAX_FILE_BYTES + 1), "it is larger than the limit of 4,194,304 bytes."),
    ],
)
def test_a_file_that_cannot_be_used_costs_one_sentence_and_nothing_else(
    tmp_path: Path, content: dict[str, Any] | bytes, says: str
) -> None:
    good, bad = made_files(KEY, 2)
    _, folder = written_study(tmp_path, KEY, [good])
    written = content if isinstance(content, bytes) else json.dumps(bad | content).encode()
    (folder / "bad.json").write_bytes(written)
    collected = collect_answers([folder], KEY)
    assert len(collected.participants) == 1 and len(collected.left_out_sentences) == 1
    assert collected.left_out_sentences[0].startswith(f"bad.json is left out: {says}")
    with pytest.raises(RunError, match="does not exist; give answer files"):
        collect_answers([tmp_path / "none"], KEY)


def rated(number: object) -> dict[str, Any]:
    return {"value": {"clip0-local": 3, "clip0-global": number, "clip0-rival": 0}}


@pytest.mark.parametrize(
    ("protocol", "edit", "says"),
    [
        ("pairwise", {"value": "clip3-rival"}, "the chosen video was not shown (1)"),
        ("pairwise", {"trial": "clip9/0"}, "the trial is not on the participant's list"),
        (
            "pairwise",
            {"question": "beauty"},
            "the answered question is not part of the trial",
        ),
        ("pairwise", {"watched": 0}, "a video was not watched to its end"),
        ("pairwise", {"trial": "clip0/1"}, "the videos shown are not those of the trial"),
        ("pairwise", {"reasons": "smoothness"}, "`reasons` cannot be 'smoothness'"),
        ("ranking", {"value": ["clip0-local"] * 3}, "does not contain each video exactly once"),
        ("ranking", {"value": [1, 2, 3]}, "does not contain each video exactly once"),
        ("rating", {"value": {"clip0-local": 3}}, "the rated videos are not those that were shown"),
        ("rating", rated(10**400), "a rating is not between 0 and 100"),
        ("rating", rated(True), "a rating is not between 0 and 100"),
    ],
)
def test_an_edited_answer_is_left_out_and_the_others_count(
    tmp_path: Path, protocol: str, edit: dict[str, Any], says: str
) -> None:
    whole = 14 if protocol == "pairwise" else 6
    counts, left_out = edited(tmp_path, lambda file: file["answers"][0].update(edit), protocol)
    assert counts == [whole - 1, whole]
    assert len(left_out) == 1
    assert left_out[0].startswith(f"edited.json: 1 of {whole} answers is left out: ")
    assert says in left_out[0]


def test_the_same_question_answered_twice_counts_once_as_first_given(tmp_path: Path) -> None:
    def double(file: dict[str, Any]) -> None:
        file["answers"].append(file["answers"][0] | {"value": "tie"})

    counts, left_out = edited(tmp_path, double)
    assert counts == [14, 14] and "the question was answered before (1)" in left_out[0]


def test_of_doubles_the_finished_then_the_later_counts(tmp_path: Path) -> None:
    first, second, half = made_files(KEY, 3)
    for file in (first, second, half):
        file["participant"] = "same"
    second["finished"] = "2030-01-01T00:00:00Z"
    half.update(finished=None, started="2031-01-01T00:00:00")
    _, folder = written_study(tmp_path, KEY, [])
    for name, file in (("a", first), ("b", second), ("c", half)):
        (folder / f"{name}.json").write_text(json.dumps(file))
    collected = collect_answers([folder], KEY)
    assert [one.file_name for one in collected.participants] == ["b.json"]
    assert collected.left_out_sentences == (
        "a.json is left out: its participant also sent b.json, which is more recent.",
        "c.json is left out: its participant also sent b.json, which is finished.",
    )


def with_checks(key: StudyKey, *values: object) -> Participant:
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


def test_checks_count_as_failed_when_wrong_or_missing() -> None:
    for values, failed in [
        (("left", "left"), 0),
        (("left", "right"), 1),
        (("tie", "right"), 2),
        (("left", None), 1),
    ]:
        participant = with_checks(KEY, *values)
        assert failed_checks(participant, KEY) == failed
        assert bool(screen([participant], KEY).included) == (failed <= 1)


def test_the_rule_of_the_key_decides_and_the_half_finished_are_listed() -> None:
    careless = with_checks(KEY, "tie", "tie")
    half = replace(with_checks(KEY, "left", None), finished=None)
    screened = screen([careless, half, with_checks(KEY, "left", "left")], KEY)
    assert [dropped.reason for dropped in screened.excluded] == [
        "attention checks: 2 failed, 1 allowed",
        "not finished (13 of 14 trials)",
    ]
    assert len(screened.included) == 1
    assert screen([careless], replace(KEY, attention_rule=AttentionRule(2))).included


def test_a_slider_may_stand_a_little_off() -> None:
    for protocol, given, is_failed in [
        ("rating", 75, False),
        ("rating", 76, True),
        ("rating", True, True),
        ("rating", "70", True),
        ("pairwise", 70, False),
        ("pairwise", 71, True),
    ]:
        key = made_key(protocol)
        check = replace(LEFT_CHECK, expected=ExpectedAnswer("c", 70))
        key = replace(key, trials={**key.trials, "check0": check, "check1": check})
        assert failed_checks(with_checks(key, given, 70), key) == is_failed


def each(change: Callable[[int], dict]) -> Forge:
    """A participant with every answer changed, by its number."""
    return lambda who: replace(
        who,
        answers=tuple(replace(one, **change(number)) for number, one in enumerate(who.answers)),
    )


def always(of: Callable[[Answer], object], num_failed: int = 0) -> Forge:
    """A participant whose answers are all of one kind, with so many attention checks failed."""

    def forge(who: Participant) -> Participant:
        checks = [one.trial for one in who.answers if LONG.trials[one.trial].expected is not None]
        answers = (
            replace(one, value=of(one))
            if one.trial not in checks
            else replace(one, value="missed" if one.trial in checks[:num_failed] else one.value)
            for one in who.answers
        )
        return replace(who, answers=tuple(answers))

    return forge


def left(answer: Answer) -> object:
    return answer.videos[0]


def left_and_hasty_once(who: Participant) -> Participant:
    first = next(one for one in who.answers if LONG.trials[one.trial].expected is None)
    same = always(left)(who)
    return replace(
        same,
        answers=tuple(
            replace(one, page_ms=1) if one.trial == first.trial else one for one in same.answers
        ),
    )


def test_nobody_is_doubted_who_answers_as_people_do() -> None:
    assert implausibility_reasons(PEOPLE, LONG) == {}
    for protocol in ("matched", "ranking", "rating"):
        key = replace(made_key(protocol, num_clips=6), video_s=2.0)
        assert implausibility_reasons(made_participants(key, 8), key) == {}


def test_ties_are_answers_and_sameness_alone_is_no_evidence_of_not_looking() -> None:
    ties: Callable[[Answer], object] = lambda answer: TIE  # noqa: E731
    for forge in (always(ties), always(ties, num_failed=1), always(left)):
        honest = forge(PEOPLE[3])
        assert screen([honest, *PEOPLE[4:]], LONG).included[0] == honest
    rating = replace(made_key("rating", num_clips=10), video_s=2.0)
    (rater,) = made_participants(rating, 1)
    equal = tuple(
        replace(one, value=dict.fromkeys(one.videos, 50)) if isinstance(one.value, dict) else one
        for one in rater.answers
    )
    assert implausibility_reasons([replace(rater, answers=equal)], rating) == {}


def test_impossible_answers_are_set_aside() -> None:
    for forge, words in [
        (
            lambda who: replace(who, finished=who.started - timedelta(seconds=1)),
            "the end time",
        ),
        (each(lambda number: {"ms": 1}), "in less time than the videos last"),
        (
            each(lambda number: {"ms": 1 if number % 5 == 0 else 9_000}),
            "4 of 18 trials answered in less time",
        ),
        (lambda who: replace(who, finished=who.started + timedelta(seconds=60)), "only 60 s from"),
        (lambda who: replace(who, answers=who.answers[::-1]), "a different order"),
        (
            always(left, num_failed=1),
            "every trial; also 1 attention check failed",
        ),
        (
            left_and_hasty_once,
            "every trial; also 1 of 18 trials answered in less time",
        ),
    ]:
        forged = forge(PEOPLE[3])
        screened = screen([*PEOPLE[:3], forged, *PEOPLE[4:]], LONG)
        assert [one.participant.id for one in screened.implausible] == [forged.id]
        assert words in screened.implausible[0].reason and len(screened.included) == 7


def test_copies_are_set_aside_but_the_first_and_one_bad_reload_is_forgiven() -> None:
    copy = replace(PEOPLE[0], id="another", file_name="another.json")
    found = implausibility_reasons([*PEOPLE, copy], LONG)
    assert found == {"another": f"the same answers and response times as {PEOPLE[0].file_name}"}
    hasty = each(lambda number: {"ms": 100 if number == 2 else 9_000})(PEOPLE[0])
    assert implausibility_reasons([hasty], LONG) == {}


def test_twenty_forged_files_change_nothing_and_the_report_shows_what_they_would(
    tmp_path: Path,
) -> None:
    files = made_files(LONG, 6)
    forged = []
    for number in range(20):
        content = made_files(LONG, 1)[0] | {"participant": f"forged{number}"}
        content["finished"], content["started"] = content["started"], content["finished"]
        for answer in content["answers"]:
            is_check = LONG.trials[answer["trial"]].expected is not None
            wins = next((v for v in answer["shown"] if v.endswith("rival")), None)
            answer |= {"ms": 1} | ({} if is_check or wins is None else {"value": wins})
        forged.append(content)
    pages, tables = {}, {}
    for name, sent in (("with", files + forged), ("clean", files)):
        key, answers = written_study(tmp_path / name, LONG, sent)
        analyse(AnalysisRequest([answers], key, tmp_path / name / "report"))
        pages[name] = (tmp_path / name / "report" / "report.html").read_text()
        tables[name] = (tmp_path / name / "report" / "results.csv").read_bytes()
    assert tables["with"] == tables["clean"]
    assert "20 participants who finished are excluded as implausible" in pages["with"]
    assert "Results without and with the participants excluded as implausible" in pages["with"]
    assert "Implausible answers" not in pages["clean"]


def test_a_skipped_page_is_no_vote_and_no_reason_to_doubt_and_the_report_counts_it(
    tmp_path: Path,
) -> None:
    files = made_files(LONG, 6)
    files[0] = files[0] | {"answers": [{**one} for one in files[0]["answers"]]}
    judged = [one for one in files[0]["answers"] if LONG.trials[one["trial"]].expected is None]
    for answer in judged[:4]:
        answer |= {"value": None, "ms": 900, "watched": 0, "skipped": answer["shown"][0]}
    judged[4] |= {"value": None, "skipped": "another"}
    key_path, folder = written_study(tmp_path, LONG, files)
    collected = collect_answers([folder], LONG)
    assert "the skipped video was not shown (1)" in collected.left_out_sentences[0]
    screened = screen(collected.participants, LONG)
    assert len(screened.included) == 6
    (result,) = analyse_participants(screened.included, LONG)
    assert result.num_answers == 6 * len(judged) - 5
    analyse(AnalysisRequest([folder], key_path, tmp_path / "report"))
    page = (tmp_path / "report" / "report.html").read_text("utf-8")
    assert "4 pages of 1 included participant were skipped" in page
    rows = csv_rows(tmp_path / "report" / "participants.csv")
    assert sorted(row["skipped"] for row in rows) == ["0"] * 5 + ["4"]


def test_ids_of_a_panel_are_those_the_plan_names_and_each_person_counts_once(
    tmp_path: Path,
) -> None:
    key = replace(LONG, panel_id_names=("PROLIFIC_PID", "STUDY_ID"))
    files = made_files(key, 4)
    for number, file in enumerate(files[:3]):
        file["panel"] = {"PROLIFIC_PID": f"abc{number % 2}", "email": "person"}
    files[3]["panel"] = {"PROLIFIC_PID": "a b <script>"}
    files[0]["finished"] = "2030-01-01T00:00:00Z"  # later than the other one of that id
    key_path, folder = written_study(tmp_path, key, files)
    assert read_key(key_path) == key
    collected = collect_answers([folder], key)
    sentence = collected.left_out_sentences[0]
    assert sentence.startswith("simulated00003.json is left out: `panel.PROLIFIC_PID`")
    assert [one.panel_values for one in collected.participants] == [
        {"PROLIFIC_PID": "abc0"},
        {"PROLIFIC_PID": "abc1"},
        {"PROLIFIC_PID": "abc0"},
    ]
    (aside,) = screen(collected.participants, key).implausible
    assert aside.participant.file_name == "simulated00000.json"
    assert "the same PROLIFIC_PID as simulated00002.json" in aside.reason
    analyse(AnalysisRequest([folder], key_path, tmp_path / "report"))
    report = tmp_path / "report"
    assert "abc0" not in (report / "report.html").read_text("utf-8")  # it may be passed on
    rows = csv_rows(report / "participants.csv")
    assert [(row["PROLIFIC_PID"], row["included"]) for row in rows] == [
        ("abc1", "yes"),
        ("abc0", "yes"),
        ("abc0", "implausible"),
    ]


def signed(key: StudyKey = LINKED, count: int = 4) -> list[Participant]:
    """Participants who each came by a link of their own, on the list that goes with it."""
    people = made_participants(key, count)
    numbers = {key.list_number_of(number): number for number in range(len(key.lists))}
    return [
        replace(one, link_token=key.token(numbers[one.list_number] + len(key.lists) * place))
        for place, one in enumerate(people)
    ]


def test_good_links_count_and_without_a_secret_nobody_needs_one() -> None:
    assert len(screen(signed(), LINKED).included) == 4
    assert re.fullmatch("17-[0-9a-f]{32}", LINKED.token(17)), "128 bits, or it can be guessed"
    assert (
        len(screen(made_participants(LINKED, 4), replace(LINKED, link_secret=None)).included) == 4
    )


def test_forged_links_are_set_aside() -> None:
    for forge, words in [
        (lambda token: None, "without a signed link"),
        (lambda token: token[:-1] + "x", "signature of the link is invalid"),
        (lambda token: "9" + token, "signature of the link is invalid"),
        (lambda token: "٣" + token, "signature of the link is invalid"),
        (lambda token: "no token", "signature of the link is invalid"),
        (lambda token: "0-é", "signature of the link is invalid"),
        (lambda token: replace(LINKED, link_secret=secrets.token_hex(32)).token(0), "is invalid"),
        (lambda token: replace(LINKED, study_id="0" * 16).token(0), "is invalid"),
    ]:
        first, *others = signed()
        assert first.link_token is not None
        screened = screen([replace(first, link_token=forge(first.link_token)), *others], LINKED)
        assert [one.participant.id for one in screened.implausible] == [first.id]
        assert words in screened.implausible[0].reason and len(screened.included) == 3


def test_a_link_counts_once_and_for_its_own_list_and_an_earlier_time_displaces_nobody() -> None:
    first, *others = signed()
    assert first.finished is not None
    hour = timedelta(hours=1)
    copy = replace(first, id="thief", started=first.started - hour, finished=first.finished - hour)
    (aside,) = screen([first, copy, *others], LINKED).implausible
    assert aside.participant is copy and f"also used for {first.file_name}" in aside.reason
    answer, *rest = copy.answers
    forged = replace(copy, file_name="forged.json", answers=(replace(answer, value="tie"), *rest))
    screened = screen([first, forged, *others], LINKED)
    assert [one.participant for one in screened.implausible] == [first, forged]
    assert "also used for forged.json" in screened.implausible[0].reason
    assert list(screened.included) == others
    number = next(n for n in range(9) if LINKED.list_number_of(n) != first.list_number)
    (aside,) = screen([replace(first, link_token=LINKED.token(number))], LINKED).implausible
    assert "another list" in aside.reason


@pytest.mark.parametrize("finishes", [True, False])
@pytest.mark.parametrize("link", [None, "0-" + 32 * "0"])
def test_a_forged_ballot_of_a_later_time_displaces_no_signed_one(
    link: str | None, finishes: bool, tmp_path: Path
) -> None:
    """Someone sends other answers under the name of a participant, an hour after them."""
    files = made_files(LINKED, 3)
    forged = {**files[0], "link": link, "answers": files[0]["answers"][:10]}
    forged["finished"] = "2100-01-01T00:00:00+00:00"
    if not finishes:
        files[0]["finished"] = None
    _, folder = written_study(tmp_path, LINKED, files)
    (folder / "forged.json").write_text(json.dumps(forged))
    collected = collect_answers([folder], LINKED)
    kept = {one.id: one for one in collected.participants}
    assert len(kept) == 3 and kept[files[0]["participant"]].link_token == files[0]["link"]
    (sentence,) = collected.left_out_sentences
    assert sentence.startswith("forged.json is left out") and "a valid link" in sentence
    assert len(screen(collected.participants, LINKED).included) == 3 - (not finishes)


def test_the_command_gives_the_same_links_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "study" / "researcher_only" / "key.json"
    path.parent.mkdir(parents=True)
    write_key(replace(LINKED, link_secret=None), path)
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
        assert query == {"p": [row["list"]], "t": [key.token(number)]}
    assert path.stat().st_mode & 0o777 == 0o600 and str(key.link_secret) not in first
    assert main([*command[:-1], "lab.example"]) != 0
    assert main([*command, "--participants", "10001"]) != 0
