"""BVH: the skeleton and its motion as text, for animation software.

Metres, y up, 30 frames a second. The root has three positions, every joint three rotations in
degrees in the order Z, X, Y (the matrix is ``Rz @ Rx @ Ry``). Only joints: no mesh, no face.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_NAMES, NUM_JOINTS, PARENTS, TIP_VERTICES
from conventions.rates import FPS
from renderer.body.body import Body, BodyMotion
from renderer.files.written import written_whole

_BLOCK_FRAMES = 512
_ROTATIONS = "Zrotation Xrotation Yrotation"
# Where a bone without a child ends, from its joint; metres. Fingers end at their tip vertex.
_ENDS = {
    "left_foot": (0.0, 0.0, 0.08),
    "right_foot": (0.0, 0.0, 0.08),
    "jaw": (0.0, -0.04, 0.09),
    "left_eye": (0.0, 0.0, 0.012),
    "right_eye": (0.0, 0.0, 0.012),
}


def write_bvh(body: Body, motion: BodyMotion, out: Path) -> None:
    """Write the joints of ``motion``, with the bone lengths of ``body``, to ``out``.

    Raises:
        OSError: if ``out`` cannot be written; nothing half-written stays behind.
    """
    vertices, joints = body.shaped(motion)
    order = _depth_first()
    with written_whole(out) as file:
        ends = {name: np.array(offset) for name, offset in _ENDS.items()}
        ends |= {
            f"{finger}3": vertices[vertex] - joints[JOINT_NAMES.index(f"{finger}3")]
            for finger, vertex in TIP_VERTICES.items()
            if vertex < len(vertices)
        }
        lines = ["HIERARCHY", *_hierarchy(0, 0, joints, ends)]
        lines += ["MOTION", f"Frames: {motion.num_frames}", f"Frame Time: {1 / FPS:.8f}", ""]
        file.write("\n".join(lines).encode("ascii"))
        for start in range(0, motion.num_frames, _BLOCK_FRAMES):
            frames = slice(start, min(start + _BLOCK_FRAMES, motion.num_frames))
            channels = np.concatenate(
                [
                    joints[0] + motion.trans[frames],
                    _angles(motion, frames)[:, order].reshape(-1, 165),
                ],
                axis=1,
            )
            np.savetxt(file, channels, fmt="%.6f")


def _depth_first(joint: int = 0) -> list[int]:
    """Joints in the order in which the hierarchy, and so each frame, lists them."""
    order = [joint]
    for child in (k for k in range(NUM_JOINTS) if PARENTS[k] == joint):
        order += _depth_first(child)
    return order


def _hierarchy(
    joint: int,
    depth: int,
    joints: Float[np.ndarray, "J 3"],
    ends: dict[str, np.ndarray],
) -> list[str]:
    indent = "  " * depth
    name = JOINT_NAMES[joint]
    parent = PARENTS[joint]
    offset = joints[joint] - (joints[parent] if parent >= 0 else joints[joint])
    channels = f"3 {_ROTATIONS}"
    if parent < 0:
        channels = f"6 Xposition Yposition Zposition {_ROTATIONS}"
    lines = [
        f"{indent}{'ROOT' if parent < 0 else 'JOINT'} {name}",
        f"{indent}{{",
        f"{indent}  OFFSET {_numbers(offset)}",
        f"{indent}  CHANNELS {channels}",
    ]
    children = [k for k in range(NUM_JOINTS) if PARENTS[k] == joint]
    for child in children:
        lines += _hierarchy(child, depth + 1, joints, ends)
    if not children:
        end = ends.get(name, np.array([0.0, 0.02, 0.0]))
        lines += [
            f"{indent}  End Site",
            f"{indent}  {{",
            f"{indent}    OFFSET {_numbers(end)}",
            f"{indent}  }}",
        ]
    return [*lines, f"{indent}}}"]


def _numbers(vector: np.ndarray) -> str:
    return " ".join(f"{value:.6f}" for value in vector)


def _angles(motion: BodyMotion, frames: slice) -> Float[np.ndarray, "T J 3"]:
    """Degrees about Z, X and Y of each joint's local rotation."""
    rotations = Rotation.from_rotvec(motion.poses[frames].astype(np.float64).reshape(-1, 3))
    with warnings.catch_warnings():
        # At a right angle about X the other two are not unique; any choice is the same rotation.
        warnings.filterwarnings("ignore", message="Gimbal lock")
        return rotations.as_euler("ZXY", degrees=True).reshape(-1, NUM_JOINTS, 3)
