"""Vertex normals of one topology, frame after frame."""

import numpy as np
from jaxtyping import Float, Float32, Int
from scipy import sparse


class VertexNormals:
    """Area-weighted vertex normals: ``n_v = normalize(sum of the cross products of v's faces)``.

    The faces of a clip never change, so the sum is a sparse product that is laid out once.
    """

    def __init__(self, faces: Int[np.ndarray, "F 3"], num_vertices: int) -> None:
        """
        Raises:
            ValueError: if a face names a vertex that does not exist.
        """
        if faces.size and not 0 <= int(faces.min()) <= int(faces.max()) < num_vertices:
            raise ValueError(
                f"The faces name vertices {int(faces.min())} to {int(faces.max())}; "
                f"the body has {num_vertices}."
            )
        num_faces = len(faces)
        self._corners = np.ascontiguousarray(faces.T.astype(np.intp))
        self._sum_over_faces = sparse.csr_matrix(
            (
                np.ones(3 * num_faces, np.float32),
                (faces.ravel(), np.repeat(np.arange(num_faces), 3)),
            ),
            shape=(num_vertices, num_faces),
        )

    def __call__(self, vertices: Float[np.ndarray, "V 3"]) -> Float32[np.ndarray, "V 3"]:
        """Unit normals; a vertex without faces, or with faces of no area, gets zeros."""
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
        return normals
