"""Sentences and verdict: the numbers choose the words, and swapped numbers turn them round."""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.findings.comparison import (
    KIND_TITLES,
    Ratio,
    format_finding_kinds,
    format_two_digits,
    point_title,
    ratio_of_means,
    sample_names_by_system,
    values_by_metric,
)
from app.findings.metric_table import (
    JERK,
    KEYS_OF_OLD_TITLES,
    METRICS,
    SPEED,
    TITLES,
    metric_values,
    parts_others_have,
)
from app.findings.sentences import figure_sentences
from app.findings.verdict import make_verdict
from app.run.examples import FIRST_MOTION, add_tremble
from app.run.output.run_folder import read_run
from app.run.pipeline import run
from app.run.run_writer import finding_records
from conventions.names import SampleName, short_names
from model.diagnostics import RawAndFiltered
from model.faults.analysis import Finding
from model.faults.table import FAULTS, STILL
from model.metrics.results import BeatMetrics
from model.metrics.seams import JerkPeriod
from model.metrics.tracked_point import JerkAttribution
from model.motion.motion import load_motion, save_motion
from tests.app.measured import both, diagnostics_of
from tests.app.requests import diagnose_request
from tests.helpers import ROOT


def by_depth(root: float, tip: float) -> np.ndarray:
    return np.linspace(root, tip, 11)


def shares(*values: float) -> JerkAttribution:
    return JerkAttribution(("pelvis", "right_elbow"), np.array(values), math.nan)


def told(plot: str, reference: Any = None, **systems: Any) -> str:
    """The sentence of a plot, of each system's numbers."""
    measured = {name: both(**numbers) for name, numbers in systems.items()}
    return figure_sentences(diagnostics_of(reference and both(**reference), **measured))[plot]


def test_numbers_stand_beside_each_other_as_generated_and_smoothed() -> None:
    one, two = (
        RawAndFiltered(both(tip_jerk_m_s3=raw).raw, both(tip_jerk_m_s3=savgol).savgol)
        for raw, savgol in ((95.0, 50.0), (123.5, 60.0))
    )
    measured = diagnostics_of(two, **{"x/a": one, "x/b": two, "x/b.s2": one})
    assert figure_sentences(measured)["trajectory"] == (  # by their names on the page
        "Right middle fingertip jerk in m/s³: a 95, b 109; reference 124."
        " After Savitzky-Golay smoothing: a 50, b 55; reference 60."
    )
    power = told("spectrum", a={"tip_velocity_power_share_above_5hz": 0.012})
    assert power.startswith("Right middle fingertip power above 5 Hz in %: a 1.2. After")
    jerk = {"jerk_by_depth_m_s3": by_depth(10.0, 300.0)}
    assert told("depth", a=jerk, b={"jerk_by_depth_m_s3": by_depth(8.0, 20.0)}) == (
        "Mean joint jerk in m/s³, at the pelvis and at the outermost finger joints: a 10 and 300,"
        " b 8.0 and 20."
    )


def test_attribution_points_at_the_strongest_joint_or_at_none() -> None:
    start = "Joint whose smoothing reduces the jerk of the right middle fingertip most:"
    few = (
        "In a, smoothing a single joint never reduces the jerk of the right middle fingertip by 5 "
        "% or more."
    )
    for of_joints, words in (
        ((0.1, 0.45), f"{start} right elbow in a (by 45 %)."),
        ((0.2, 0.1), f"{start} pelvis in a (by 20 %)."),
        ((0.03, -0.2), few),
        ((math.nan, math.nan), ""),
    ):
        a, b = ({"tip_jerk_attribution": shares(*each)} for each in (of_joints, (0.0, 0.3)))
        assert told("attribution", a=a) == words
        if words == few:
            words = (
                f"{start} right elbow in b (by 30 %); in a, smoothing one joint reduces it by "
                "less than 5 %."
            )
            assert told("attribution", a=a, b=b) == words


