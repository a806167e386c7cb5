"""Planted faults are found and named; clean motion is left alone."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from conventions.joints import JOINT_INDEX, LEFT_HAND, MIRROR_PERMUTATION
from model.diagnostics import diagnose
from model.faults.evidence import Finding
from model.measures.seams import Windows
from model.motion.kinematics import mirror_poses, open_body_skeleton
from model.motion.motion import Motion
from model.motion.tracks import point_words
from tests.helpers import smooth_motion_example

SKELETON = open_body_skeleton()
FRAMES = 420


@pytest.fixture(scope="module")
def clean() -> Motion:
    """Slow motion of every joint about a human pose, the feet almost in place."""
    motion = smooth_motion_example(FRAMES, seed=2)
    poses = 0.25 * motion.poses.reshape(FRAMES, 55, 3)
    poses[:, JOINT_INDEX["left_elbow"], 1] -= 1.2
    poses[:, JOINT_INDEX["right_elbow"], 1] += 1.2
    poses[:, list(range(12)), :] *= 0.05
    return replace(
        motion,
        poses=poses.reshape(FRAMES, 165),
        trans=np.zeros((FRAMES, 3), np.float32),
    )


NOT_ASKED = {
    *("jerk", "high_frequency", "amplitude", "speed", "still_translation"),
    *("identical", "lifted", "copied_face"),
}
"""What is truly found in the motion of these tests: it is made of a few sinusoids, and stands
where its reference does not, or is a copy of it."""


def faults(
    motion: Motion, reference: Motion | None = None, windows: Windows | None = None
) -> list[Finding]:
    cut = None if windows is None else {"a": windows}
    found = diagnose({"a": motion}, SKELETON, reference=reference, windows=cut).findings["a"]
    return [finding for finding in found if finding.kind not in NOT_ASKED]


def only_fault(motion: Motion, reference: Motion | None = None) -> Finding:
    (fault,) = faults(motion, reference)
    return fault


def with_joint(motion: Motion, joint: str, change: np.ndarray) -> Motion:
    poses = motion.poses.copy().reshape(-1, 55, 3)
    poses[:, JOINT_INDEX[joint]] += change
    return replace(motion, poses=poses.reshape(-1, 165))


def test_clean_motion_is_left_alone(clean: Motion):
    assert faults(clean) == []
    assert faults(clean, reference=clean) == []
    assert faults(clean, reference=smooth_motion_example(FRAMES)) == []


@pytest.mark.parametrize("joint", ["right_elbow", "left_elbow", "right_middle1"])
def test_noise_on_one_joint_is_named(clean: Motion, joint: str):
    noise = 0.02 * np.random.default_rng(0).standard_normal((FRAMES, 3))
    fault = only_fault(with_joint(clean, joint, noise))
    assert fault.kind == "joint_noise"
    assert set(fault.numbers["noise_deg"]) == {joint}
    # Noise of an axis-angle turns a bent joint by a tenth less across its axis.
    assert fault.numbers["noise_deg"][joint] == pytest.approx(np.degrees(0.02), rel=0.15)
    assert f"({fault.numbers['noise_deg'][joint]:.1f}°)" in fault.sentence
    assert point_words(joint) in fault.sentence
    if joint.startswith("right"):  # the right middle fingertip is followed
        assert fault.numbers["attributed_joint"] == joint
        assert fault.numbers["attributed_share"] > 0.5
    else:
        assert "attributed_joint" not in fault.numbers


def test_noise_everywhere_is_counted(clean: Motion):
    noise = 0.02 * np.random.default_rng(0).standard_normal(clean.poses.shape)
    found = {
        fault.kind: fault
        for fault in faults(replace(clean, poses=(clean.poses + noise).astype(np.float32)))
    }
    assert len(found["joint_noise"].numbers["noise_deg"]) == 55
    assert found["joint_noise"].sentence.startswith("55 of 55 joints shake")


def test_a_jump_every_52_frames_is_a_seam(clean: Motion):
    windows = (np.arange(FRAMES) + 52 - 5) // 52
    jumps = 0.1 * (windows[:, None] % 2) * np.array([1.0, 0, 0])
    jumping = with_joint(clean, "right_shoulder", jumps)
    (fault,) = faults(jumping, windows=Windows(52, 8))
    assert fault.kind == "seams"
    assert fault.numbers["phase_frame"] in (4, 5, 6)
    assert "every 52 frames" in fault.sentence
    (fault,) = faults(jumping, windows=Windows(60, 8))
    assert fault.kind == "period" and "every 52 frames" in fault.sentence


def test_one_jump_is_no_seam(clean: Motion):
    step = 0.3 * (np.arange(FRAMES) >= 104)[:, None] * np.array([1.0, 0, 0])
    assert faults(with_joint(clean, "right_shoulder", step)) == []


def test_sliding_feet_are_found(clean: Motion):
    trans = np.zeros((FRAMES, 3))
    trans[:, 2] = 0.3 * np.arange(FRAMES) / 30
    fault = only_fault(replace(clean, trans=trans.astype(np.float32)))
    assert fault.kind == "foot_slide"
    assert fault.numbers["foot_slide_m_s"] == pytest.approx(0.3, rel=0.1)
    assert "30 cm/s" in fault.sentence


def test_a_mirror_image_shows_beside_a_reference_only(clean: Motion):
    mirrored = replace(clean, poses=mirror_poses(torch.from_numpy(clean.poses)).numpy())
    fault = only_fault(mirrored, reference=clean)
    assert (fault.kind, fault.numbers["way"]) == ("swapped_sides", "mirrored")
    assert fault.numbers["error_swapped_deg"] < 0.1 < fault.numbers["error_deg"]
    assert faults(mirrored) == []


def test_swapped_joints_show_with_and_without_a_reference(clean: Motion):
    joints = clean.poses.reshape(FRAMES, 55, 3)[:, list(MIRROR_PERMUTATION)]
    swapped = replace(clean, poses=joints.reshape(FRAMES, 165))
    for reference in (None, clean):
        fault = only_fault(swapped, reference)
        assert (fault.kind, fault.numbers["way"]) == ("swapped_sides", "swapped")
    assert "both elbows bend backwards" in only_fault(swapped).sentence


def test_a_frozen_hand_is_found_on_its_side(clean: Motion):
    joints = clean.poses.copy().reshape(FRAMES, 55, 3)
    joints[:, list(LEFT_HAND)] = joints[0, list(LEFT_HAND)]
    fault = only_fault(replace(clean, poses=joints.reshape(FRAMES, 165)))
    assert (fault.kind, fault.numbers["side"]) == ("frozen_hand", "left")
    assert "100%" in fault.sentence


def test_a_finger_bent_backwards_is_named(clean: Motion):
    bent = with_joint(clean, "right_index2", np.array([0, 0, -1.0]))  # inwards is +z
    fault = only_fault(bent)
    assert fault.kind == "finger_range"
    assert fault.numbers["joints"] == {"right_index2": pytest.approx(1.0)}
    assert "right index joint 2 (100%)" in fault.sentence


def test_a_still_motion_is_said_to_be_still(clean: Motion):
    still = replace(clean, poses=np.repeat(clean.poses[:1], FRAMES, axis=0))
    assert [fault.kind for fault in faults(still)] == ["still"]


@pytest.mark.parametrize("num_frames", [1, 2, 3, 4, 40])
def test_short_clips_have_no_findings(clean: Motion, num_frames: int):
    short = replace(
        clean,
        poses=clean.poses[:num_frames],
        trans=clean.trans[:num_frames],
        expressions=clean.expressions[:num_frames],
    )
    assert faults(short) == []
