"""The verdict above the videos: its words follow from the numbers."""

import math

import pytest

from app.findings.verdict import short_names, verdict_of
from tests.app.measured import both, diagnostics_of

RUNGS = ("globaldiff/local", "globaldiff/global", "globaldiff/full")


def said(recorded: float | None = None, **jerks: float):
    systems = {
        name.replace("_", "/", 1).replace("__", "."): both(tip_jerk_m_s3=float(jerk))
        for name, jerk in jerks.items()
    }
    reference = None if recorded is None else both(tip_jerk_m_s3=float(recorded))
    return verdict_of(diagnostics_of(reference, **systems))


def test_the_issue_s_own_example() -> None:
    verdict = said(108, globaldiff_local=89, globaldiff_global=104, globaldiff_full=120)
    assert verdict is not None
    assert verdict.numbers == (
        "Right middle fingertip jerk in m/s³: local 89, global 104, full 120; recorded 108."
    )
    assert verdict.judgement.startswith(
        "On this clip the paper's claim, that global rotations jerk less than local ones, does not "
        "show. Here full jerks more than global: its constraints did not help. "
        "This is one clip, one sample and one training of each"
    )
    assert "10 clips or more" in verdict.text and "several seeds" in verdict.text


@pytest.mark.parametrize(
    ("jerks", "words"),
    [
        ((120, 90, 80), "claim shows: global"),
        ((100, 80, 110), "shows with global, not with full"),
        ((100, 98, 99), "does not show"),
        ((90, 100, 110), "does not show"),
    ],
)
def test_swapped_numbers_turn_it_round(jerks, words) -> None:
    verdict = verdict_of(
        diagnostics_of(
            **{
                name: both(tip_jerk_m_s3=float(jerk))
                for name, jerk in zip(RUNGS, jerks, strict=True)
            }
        )
    )
    assert verdict is not None and words in verdict.judgement
    assert "recorded" not in verdict.numbers


def test_samples_that_do_not_tell_the_systems_apart_show_nothing() -> None:
    ends = ("", "__s2", "__s3")
    apart, open_ = (
        {f"globaldiff_local{end}": jerk for end, jerk in zip(ends, jerks, strict=True)}
        for jerks in ((200.0, 210.0, 190.0), (300.0, 60.0, 90.0))
    )
    other = {f"globaldiff_full{end}": 100.0 for end in ends}
    for local, words in ((apart, "claim shows"), (open_, "does not show")):
        verdict = said(**local, **other)
        assert verdict is not None and words in verdict.judgement
        assert "3 samples and one training" in verdict.judgement


def test_without_the_ladder_nothing_is_said_of_the_paper() -> None:
    verdict = said(gan_20=80, asynfusion_ddim=90)
    assert verdict is not None
    assert verdict.numbers.endswith("gan/20 80, ddim 90.")
    assert "paper" not in verdict.judgement and "one clip" in verdict.judgement
    alone = said(globaldiff_local=80)
    assert alone is not None and alone.judgement == ""


def test_without_jerk_there_is_no_verdict() -> None:
    assert said(globaldiff_local=math.nan) is None


def test_names_that_two_families_share_stay_whole() -> None:
    assert short_names(["a/x", "b/x", "b/y"]) == {"a/x": "a/x", "b/x": "b/x", "b/y": "y"}


@pytest.mark.parametrize(("full", "is_worse"), [(100.0, False), (104.0, False), (112.0, True)])
def test_full_is_said_to_be_worse_than_global_where_it_clearly_is(
    full: float, is_worse: bool
) -> None:
    verdict = said(globaldiff_global=100, globaldiff_full=full)
    assert verdict is not None and ("jerks more than global" in verdict.text) == is_worse
