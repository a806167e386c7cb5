"""Sentences and verdict: the numbers choose the words, and swapped numbers turn them round."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.findings.comparison import Ratio, plain, point_title, ratio_of, samples_by_system
from app.findings.measure_rows import JERK
from app.findings.sentences import CHANCE_SHIFTS, SPEEDS_OF, sentences_of, told_findings
from app.findings.verdict import jerk_over_clips, verdict_of, verdict_over_clips
from app.run.ask import Ask
from app.run.examples import FIRST_LOOK
from app.run.pipeline import do
from conventions.names import short_names
from model.diagnostics import Versions
from model.measures import beats
from model.measures.point import JerkAttribution
from model.measures.results import BeatMeasures, BeatSpeeds
from tests.app.measured import both, diagnostics_of

PLOTS = ["trajectory", "depth", "spectrum", "attribution", "seams", "reference"]
RUNGS = ("globaldiff/local", "globaldiff/global", "globaldiff/full")


def by_depth(root: float, tip: float) -> np.ndarray:
    return np.linspace(root, tip, 11)


def shares(*values: float) -> JerkAttribution:
    return JerkAttribution(("pelvis", "right_elbow"), np.array(values), math.nan)


def measures(**changes: Any) -> Versions:
    usual = {
        "tip_jerk_m_s3": 100.0,
        "tip_velocity_power_above_5hz": 0.01,
        "seam_jerk_ratio": 1.0,
        "jerk_by_depth_m_s3": by_depth(10.0, 100.0),
        "tip_jerk_attribution": shares(0.1, 0.3),
    }
    return both(**{**usual, **changes})


def jerks(raw: float, savgol: float | None = None) -> Versions:
    filtered = raw if savgol is None else savgol
    return Versions(measures(tip_jerk_m_s3=raw).raw, measures(tip_jerk_m_s3=filtered).savgol)


def trajectory(**systems: Versions) -> str:
    return sentences_of(diagnostics_of(**systems))["trajectory"]


def test_the_rougher_system_is_named_with_both_numbers_and_both_ratios() -> None:
    found = trajectory(**{"x/a": jerks(95.0, 50.0), "x/b": jerks(123.5, 60.0)})
    assert found == (  # by their names on the page
        "On this clip b has 1.3 times the right middle fingertip jerk of a (124 against 95 m/s³);"
        " after the filter 1.2 times. One sample each: of these motions, not of the systems."
    )


def test_swapped_numbers_turn_every_sentence_round() -> None:
    rough = measures(
        tip_jerk_m_s3=200.0,
        tip_velocity_power_above_5hz=0.2,
        seam_jerk_ratio=3.0,
        jerk_by_depth_m_s3=by_depth(10.0, 300.0),
        tip_jerk_attribution=shares(0.6, 0.3),
        position_error_m=np.full(55, 0.25),
    )
    smooth = measures(position_error_m=np.full(55, 0.1))
    one = sentences_of(diagnostics_of(measures(), left=rough, right=smooth))
    other = sentences_of(diagnostics_of(measures(), left=smooth, right=rough))

    swap = {"left": "right", "right": "left"}
    for plot in PLOTS:
        words = [word.strip(",;.") for word in one[plot].split()]
        assert "left" in words and "right" in words, plot
        turned = [swap.get(word, word) for word in words]
        # "right" is also a side of the body: its own sentence has it in fixed places
        for index, word in enumerate(words):
            if word == "right" and words[index + 1 : index + 2] in (["middle"], ["elbow"]):
                turned[index] = "right"
        assert turned == [word.strip(",;.") for word in other[plot].split()], plot


def test_equal_numbers_are_told_as_equal() -> None:
    found = sentences_of(diagnostics_of(measures(), a=measures(), b=measures()))
    same = "the same right middle fingertip jerk within 5 % (100 against 100 m/s³)"
    assert same in found["trajectory"]
    assert "the same share of velocity power above 5 Hz" in found["spectrum"]
    assert "stays the same within 5 %: 1.0 times at the pelvis, 1.0 times" in found["depth"]
    assert "1.0 times the reference's" in found["reference"]
    assert "is no nearer to it than b" in found["reference"]
    assert "joins stand out" not in found["seams"]


def test_a_filter_that_turns_the_order_is_told() -> None:
    found = trajectory(a=jerks(200.0, 50.0), b=jerks(100.0, 75.0))
    assert "a has 2.0 times the right middle fingertip jerk of b" in found
    assert "after the filter b has 1.5 times that of a" in found

    same = trajectory(a=jerks(200.0, 50.0), b=jerks(100.0, 50.0))
    assert "after the filter the two are the same within 5 %" in same


def test_several_samples_give_an_interval_and_one_that_holds_1_tells_nothing_apart() -> None:
    found = trajectory(
        **{f"a{end}": jerks(v) for end, v in (("", 300.0), (".s2", 200.0), (".s3", 250.0))},
        **{f"b{end}": jerks(100.0) for end in ("", ".s2", ".s3")},
    )
    assert "a has 2.5 times" in found
    assert "95 % interval 2.0 to 3.0 over 3 samples" in found
    assert "From only 3 samples the interval is rough." in found
    assert "One sample" not in found and "holds 1" not in found
    values = {"a": 300.0, "a.s2": 50.0, "b": 100.0, "b.s2": 200.0}
    found = trajectory(**{name: jerks(value) for name, value in values.items()})
    assert "The interval holds 1: these samples do not tell the two apart." in found


def test_samples_are_compared_in_pairs_with_the_same_noise() -> None:
    # Twice as rough with every noise, while the noises differ by far more than twice.
    above, below = ({n: factor * 10.0**n for n in range(1, 6)} for factor in (2.0, 1.0))
    ratio = ratio_of(above, below)
    assert ratio is not None
    assert (ratio.num_samples, ratio.is_open) == (5, False)
    assert ratio.low == pytest.approx(2.0) and ratio.high == pytest.approx(2.0)

    assert ratio_of({1: 4.0}, {1: 2.0, 2: 2.0}) == Ratio(2.0)
    assert ratio_of({1: 4.0}, {1: 0.0}) is None


def test_of_many_systems_the_extremes_are_compared_and_one_alone_is_not() -> None:
    found = trajectory(a=jerks(100.0), b=jerks(300.0), c=jerks(200.0))
    extremes = "b has 3.0 times the right middle fingertip jerk of a, the highest and the lowest of"
    assert f"{extremes} 3" in found
    assert trajectory(a=jerks(121.0, 54.0)) == (
        "On this clip a has a right middle fingertip jerk of 121 m/s³, 54 m/s³ after the filter."
    )


def test_depth_names_the_course_of_the_gap() -> None:
    rough = measures(tip_jerk_m_s3=200.0, jerk_by_depth_m_s3=by_depth(10.0, 300.0))
    found = sentences_of(diagnostics_of(a=rough, b=measures()))["depth"]
    assert found == (
        "From the pelvis (depth 0) to the last finger joints (depth 10) the jerk of a relative to b"
        " grows: 1.0 times at the pelvis, 3.0 times at the fingers (300 against 100 m/s³)."
    )
    rough = measures(tip_jerk_m_s3=200.0, jerk_by_depth_m_s3=by_depth(80.0, 200.0))
    found = sentences_of(diagnostics_of(a=rough, b=measures()))["depth"]
    assert "relative to b falls: 8.0 times" in found

    falling = measures(jerk_by_depth_m_s3=by_depth(30.0, 10.0))
    assert "falls (30 to 10 m/s³)" in sentences_of(diagnostics_of(a=falling))["depth"]


def test_attribution_points_at_the_strongest_joint_or_at_none() -> None:
    def told(*values: float) -> str:
        attribution = shares(*values)
        found = sentences_of(diagnostics_of(a=measures(tip_jerk_attribution=attribution)))
        return found["attribution"]

    assert "the right elbow alone, smoothed, lowers right middle fingertip jerk most (45 %)" in (
        told(0.1, 0.45)
    )
    assert "the pelvis alone, smoothed" in told(0.2, 0.1)
    assert "no single joint stands out (pelvis most, 3.0 %)" in told(0.03, 0.02)
    assert "no joint's smoothing alone takes jerk" in told(-0.1, -0.2)
    assert "could be told apart by joint" in told(math.nan, math.nan)


def test_seams_stand_out_or_do_not() -> None:
    found = sentences_of(
        diagnostics_of(a=measures(seam_jerk_ratio=2.1), b=measures(seam_jerk_ratio=1.02))
    )["seams"]
    assert "2.1 times that elsewhere with a (joins stand out, 2.1 after the filter)" in found
    assert "1.0 times that elsewhere with b (joins do not stand out" in found

    reference = measures(seam_jerk_ratio=2.2)
    found = sentences_of(diagnostics_of(reference, a=measures(seam_jerk_ratio=2.1)))["seams"]
    assert "joins stand out" not in found
    assert "the reference, which has no joins, has 2.2" in found


def test_the_nearest_to_the_reference_need_not_be_the_smoothest() -> None:
    found = sentences_of(diagnostics_of(jerks(150.0), a=jerks(160.0), b=jerks(50.0)))["reference"]
    assert found.startswith("a has 1.1 times the reference's right middle fingertip jerk")
    assert "is nearest to it; b has 0.33 times it" in found
    assert sentences_of(diagnostics_of(a=jerks(160.0)))["reference"] == ""


def test_missing_numbers_are_told_and_never_crash() -> None:
    empty = both()
    found = sentences_of(diagnostics_of(a=empty, b=empty))
    assert list(found) == [*PLOTS, "beats", "step"]
    assert "too short" in found["trajectory"] and "too short" in found["depth"]
    assert "long enough" in found["spectrum"] and "long enough" in found["seams"]
    half = trajectory(a=empty, b=jerks(100.0))
    assert half.startswith("On this clip b has a right middle fingertip jerk of 100 m/s³")
    still = trajectory(a=jerks(0.0), b=jerks(10.0))
    assert "highest with b and lowest with a (10 against 0 m/s³)" in still


def test_the_followed_point_is_named() -> None:
    elbow = replace(diagnostics_of(a=jerks(10.0)), point="right_elbow")
    assert "a right elbow jerk of 10 m/s³" in sentences_of(elbow)["trajectory"]
    assert point_title("right_thumb") == "Right thumb tip"
    assert point_title("left_ring") == "Left ring fingertip"
    assert point_title("right_middle3") == "Right middle joint 3"


def test_samples_belong_to_their_system_only_where_it_is_there() -> None:
    assert samples_by_system(["a", "a.s2", "b.s2", "c.s1", "c"]) == {
        "a": {1: "a", 2: "a.s2"},
        "b.s2": {1: "b.s2"},
        "c.s1": {1: "c.s1"},
        "c": {1: "c"},
    }


def test_numbers_are_plain() -> None:
    told = {0.0: "0", 0.00621: "0.0062", 0.996: "1.0", 1.26: "1.3", 9.96: "10", 123.4: "123"}
    told |= {123456.0: "123456", -0.034: "-0.034"}
    assert {value: plain(value) for value in told} == told


def beating(score: float, highest: float, speeds_of: BeatSpeeds = "own") -> Versions:
    found = BeatMeasures(score, 0.42, highest, 1.46, 120, speeds_of)
    raw = replace(measures().raw, beats=found)
    return Versions(raw, raw)


def test_beats_are_told_with_their_number_and_chance() -> None:
    told = sentences_of(diagnostics_of(a=beating(0.71, 0.72)))["beats"]
    assert "says nothing here" in told and "0.71" not in told
    told = sentences_of(diagnostics_of(a=beating(0.71, 0.7, "emage")))["beats"]
    assert "a 0.71 (chance 0.42) with 1.5 beats a second of each joint" in told
    assert "over 120 onsets, with EMAGE's published mean speeds" in told
    told = sentences_of(diagnostics_of(beating(0.4, 0.5), a=beating(0.71, 0.7)))["beats"]
    assert "the reference 0.40" in told and "20 shifts of the speech: a." in told
    assert sentences_of(diagnostics_of(a=measures()))["beats"] == ""
    assert CHANCE_SHIFTS == beats.CHANCE_SHIFTS
    assert set(SPEEDS_OF) == set(BeatSpeeds.__args__)


def said(recorded: float | None = None, **jerks: float):
    systems = {
        name.replace("_", "/", 1).replace("__", "."): both(tip_jerk_m_s3=float(jerk))
        for name, jerk in jerks.items()
    }
    reference = None if recorded is None else both(tip_jerk_m_s3=float(recorded))
    return verdict_of(diagnostics_of(reference, **systems))


def test_the_verdict_goes_through_the_ladder() -> None:
    verdict = said(
        108, globaldiff_local=150, globaldiff_global=100, globaldiff_joint=90, globaldiff_full=120
    )
    assert verdict is not None
    assert verdict.numbers == (
        "Right middle fingertip jerk in m/s³: local 150, global 100, joint 90, full 120; "
        "recorded 108."
    )
    assert verdict.judgement.startswith(
        "On this clip the paper's claim, that global rotations jerk less than local ones, shows: "
        "from local to global 33 % less. Compared with global: joint 10 % less, full 20 % more; "
        "joint is calmer here. Full jerks more than global: its constraints did not help. "
        "This is one clip, one sample and one training of each"
    )
    assert "10 clips or more" in verdict.text and "several seeds" in verdict.text


def test_swapped_numbers_turn_the_verdict_round() -> None:
    for jerks, words, are_calmer in [
        ((120, 90, 80), "shows: from local to global 25 % less.", "full is calmer"),
        ((100, 80, 110), "shows: from local to global 20 % less.", "none is calmer"),
        ((100, 98, 99), "does not show: from local to global alike within 5 %.", "none is calmer"),
        ((90, 100, 110), "does not show: from local to global 11 % more.", "none is calmer"),
    ]:
        numbers = zip(RUNGS, jerks, strict=True)
        systems = {name: both(tip_jerk_m_s3=float(jerk)) for name, jerk in numbers}
        verdict = verdict_of(diagnostics_of(**systems))
        assert verdict is not None and words in verdict.judgement
        assert are_calmer in verdict.judgement
        assert "recorded" not in verdict.numbers


def test_samples_give_an_interval_and_where_they_do_not_tell_systems_apart_show_nothing() -> None:
    ends = ("", "__s2", "__s3")
    apart, open_ = (
        {f"globaldiff_local{end}": jerk for end, jerk in zip(ends, jerks, strict=True)}
        for jerks in ((200.0, 210.0, 190.0), (300.0, 60.0, 90.0))
    )
    other = {f"globaldiff_full{end}": 100.0 for end in ends}
    for local, words in (
        (apart, "shows: from local to full 50 % less (47 to 52 %, 3 samples)."),
        (open_, "does not show: from local to full not told apart by 3 samples."),
    ):
        verdict = said(**local, **other)
        assert verdict is not None and words in verdict.judgement
        assert "3 samples and one training" in verdict.judgement


def test_without_the_ladder_nothing_is_said_of_the_paper_and_without_jerk_nothing() -> None:
    verdict = said(gan_20=80, asynfusion_ddim=90)
    assert verdict is not None
    assert verdict.numbers.endswith("gan/20 80, ddim 90.")
    assert "paper" not in verdict.judgement and "one clip" in verdict.judgement
    alone = said(globaldiff_local=80)
    assert alone is not None and alone.judgement == ""
    assert said(globaldiff_local=math.nan) is None
    # Names that two families share stay whole.
    assert short_names(["a/x", "b/x", "b/y"]) == {"a/x": "a/x", "b/x": "b/x", "b/y": "y"}


def test_over_several_clips_the_interval_is_over_clips_each_with_the_mean_of_its_samples() -> None:
    def clip(**jerk: float | None) -> dict[str, Any]:
        told = {name.replace("_", "/").replace("//", "."): value for name, value in jerk.items()}
        return {
            name: {"raw": {} if value is None else {JERK: value}, "savgol": {JERK: 7.0}}
            for name, value in told.items()
        }

    clips = [
        clip(globaldiff_local=180.0, globaldiff_local__s2=220.0, globaldiff_full=100.0),
        clip(globaldiff_local=210.0, globaldiff_full=100.0, reference=50.0),
        clip(globaldiff_local=None, globaldiff_full=None),
        clip(globaldiff_local=190.0, globaldiff_full=100.0),
    ]
    jerk = jerk_over_clips(clips)
    assert jerk["globaldiff/local"] == {1: 200.0, 2: 210.0, 4: 190.0}
    verdict = verdict_over_clips("right_middle", jerk)
    assert verdict is not None and verdict.numbers == (
        "Right middle fingertip jerk in m/s³, mean over 3 clips: local 200, full 100; recorded 50."
    )
    words = "Over 3 clips the paper's claim, that global rotations jerk less than local ones, shows"
    assert f"{words}: from local to full 50 % less (47 to 52 %, 3 clips)." in verdict.judgement
    assert (
        "These are 3 clips and one training of each: an example, no evidence." in verdict.judgement
    )
    many = verdict_over_clips("right_middle", jerk_over_clips([clips[1]] * 10))
    assert many is not None and "10 clips" in many.judgement and "example" not in many.judgement
    assert verdict_over_clips("right_middle", jerk_over_clips(clips[:1])) is None


def test_full_is_said_to_be_worse_than_global_where_it_clearly_is() -> None:
    for full, is_worse in [(100.0, False), (104.0, False), (112.0, True)]:
        verdict = said(globaldiff_global=100, globaldiff_full=full)
        assert verdict is not None and ("jerks more than global" in verdict.text) == is_worse


def test_the_first_finding_is_of_the_motion_that_the_headline_tells_to_be_worst(
    tmp_path: Path,
) -> None:
    motions = (FIRST_LOOK / "shown" / "A.npz", FIRST_LOOK / "shown" / "B.npz")
    request = Ask(motions=motions, out=tmp_path / "out", names=("A", "B"), has_poses=False)
    diagnostics = do(request, lambda share: None).diagnostics
    verdict = verdict_of(diagnostics)
    assert verdict is not None and verdict.numbers.endswith("A 190, B 1318.")
    first, *_, last = told_findings(diagnostics.findings)
    assert first.startswith("B: The jerk of all ten fingertips is 687 m/s³")
    assert last == "Nothing stands out in A."
    assert told_findings({"A": []}) == ["Nothing stands out."]