def test_joins_stand_out_where_a_finding_says_so_and_nowhere_else() -> None:
    """So "No findings in planned" never stands beside joins of it that do."""
    systems = {"x/planned": both(seam_jerk_ratio=2.1), "b": both(seam_jerk_ratio=1.02)}
    seams = Finding("The body jumps every 52 frames.", {}, kind="seams")
    for found, words in (
        ([], "significantly at the seams: none."),
        ([seams], "significantly at the seams: planned."),
    ):
        findings = {"x/planned": found, "b": []}
        measured = replace(diagnostics_of(**systems), findings=findings)
        said = figure_sentences(measured)["seams"]
        assert "planned 2.1, b 1.0. Motions with jerk that recurs" in said
        assert said.endswith(words)
        out = finding_records(findings)[-1].sentence
        assert ("planned" in out) == (not found)


def test_a_period_is_told_where_a_finding_tells_it() -> None:
    period = JerkPeriod(52, "pulses", "left arm", 3, 8, 4.0, 6.0, 1e-6, (3, 55))
    measured = replace(diagnostics_of(a=both(period=period)), windows=None)
    assert figure_sentences(measured)["seams"].startswith("The jerk has no period")
    lacking = replace(measured, missing_parts={"a": ["detail"]})
    assert figure_sentences(lacking)["seams"] == ""  # it could not be looked for
    found = replace(measured, findings={"a": [Finding("It repeats.", {}, kind="period")]})
    assert "every 52 frames in a, strongest in the left arm" in figure_sentences(found)["seams"]


def test_numbers_that_a_note_says_not_to_compare_make_no_sentence_and_no_verdict() -> None:
    """Of a file of 15 frames a second, filled in, beside two of 30."""
    numbers = {
        name: both(tip_jerk_m_s3=jerk) for name, jerk in (("a", 90.0), ("b", 14.0), ("c", 60.0))
    }
    for missing_parts, is_left_out in (
        ({"a": [], "b": ["detail"], "c": []}, True),
        ({"a": [], "b": ["place"], "c": []}, True),
        ({"a": ["detail"], "b": ["detail"], "c": ["detail"]}, False),
    ):
        measured = replace(diagnostics_of(**numbers), missing_parts=missing_parts)
        assert ("b 14" in figure_sentences(measured)["trajectory"]) == (not is_left_out)
        apart = parts_others_have(measured.missing_parts)
        clip: Any = {
            name: {"raw": metric_values(each.raw, incomparable=apart[name])}
            for name, each in measured.systems.items()
        }
        verdict = make_verdict("right_middle", [clip], is_generated=False)
        assert verdict is not None
        assert ("b 14" in verdict.jerk_sentence) == (not is_left_out)
        told = (
            "Jerk of c (lowest) compared with a (highest): 33 % less. The jerk cannot be compared "
            "for b."
        )
        assert (told in verdict.comparison) == is_left_out


def test_beat_align_is_there_with_its_chance_level_or_not_at_all() -> None:
    whole = metric_values(beating(0.71, 0.7).raw)
    assert {key for key in whole if "align" in key} == {"beat_align", "beat_align_chance"}
    beats = beating(0.71, 0.7).raw.beats
    assert beats is not None
    alone = replace(beats, beat_align_chance=math.nan)
    assert not [key for key in metric_values(replace(both().raw, beats=alone)) if "align" in key]
    rows = {row.key: row for row in METRICS}
    assert rows["beat_align"].is_primary == rows["beat_align_chance"].is_primary


def test_every_metric_has_one_key_and_the_documents_list_it() -> None:
    documented = set(re.findall(r"`(\w+)`", (ROOT / "docs" / "formats.md").read_text()))
    assert TITLES.keys() <= documented and len(TITLES) == len(METRICS) + 5
    assert set(KEYS_OF_OLD_TITLES.values()) <= TITLES.keys()


