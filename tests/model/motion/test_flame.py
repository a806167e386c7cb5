"""FLAME's coefficients become the ARKit weights that a matrix made them of."""

from dataclasses import replace

import numpy as np
import pytest

from conventions.joints import JOINT_INDEX
from model.motion.flame import flame_to_arkit, read_flame_matrix
from model.storage.npz import MotionError
from renderer.body.body import load_body
from tests.helpers import smooth_motion_example

JAW = 3 * JOINT_INDEX["jaw"]


def test_weights_are_those_that_the_coefficients_were_made_of(tmp_path):
    rng = np.random.default_rng(0)
    names = load_body().expression_names
    np.save(tmp_path / "mat_final.npy", rng.normal(size=(51, 103)))
    matrix = read_flame_matrix(tmp_path / "mat_final.npy")
    weights = np.zeros((8, 51))
    weights[:, names.index("mouthSmileLeft")] = np.linspace(0, 1, 8)
    weights[:, names.index("eyeBlinkRight")] = 0.5
    weights[:, names.index("jawOpen")] = 0.7
    coefficients = (weights @ matrix).astype(np.float32)
    motion = smooth_motion_example(8)
    poses = motion.poses.copy()
    poses[:, JAW : JAW + 3] = coefficients[:, 100:]
    flame = replace(
        motion, poses=poses, expressions=coefficients[:, :100], expression_basis="flame100"
    )
    found = flame_to_arkit(flame, matrix)
    weights[:, names.index("jawOpen")] = 0  # the jaw joint opens the mouth
    assert found.expression_basis == "arkit52"
    np.testing.assert_allclose(found.expressions[:, :51], weights, atol=0.01)
    assert flame_to_arkit(found, matrix) is found


@pytest.mark.parametrize("shape", [(103, 51), (51,)])
def test_another_matrix_is_refused(tmp_path, shape):
    np.save(tmp_path / "mat_final.npy", np.zeros(shape))
    with pytest.raises(MotionError, match="51 x 103"):
        read_flame_matrix(tmp_path / "mat_final.npy")
