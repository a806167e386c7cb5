"""Plans in and out of files; annotators' own habits; hostile files; markers."""

import csv
import json
import re
from dataclasses import replace
from itertools import pairwise, permutations
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from model.plan.annotation_files import Interval, NamedTier, format_textgrid, parse_textgrid
from model.plan.files import (
    ENDINGS,
    markers_csv,
    plan_markers,
    read_corpus_textgrid,
    read_plan_file,
    write_plan_file,
)
from model.plan.kinds import REST_POSITION, USUAL_STROKE_GOALS
from model.plan.plan import (
    PHASES,
    SIDES,
    Blink,
    Brow,
    FootContact,
    Gaze,
    GesturePlan,
    HandPhase,
    Nod,
    PlanError,
    PlanResult,
    Smile,
    Stance,
)
from model.plan.tiers import DEFAULT_NOD_DEG, plan_to_tiers, tiers_to_plan
from tests.helpers import reported_folder
from tests.model.plan.made import HANDS, HIGH, grid, made_plan, phase, tier

MS = 0.0005000001
NAMES = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), max_size=12)


def _times(most: int) -> st.SearchStrategy[list[float]]:
    """Rising, 20 ms apart at least."""
    steps = st.lists(st.integers(20, 900), max_size=most)
    return steps.map(lambda gaps: [sum(gaps[: k + 1]) / 1000 for k in range(len(gaps))])


def _numbers(least: float, most: float) -> st.SearchStrategy[float]:
    return st.floats(least, most).map(lambda number: round(number, 4))


@st.composite
def plans(draw: st.DrawFn) -> GesturePlan:
    """Times in whole milliseconds and numbers of four decimals, which every file can hold."""

    def spans(most: int) -> list[tuple[float, float]]:
        times = draw(_times(2 * most))
        pairs = list(zip(times[::2], times[1::2], strict=False))
        is_tight = draw(st.booleans())
        return [(a, c) for (a, _), (c, _) in pairwise(pairs)] if is_tight else pairs

    def hand() -> tuple[HandPhase, ...]:
        return tuple(
            HandPhase(a, b, draw(st.sampled_from(PHASES)),
                      (draw(_numbers(-1, 1)), draw(_numbers(-1, 1)), draw(_numbers(-1, 1))),
                      draw(NAMES), draw(NAMES))
            for a, b in spans(5)
        )  # fmt: skip

    return GesturePlan(
        duration_s=draw(_numbers(0.5, 20)),
        left=hand(),
        right=hand(),
        nods=tuple(Nod(at, draw(_numbers(0, 9))) for at in draw(_times(3))),
        looks=tuple(
            Gaze(a, b, draw(_numbers(-30, 30)), draw(_numbers(-9, 9))) for a, b in spans(3)
        ),
        brows=tuple(Brow(at, draw(_numbers(-1, 1))) for at in draw(_times(3))),
        smiles=tuple(Smile(a, b, draw(_numbers(0, 1))) for a, b in spans(2)),
        blinks=tuple(Blink(at) for at in draw(_times(3))),
        stands=tuple(Stance(a, b, draw(st.sampled_from(["left", "both"]))) for a, b in spans(2)),
        planted=tuple(FootContact(a, b, side) for side in SIDES for a, b in spans(2)),
    )


