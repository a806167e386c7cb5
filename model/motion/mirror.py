"""Motion as seen in a mirror, in the form in which training data is stored.

The mirror plane is the body's middle, x = 0. `model.motion.kinematics` has the same for matrices.
"""

from functools import cache

from jaxtyping import Float
from torch import Tensor

from conventions.joints import MIRROR_PERMUTATION, NUM_JOINTS
from model.motion.skeleton import face_unit_names


def mirror_poses(poses: Float[Tensor, "*batch 165"]) -> Float[Tensor, "*batch 165"]:
    """Local axis-angle, radians: left and right joints change places and y and z their sign.

    ``M R(a) M = R(-M a)`` with ``M = diag(-1, 1, 1)``: a rotation's axis is an axial vector.
    """
    joints = poses.unflatten(-1, (NUM_JOINTS, 3))[..., list(MIRROR_PERMUTATION), :]
    return (joints * joints.new_tensor([1.0, -1.0, -1.0])).flatten(-2)


def mirror_face_units(units: Float[Tensor, "*batch 52"]) -> Float[Tensor, "*batch 52"]:
    """ARKit's face units: what is called left and what is called right change places.

    This holds for eye looks too: "in" is towards the nose on either side.
    """
    return units[..., list(_face_partners())]


@cache
def _face_partners() -> tuple[int, ...]:
    names = face_unit_names()
    return tuple(names.index(_partner(name)) for name in names)


def _partner(name: str) -> str:
    for side, other in (("Left", "Right"), ("Right", "Left")):
        if name.endswith(side):
            return name.removesuffix(side) + other
    return name
