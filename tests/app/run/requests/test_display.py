import numpy as np
import pytest

from app.errors import RunError
from app.run.followed_point import choose_tip_source
from app.run.requests.display import TOLD, Display, check_display, displayed, marks_of
from conventions.joints import JOINT_INDEX
from renderer.body.body import load_body
from tests.app.fakes import made_motion

BODY = load_body()
TIP = choose_tip_source(BODY, None)


def test_a_plain_display_marks_nothing():
    motion = made_motion(40)
    assert Display().is_plain
    assert marks_of(motion, Display(), TIP, BODY) is None
    assert displayed(motion, Display()) is motion


def test_dots_stand_where_the_point_jerks():
    trembling, still = made_motion(60, 0.5), made_motion(60, 0.0)
    for motion, is_any in ((trembling, True), (still, False)):
        marks = marks_of(motion, Display(has_trail=True), TIP, BODY)
        assert marks is not None and marks.trail is not None and marks.heat is None
        trail = marks.trail
        assert trail.points.shape == (60, 3) and trail.speeds.shape == trail.is_spike.shape == (60,)
        assert trail.is_spike.any() == is_any
        assert trail.close_up == "right_hand"
        assert not marks.notice


def test_the_trail_of_a_single_jump_has_its_dots_there():
    motion = made_motion(60, 0.0)
    motion.poses[30:, 3 * JOINT_INDEX["right_elbow"] + 1] = 0.3
    marks = marks_of(motion, Display(has_trail=True), TIP, BODY)
    assert marks is not None and marks.trail is not None
    frames = np.flatnonzero(marks.trail.is_spike)
    assert len(frames) and 27 <= frames.min() <= 30 <= frames.max() <= 32


def test_colours_follow_the_jerk_of_each_joint_on_a_fixed_scale():
    marks = marks_of(made_motion(60, 0.5), Display(coloring="jerk"), TIP, BODY)
    assert marks is not None and marks.heat is not None
    shares = marks.heat.shares
    assert shares.shape == (60, 55) and shares.min() >= 0 and shares.max() <= 1
    assert shares[:, JOINT_INDEX["right_wrist"]].mean() > 0.5
    assert shares[:, JOINT_INDEX["left_wrist"]].max() < 1e-3
    assert "500 m/s³" in marks.heat.legend
    wider = marks_of(made_motion(60, 0.5), Display(coloring="jerk", jerk_m_s3=2000.0), TIP, BODY)
    assert wider is not None and wider.heat is not None and "2000" in wider.heat.legend
    inside = shares[shares < 1]
    assert np.allclose(wider.heat.shares[shares < 1], inside / 4)


def test_exaggerated_motion_says_so_and_its_jerk_is_that_of_the_motion():
    motion = made_motion(60, 0.002)
    display = Display(exaggeration=20, has_trail=True, coloring="jerk")
    marks, plain = (
        marks_of(motion, each, TIP, BODY) for each in (display, Display(1, True, "jerk"))
    )
    assert marks is not None and plain is not None
    assert marks.notice.startswith("EXAGGERATED x20") and marks.tag == "x20"
    assert marks.trail is not None and plain.trail is not None
    assert np.array_equal(marks.trail.is_spike, plain.trail.is_spike)
    assert np.array_equal(marks.heat.shares, plain.heat.shares)  # type: ignore[union-attr]
    drawn, kept = (np.ptp(each.trail.points, axis=0).max() for each in (marks, plain))  # type: ignore[union-attr]
    assert 8 * kept < drawn < 30 * kept


def test_factor_cut_off_and_length_of_a_trail_are_what_was_asked_for():
    motion = made_motion(60, 0.02)
    display = Display(2.26, True, cutoff_hz=7.0, trail_frames=12)
    marks = marks_of(motion, display, TIP, BODY)
    assert marks is not None and marks.trail is not None
    assert marks.notice == "EXAGGERATED x2.3: all above 7 Hz" and marks.trail.num_frames == 12
    lower = displayed(motion, Display(2.26, cutoff_hz=3.0))
    assert np.abs(displayed(motion, display).poses - lower.poses).max() > 0.005


def test_clips_too_short_for_jerk_have_none():
    marks = marks_of(made_motion(2), Display(has_trail=True, coloring="jerk"), TIP, BODY)
    assert marks is not None and marks.trail is not None and marks.heat is not None
    assert not marks.trail.is_spike.any() and not marks.heat.shares.any()


LOOK = {
    "factor": 6.5, "hasTrail": True, "hasHeat": True, "cutoff": 4, "trailFrames": 60,
    "heatScale": 300, "tone": "dark",
}  # fmt: skip


def test_a_display_is_what_the_stage_tells():
    display = Display.of_look(LOOK)
    assert display == Display(6.5, True, "jerk", 4.0, 60, 300.0)
    assert type(display.trail_frames) is int and type(display.cutoff_hz) is float
    plain = Display.of_look({**LOOK, "factor": 1, "hasTrail": 1, "hasHeat": "true"})
    assert plain.is_plain, "only true is true"
    beyond = Display.of_look({**LOOK, "trailFrames": 91.0})
    with pytest.raises(RunError, match="5 to 90 frames long; got 91"):
        check_display(beyond)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("factor", value) for value in ("2", True, None, [2], float("nan"), float("inf"))),
        pytest.param("factor", 10**400, id="factor-of 400 digits"),
        ("cutoff", False),
        ("heatScale", {}),
        *(("trailFrames", value) for value in (30.5, True, "30", float("-inf"))),
    ],
)
def test_what_the_stage_does_not_tell_is_refused(name, value):
    with pytest.raises(ValueError, match=r"is no (whole )?number\."):
        Display.of_look({**LOOK, name: value})


@pytest.mark.parametrize("told", TOLD.values(), ids=TOLD)
def test_what_the_stage_leaves_out_is_missed(told):
    with pytest.raises(KeyError, match=told.name):
        Display.of_look({name: value for name, value in LOOK.items() if name != told.name})


@pytest.mark.parametrize(
    ("display", "words"),
    [
        (Display(exaggeration=21), "1 to 20 times as large; got 21"),
        (Display(exaggeration=float("nan")), "1 to 20 times as large; got nan"),
        (Display(cutoff_hz=2), "faster than 3 to 8 Hz; got 2"),
        (Display(trail_frames=91), "5 to 90 frames long; got 91"),
        (Display(jerk_m_s3=0), "end at 50 to 2000 m/s³; got 0"),
        (Display(coloring="rainbow"), "no colouring 'rainbow'"),  # type: ignore[arg-type]
    ],
)
def test_what_cannot_be_shown_is_refused(display, words):
    with pytest.raises(RunError, match=words):
        check_display(display)