def test_missing_numbers_take_no_words() -> None:
    assert set(figure_sentences(diagnostics_of(a=both(), b=both())).values()) == {""}
    half = told("trajectory", a={}, b={"tip_jerk_m_s3": 100.0})
    assert half.startswith("Right middle fingertip jerk in m/s³: b 100.")


def test_samples_are_compared_in_pairs_with_the_same_noise() -> None:
    # Twice as rough with every noise, while the noises differ by far more than twice.
    above, below = ({n: factor * 10.0**n for n in range(1, 6)} for factor in (2.0, 1.0))
    ratio = ratio_of_means(above, below)
    assert ratio is not None
    assert (ratio.num_pairs, ratio.interval_includes_one) == (5, False)
    assert ratio.low == pytest.approx(2.0) and ratio.high == pytest.approx(2.0)

    assert ratio_of_means({1: 4.0}, {1: 2.0, 2: 2.0}) == Ratio(2.0)
    assert ratio_of_means({1: 4.0}, {1: 0.0}) is None


def test_the_followed_point_is_named() -> None:
    elbow = replace(diagnostics_of(a=both(tip_jerk_m_s3=10.0)), tracked_point="right_elbow")
    assert figure_sentences(elbow)["trajectory"].startswith("Right elbow jerk in m/s³: a 10.")
    assert point_title("right_thumb") == "Right thumb tip"
    assert point_title("left_ring") == "Left ring fingertip"
    assert point_title("right_middle3") == "Right middle joint 3"


def test_samples_belong_to_their_system_only_where_it_is_there() -> None:
    assert sample_names_by_system(["a", "a.s2", "b.s2", "c.s1", "c"]) == {
        "a": {1: "a", 2: "a.s2"},
        "b.s2": {1: "b.s2"},
        "c.s1": {1: "c.s1"},
        "c": {1: "c"},
    }


def test_numbers_are_plain() -> None:
    told = {0.0: "0", 0.00621: "0.0062", 0.996: "1.0", 1.26: "1.3", 9.96: "10", 123.4: "123"}
    told |= {123456.0: "123456", -0.034: "-0.034", 9.7e-6: "under 0.001"}
    assert {value: format_two_digits(value) for value in told} == told


def beating(score: float, highest: float) -> RawAndFiltered:
    raw = replace(both().raw, beats=BeatMetrics(score, 0.42, highest, 1.46, 120, "own"))
    return RawAndFiltered(raw, raw)


def test_only_beats_above_chance_are_told() -> None:
    low, high = beating(0.71, 0.72), beating(0.71, 0.7)
    for systems, words in (
        ({"a": low}, ""),
        (
            {"a": high},
            "BeatAlign above chance: a 0.71 (time-shifted onsets: mean 0.42, maximum 0.70).",
        ),
        (
            {"a": high, "b": low},
            "BeatAlign above chance: a 0.71 (time-shifted onsets: mean 0.42, maximum 0.70); the "
            "others are not above chance.",
        ),
        ({"a": both()}, ""),
    ):
        assert figure_sentences(diagnostics_of(**systems))["beats"] == words


def clip_of(**values: float | None) -> dict[str, Any]:
    return {
        name.replace("_", "/", 1).replace("__", "."): {
            "raw": {} if value is None else {JERK: value},
            "savgol": {JERK: 7.0},
        }
        for name, value in values.items()
    }


def said(**jerks: float):
    return make_verdict("right_middle", [clip_of(**jerks)])


def test_the_verdict_goes_through_the_ladder() -> None:
    verdict = said(
        globaldiff_local=150,
        globaldiff_global=100,
        globaldiff_joint=90,
        globaldiff_full=120,
        reference=108,
    )
    assert verdict is not None
    assert verdict.jerk_sentence == (
        "Right middle fingertip jerk in m/s³: local 150, global 100, joint 90, full 120; "
        "reference 108."
    )
    assert verdict.comparison.startswith(
        "On this clip, as the paper claims, the system with global rotations has less jerk than "
        "the one with local rotations. Jerk of global compared with local: 33 % less. Adding "
        "constraints one by one changes the jerk as follows (each compared with global): joint "
        "10 % less, full 20 % more. Clearly less jerk: joint. One clip, one sample, one training "
        "run per system"
    )
    assert "10 clips or more" in verdict.text and "several training seeds" in verdict.text


