"""A visitor's own character file with an animation: mesh, materials and textures stay untouched.

World rotations of the character's bones are those of the motion, turned back to the file's axes;
the root moves by the motion's translation in the file's units, with the floor at its zero.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from renderer.body.body import Body, BodyMotion
from renderer.body.body_file import BodyError
from renderer.body.gltf import Gltf, read_glb_bytes
from renderer.files.glb import GlbBinary, glb_bytes, make_animation


def character_glb_bytes(
    body: Body, motion: BodyMotion, markers: Sequence[tuple[float, str]] = ()
) -> bytes:
    """Return a character's own file with the motion as animation; other bodies as `glb_bytes` does.

    Raises BodyError if the character's file has changed or gone since it was read.
    """
    rig = body.rig
    if rig is None:
        return glb_bytes(body, motion, markers=markers)
    try:
        gltf = Gltf(read_glb_bytes(rig.path), body.name)
    except OSError as error:
        raise BodyError(
            f"The character file {body.name} can no longer be read; choose it again."
        ) from error
    buffer = GlbBinary(gltf.document, gltf.binary)
    channels: list[tuple[int, str, int]] = []
    for node, (rotations, translations) in _local_transforms(gltf, body, motion).items():
        if "matrix" in gltf.nodes[node]:
            _split_matrix(gltf.nodes[node], gltf.local[node])
        channels.append((node, "rotation", buffer.add_rotations(rotations)))
        if translations is not None:
            channels.append((node, "translation", buffer.add_accessor(translations)))
    for node, weights in _target_weights(gltf, body, motion).items():
        channels.append((node, "weights", buffer.add_accessor(weights.ravel())))
    return buffer.to_glb(animations=[make_animation(buffer, motion.num_frames, channels, markers)])


def _local_transforms(
    gltf: Gltf, body: Body, motion: BodyMotion
) -> dict[int, tuple[Rotation, np.ndarray | None]]:
    """Return rotations (T) of each node with a joint, and the translations (T, 3) of the root's."""
    rig = body.rig
    assert rig is not None
    to_file = Rotation.from_matrix(rig.R_file_to_body.T)
    joint_of = {node: joint for joint, node in enumerate(rig.joint_nodes) if node >= 0}
    world, positions = body.global_transforms_without_trans(motion)
    rest = Rotation.from_matrix(_rotations(gltf.world))
    local = Rotation.from_matrix(_rotations(gltf.local))
    moved: dict[int, Rotation] = {}
    result: dict[int, tuple[Rotation, np.ndarray | None]] = {}
    for node in gltf.order:
        parent = gltf.parents[node]
        above = moved.get(parent)
        if node not in joint_of:
            if above is not None:  # else it stands still
                moved[node] = above * local[node]
            continue
        joint = joint_of[node]
        turned = Rotation.from_matrix(world[:, joint] @ rig.R_rest_to_zero_pose[joint])
        moved[node] = to_file * turned * to_file.inv() * rest[node]
        if above is None:
            above = rest[parent] if parent >= 0 else Rotation.identity()
        translations = None
        if joint == 0:
            place = (positions[:, 0] + motion.trans) @ rig.R_file_to_body / rig.file_to_body_scale
            frame = np.linalg.inv(gltf.world[parent]) if parent >= 0 else np.eye(4)
            translations = (place @ frame[:3, :3].T + frame[:3, 3]).astype(np.float32)
        result[node] = above.inv() * moved[node], translations
    return result


def _rotations(matrices: Float[np.ndarray, "N 4 4"]) -> np.ndarray:
    """Return the nearest rotation of each matrix (N, 4, 4), as (N, 3, 3)."""
    left, _, right = np.linalg.svd(matrices[:, :3, :3])
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    return left @ right


def _split_matrix(described: dict, matrix: Float[np.ndarray, "4 4"]) -> None:
    """Write a node's matrix as translation, rotation and scale, which alone can be animated."""
    del described["matrix"]
    turn = _rotations(matrix[None])[0]
    described["translation"] = matrix[:3, 3].tolist()
    described["rotation"] = Rotation.from_matrix(turn).as_quat().tolist()
    described["scale"] = np.diag(turn.T @ matrix[:3, :3]).tolist()


def _target_weights(gltf: Gltf, body: Body, motion: BodyMotion) -> dict[int, np.ndarray]:
    """Return weights (T, targets) of each node whose mesh has blendshapes that the face drives."""
    assert body.rig is not None
    expressions = body.expression_weights(motion, slice(0, motion.num_frames))
    result: dict[int, np.ndarray] = {}
    for node, described in enumerate(gltf.nodes):
        of_targets = body.rig.target_weights.get(described.get("mesh", -1))
        if not of_targets:
            continue
        primitives = gltf.element("meshes", described["mesh"])["primitives"]
        num_targets = len(primitives[0].get("targets", ()))
        weights = np.zeros((motion.num_frames, num_targets), np.float32)
        for target, shares in of_targets.items():
            if 0 <= target < num_targets:
                for component, share in shares.items():
                    weights[:, target] += share * expressions[:, component]
        if weights.any():
            result[node] = weights
    return result
