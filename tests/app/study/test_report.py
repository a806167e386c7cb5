"""The report is whole, holds the numbers of the answers, and says what they show."""

import html
import json
import math
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.errors import RunError
from app.study.analyse import AnalysisRequest, analyse
from app.study.design.key import StudyKey
from app.study.report.report import NO_BREAK, format_p_with_letter, headline, percent, templates
from app.study.simulate import UNIFORM_RATERS, RaterModel, simulate_answers
from app.study.statistics.proportions import ResultEstimate, detectable_share, proportion_estimates
from app.study.statistics.results import analyse_participants
from tests.app.study.made import (
    STRENGTHS,
    SYSTEMS,
    made_files,
    made_key,
    made_participants,
    made_votes,
    written_study,
)
from tests.helpers import csv_rows

ATTENTIVE = RaterModel(check_failure_probability=0)
Report = tuple[str, list[dict[str, str]], str]
"""Page, rows of the CSV and LaTeX table."""


def report_of(tmp_path: Path, key: StudyKey, files: list, measured: Path | None = None) -> str:
    """The page; tables lie beside it."""
    key_path, answers = written_study(tmp_path, key, files)
    analyse(AnalysisRequest([answers], key_path, tmp_path / "report", measured))
    return (tmp_path / "report" / "report.html").read_text("utf-8")


