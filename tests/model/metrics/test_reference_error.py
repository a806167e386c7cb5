"""Degrees between two motions, and how errors grow along a chain, against lever arms by hand."""

import re

import numpy as np
import pytest

from conventions.joints import FINGERTIP_NAMES, JOINT_INDEX, JOINT_NAMES
from model.metrics.error_growth import error_growth_summary, measure_error_growth
from model.metrics.reference_error import PARTS, rotation_difference_by_part_deg
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import load_motion
from tests.helpers import beat2_folder, smooth_motion_example
from tests.model.motion.made import about, posed

SKELETON = open_body_skeleton()
REST = SKELETON.rest_joints.double().numpy()


def test_a_turned_joint_counts_for_its_part_alone():
    """An elbow turned by .3 rad in the second half of the frames that both have: .15 on average,
    shared among the arm's four joints."""
    turn = about(1, np.where(np.arange(60) < 30, 0.0, 0.3))
    found = rotation_difference_by_part_deg(posed(90), posed(60, right_elbow=turn))
    assert next(iter(found)) == "right arm"
    assert found["right arm"] == pytest.approx(np.rad2deg(0.15) / 4, rel=1e-3)
    assert max(value for part, value in found.items() if part != "right arm") < 0.01


def test_parts_leave_the_face_alone():
    left = [n for n in JOINT_NAMES if not any(re.match(begin, n) for begin in PARTS.values())]
    assert left[0] == "jaw" and [name[:9].rstrip("_") for name in left[1:]] == [
        *("left_eye", "right_eye")
    ]


def test_spread_in_the_rest_pose_follows_its_lever_arms():
    names = [
        *("pelvis", "spine1", "spine2", "spine3", "right_collar", "right_shoulder", "right_elbow"),
        *("right_wrist", "right_middle1", "right_middle2", "right_middle3"),
    ]
    chain = [JOINT_INDEX[name] for name in names]
    tip = REST[chain[-1]] + SKELETON.tip_offsets[6].double().numpy()
    stations = np.array([*REST[chain], tip])
    arms = np.linalg.norm(tip - stations[:-1], axis=1)
    bones = np.linalg.norm(np.diff(stations, axis=0), axis=1)
    growth = measure_error_growth(posed(600), SKELETON, "right_middle", 0.01)
    local, world = (0.01 * np.sqrt(2 * np.sum(lever**2)) for lever in (arms, bones))
    assert growth.point_names == (*names[1:], "right_middle")
    assert growth.predicted_local_rms_m[-1] == pytest.approx(local, rel=1e-9)
    assert growth.predicted_global_rms_m[-1] == pytest.approx(world, rel=1e-9)
    assert growth.local_rms_m[-1] == pytest.approx(local, rel=0.05)
    assert growth.global_rms_m[-1] == pytest.approx(world, rel=0.05)
    assert growth.predicted_local_to_global_ratio == pytest.approx(local / world)
    assert growth.local_angle_global_to_local_ratio == pytest.approx(np.sqrt(2), rel=0.02)


def test_a_joint_is_moved_by_its_ancestors_alone_and_the_first_bone_alike_by_both():
    growth = measure_error_growth(posed(300), SKELETON, "left_knee", 0.01)
    assert growth.point_names == ("left_hip", "left_knee")
    hip, knee = REST[JOINT_INDEX["left_hip"]], REST[JOINT_INDEX["left_knee"]]
    to_hip, to_knee = np.linalg.norm(hip - REST[0]), np.linalg.norm(knee - REST[0])
    thigh = np.linalg.norm(knee - hip)
    expected = 0.01 * np.sqrt(2) * np.array([to_hip, np.hypot(to_knee, thigh)])
    np.testing.assert_allclose(growth.predicted_local_rms_m, expected, rtol=1e-9)
    expected = 0.01 * np.sqrt(2) * np.array([to_hip, np.hypot(to_hip, thigh)])
    np.testing.assert_allclose(growth.predicted_global_rms_m, expected, rtol=1e-9)
    assert growth.local_rms_m[0] == pytest.approx(growth.global_rms_m[0], rel=1e-9)


def test_a_seed_decides_the_noise_and_the_pelvis_cannot_be_followed():
    motion = smooth_motion_example(40)
    first, again, other = (
        measure_error_growth(motion, SKELETON, "left_thumb", seed=seed) for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(first.local_rms_m, again.local_rms_m)
    assert first.local_to_global_ratio != other.local_to_global_ratio and np.all(
        np.diff(first.local_rms_m) > 0
    )
    with pytest.raises(ValueError, match="do not move the pelvis"):
        measure_error_growth(motion, SKELETON, "pelvis")
    one = measure_error_growth(motion.part(slice(1)), SKELETON, FINGERTIP_NAMES[0])
    assert np.isfinite(one.local_to_global_ratio) and np.isnan(one.jerk_m_s3["clean"])


@pytest.mark.beat2
def test_a_recorded_clip_shows_the_known_ratio():
    """An independent computation on a slightly different skeleton gave 4.20 cm over 1.33 cm."""
    motion = load_motion(beat2_folder() / "smplxflame_30" / "2_scott_0_1_1.npz")
    growth = measure_error_growth(motion, SKELETON, "right_middle", 0.02)
    assert growth.local_to_global_ratio == pytest.approx(3.2, rel=0.15)
    assert growth.local_to_global_ratio == pytest.approx(
        growth.predicted_local_to_global_ratio, rel=0.03
    )
    assert growth.local_rms_m[-1] == pytest.approx(0.042, rel=0.1)
    sentence = error_growth_summary(growth, 0.02)
    assert "right middle fingertip" in sentence and "0.02 rad" in sentence
    assert "4.1 cm" in sentence and "3.2 times" in sentence
