import numpy as np
import pytest
import torch

from conventions.joints import JOINT_INDEX, NUM_JOINTS
from model.motion.altered import noisy_motions
from model.motion.kinematics import global_from_local
from model.motion.motion import Motion
from model.motion.rotations import geodesic_angle
from model.motion.tracks import moving_chain
from tests.helpers import smooth_motion_example

NOISE_RAD = 0.05
MOTION = smooth_motion_example(60)
FACE = [JOINT_INDEX[name] for name in ("jaw", "left_eye", "right_eye")]
OTHERS = [joint for joint in range(NUM_JOINTS) if joint not in FACE]


def errors_rad(motion: Motion, is_global: bool) -> torch.Tensor:
    """Angle of each joint, frame by frame, from where the motion has it."""
    local = [each.local_rotations().double() for each in (motion, MOTION)]
    rotmats = [global_from_local(each) for each in local] if is_global else local
    return geodesic_angle(*rotmats)


def test_both_motions_hold_the_same_turns_each_in_its_own_form() -> None:
    on_local, on_global = noisy_motions(MOTION, NOISE_RAD)
    local_error = errors_rad(on_local, is_global=False)[:, OTHERS]
    global_error = errors_rad(on_global, is_global=True)[:, OTHERS]
    assert torch.allclose(local_error, global_error, atol=1e-3)
    assert local_error.square().mean().sqrt().item() == pytest.approx(
        NOISE_RAD * np.sqrt(3), rel=0.05
    )


def test_local_noise_adds_up_along_the_chain_and_global_noise_does_not() -> None:
    on_local, on_global = noisy_motions(MOTION, NOISE_RAD)
    wrist = JOINT_INDEX["right_middle3"]
    depth = len(moving_chain("right_middle"))
    sums = errors_rad(on_local, is_global=True)[:, wrist].square().mean().sqrt().item()
    assert sums == pytest.approx(NOISE_RAD * np.sqrt(3 * depth), rel=0.2)
    # The price: an angle between neighbours holds the noise of both.
    between = errors_rad(on_global, is_global=False)[:, wrist].square().mean().sqrt().item()
    assert between == pytest.approx(NOISE_RAD * np.sqrt(6), rel=0.2)


def test_the_face_and_all_else_stay_as_they_are() -> None:
    for motion in noisy_motions(MOTION, NOISE_RAD):
        assert errors_rad(motion, is_global=False)[:, FACE].max() < 1e-3
        assert np.array_equal(motion.trans, MOTION.trans)
        assert np.array_equal(motion.expressions, MOTION.expressions)


def test_a_seed_decides_the_noise() -> None:
    first, again, other = (noisy_motions(MOTION, NOISE_RAD, seed)[0].poses for seed in (0, 0, 1))
    assert np.array_equal(first, again) and not np.array_equal(first, other)
