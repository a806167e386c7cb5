"""Plans found in motion: in recordings made here by rule, whose phases are known."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from conventions.joints import JOINT_NAMES
from model.motion.kinematics import blendshape_names, open_body_skeleton
from model.motion.motion import Motion
from model.plan.detection import hand_phases, plan_from_motion
from model.plan.plan import PHASES, GesturePlan
from model.plan.plan_features import hand_tracks, plan_tracks
from tests.model.motion.made import about, posed
from tests.model.plan.made import phase

REST, HIGH, LOW = (0.25, -0.26, 0.25), (0.18, 0.05, 0.3), (0.22, -0.15, 0.36)
SECONDS = 14


def gestures_at(*times: float) -> GesturePlan:
    phases, at = [], 0.0
    for lands in times:
        for name, ends, goal in (
            ("rest", lands - 0.8, REST), ("preparation", lands - 0.32, HIGH),
            ("stroke", lands, LOW), ("hold", lands + 0.6, LOW), ("retraction", lands + 1.4, REST),
        ):  # fmt: skip
            phases.append(phase(at, ends, name, goal))
            at = ends
    phases.append(phase(at, float(SECONDS), "rest", REST))
    return GesturePlan(float(SECONDS), right=tuple(phases))


def wrist(plan: GesturePlan) -> np.ndarray:
    """The planned way with a little tremor."""
    path = plan_tracks(plan, 30 * SECONDS)[:, hand_tracks("right")][:, :3].astype(np.float64)
    tremor = np.random.default_rng(0).normal(0, 0.004, path.shape)
    return path + gaussian_filter1d(tremor, 3, axis=0)


def test_gestures_are_found_where_they_are():
    times = (2.0, 6.0, 10.5)
    plan = gestures_at(*times)
    still = np.tile(np.array(REST), (30 * SECONDS, 1))
    found = list(hand_phases(wrist(plan), still))
    ends = [p.end_s for p in found if p.phase == "stroke"]
    assert np.abs(np.array(ends) - times).max() < 0.12
    wanted = [p.phase for p in plan.right]
    assert [p.phase for p in found] == wanted
    off = [abs(a.end_s - b.end_s) for a, b in zip(found[:-1], plan.right[:-1], strict=True)]
    assert np.median(off) < 0.07 and max(off) < 0.25
    strokes = [p.goal for p in found if p.phase == "stroke"]
    np.testing.assert_allclose(strokes, [LOW] * 3, atol=0.05)
    assert [p.phase for p in hand_phases(still, still)] == ["rest"]


def test_phases_cover_any_length_once():
    for frames in (1, 2, 40):
        path = wrist(gestures_at(2.0))[:frames]
        found = list(hand_phases(path, path))
        assert found[0].start_s == 0 and found[-1].end_s == pytest.approx(frames / 30)
        assert all(a.end_s == b.start_s for a, b in pairwise(found))
        assert {p.phase for p in found} <= set(PHASES)


def made_motion(frames: int, basis="arkit52") -> Motion:
    names, face = list(blendshape_names()), np.zeros((frames, 100), np.float32)
    time_s = (np.arange(frames) + 0.5) / 30

    def bell(at: float, width: float) -> np.ndarray:
        return np.exp(-0.5 * ((time_s - at) / width) ** 2)

    for side in ("Left", "Right"):
        face[:, names.index(f"eyeBlink{side}")] = bell(1.0, 0.05) + bell(4.0, 0.05)
        face[:, names.index(f"mouthSmile{side}")] = 0.4 * ((time_s > 2) & (time_s < 4))
    face[:, names.index("browInnerUp")] = 0.5 * bell(3.0, 0.15)
    nod, left = np.radians(5) * bell(2.0, 0.1), np.radians(15) * (time_s > 2.5)
    eyes = {JOINT_NAMES[joint]: about(1, left) for joint in (23, 24)}
    return posed(frames, units=face, basis=basis, head=about(0, nod), **eyes)


def test_heads_and_faces_are_found():
    plan = plan_from_motion(made_motion(150), open_body_skeleton())
    (nod,) = plan.nods
    assert nod.time_s == pytest.approx(2.0, abs=0.05) and 3 < nod.depth_deg < 7
    assert [b.time_s for b in plan.blinks] == pytest.approx([1.0, 4.0], abs=0.03)
    (brow,), (smile,) = plan.brows, plan.smiles
    assert brow.time_s == pytest.approx(3.0, abs=0.05) and brow.height == pytest.approx(
        0.5, abs=0.1
    )
    assert smile.size == pytest.approx(0.4, abs=0.1) and smile.start_s < 2.1 < 3.9 < smile.end_s
    yaws = [round(look.yaw_deg) for look in plan.looks]
    assert yaws == [0, 15] and plan.looks[0].end_s == pytest.approx(2.5, abs=0.1)
    assert [(p.start_s, p.end_s) for p in plan.planted] == [(0.0, 5.0)] * 2
    assert plan.stands[0].start_s == 0 and plan.stands[-1].end_s == 5.0
    assert plan.duration_s == 5.0 and {p.phase for p in plan.right} <= {"rest", "hold"}


def test_a_body_stands_on_the_foot_that_is_below_its_pelvis():
    lean = about(2, 0.15 * np.repeat([-1, 1], 45))  # both feet go to its right, then to its left
    plan = plan_from_motion(posed(90, left_hip=lean, right_hip=lean), open_body_skeleton())
    assert [one.leg for one in plan.stands] == ["left", "right"]


def test_faces_in_another_basis_and_eyes_that_never_stay_are_left_out():
    plan = plan_from_motion(made_motion(60, "flame100"), open_body_skeleton())
    assert plan.blinks == plan.brows == plan.smiles == ()
    # The whole body turns at 115 degrees a second.
    turning = posed(90, basis="flame100", pelvis=about(1, np.linspace(0, 6, 90)))
    for count in (1, 2, 90):
        assert plan_from_motion(turning.part(slice(count)), open_body_skeleton()).looks == ()
