"""Export for other programs: BVH, an npz for Blender's SMPL-X add-on, one frame as OBJ or PLY.

Metres, y up, 30 frames a second. A failure to write raises OSError.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from conventions.joints import FINGERTIP_VERTICES, JOINT_NAMES, NUM_JOINTS, PARENTS
from conventions.rates import FPS
from renderer.body.body import Body, BodyMotion
from renderer.scene.camera_setup import select_frames


def write_posed_mesh(body: Body, motion: BodyMotion, frame: int, out: Path) -> None:
    """Write the posed body in metres, y up; the suffix of ``out`` selects the format."""
    import trimesh  # takes long to import, and only this function needs it

    (vertices,) = np.concatenate(list(body.posed_vertices(select_frames(motion, [frame]))))
    shown = np.sqrt(body.vertex_colors)  # linear
    if (texture := body.texture) is not None:
        rows, columns = (np.array(texture.pixels.shape[:2]) * texture.uv[:, ::-1]).astype(int).T
        shown = shown * texture.pixels[rows, columns, :3] / np.float32(255)
    mesh = trimesh.Trimesh(vertices, body.faces, vertex_colors=shown, process=False)
    with out.open("wb") as file:
        mesh.export(file, file_type=out.suffix.lower()[1:])


_ROTATIONS = "Zrotation Xrotation Yrotation"
# Offset of the end of bones without a child (m). Fingers end at their tip vertex.
_ENDS = {
    "left_foot": (0.0, 0.0, 0.08),
    "right_foot": (0.0, 0.0, 0.08),
    "jaw": (0.0, -0.04, 0.09),
    "left_eye": (0.0, 0.0, 0.012),
    "right_eye": (0.0, 0.0, 0.012),
}


def write_bvh(body: Body, motion: BodyMotion, out: Path) -> None:
    """Write the joints of ``motion`` with the bone lengths of ``body``, without mesh and face.

    The root has three positions, every joint three rotations in degrees in the order Z, X, Y (the
    matrix is ``Rz @ Rx @ Ry``).
    """
    vertices, joints = body.shaped_vertices_and_joints(motion)
    order = _depth_first()
    with out.open("wb") as file:
        ends = {name: np.array(offset) for name, offset in _ENDS.items()}
        ends |= {
            f"{finger}3": vertices[vertex] - joints[JOINT_NAMES.index(f"{finger}3")]
            for finger, vertex in FINGERTIP_VERTICES.items()
            if vertex < len(vertices) and body.rig is None
        }
        lines = ["HIERARCHY", *_hierarchy(0, 0, joints, ends)]
        lines += ["MOTION", f"Frames: {motion.num_frames}", f"Frame Time: {1 / FPS:.8f}", ""]
        file.write("\n".join(lines).encode("ascii"))
        turns = _angles(motion)[:, order].reshape(-1, 165)
        np.savetxt(file, np.hstack([joints[0] + motion.trans, turns]), fmt="%.6f")


def _depth_first(joint: int = 0) -> list[int]:
    """Return the joint indices in the depth-first order of the hierarchy and of each frame."""
    order = [joint]
    for child in (k for k in range(NUM_JOINTS) if PARENTS[k] == joint):
        order += _depth_first(child)
    return order


def _hierarchy(
    joint: int,
    depth: int,
    joints: Float[np.ndarray, "J 3"],
    ends: dict[str, Float[np.ndarray, " 3"]],
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


def _numbers(vector: Float[np.ndarray, " N"]) -> str:
    return " ".join(f"{value:.6f}" for value in vector)


def _angles(motion: BodyMotion) -> Float[np.ndarray, "T J 3"]:
    """Compute the local rotation of each joint as Euler angles about Z, X and Y in degrees."""
    rotations = Rotation.from_rotvec(motion.poses.astype(np.float64).reshape(-1, 3))
    with warnings.catch_warnings():
        # At a right angle about X the other two are not unique; any choice is the same rotation.
        warnings.filterwarnings("ignore", message="Gimbal lock")
        return rotations.as_euler("ZXY", degrees=True).reshape(-1, NUM_JOINTS, 3)


_FEWEST_BETAS = 10
"""Fewest betas written: the smallest model of the add-on has as many and warns about more."""


def blender_unsupported_notes(motion: BodyMotion) -> tuple[str, ...]:
    """Return one sentence for each part of a motion that a file for the add-on leaves out."""
    if motion.expression_basis == "flame100" or not motion.expressions.any():
        return ()
    return (
        f"Facial expressions are left out: the motion has {motion.expression_basis} coefficients,"
        " and Blender's SMPL-X body needs flame100; the jaw and eyes still move.",
    )


def write_blender_npz(
    motion: BodyMotion, out: Path, markers: Sequence[tuple[float, str]] = ()
) -> None:
    """Write ``motion`` for the SMPL-X add-on's "Add Animation" (Load animation); radians.

    The add-on reads (``SMPLXAddAnimation`` of its ``__init__.py``, version 2022-06-23 and later)
    ``trans``, ``gender``, ``mocap_frame_rate``, ``betas`` and ``poses``, all of them required,
    without pickled objects. The other keys are those of AMASS for SMPL-X, for tools that read the
    pose in parts, and ``expressions`` (T, 100), FLAME's coefficients, which BEAT2's version of the
    add-on requires; zeros where the motion has ARKit's weights. Choose in Blender: Format "SMPL-X"
    (y up; "AMASS" would lay the body down), hand pose reference "Flat". Markers are times in
    seconds with names, written as the arrays ``marker_frames``, counted from 0, and
    ``marker_names``, which the add-on ignores.
    """
    num_betas = max(_FEWEST_BETAS, int(np.flatnonzero(motion.betas).max(initial=-1)) + 1)
    betas = np.zeros(num_betas, np.float32)
    betas[: len(motion.betas)] = motion.betas[:num_betas]
    motions = {}
    if markers:
        frames = [round(seconds * FPS) for seconds, _ in markers]
        motions["marker_frames"] = np.array(frames, np.int32)
        motions["marker_names"] = np.array([name for _, name in markers])
    is_flame = motion.expression_basis == "flame100"
    with out.open("wb") as file:
        np.savez(
            file,
            gender="neutral",
            surface_model_type="smplx",
            mocap_frame_rate=np.int32(FPS),
            mocap_time_length=np.float32(motion.num_frames / FPS),
            trans=motion.trans,
            poses=motion.poses,
            expressions=motion.expressions if is_flame else np.zeros_like(motion.expressions),
            betas=betas,
            num_betas=np.int32(num_betas),
            root_orient=motion.poses[:, :3],
            pose_body=motion.poses[:, 3:66],
            pose_jaw=motion.poses[:, 66:69],
            pose_eye=motion.poses[:, 69:75],
            pose_hand=motion.poses[:, 75:],
            **motions,
        )
