"""Meshes with all skinning attributes per vertex, and operations that cut and join them.

Every operation makes new vertices as weighted means of old ones, of positions, skinning weights and
offsets alike; so an edited mesh moves like its source, in every build.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int

from conventions.joints import NUM_JOINTS

Field = Callable[[Float[np.ndarray, "N 3"]], Float[np.ndarray, " N"]]
"""Scalar field over points in space; its zero set on a mesh is a curve."""

SNAP_SHARE = 0.2
"""Share of an edge within which a cut moves the near vertex onto the cut."""


@dataclass(frozen=True)
class Mesh:
    faces: Int[np.ndarray, "F K"]
    """Quads or triangles, counter-clockwise from outside."""
    attributes: Float[np.ndarray, "V C"]
    """Columns: position (3, metres, zero pose), weights (55), offsets (M * 3).

    The offsets are those of the expressions, then those to the other builds.
    """
    regions: Int[np.ndarray, " V"]
    """Painted region of each vertex: an index into ``renderer.body.look.REGION_NAMES``."""

    @property
    def num_vertices(self) -> int:
        return len(self.attributes)

    @property
    def positions(self) -> Float[np.ndarray, "V 3"]:
        return self.attributes[:, :3]

    @property
    def weights(self) -> Float[np.ndarray, "V J"]:
        return self.attributes[:, 3 : 3 + NUM_JOINTS]

    @property
    def offsets(self) -> Float[np.ndarray, "V M 3"]:
        return self.attributes[:, 3 + NUM_JOINTS :].reshape(self.num_vertices, -1, 3)

    def with_positions(self, positions: Float[np.ndarray, "V 3"]) -> Mesh:
        attributes = self.attributes.copy()
        attributes[:, :3] = positions
        return replace(self, attributes=attributes)

    def painted(self, region: int) -> Mesh:
        return replace(self, regions=np.full_like(self.regions, region))

    def faces_only(self, keep: Bool[np.ndarray, " F"]) -> Mesh:
        """Return the faces in ``keep`` and the vertices they use."""
        used, faces = np.unique(self.faces[keep], return_inverse=True)
        return Mesh(
            faces.reshape(-1, self.faces.shape[1]), self.attributes[used], self.regions[used]
        )

    def triangles(self) -> Mesh:
        if self.faces.shape[1] == 3:
            return self
        return replace(self, faces=np.concatenate([self.faces[:, :3], self.faces[:, [0, 2, 3]]]))


def merge_meshes(meshes: list[Mesh]) -> Mesh:
    """Join meshes to one triangle mesh, with vertices in the order of ``meshes``."""
    meshes = [mesh.triangles() for mesh in meshes]
    offsets = np.cumsum([0] + [mesh.num_vertices for mesh in meshes[:-1]])
    return Mesh(
        np.concatenate([mesh.faces + o for mesh, o in zip(meshes, offsets, strict=True)]),
        np.concatenate([mesh.attributes for mesh in meshes]),
        np.concatenate([mesh.regions for mesh in meshes]),
    )


def edges(faces: Int[np.ndarray, "F K"]) -> Int[np.ndarray, "E 2"]:
    """Return the directed edges of all faces, face by face."""
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)


def border_edges(faces: Int[np.ndarray, "F K"]) -> Int[np.ndarray, "B 2"]:
    """Return the directed edges that have a face on one side only."""
    directed = edges(faces)
    _, index, count = np.unique(
        np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    return directed[count[index] == 1]


def normals(mesh: Mesh) -> Float[np.ndarray, "V 3"]:
    """Compute unit vertex normals, with faces weighted by their area."""
    faces = mesh.triangles().faces
    a, b, c = (mesh.positions[faces[:, k]] for k in range(3))
    total = np.zeros_like(mesh.positions)
    for corner in range(3):
        np.add.at(total, faces[:, corner], np.cross(b - a, c - a))
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)


def subdivide_catmull_clark(mesh: Mesh) -> Mesh:
    """Apply one step of Catmull-Clark subdivision to a quad mesh; borders become smooth curves."""
    num_vertices, quads = mesh.num_vertices, mesh.faces
    num_faces = len(quads)
    directed = edges(quads)
    pairs, edge_of_side, faces_of_edge = np.unique(
        np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    num_edges = len(pairs)
    face_points = _matrix(np.repeat(np.arange(num_faces), 4), quads.ravel(), 0.25, num_vertices)
    face_of_side = np.repeat(np.arange(num_faces), 4)
    edge_faces = sp.csr_array(
        (np.ones(len(directed)), (edge_of_side, face_of_side)), shape=(num_edges, num_faces)
    )
    midpoints = _matrix(np.repeat(np.arange(num_edges), 2), pairs.ravel(), 0.5, num_vertices)
    inner = (faces_of_edge == 2).astype(float)
    edge_points = (
        sp.diags_array(1 - 0.5 * inner) @ midpoints
        + sp.diags_array(0.25 * inner) @ edge_faces @ face_points
    )

    touching = sp.csr_array(
        (np.ones(2 * num_edges), (pairs.ravel(), np.repeat(np.arange(num_edges), 2))),
        shape=(num_vertices, num_edges),
    )
    vertex_faces = sp.csr_array(
        (np.ones(4 * num_faces), (quads.ravel(), np.repeat(np.arange(num_faces), 4))),
        shape=(num_vertices, num_faces),
    )
    valence = np.maximum(touching.sum(1), 1)
    border_touching = touching @ sp.diags_array(1 - inner)
    is_border = border_touching.sum(1) > 0
    inside = np.where(is_border, 0.0, 1.0)
    identity = sp.eye_array(num_vertices, format="csr")
    vertex_points = (
        sp.diags_array(inside * (valence - 3) / valence) @ identity
        + sp.diags_array(inside * 2 / valence**2) @ touching @ midpoints
        + sp.diags_array(inside / valence / np.maximum(vertex_faces.sum(1), 1))
        @ vertex_faces
        @ face_points
        + sp.diags_array(0.5 * (1 - inside)) @ identity
        + sp.diags_array(0.25 * (1 - inside)) @ border_touching @ midpoints
    )
    attributes = sp.vstack([vertex_points, edge_points, face_points]) @ mesh.attributes
    side = num_vertices + edge_of_side.reshape(num_faces, 4)
    centre = num_vertices + num_edges + np.arange(num_faces)
    faces = np.stack(
        [np.stack([quads[:, k], side[:, k], centre, side[:, k - 1]], axis=1) for k in range(4)]
    ).reshape(-1, 4)
    regions = np.concatenate([mesh.regions, mesh.regions[pairs[:, 0]], mesh.regions[quads[:, 0]]])
    return Mesh(faces, attributes, regions)


def _matrix(
    rows: Int[np.ndarray, " N"], columns: Int[np.ndarray, " N"], value: float, num_columns: int
) -> sp.csr_array:
    return sp.csr_array(
        (np.full(len(rows), value), (rows, columns)), shape=(rows.max() + 1, num_columns)
    )


def cut_along_field(
    mesh: Mesh,
    field: Field,
    within: Callable[[Float[np.ndarray, "N 3"]], Bool[np.ndarray, " N"]] | None = None,
) -> Mesh:
    """Cut a mesh along the curve where ``field`` of the position is zero.

    Args:
        mesh: triangles or quads; the result has triangles.
        field: should be close to linear along an edge, or the curve is ragged.
        within: region of edge midpoints outside which edges are not cut.
    """
    mesh = mesh.triangles()
    attributes, values = mesh.attributes.copy(), field(mesh.positions)
    pairs = np.unique(np.sort(edges(mesh.faces), axis=1), axis=0)
    crossing = values[pairs[:, 0]] * values[pairs[:, 1]] < 0
    if within is not None:
        crossing &= within(mesh.positions[pairs].mean(1))
    for a, b in pairs[crossing]:
        if values[a] * values[b] >= 0:
            continue  # an end has been moved onto the curve by an earlier edge
        share = values[a] / (values[a] - values[b])
        if share < SNAP_SHARE or share > 1 - SNAP_SHARE:
            near = a if share < SNAP_SHARE else b
            attributes[near] = (1 - share) * attributes[a] + share * attributes[b]
            values[near] = 0.0
    pairs = pairs[crossing]
    pairs = pairs[values[pairs[:, 0]] * values[pairs[:, 1]] < 0]
    share = (values[pairs[:, 0]] / (values[pairs[:, 0]] - values[pairs[:, 1]]))[:, None]
    points = (1 - share) * attributes[pairs[:, 0]] + share * attributes[pairs[:, 1]]
    point_on = {(int(a), int(b)): mesh.num_vertices + k for k, (a, b) in enumerate(pairs)}
    faces: list[list[int]] = []
    for face in mesh.faces.tolist():
        polygon: list[int] = []
        for a, b in zip(face, face[1:] + face[:1], strict=True):
            polygon.append(a)
            point = point_on.get((min(a, b), max(a, b)))
            if point is not None:
                polygon.append(point)
        faces += _triangles_of(polygon, mesh.num_vertices)
    return Mesh(
        np.array(faces, np.int64),
        np.concatenate([attributes, points]),
        np.concatenate([mesh.regions, mesh.regions[pairs[:, 0]]]),
    )


def _triangles_of(polygon: list[int], first_new: int) -> list[list[int]]:
    """Triangulate a face with up to two new vertices on its sides, with a cut between them."""
    new = [k for k, vertex in enumerate(polygon) if vertex >= first_new]
    if not new:
        return [polygon]
    polygon = polygon[new[0] :] + polygon[: new[0]]
    pieces = [polygon]
    if len(new) == 2:
        middle = new[1] - new[0]
        pieces = [polygon[: middle + 1], [polygon[0], *polygon[middle:]]]
    return [[part[0], part[k], part[k + 1]] for part in pieces for k in range(1, len(part) - 1)]


def paint(mesh: Mesh, face_regions: Int[np.ndarray, " F"]) -> Mesh:
    """Assign each face a region; regions share no vertex, so their borders are sharp."""
    return merge_meshes(
        [mesh.faces_only(face_regions == r).painted(int(r)) for r in np.unique(face_regions)]
    )


def centres(mesh: Mesh) -> Float[np.ndarray, "F 3"]:
    return mesh.positions[mesh.faces].mean(1)


def smooth(mesh: Mesh, rounds: int, movable: Bool[np.ndarray, " V"]) -> Mesh:
    """Move vertices half way to the mean of their neighbours, ``rounds`` times."""
    movable = movable.copy()
    movable[border_edges(mesh.faces)] = False
    for _ in range(rounds):
        step = 0.5 * movable[:, None] * towards_neighbours(mesh)
        mesh = mesh.with_positions(mesh.positions + step)
    return mesh


def smooth_weights(mesh: Mesh, rounds: int) -> Mesh:
    """Spread skinning weights over neighbours, so that a joint bends over a longer stretch."""
    mean, attributes = _mean_of_neighbours(mesh), mesh.attributes.copy()
    weights = attributes[:, 3 : 3 + NUM_JOINTS]
    for _ in range(rounds):
        weights += 0.5 * (mean @ weights - weights)
    return replace(mesh, attributes=attributes)


def towards_neighbours(mesh: Mesh) -> Float[np.ndarray, "V 3"]:
    """Return the vector from each vertex to the mean of its neighbours."""
    return _mean_of_neighbours(mesh) @ mesh.positions - mesh.positions


def _mean_of_neighbours(mesh: Mesh) -> sp.csr_array:
    pairs = np.unique(np.sort(edges(mesh.faces), axis=1), axis=0)
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    links = sp.csr_array(
        (np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(mesh.num_vertices,) * 2
    )
    return sp.csr_array(sp.diags_array(1 / np.maximum(links.sum(1), 1)) @ links)


def fold_border(
    mesh: Mesh, on_border: Bool[np.ndarray, " V"], inward: Float[np.ndarray, "V 3"]
) -> Mesh:
    """Make a hem: faces from the marked border to its copy moved ``inward``, sharp in shading."""
    mesh = mesh.triangles()
    border = border_edges(mesh.faces)
    border = border[on_border[border].all(1)]
    ring, index = np.unique(border, return_inverse=True)
    index = index.reshape(-1, 2)
    a, b = index[:, 0], index[:, 1]
    a_in, b_in = a + len(ring), b + len(ring)
    attributes = np.concatenate([mesh.attributes[ring], mesh.attributes[ring]])
    attributes[len(ring) :, :3] += inward[ring]
    faces = np.concatenate([np.stack([b, a, a_in], 1), np.stack([b, a_in, b_in], 1)])
    return merge_meshes([mesh, Mesh(faces, attributes, np.tile(mesh.regions[ring], 2))])
