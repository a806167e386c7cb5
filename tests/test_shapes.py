"""Shapes of annotations are checked in tests, or a mistake in one would be seen by nobody."""

import jaxtyping
import pytest
import torch

from model.motion.rotations import matrix_from_axis_angle
from renderer.body.body import BodyMotion


@pytest.mark.parametrize("again", range(2))
def test_the_first_calls_of_each_test_are_checked(again):
    with pytest.raises(jaxtyping.TypeCheckError, match=r"parameters of model\.motion\.rotations"):
        matrix_from_axis_angle(torch.zeros(2, 4))
    for _ in range(5):
        assert matrix_from_axis_angle(torch.zeros(2, 3)).shape == (2, 3, 3)
    with pytest.raises(jaxtyping.TypeCheckError):
        BodyMotion(*["no array"] * 5)