def test_swapped_numbers_turn_the_verdict_round() -> None:
    for jerks, words, are_calmer in [
        (
            (120, 90, 80),
            "the paper claims; Jerk of global compared with local: 25 % less.",
            "Clearly less jerk: full.",
        ),
        (
            (100, 80, 110),
            "the paper claims; Jerk of global compared with local: 20 % less.",
            "Clearly less jerk: none.",
        ),
        (
            (100, 98, 99),
            "the paper's claim; Jerk of global compared with local: equal within 5 %.",
            "Clearly less jerk: none.",
        ),
        (
            (90, 100, 110),
            "the paper's claim; Jerk of global compared with local: 11 % more.",
            "Clearly less jerk: none.",
        ),
    ]:
        local, plain_one, full = jerks
        verdict = said(globaldiff_local=local, globaldiff_global=plain_one, globaldiff_full=full)
        assert verdict is not None
        for each in words.split("; "):
            assert each in verdict.comparison
        assert are_calmer in verdict.comparison
        assert "reference" not in verdict.jerk_sentence


def test_samples_give_an_interval_and_where_they_do_not_tell_systems_apart_show_nothing() -> None:
    ends = ("", "__s2", "__s3")
    apart, open_ = (
        {f"globaldiff_local{end}": jerk for end, jerk in zip(ends, jerks, strict=True)}
        for jerks in ((200.0, 210.0, 190.0), (300.0, 60.0, 90.0))
    )
    other = {f"globaldiff_full{end}": 100.0 for end in ends}
    for local, shows, words in (
        (apart, "as the paper claims", "50 % less (47 to 52 %)."),
        (open_, "contrary to the paper's claim", "no clear difference."),
    ):
        words = f"Jerk of full, which also has global rotations, compared with local: {words}"
        verdict = said(**local, **other)
        assert verdict is not None and words in verdict.comparison and shows in verdict.comparison
        assert "3 samples, one training run per system" in verdict.comparison


def test_without_the_ladder_nothing_is_said_of_the_paper_and_without_jerk_nothing() -> None:
    verdict = said(gan_20=80, asynfusion_ddim=90)
    assert verdict is not None
    assert verdict.jerk_sentence.endswith("gan/20 80, ddim 90.")
    assert verdict.comparison.startswith(
        "Jerk of gan/20 (lowest) compared with ddim (highest): 11 % less. One clip"
    )
    alone = said(globaldiff_local=80)
    assert alone is not None and alone.comparison == ""
    assert make_verdict("right_middle", [clip_of(globaldiff_local=None)]) is None
    # Names that two families share stay whole.
    assert short_names(["a/x", "b/x", "b/y"]) == {"a/x": "a/x", "b/x": "b/x", "b/y": "y"}


def test_over_several_clips_the_interval_is_over_clips_each_with_the_mean_of_its_samples() -> None:
    clips = [
        clip_of(globaldiff_local=180.0, globaldiff_local__s2=220.0, globaldiff_full=100.0),
        clip_of(globaldiff_local=210.0, globaldiff_full=100.0, reference=50.0),
        clip_of(globaldiff_local=None, globaldiff_full=None),
        clip_of(globaldiff_local=190.0, globaldiff_full=100.0),
    ]
    jerk = values_by_metric({name: of["raw"] for name, of in clip.items()} for clip in clips)[JERK]
    assert jerk["globaldiff/local"] == {1: 200.0, 2: 210.0, 4: 190.0}
    verdict = make_verdict("right_middle", clips)
    assert verdict is not None and verdict.jerk_sentence == (
        "Right middle fingertip jerk in m/s³, mean over 3 clips: local 200, full 100; reference 50 "
        "(of 1 clip)."
    )
    words = "as the paper claims, the system with global rotations has less jerk than the one with"
    assert f"Over 3 clips, {words} local rotations. Jerk of full, which also" in verdict.comparison
    assert "rotations, compared with local: 50 % less (47 to 52 %)." in verdict.comparison
    assert "3 clips, one training run per system: an example, not evidence." in verdict.comparison
    many = make_verdict("right_middle", [clips[1]] * 10)
    assert many is not None and "10 clips" in many.comparison and "example" not in many.comparison
    assert make_verdict("right_middle", clips[1:3]) is None


