"""The experiment against lever arms worked out by hand, and on a recorded clip."""

from dataclasses import replace

import numpy as np
import pytest

from conventions.joints import FINGERTIP_NAMES, JOINT_INDEX
from model.measures.error_growth import growth_sentence, measure_error_growth
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, load_motion
from tests.helpers import beat2_folder, smooth_motion_example

SKELETON = open_body_skeleton()
REST = SKELETON.rest_joints.double().numpy()


def rest_pose(num_frames: int) -> Motion:
    motion = smooth_motion_example(num_frames)
    return replace(motion, poses=np.zeros_like(motion.poses))


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
    growth = measure_error_growth(rest_pose(600), SKELETON, "right_middle", 0.01)
    local, world = (0.01 * np.sqrt(2 * np.sum(lever**2)) for lever in (arms, bones))
    assert growth.points == (*names[1:], "right_middle")
    assert growth.predicted_local_spread_m[-1] == pytest.approx(local, rel=1e-9)
    assert growth.predicted_global_spread_m[-1] == pytest.approx(world, rel=1e-9)
    assert growth.local_spread_m[-1] == pytest.approx(local, rel=0.05)
    assert growth.global_spread_m[-1] == pytest.approx(world, rel=0.05)
    assert growth.predicted_ratio == pytest.approx(local / world)
    assert growth.local_angle_error_ratio == pytest.approx(np.sqrt(2), rel=0.02)


def test_a_joint_is_moved_by_its_ancestors_alone():
    growth = measure_error_growth(rest_pose(300), SKELETON, "left_knee", 0.01)
    assert growth.points == ("left_hip", "left_knee")
    hip, knee = REST[JOINT_INDEX["left_hip"]], REST[JOINT_INDEX["left_knee"]]
    to_hip, to_knee = np.linalg.norm(hip - REST[0]), np.linalg.norm(knee - REST[0])
    thigh = np.linalg.norm(knee - hip)
    expected = 0.01 * np.sqrt(2) * np.array([to_hip, np.hypot(to_knee, thigh)])
    np.testing.assert_allclose(growth.predicted_local_spread_m, expected, rtol=1e-9)
    expected = 0.01 * np.sqrt(2) * np.array([to_hip, np.hypot(to_hip, thigh)])
    np.testing.assert_allclose(growth.predicted_global_spread_m, expected, rtol=1e-9)


def test_the_first_bone_is_moved_alike_by_both():
    """Nothing can pile up over one joint."""
    growth = measure_error_growth(smooth_motion_example(60), SKELETON, "left_index")
    assert growth.local_spread_m[0] == pytest.approx(growth.global_spread_m[0], rel=1e-9)
    assert np.all(np.diff(growth.local_spread_m) > 0)


def test_the_same_seed_gives_the_same_numbers_and_another_others():
    motion = smooth_motion_example(40)
    first, again, other = (
        measure_error_growth(motion, SKELETON, "left_thumb", seed=seed) for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(first.local_spread_m, again.local_spread_m)
    assert first.ratio != other.ratio


def test_the_pelvis_cannot_be_followed():
    with pytest.raises(ValueError, match="No rotation moves the pelvis"):
        measure_error_growth(smooth_motion_example(10), SKELETON, "pelvis")


def test_one_frame_is_enough_for_the_spread():
    growth = measure_error_growth(smooth_motion_example(1), SKELETON, FINGERTIP_NAMES[0])
    assert np.isfinite(growth.ratio) and np.isnan(growth.jerk_m_s3["clean"])


@pytest.mark.beat2
def test_a_recorded_clip_shows_the_known_ratio():
    """An independent computation on a slightly different skeleton gave 4.20 cm over 1.33 cm."""
    motion = load_motion(beat2_folder() / "smplxflame_30" / "2_scott_0_1_1.npz")
    growth = measure_error_growth(motion, SKELETON, "right_middle", 0.02)
    assert growth.ratio == pytest.approx(3.2, rel=0.15)
    assert growth.ratio == pytest.approx(growth.predicted_ratio, rel=0.03)
    assert growth.local_spread_m[-1] == pytest.approx(0.042, rel=0.1)
    assert growth.local_angle_error_ratio == pytest.approx(np.sqrt(2), rel=0.01)
    sentence = growth_sentence(growth, 0.02)
    assert "right middle fingertip" in sentence and "0.02 rad" in sentence
    assert "4.1 cm" in sentence and "3.2 times" in sentence