def made_report(
    tmp_path: Path, key: StudyKey, count: int = 12, measured: Path | None = None
) -> Report:
    page = report_of(tmp_path, key, made_files(key, count, ATTENTIVE), measured)
    out = tmp_path / "report"
    assert {path.name for path in out.iterdir()} == {
        *("participants.csv", "preference.pdf", "report.html", "results.csv", "table.tex"),
        *(("battles.csv",) if key.questions[0].kind == "choice" else ()),
    }
    return page, csv_rows(out / "results.csv"), (out / "table.tex").read_text()


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Diagnostics of each clip."""
    folder = tmp_path_factory.mktemp("measured")
    jerk = {"global": 50.0, "local": 90.0, "rival": 150.0}
    for clip in range(4):
        systems = {name: {"raw": {"tip_jerk_m_s3": value + clip}} for name, value in jerk.items()}
        content = {"systems": systems, "reference": None}
        (folder / f"clip{clip}").mkdir()
        (folder / f"clip{clip}" / "diagnostics.json").write_text(json.dumps(content))
    return folder


@pytest.fixture(scope="module")
def pairwise(tmp_path_factory: pytest.TempPathFactory, measured: Path) -> Report:
    return made_report(tmp_path_factory.mktemp("pairwise"), made_key(), measured=measured)


@pytest.mark.parametrize("protocol", ["pairwise", "matched", "ranking", "rating"])
def test_the_page_is_whole_and_needs_nothing_beside_it(tmp_path, pairwise, protocol):
    is_made = protocol == "pairwise"
    page, rows, table = pairwise if is_made else made_report(tmp_path, made_key(protocol))
    tags = re.findall(r"<(/?)([a-z][\w:]*)[^>]*?(/?)>", page)
    opened = Counter(tag for end, tag, alone in tags if not (end or alone))
    assert opened - Counter(meta=9, br=9) == Counter(tag for end, tag, _ in tags if end)
    ids = re.findall(r' id="([^"]*)"', page)
    assert len(set(ids)) == len(ids)
    references = set(re.findall(r'(?:href="#|url\(#)([^")]+)', page))
    assert references and references <= set(ids)
    assert not re.search(r'(src|href)="(?!#)', page)
    assert "<script" not in page
    assert "Three &lt;systems&gt; &amp; a study" in page and "<systems>" not in page
    assert {row["first"] for row in rows if row["first"]} == set(SYSTEMS)
    assert table.count("\\\\") == 1 + len(SYSTEMS)
    assert ("Krippendorff" in page) == (protocol != "matched")


def test_the_csv_has_the_counts_of_the_answers_and_the_same_answers_make_the_same_files(
    tmp_path, pairwise, measured
):
    key = made_key()
    assert made_report(tmp_path, key, measured=measured) == pairwise
    values = [
        answer.value
        for one in made_participants(key, 12, ATTENTIVE)
        for answer in one.answers
        if {key.videos[video].system for video in answer.videos} == {"local", "global"}
        and not answer.trial.startswith("check")
    ]
    shares = {
        (row["first"], row["second"]): row for row in pairwise[1] if row["measure"] == "share"
    }
    row = shares["local", "global"]
    assert int(row["wins"]) == sum("local" in value for value in values)
    assert int(row["ties"]) == values.count("tie")
    assert int(row["losses"]) == sum("global" in value for value in values)
    share = (int(row["wins"]) + int(row["ties"]) / 2) / 48
    assert float(row["value"]) == pytest.approx(share, abs=1e-5)
    assert float(row["low"]) < share < float(row["high"])


def test_who_and_what_is_left_out_is_told(tmp_path):
    key = made_key()
    files = made_files(key, 6, ATTENTIVE)
    files[0]["finished"] = None
    for answer in files[1]["answers"]:
        if answer["trial"].startswith("check"):
            answer["value"] = "right"
    files[2]["study"] = "another"
    files[3]["answers"][0]["value"] = "edited"
    key_path, answers = written_study(tmp_path, key, files)
    for name in ("<cut>", "\udcff"):  # the last is not text
        (answers / f"{name}.json").write_text('{"format": 1')
    analyse(AnalysisRequest([answers], key_path, tmp_path / "report"))
    page = (tmp_path / "report" / "report.html").read_text("utf-8")
    assert "3 of 5 participants are included; 4 were planned." in page
    for told in (
        "not finished (14 of 14 trials)",
        "attention checks: 2 failed, 1 allowed",
        "simulated00002.json is left out: it belongs to another study.",
        "simulated00003.json: 1 of 14 answers is left out",
        "&lt;cut&gt;.json is left out: it is not a valid JSON file",
        "?.json is left out",
    ):
        assert told in page
    with pytest.raises(RunError, match=r"no valid answers.*simulated00000.json: not finished"):
        report_of(tmp_path / "none", key, files[:1])
    assert not (tmp_path / "none" / "report").exists()


def test_few_participants_are_enough_for_a_report_and_too_few_for_a_test(tmp_path):
    page, _, _ = made_report(tmp_path / "two", made_key(), count=2)
    assert "With 2 participants, the sign test cannot be significant" in page
    assert "difference is significant" not in page
    assert "2 of 2 participants are included;" in page
    page, _, _ = made_report(tmp_path / "one", made_key("ranking"), count=1)
    assert "(95 % interval unknown)" in plain(page)
    assert "1 of 1 participant is included;" in page
    assert re.search(r"1 of \d+ participant lists? was used", page)
    words = re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL)
    assert not re.search(r"\b(inf|nan)\b", words)


def test_measured_jitter_is_joined(pairwise):
    """The smoother system is also the stronger one in the simulation, so it must win."""
    page = pairwise[0]
    assert re.search(r"smoothness as a reason \(\d+\), \d+.% went to the video with less", page)
    assert "more often than chance" in page


def pair_of(wins: int, losses: int, ties: int = 0, *names: str) -> ResultEstimate:
    score = [1.0] * wins + [0.0] * losses + [0.5] * ties
    votes = made_votes([(rater, "l", "r", value) for rater, value in enumerate(score)])
    found, *_ = proportion_estimates("share", votes, *(names or ("local", "global")))
    return replace(found, p_holm=found.p)


def say(sentence: str, *about: object) -> str:
    """One of the sentences of the report."""
    return str(getattr(templates().get_template("sentences.j2").module, sentence)(*about))


def plain(sentence: str) -> str:
    return html.unescape(sentence).replace(NO_BREAK, " ")


def test_the_sentence_of_a_pair_follows_its_numbers():
    won = plain(say("pair", pair_of(24, 4), False))
    assert won.startswith(
        "local was preferred to global in 86 % of 28 votes (24 for, 4 against; "
        "95 % interval 67 to 96 %)"
    )
    assert won.endswith("the difference is significant (p < .001 after Holm).")
    lost = plain(say("pair", pair_of(4, 24), False))
    assert lost == won.replace("local", "?").replace("global", "local").replace("?", "global")
    close = plain(say("pair", pair_of(15, 13), False))
    assert close.endswith("the difference is not significant (p = .851 after Holm).")
    assert "were preferred equally often in 10 votes." in plain(say("pair", pair_of(5, 5), False))
    alone = plain(say("pair", pair_of(1, 0), False))
    assert "preferred to global in 100 % of 1 vote (1 for, 0 against; " in alone
    tied = plain(say("pair", replace(pair_of(9, 5), ties=2), True))
    assert tied.startswith("local was ranked above global in ")
    assert "(9 for, 5 against, 2 ties counted as half; " in tied


def test_the_sentence_of_a_match_follows_its_numbers():
    for wins, losses, told in (
        (24, 4, "significantly more often than the mismatched speech"),
        (4, 24, "significantly less often than the mismatched speech"),
        (15, 13, "no significant preference for the matching speech"),
    ):
        assert told in plain(say("match", pair_of(wins, losses)))


def test_headline_and_power_say_who_came_first_and_how_surely():
    key = made_key(num_clips=10)
    (strong,) = analyse_participants(made_participants(key, 28, UNIFORM_RATERS), key)
    assert headline(strong) == "realism: global is significantly better than local and rival."
    share = detectable_share(28)
    assert share is not None
    said = say(
        "power",
        share,
        strong.detectable_share_after_holm,
        strong.num_raters,
        strong.num_comparisons,
    )
    assert (
        f"a preference shared by {percent(share)} of the participants; with Holm's correction"
        in said
    )
    (weak,) = analyse_participants(made_participants(key, 4, UNIFORM_RATERS), key)
    assert headline(weak) == "realism: global, local and rival do not differ significantly."


@pytest.mark.parametrize("is_ranking", [True, False])
def test_equal_means_have_no_winner(is_ranking: bool) -> None:
    what = "rank" if is_ranking else "rating"
    gap = ResultEstimate(f"mean_{what}_gap", "local", "global", 0.0, -1.0, 1.0, p_holm=1.0)
    told = f"local and global have the same mean {what} (Wilcoxon, p = 1.000 after Holm)."
    assert plain(say("mean_gap", gap, is_ranking)) == told


def test_agreement_is_told_by_krippendorffs_marks() -> None:
    for alpha, low, told in [
        (0.8, 0.7, "is 0.80 (95 % interval 0.70 to 0.90), over 9 items"),
        (0.667, 0.5, "agreement is sufficient for tentative conclusions only"),
        (0.1, 0.01, "agreement is low"),
        (0.8, 0.7, "): raters agree well"),
        (0.8, -0.1, "): agreement does not differ significantly"),
        (0.8, -math.inf, "): agreement does not differ significantly"),
        (
            0.8,
            -0.1,
            "\N{MINUS SIGN}0.10 to 0.90), over 9 items",
        ),
        (
            0.8,
            -math.inf,
            "(95 % interval unknown), over 9 items",
        ),
    ]:
        one = ResultEstimate("krippendorff_alpha_ordinal", value=alpha, low=low, high=0.9)
        assert told in plain(say("agreement", one, "ordinal", 9))


def test_a_tie_has_no_winner_in_its_first_line() -> None:
    key = made_key(num_clips=10)
    (result,) = analyse_participants(made_participants(key, 4, UNIFORM_RATERS), key)

    def said(wins: int, ties: int, losses: int) -> str:
        lead = float(wins - losses)
        strengths = [
            ResultEstimate("log_strength", name, None, value, value, value)
            for name, value in (("local", lead), ("global", -lead))
        ]
        return headline(replace(result, estimates=(pair_of(wins, losses, ties), *strengths)))

    assert said(2, 0, 2) == "realism: local and global do not differ significantly: 2 and 2 votes."
    assert said(1, 0, 0) == "realism: local and global do not differ significantly: 1 and 0 votes."
    assert said(1, 1, 3) == (
        "realism: global and local do not differ significantly: 3 and 1 votes, 1 tie."
    )
    assert said(0, 5, 0) == (
        "realism: local and global do not differ significantly: 0 and 0 votes, 5 ties."
    )
    assert said(2, 0, 20).startswith("realism: global is significantly better")


def test_the_headline_of_rankings_and_ratings_agrees_with_the_strengths():
    for protocol in ("ranking", "rating"):
        key = made_key(protocol, num_clips=10)
        (result,) = analyse_participants(made_participants(key, 28, UNIFORM_RATERS), key)
        assert headline(result).startswith("realism: global is significantly better")
        measure = "mean_rank_gap" if protocol == "ranking" else "mean_rating_gap"
        gaps = result.estimates_of(measure)
        sentences = [plain(say("mean_gap", gap, protocol == "ranking")) for gap in gaps]
        better = "places better" if protocol == "ranking" else "points higher"
        assert re.match(rf"global is [\d.]+ {better} than local \(95 % interval \d", sentences[0])
        assert "global is" in sentences[2] and "rival" in sentences[2]
    assert STRENGTHS["global"] == max(STRENGTHS.values())


@pytest.mark.parametrize("protocol", ["pairwise", "matched"])
def test_battles_that_were_written_read_back_to_the_same_numbers(tmp_path, protocol):
    """In the columns of the leaderboard's analysis, ours and a file of theirs."""
    key = made_key(protocol)
    made_report(tmp_path, key)
    analyse(AnalysisRequest([tmp_path / "report" / "battles.csv"], None, tmp_path / "again"))
    measures = ("elo", "log_strength", "share_of_all_votes", "right_choices", "left_chosen")
    written, read = (
        [
            sorted(row.items())
            for row in csv_rows(tmp_path / name / "results.csv")
            if row["measure"] in measures
        ]
        for name in ("report", "again")
    )
    assert len(written) > 3 and sorted(written) == sorted(read)
    theirs = tmp_path / "battles_elo.csv"
    theirs.write_text(
        "user,input_code,model_a,model_b,winner,is_strong,juiceOptions,juiceOtherReason\n"
        'u1,1_wayne_0_2,AMUSE,HoloGest,model_a,True,"[""MotionSmoothness""]",\n'
        "u1,1_wayne_0_3,HoloGest,AMUSE,tie,,{},\n"
    )
    analyse(AnalysisRequest([theirs], None, tmp_path / "theirs"))
    page = plain((tmp_path / "theirs" / "report.html").read_text("utf-8"))
    assert "AMUSE and HoloGest do not differ significantly: 1 and 0 votes, 1 tie." in page
    theirs.write_text("user,input_code,model_a,model_b\n1,2,3,4\n")
    with pytest.raises(RunError, match="not a table of battles: it has no column winner"):
        analyse(AnalysisRequest([theirs], None, tmp_path / "none"))
    with pytest.raises(RunError, match="a key, only one"):
        analyse(AnalysisRequest([tmp_path], None, tmp_path / "none"))


def test_p_is_printed_as_in_papers():
    printed = [plain(format_p_with_letter(p)) for p in (0.00049, 0.0005, 0.0416, 0.9999, 1.0)]
    assert printed == ["p < .001", "p = .001", "p = .042", "p = 1.000", "p = 1.000"]


@pytest.mark.filterwarnings("error")
def test_any_name_of_a_system_can_be_drawn(tmp_path):
    key = made_key(num_clips=1)
    names = dict(zip(SYSTEMS, ("_first", r"$\frac{x$_2%", "long " * 12), strict=True))
    videos = {
        blind: replace(video, system=names[video.system]) for blind, video in key.videos.items()
    }
    key = replace(key, systems=tuple(names.values()), videos=videos)
    strengths = {names[name]: value for name, value in STRENGTHS.items()}
    files = simulate_answers(key, strengths, 4, ATTENTIVE, np.random.default_rng(0))
    page = report_of(tmp_path, key, list(files))
    assert all(f">{name}</td>" in page for name in names.values())