def test_full_is_said_to_jerk_more_than_global_where_it_clearly_does() -> None:
    for full, words in [(100.0, "equal within 5 %"), (104.0, "equal"), (112.0, "12 % more")]:
        verdict = said(globaldiff_global=100, globaldiff_full=full)
        assert verdict is not None and f"compared with global): full {words}" in verdict.text


def test_calmer_than_the_reference_is_told_apart_from_moving_less() -> None:
    moved = {"a/slow": (60.0, 0.3), "a/smooth": (40.0, 1.1), "a/like": (90.0, 0.2)}
    clip: Any = {
        name: {"raw": {JERK: jerk, SPEED: speed}}
        for name, (jerk, speed) in {**moved, "reference": (100.0, 1.0)}.items()
    }
    verdict = make_verdict("right_middle", [clip])
    assert verdict is not None and (
        "Less jerk than the reference: slow (60 % of the reference's jerk, 30 % of its speed: "
        "moves less, possibly over-smoothed) and smooth (40 % of the reference's jerk, 110 % of "
        "its speed: "
        "moves about as much). One clip" in verdict.comparison
    )
    alone = make_verdict("right_middle", [{name: clip[name] for name in ("a/slow", "reference")}])
    assert alone is not None and alone.comparison.startswith("Less jerk than the reference: slow (")


def test_in_what_the_claimed_system_is_worse_beyond_chance_is_told() -> None:
    slide, power = "foot_sliding_cm_s", "tracked_point_power_above_5hz_percent"
    clips: list[dict[str, Any]] = [
        {
            "globaldiff/local": {"raw": {JERK: 200.0, slide: 2.0, power: 1.0}},
            "globaldiff/global": {"raw": {JERK: 110.0, slide: more, power: 9.0}},
        }
        for more in (3.0, 5.0)
    ]
    verdict = make_verdict("right_middle", clips)
    words = "Global is worse than local in foot sliding (4.0 against 2.0 cm/s). 2 clips, one"
    assert verdict is not None and words in verdict.comparison
    clips[0]["globaldiff/global"]["raw"][slide] = 1.9
    verdict = make_verdict("right_middle", clips)
    assert verdict is not None and "worse" not in verdict.comparison


def test_the_first_finding_is_of_the_motion_that_the_headline_tells_to_be_worst(
    tmp_path: Path,
) -> None:
    trembling = tmp_path / "b.npz"
    save_motion(add_tremble(load_motion(FIRST_MOTION)), trembling)
    motions = (FIRST_MOTION, trembling)
    run(
        diagnose_request(motions=motions, out=tmp_path / "out", names=("A", "B"), has_figures=False)
    )
    record = read_run(tmp_path / "out")
    verdict = record.verdict
    assert verdict is not None and verdict.jerk_sentence.endswith("A 185, B 1226.")
    assert verdict.comparison.startswith(
        "Jerk of A (lowest) compared with B (highest): 85 % less. One clip is"
    )
    first, last = record.findings[0], record.findings[-1]
    assert first.motion_name == "B"
    assert first.sentence.startswith("Jittery hands, worst at 0:")
    assert "mean jerk of all ten fingertips 655 m/s³ (recorded and pro" in first.sentence
    assert first.sentence.endswith(": 43 to 202).")
    assert (last.motion_name, last.sentence) == ("", "No findings in A.")
    more = record.model_copy(update={"findings": [*[first] * 5, last]})
    assert more.top_findings == [*[first] * 3, last]
    assert finding_records({"A": []})[0].sentence == "No findings."


