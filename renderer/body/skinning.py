"""Linear blend skinning and vertex normals, frame by frame.

The same formulas as the ``smplx`` package: rest joints follow betas and expressions, pose
correctives are linear in ``R - I``, vertices are blended joint transforms of the corrected rest
shape. Column vectors, metres, radians.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32, Float64, Int, Int32
from scipy import sparse

from conventions.joints import NUM_JOINTS, PARENTS


def global_transforms(
    R_parent_joint: Float64[np.ndarray, "T J 3 3"], rest_joints: Float64[np.ndarray, "T J 3"]
) -> tuple[Float64[np.ndarray, "T J 3 3"], Float64[np.ndarray, "T J 3"]]:
    """Compute global rotation and position of each joint; the root stays at its rest position."""
    R_world_joint = np.empty_like(R_parent_joint)
    positions = np.empty_like(rest_joints)
    R_world_joint[:, 0], positions[:, 0] = R_parent_joint[:, 0], rest_joints[:, 0]
    for joint in range(1, NUM_JOINTS):
        parent = PARENTS[joint]
        R_world_joint[:, joint] = R_world_joint[:, parent] @ R_parent_joint[:, joint]
        bone = (rest_joints[:, joint] - rest_joints[:, parent])[:, :, None]
        positions[:, joint] = positions[:, parent] + (R_world_joint[:, parent] @ bone)[:, :, 0]
    return R_world_joint, positions


def skin(
    rest_vertices: Float32[np.ndarray, "T V 3"],
    weights: sparse.csr_array,
    R_world_joint: Float[np.ndarray, "T J 3 3"],
    translations: Float[np.ndarray, "T J 3"],
) -> Float32[np.ndarray, "T V 3"]:
    """Compute ``sum_j weight[v, j] (R_world_joint[j] rest[v] + translations[j])`` per vertex."""
    transforms = np.concatenate([R_world_joint, translations[..., None]], -1).astype(np.float32)
    posed = np.empty_like(rest_vertices)
    # One frame at a time: its blended matrices stay in the cache, which is six times as fast as
    # blending a block of frames at once.
    for frame, by_joint in enumerate(transforms.reshape(-1, NUM_JOINTS, 12)):
        blended = (weights @ by_joint).reshape(-1, 3, 4)
        np.einsum("vab,vb->va", blended[..., :3], rest_vertices[frame], out=posed[frame])
        posed[frame] += blended[..., 3]
    return posed


def add_pose_correctives(
    rest_vertices: Float32[np.ndarray, "T V 3"],
    pose_vertices: Int32[np.ndarray, " P"],
    pose_dirs: sparse.csr_array | Float32[np.ndarray, "P3 N"],
    R_parent_joint: Float64[np.ndarray, "T J 3 3"],
) -> None:
    """Add the correctives of the pose to ``rest_vertices``, in place."""
    num_frames = len(R_parent_joint)
    features = (R_parent_joint[:, 1:] - np.eye(3)).reshape(num_frames, -1).astype(np.float32)
    offsets = (pose_dirs @ features.T).T  # (T, 3 P)
    rest_vertices[:, pose_vertices] += offsets.reshape(num_frames, -1, 3)


class VertexNormals:
    """Area-weighted vertex normals: ``n_v = normalize(sum of the cross products of v's faces)``.

    The faces of a clip never change, so the sum is a sparse product with a matrix that is built
    once. trimesh's normals (weighted by angle), computed for each frame, take eight times as long.
    """

    def __init__(
        self,
        faces: Int[np.ndarray, "F 3"],
        num_vertices: int,
        welds: Int[np.ndarray, " V"] | None = None,
    ) -> None:
        """Prepare the sum over faces.

        Args:
            welds: vertex whose normal each vertex shares, such as across a seam of a texture.
        """
        num_faces = len(faces)
        self._corners = np.ascontiguousarray(faces.T.astype(np.intp))
        self._welds = welds
        faces = faces if welds is None else welds[faces]
        self._sum_over_faces = sparse.csr_matrix(
            (
                np.ones(3 * num_faces, np.float32),
                (faces.ravel(), np.repeat(np.arange(num_faces), 3)),
            ),
            shape=(num_vertices, num_faces),
        )

    def __call__(self, vertices: Float[np.ndarray, "V 3"]) -> Float32[np.ndarray, "V 3"]:
        """Return unit normals; zeros for a vertex without faces, or with faces of no area."""
        planes = np.ascontiguousarray(vertices.T, dtype=np.float32)  # (3, V): one axis, one row
        a, b, c = (planes[:, corner] for corner in self._corners)  # each (3, F)
        u, v = b - a, c - a
        cross = np.empty((u.shape[1], 3), np.float32)
        cross[:, 0] = u[1] * v[2] - u[2] * v[1]
        cross[:, 1] = u[2] * v[0] - u[0] * v[2]
        cross[:, 2] = u[0] * v[1] - u[1] * v[0]
        normals = self._sum_over_faces @ cross
        length = np.sqrt(np.einsum("vi,vi->v", normals, normals))
        normals /= np.maximum(length, np.finfo(np.float32).tiny)[:, None]
        return normals if self._welds is None else normals[self._welds]