@pytest.mark.parametrize("ending", ENDINGS)
@settings(
    max_examples=8,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(plans())
def test_a_plan_comes_back_as_it_went(ending: str, tmp_path: Path, plan: GesturePlan) -> None:
    write_plan_file(plan, tmp_path / f"plan{ending}")
    read = read_plan_file(tmp_path / f"plan{ending}")
    assert read.plan == plan and read.notes == ()


def test_a_plan_may_tell_little_go_at_another_speed_and_change_a_hand(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    path.write_text('{"format": 1, "duration_s": 2, "nods": [{"time_s": 1, "depth_deg": 3}]}')
    assert read_plan_file(path).plan == GesturePlan(2.0, nods=(Nod(1.0, 3.0),))
    plan = made_plan().at_speed(2.0)
    assert plan.duration_s == 3.0 and plan.nods[0] == Nod(0.95, 4.0)
    assert plan.right[2].end_s == 0.95 and plan.right[2].goal == made_plan().right[2].goal
    assert plan.at_speed(0.5) == made_plan()
    other = (phase(0.0, 1.0, "rest", HIGH),)
    assert made_plan().with_hand("left", other) == replace(made_plan(), left=other)
    assert made_plan().with_hand("right", other).hand("right") == other


def plan_with(field: str, told: str) -> str:
    return f'{{"format": 1, "duration_s": 2, "{field}": {told}}}'


BAD = [
    ("not json", "is not a plan of format 1"),
    ("[]", "is not a plan of format 1"),
    ("[" * 100_000, "is not a plan"),
    ('{"format": 2}', "is not a plan of format 1"),
    (f'{{"format": 1, "duration_s": {10**400}}}', "`duration_s` cannot be "),
    (plan_with("dance", "[]"), "`dance` is not a known key"),
    (plan_with("nods", "3"), "`nods` cannot be 3: input should be a valid array"),
    (plan_with("nods", '[{"time_s": 1}]'), "`nods.0.depth_deg` is missing"),
    (plan_with("nods", '[{"time_s": true, "depth_deg": 1}]'), "should be a valid number"),
    (plan_with("smiles", '[{"start_s": 1, "end_s": 1, "size": 1}]'), "must end after it begins"),
    (plan_with("stands", '[{"start_s": 0, "end_s": 1, "leg": "third"}]'), "'left', 'right' or"),
]  # fmt: skip
BAD_HANDS = [
    ({"goal": [0, 0]}, "`right.1.goal.2` is missing"),
    ({"goal": [0, 0, 3]}, "over 1 m from the chest"),
    ({"word": "x" * 100}, "at most 80 characters"),
    ({"start_s": 0.5}, "in the middle of a rest; phases of one hand must not overlap"),
]


def test_what_is_no_plan_is_refused_in_a_sentence(tmp_path: Path) -> None:
    path, bad = tmp_path / "plan.json", list(BAD)
    for change, says in BAD_HANDS:
        wrong = json.loads(made_plan().as_json())
        wrong["right"][1] |= change
        bad.append((json.dumps(wrong), says))
    for text, says in bad:
        path.write_text(text)
        with pytest.raises(PlanError, match=r"^plan\.json") as told:
            read_plan_file(path)
        assert says in str(told.value)


def test_half_a_character_of_a_word_leaves_a_plan_that_every_form_can_hold(tmp_path: Path) -> None:
    path, told = tmp_path / "plan.json", json.loads(made_plan().as_json())
    told["right"][1]["word"] = "ne\ud800ver"
    path.write_text(json.dumps(told))
    plan = read_plan_file(path).plan
    for name in ("a.eaf", "a.TextGrid", "a.json"):
        write_plan_file(plan, tmp_path / name)
        assert read_plan_file(tmp_path / name).plan.right[1].word == "ne?ver"


def test_times_between_milliseconds_are_rounded_once(tmp_path: Path) -> None:
    plan = made_plan().at_speed(1.0417)
    write_plan_file(plan, tmp_path / "a.eaf")
    once = read_plan_file(tmp_path / "a.eaf").plan
    for before, after in zip(plan.right, once.right, strict=True):
        assert abs(before.start_s - after.start_s) < MS and abs(before.end_s - after.end_s) < MS
        assert (before.goal, before.kind, before.word) == (after.goal, after.kind, after.word)
    write_plan_file(once, tmp_path / "b.eaf")
    assert read_plan_file(tmp_path / "b.eaf").plan == once


def test_an_elan_file_has_phases_to_choose_from_and_the_sound(tmp_path: Path) -> None:
    write_plan_file(made_plan(), tmp_path / "a.eaf", tmp_path / "so & so.wav")
    told = (tmp_path / "a.eaf").read_text()
    assert 'RELATIVE_MEDIA_URL="./so%20%26%20so.wav"' in told
    for name in PHASES:
        assert f">{name}</CVE_VALUE>" in told
    tiers = re.findall(r'TIER .*TIER_ID="(\w+)"', told)
    assert tiers[:4] == ["gesture_left", "kind_left", "word_left", "goal_left"]
    assert 'PARENT_REF="gesture_right"' in told


def test_what_a_form_cannot_hold_is_refused_and_leaves_no_file(tmp_path: Path) -> None:
    plan = replace(made_plan(), smiles=(Smile(1.0, 3.0, 0.5), Smile(2.0, 4.0, 0.2)))
    write_plan_file(plan, tmp_path / "plan.json")
    assert read_plan_file(tmp_path / "plan.json").plan == plan
    for ending in (".TextGrid", ".eaf"):
        with pytest.raises(PlanError, match=r"events in smile overlap at 2.00 s.*JSON"):
            write_plan_file(plan, tmp_path / f"plan{ending}")
        assert not (tmp_path / f"plan{ending}").exists()
    with pytest.raises(PlanError, match=r"a plan file must end in .json, .TextGrid, .eaf"):
        write_plan_file(plan, tmp_path / "plan.txt")
    for sign, says in (
        ("\0", "a character"),
        ("\ud800", "is not valid Unicode"),
    ):  # which XML cannot hold
        bad = plan.with_hand("left", (replace(plan.left[0], kind=f"a{sign}"),))
        with pytest.raises(PlanError, match=says):
            write_plan_file(replace(bad, smiles=()), tmp_path / "a.eaf")


def told(*tiers: NamedTier) -> PlanResult:
    return tiers_to_plan(tiers, 5.0)


ROWS = (
    (0.0, 1.0, "Rest"), (1.0, 1.4, "Prep"), (1.4, 1.8, "S"), (1.8, 2.2, "post-stroke hold"),
    (2.2, 3.0, "Retr."),
)  # fmt: skip
SHORT_LABELS = [
    ("rest", 0.0, ""), ("preparation", 1.0, "you"), ("stroke", 1.4, "you"), ("hold", 1.8, "you"),
    ("retraction", 2.2, ""),
]  # fmt: skip
PHRASE = tier("Gesture", (1.0, 2.0, "Deictic"))
HABITS = [
    *(
        ([tier(name, *ROWS), tier("RH-Kind", (1.0, 2.2, "you"))], SHORT_LABELS, "The right hand")
        for name in ("RH-Phase", "Right hand phases", "gesture_right", "RHPhase", "phase R")
    ),
    (
        [tier("RH Stroke", (1.4, 1.8, "no"), (3.0, 3.3, "")), tier("RH Prep", (1.0, 1.4, "")),
         tier("RH Retraction", (1.8, 2.4, "")), tier("Notes", (0.0, 1.0, "windy"))],
        [("preparation", 1.0, ""), ("stroke", 1.4, "no"), ("retraction", 1.8, ""),
         ("stroke", 3.0, "")],
        "Ignored tiers with unknown names: 'Notes'.",
    ),
    ([PHRASE], [("stroke", 1.0, "deictic")], "These labels are read as"),
    *(  # a beat among gesture types is McNeill's: a gesture with a stroke
        ([tier(name, (0, 1, "beat"), (1, 2, "iconic"), (2, 3, "Beat"), (3, 4, "beat"))],
         [("stroke", 0, "beat"), ("stroke", 1, "iconic"), ("stroke", 2, "beat"),
          ("stroke", 3, "beat")], f"Beats in tier {name} are read as beat gestures")
        for name in ("gesture_right", "RH phase", "Gesture")
    ),
    ([tier("RH gestures", (0, 1, "beat"), (1, 2, "rest"))],
     [("stroke", 0, "beat"), ("rest", 1, "")],
     "Tier RH gestures has whole gestures without phases; each is performed as one long"),
    ([tier("RH beats", (0, 1, ""))], [("stroke", 0, "beat")], "Beats in tier RH beats are read"),
    ([tier("gesture_right", (0, 1, "rest"), (1, 2, "beat"), (2, 3, "rest"))],
     [("rest", 0, ""), ("beat", 1, ""), ("rest", 2, "")], "The right hand has no goals"),
    ([tier("RH phase", (0, 1, "S"), (1, 2, "beat"), (2, 3, "point_up"))],
     [("stroke", 0, ""), ("beat", 1, ""), ("stroke", 2, "point_up")], "These labels are read as"),
    *(
        ([tier("phase R", (0, 1, label), (1, 2, "stroke"), (2, 3, "P"))],
         [("rest", 0, ""), ("stroke", 1, ""), ("preparation", 2, "")],
         f"These labels name no gesture and are read as rest: {label!r}.")
        for label in ("adaptor", "Self-touch", "?", "unclear", "none", "-", "")
    ),
    ([tier("Gesture", (0, 1, "adaptor"), (1, 2, ""), (2, 3, "self"))],
     [("rest", 0, ""), ("stroke", 1, ""), ("stroke", 2, "self")], "These labels name no gesture"),
    (
        [PHRASE, tier("Phase", (1.0, 1.5, "prep"), (1.5, 2.0, "stroke"))],
        [("preparation", 1.0, "Deictic"), ("stroke", 1.5, "Deictic")],
        "Tier Phase names no hand; it is used for the right hand.",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("tiers", "phases", "note"), HABITS)
def test_annotators_names_labels_and_tiers_are_understood(
    tiers: list[NamedTier], phases: list[tuple[str, float, str]], note: str
) -> None:
    read = told(*tiers)
    assert [(p.phase, p.start_s, p.kind) for p in read.plan.right] == phases
    assert read.plan.left == () and any(each.startswith(note) for each in read.notes)


def test_what_is_told_without_places_goes_where_such_gestures_usually_do() -> None:
    rest, _, stroke, hold, back = told(*HABITS[0][0]).plan.right
    assert (
        stroke.goal == hold.goal == USUAL_STROKE_GOALS["you"]
        and rest.goal == back.goal == REST_POSITION
    )


def test_heads_and_faces_need_no_numbers() -> None:
    read = told(
        tier("phases both hands", (0.0, 1.0, "rest")),
        tier("head nod", (1.0, 1.4, "nod")),
        tier("Gaze", (0.0, 1.0, "listener"), (1.0, 2.0, "looks left")),
        tier("eyebrows", (1.0, 2.0, "frown")),
        tier("blink", (2.0, 2.2, "")),
        tier("weight", (0.0, 2.0, "on the left leg")),
    )
    plan = read.plan
    assert plan.left == plan.right and len(plan.left) == 1
    assert (plan.nods[0].time_s, plan.nods[0].depth_deg) == (1.2, DEFAULT_NOD_DEG)
    assert [look.yaw_deg > 0 for look in plan.looks] == [False, True]
    assert plan.brows[0].height < 0 and plan.blinks[0].time_s == 2.1
    assert plan.stands[0].leg == "left"


def test_a_name_that_means_several_things_means_the_first() -> None:
    """In every process: sets of words have an order of chance."""
    for names in permutations(("nod", "blink", "smile", "gaze")):
        plan = told(tier("phases right"), tier(" ".join(names), (1.0, 1.4, ""))).plan
        rows = {"nod": plan.nods, "blink": plan.blinks, "smile": plan.smiles, "gaze": plan.looks}
        assert [name for name in names if rows[name]] == [names[0]]


@pytest.mark.parametrize(
    ("tiers", "says"),
    [
        ([tier("words", (0.0, 1.0, "so"))], "No tier holds the gestures of a hand.*tiers: words"),
        ([], "tiers: none"),
        (
            [tier("phase R", (0, 2, "stroke"), (1, 3, "hold"))],
            "phases of one hand must not overlap",
        ),
        (
            [tier("phase R", (0, 2, "rest")), tier("goal R", (0, 2, "near"))],
            "be three numbers",
        ),
        ([tier("phase R"), tier("weight", (0, 2, "chair"))], "must be left, right or both"),
        ([tier("phase R"), tier("nods", (0, 2, "nan"))], "is not finite"),
        ([tier("phase R"), tier("smile", (2, 1, ".5"))], "must end after it begins"),
    ],
)
def test_what_tells_no_plan_is_refused(tiers: list[NamedTier], says: str) -> None:
    with pytest.raises(PlanError, match=says):
        told(*tiers)


def test_the_corpus_tells_phases_goals_kinds_words_and_the_rest_of_the_body(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.TextGrid"
    body = (
        tier("nods", (1.2, "4.500")),
        tier("gaze", (0, 1, "0.0 1.5"), (1, 3, "-12.5 4.0")),
        tier("brows", (1.0, "0.700 0.120")),
        tier("smile", (0, 1, ""), (1, 2, "0.300")),
        tier("blinks", (0.5, "0.130")),
        tier("weight", (0, 2, "left"), (2, 3, "both")),
        tier("foot_left", (0, 3, "planted")),
        tier("foot_right", (0, 1, "planted"), (1, 1.5, ""), (1.5, 3, "planted")),
    )
    path.write_text(grid(*HANDS, *body))
    plan = read_corpus_textgrid(path)
    assert [p.phase for p in plan.left] == ["rest"]
    assert plan == GesturePlan(
        3.0,
        plan.left,
        (
            phase(0, 1, "rest", (0.2, -0.3, 0.1)),
            phase(1, 1.5, "preparation", (0.2, 0.1, 0.3), "offer"),
            phase(1.5, 2, "stroke", (0.1, 0.0, 0.4), "offer", "whole"),
            phase(2.4, 3, "retraction", (0.2, -0.3, 0.1)),
        ),
        (Nod(1.2, 4.5),),
        (Gaze(0.0, 1.0, 0.0, 1.5), Gaze(1.0, 3.0, -12.5, 4.0)),
        (Brow(1.0, 0.7),),
        (Smile(1.0, 2.0, 0.3),),
        (Blink(0.5),),
        (Stance(0.0, 2.0, "left"), Stance(2.0, 3.0, "both")),
        tuple(
            FootContact(a, b, side)
            for a, b, side in ((0.0, 3.0, "left"), (0.0, 1.0, "right"), (1.5, 3.0, "right"))
        ),
    )
    path.write_text(grid(tier("words", (0, 1, "so"))))
    with pytest.raises(PlanError, match="has no tier gesture_left"):
        read_corpus_textgrid(path)


LABELS = 'say "x"', "two\nlines", "see item [3]:", "intervals [1]:", "TextTier", "xmin = 7", ""


def test_a_textgrid_comes_back_whatever_its_labels_hold() -> None:
    spans = tier("of", *((k, k + 1, label) for k, label in enumerate(LABELS)))
    told = [spans, tier("none"), tier('a "b"', *((k, label) for k, label in enumerate(LABELS)))]
    assert parse_textgrid(format_textgrid(told, 7.0), "a", PlanError) == (
        [spans, NamedTier("none", (Interval(0.0, 7.0, ""),)), told[2]],
        7.0,
    )


SHORT = """File type = "ooTextFile short"
"TextGrid"

0
2
<exists>
2
"IntervalTier"
"words"
0
2
2
0
5e-1
"so ""it"" now"
.5
2
"goes"
"TextTier"
"apex"
0
2
1
-1
"here"
"""


def test_praats_short_format_exponents_and_times_before_zero_are_read_as_they_stand() -> None:
    words = (Interval(0.0, 0.5, 'so "it" now'), Interval(0.5, 2.0, "goes"))
    apex = NamedTier("apex", (Interval(-1.0, -1.0, "here"),), has_points=True)
    assert parse_textgrid(SHORT, "a", PlanError) == ([NamedTier("words", words), apex], 2.0)


def eaf(body: str, head: str = "") -> str:
    return f"""<?xml version="1.0"?>{head}<ANNOTATION_DOCUMENT>
<HEADER TIME_UNITS="milliseconds"/>{body}</ANNOTATION_DOCUMENT>"""


def slots(*times: str) -> str:
    told = "".join(
        f'<TIME_SLOT TIME_SLOT_ID="t{k}"{f" TIME_VALUE={at!r}" if at else ""}/>'
        for k, at in enumerate(times)
    ).replace("'", '"')
    return f"<TIME_ORDER>{told}</TIME_ORDER>"


def phase_tier(*spans: tuple[int, int, str]) -> str:
    rows = "".join(
        f'<ANNOTATION><ALIGNABLE_ANNOTATION ANNOTATION_ID="a{k}" TIME_SLOT_REF1="t{a}" '
        f'TIME_SLOT_REF2="t{b}"><ANNOTATION_VALUE>{label}</ANNOTATION_VALUE>'
        "</ALIGNABLE_ANNOTATION></ANNOTATION>"
        for k, (a, b, label) in enumerate(spans)
    )
    return f'<TIER TIER_ID="R-Phase" LINGUISTIC_TYPE_REF="x">{rows}</TIER>'


def test_times_that_an_annotator_left_open_lie_between(tmp_path: Path) -> None:
    path = tmp_path / "a.eaf"
    body = slots("0", "", "", "3000") + phase_tier((0, 1, "prep"), (1, 2, "stroke"), (2, 3, "hold"))
    path.write_text(eaf(body))
    plan = read_plan_file(path).plan
    assert [(p.start_s, p.end_s) for p in plan.right] == [(0, 1), (1, 2), (2, 3)]
    assert plan.duration_s == 3.0


def test_times_are_those_of_the_media_that_elan_shows(tmp_path: Path) -> None:
    (tmp_path / "a.eaf").write_text(
        eaf(slots("1000", "1500") + phase_tier((0, 1, "stroke"))).replace(
            'TIME_UNITS="milliseconds"/>',
            'TIME_UNITS="milliseconds"><MEDIA_DESCRIPTOR MIME_TYPE="video/mp4" TIME_ORIGIN="7"/>'
            '<MEDIA_DESCRIPTOR MIME_TYPE="audio/x-wav" TIME_ORIGIN="2000"/></HEADER>',
        )
    )
    read = read_plan_file(tmp_path / "a.eaf")
    ((start_s, end_s),) = [(phase.start_s, phase.end_s) for phase in read.plan.right]
    assert (start_s, end_s, read.plan.duration_s) == (3.0, 3.5, 3.5)
    assert read.notes[0].startswith("a.eaf: the ELAN timeline begins 2 s after")
    reported = read_plan_file(reported_folder() / "phases_time_origin_2000.eaf")
    strokes = [(p.start_s, p.end_s) for p in reported.plan.right if p.phase == "stroke"]
    assert strokes == [(3.5, 3.9), (7.5, 7.9)] and "TIME_ORIGIN" in reported.notes[0]


def test_what_is_told_of_included_annotations_is_kept(tmp_path: Path) -> None:
    """A phrase, the phases in it, and the kind of one of these: as annotators nest them."""
    ref = (
        '<TIER TIER_ID="R-Kind" PARENT_REF="R-Phase"><ANNOTATION><REF_ANNOTATION '
        'ANNOTATION_ID="a9" ANNOTATION_REF="a1"><ANNOTATION_VALUE>you</ANNOTATION_VALUE>'
        "</REF_ANNOTATION></ANNOTATION></TIER>"
    )
    phases = phase_tier((0, 1, "prep"), (1, 2, "stroke")).replace("<TIER", '<TIER PARENT_REF="x"')
    (tmp_path / "a.eaf").write_text(eaf(slots("0", "500", "900") + phases + ref))
    plan = read_plan_file(tmp_path / "a.eaf").plan
    assert [(p.phase, p.kind) for p in plan.right] == [("preparation", ""), ("stroke", "you")]


HOSTILE = [
    (eaf("&a;", '<!DOCTYPE x [<!ENTITY a "aaaa">]>'), "has a DOCTYPE or ENTITY declaration"),
    (eaf("&a;", '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>'), "DOCTYPE or ENTITY"),
    (eaf("", '<!DOCTYPE x SYSTEM "http://a.b/c.dtd">'), "DOCTYPE or ENTITY"),
    (eaf("<a>" * 50 + "</a>" * 50), "levels"),
    (eaf("<a " + " ".join(f'a{k}=">"' for k in range(9_000)) + "/>"), "label or tag above"),
    (eaf(slots("0", "5"))[:-9], "is not an ELAN file"),
    ("<svg/>", "is not an ELAN file"),
    ("", "is not an ELAN file"),
    ('<?xml version="1.0" encoding="nonsense"?><a/>', "is not an ELAN file"),
    (eaf(slots("0", "-5")), "'-5' is not a number of milliseconds"),
    (eaf(slots("0", "999999999")), "longer than the limit of 24 hours"),
    (eaf(slots("0") + phase_tier((0, 4, "prep"))), "has no times"),
    (eaf("").replace("milliseconds", "PAL-frames"), "PAL-frames"),
    (eaf("").replace('"/>', '"><MEDIA_DESCRIPTOR TIME_ORIGIN="1e9"/></HEADER>', 1), "TIME_ORIGIN"),
    (eaf(slots("0", "1") + '<TIER TIER_ID="x"><ANNOTATION><REF_ANNOTATION ANNOTATION_ID="a" '
     'ANNOTATION_REF="a"/></ANNOTATION></TIER>'), "No tier holds the gestures of a hand"),
]  # fmt: skip


GRID = format_textgrid(plan_to_tiers(made_plan(), for_praat=True), 6.0)
NO_GRID = [
    (GRID.replace("xmax = 1.5000", "xmax = 1..5"), "to nan s; times must be from 0 s"),
    (GRID.replace("number = 1.5", "number = -1.5"), "from -1.5 .*times must be from 0"),
    (GRID.replace("xmax = 6.0000", "xmax = 1e99", 1), "lasts 1e.99 s; it must last"),
    (GRID.replace("xmax = 6.0000", "xmax = 1e5", 1), "at most 24 hours"),
    (GRID[: len(GRID) // 2], "should have 9 rows and has"),
    (GRID[: GRID.index("item [9]")], "is cut off or damaged: it should have 14 tiers and has 8"),
    (GRID.replace("xmin = 1.0000", "", 1), "has no start or end time"),
    (GRID.replace('"brows"', '"nods"'), "two tiers called nods; rename or delete one"),
    ("xmin = 0", "is not a TextGrid"),
    ('File type = "ooTextFile"\nObject class = "TextGrid"\n', "has no tiers"),
]


def test_hostile_files_are_refused_in_a_sentence(tmp_path: Path) -> None:
    for ending, cases in ((".eaf", HOSTILE), (".TextGrid", NO_GRID)):
        path = tmp_path / f"a{ending}"
        for text, says in cases:
            path.write_text(text)
            with pytest.raises(PlanError, match=rf"^a\{ending}.*{says}") as error:
                read_plan_file(path)
            assert str(error.value).count("\n") == 0
        with pytest.raises(PlanError, match="could not be read"):
            read_plan_file(tmp_path / f"missing{ending}")


@pytest.mark.parametrize("number", [1e308, -1e308, 1e7])
def test_numbers_that_nothing_can_be_computed_of_are_refused(number: float, tmp_path: Path) -> None:
    whole = json.loads(made_plan().as_json())
    for change in (
        {"duration_s": number},
        {"nods": [{"time_s": number, "depth_deg": 4.0}]},
        {"nods": [{"time_s": 1.0, "depth_deg": number}]},
        {"smiles": [{"start_s": 0.0, "end_s": abs(number), "size": 1.0}]},
    ):
        (tmp_path / "a.json").write_text(json.dumps({**whole, **change}))
        with pytest.raises(
            PlanError, match=r"a\.json cannot be used: .*(at most|longer than|the limit)"
        ):
            read_plan_file(tmp_path / "a.json")


def test_what_lies_beyond_a_time_is_left_out_of_a_plan() -> None:
    plan = made_plan()
    cut = plan.until(2.0)
    assert cut.duration_s == 2.0
    ends = [each.end_s for events in (cut.right, cut.left, cut.smiles, cut.nods) for each in events]
    assert max(ends) <= 2.0
    assert cut.right[:3] == plan.right[:3] and cut.right[3] == replace(plan.right[3], end_s=2.0)
    assert len(cut.right) == 4 and plan.until(6.0) == plan


def test_large_files_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.eaf").write_text(eaf(slots(*["0"] * 9)))
    monkeypatch.setattr("model.plan.annotation_files.MAX_ELEMENTS", 3)
    with pytest.raises(PlanError, match="exceeds the limit of 3 XML elements"):
        read_plan_file(tmp_path / "a.eaf")
    monkeypatch.setattr("model.plan.files.MAX_BYTES", 100)
    with pytest.raises(PlanError, match="is larger than"):
        read_plan_file(tmp_path / "a.eaf")


def test_every_movement_and_event_is_a_marker_in_time() -> None:
    markers = plan_markers(made_plan())
    assert markers == sorted(markers)
    names = [name for _, name in markers]
    assert len(names) == 7 + 2 + 3 + 1 + 2 and "left rest" not in names
    assert (1.5, "right stroke (offer) on whole") in markers
    assert {"nod 4°", "gaze 14° 5°", "brows", "blink", "right retraction"} <= set(names)
    rows = list(csv.DictReader(markers_csv(made_plan()).splitlines()))
    assert list(rows[1].values()) == ["24", "0.8000", "blink"] and len(rows) == len(markers)