JERKS = st.floats(1.0, 500.0)
CHANGES = re.compile(
    r"Jerk of ([\w/]+)(?: \(lowest\)|, which also has [\w ]+,)? compared with ([\w/]+)"
    r"(?: \(highest\))?: (.*?)(?=\. |$)"
)
"""Both systems of a comparison, and how much less or more jerk the first one has."""
SHARES = re.compile(r"\((\d+) % of its jerk(?: at (\d+) % of its speed: ([\w ,-]+))?\)")


@settings(max_examples=60, deadline=None)
@given(data=st.data(), num_clips=st.integers(1, 4), samples=st.integers(1, 3))
def test_no_words_of_a_verdict_contradict_its_numbers(
    data: st.DataObject, num_clips: int, samples: int
) -> None:
    """Over random jerks, some of them missing."""
    systems = ("globaldiff/local", "globaldiff/global", "globaldiff/full", "gan/20", "reference")
    present = data.draw(st.sets(st.sampled_from(systems), min_size=1))
    clips: list[Any] = []
    for _ in range(num_clips):
        clip: dict[str, Any] = {}
        for name in sorted(present):
            for number in range(1, 1 + (samples if name != "reference" else 1)):
                known = data.draw(st.integers(0, 9)) > 0
                jerk, speed = data.draw(JERKS), data.draw(st.none() | st.floats(0.05, 2.0))
                of = {JERK: jerk} if known else {}
                of |= {} if speed is None else {SPEED: speed}
                clip[str(SampleName(name, number))] = {"raw": of}
        clips.append(clip)
    verdict = make_verdict("right_middle", clips)
    if verdict is None:
        return
    said = verdict.comparison
    means = {
        name: float(value)
        for name, value in re.findall(
            r"([\w/]+) ([\d.]+)(?=[,; ]|\.)", verdict.jerk_sentence.split(":")[1]
        )
    }
    for other, one, change in CHANGES.findall(said):
        if change.startswith("equal"):
            assert 0.9 < means[other] / means[one] < 1.1, verdict.text
        elif "less" in change:
            assert means[other] <= means[one], verdict.text
        elif "more" in change:
            assert means[other] >= means[one], verdict.text
    if most := re.search(r"\(lowest\) compared with ([\w/]+) \(highest\)", said):
        assert means[most[1]] == max(v for n, v in means.items() if n != "reference")
    if "as the paper claims" in said:
        assert re.search(r"local rotations\. Jerk [^.:]*: (over )?[\d.]+ % less", said), (
            verdict.text
        )
    calmer = re.search(r"Less jerk than the reference: (.*?\))\.", said)
    for share, speed, how in SHARES.findall(calmer[1] if calmer else ""):
        assert int(share) < 80
        if how:
            assert (how.startswith("moves less,")) == (int(speed) < 80), how
            assert ("about as much" in how) == (int(speed) >= 95), how
    added = re.search(r"\(each compared with .*?\): (.*?)\. Clearly less jerk: (.*?)\.", said)
    if added:
        less = re.findall(r"([\w/]+) (?:over )?[\d.]+ % less", added[1])
        assert sorted(less) == sorted(re.findall(r"[\w/]+", added[2].replace(" and ", " "))) or (
            added[2] == "none" and not less
        ), verdict.text


def test_every_title_is_of_a_kind_of_finding() -> None:
    kinds = {fault.kind for fault in (*FAULTS, STILL)}
    assert set(KIND_TITLES) <= kinds
    assert format_finding_kinds(["foot_slide", "frozen_hand", "kind_of_another_lab"]) == (
        "foot sliding, frozen hand, kind of another lab"
    )
