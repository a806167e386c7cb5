"""Decimation of body meshes, for small pictures and for browsers without a GPU.

Vertices are removed one by one, where that changes the surface least (quadric error metrics,
Garland and Heckbert 1997); the others keep their positions, so that a coarser mesh is only other
faces among the same vertices, with the same weights, colours and expressions.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from conventions.joints import FINGERS, JOINT_INDEX, JOINT_NAMES
from renderer.body.body import Body

NUM_FACES = (26_000, 17_000, 12_000, 5_500, 2_800, 900)
"""Number of faces of each mesh, from fine to coarse."""
_HANDS, _HEAD, _FACE, _EYES = 6.0, 3.0, 12.0, 60.0
"""Weight of changes there relative to the rest of the body; the face is what its units move."""
_EYE_M = 0.022
"""Largest distance (m) of eyelids from the centre of an eye."""
_HEM_WEIGHT = 20.0
"""Weight of the outline of an open end relative to its surface."""
_SKIN_M = 0.03
"""Distance (m) that counts for a move to a vertex with entirely different skinning weights."""
_FACE_MOVES_M = 0.0015
"""Smallest expression offset (m) of vertices that count as the face."""
_LEAST_TURN = 0.35
"""Smallest cosine of the angle by which a face may turn."""


@dataclass
class Surface:
    """Attributes of a body by which vertices are chosen for removal."""

    vertices: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]
    colors: Float[np.ndarray, "V 3"]
    weights: Float[np.ndarray, "V J"]
    """Skinning weights of each vertex."""
    importance: Float[np.ndarray, " V"]


def body_surface(body: Body) -> Surface:
    """Return the surface of a body, in which hands, head, face and eyes are most important."""
    weights = body.weights.toarray().astype(np.float64)
    of_joint = np.ones(len(JOINT_NAMES))
    for joint, name in enumerate(JOINT_NAMES):
        if any(part in name for part in ("wrist", *FINGERS)):
            of_joint[joint] = _HANDS
        elif any(part in name for part in ("head", "jaw", "eye")):
            of_joint[joint] = _HEAD
    importance = of_joint[weights.argmax(1)]
    moves = np.abs(body.expression_dirs).max((0, 2)) > _FACE_MOVES_M
    importance[body.expression_vertices[moves]] = _FACE
    for side in ("left", "right"):
        to_eye = body.template - body.rest_joints[JOINT_INDEX[f"{side}_eye"]]
        importance[np.linalg.norm(to_eye, axis=1) < _EYE_M] = _EYES
    colors = np.asarray(body.vertex_colors, np.float64)
    return Surface(body.template.astype(np.float64), body.faces, colors, weights, importance)


def decimate(
    surface: Surface, face_counts: Sequence[int] = NUM_FACES
) -> list[Int[np.ndarray, "_ 3"]]:
    """Return the faces of coarser meshes with at most these decreasing numbers of faces."""
    collapse = _EdgeCollapse(surface)
    meshes = []
    for count in face_counts:
        collapse.reduce_to(count)
        meshes.append(np.array([face for face in collapse.faces if face], dtype=np.int64))
    return meshes


class _EdgeCollapse:
    """Mesh decimation by edge collapses, each moving a vertex onto a neighbour."""

    def __init__(self, surface: Surface) -> None:
        self.faces: list[tuple[int, int, int] | None] = [tuple(f) for f in surface.faces.tolist()]
        self._left = len(self.faces)
        self._places = surface.vertices
        self._weights = surface.weights
        self._colors = [tuple(color) for color in np.round(surface.colors, 3).tolist()]
        self._around: list[set[int]] = [set() for _ in surface.vertices]
        for number, face in enumerate(surface.faces.tolist()):
            for vertex in face:
                self._around[vertex].add(number)
        self._quadrics, self._areas = self._planes(surface)
        self._ages = [0] * len(surface.vertices)
        self._queue: list[tuple[float, int, int, int]] = []
        for vertex in range(len(surface.vertices)):
            self._ask(vertex)

    def reduce_to(self, count: int) -> None:
        """Remove vertices until at most ``count`` faces are left, or none can be removed."""
        while self._left > count and self._queue:
            _, vertex, onto, age = heapq.heappop(self._queue)
            if self._ages[vertex] != age:
                continue
            changed = self._neighbours(vertex) | {vertex}
            self._move(vertex, onto)
            for each in changed:
                self._ages[each] += 1
                self._ask(each)

    def _planes(self, surface: Surface) -> tuple[np.ndarray, np.ndarray]:
        """Return the weighted error quadrics (V, 4, 4) and areas (V,) of the vertices."""
        corners = self._places[surface.faces]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        doubled = np.linalg.norm(cross, axis=1)
        normals = cross / np.maximum(doubled, 1e-12)[:, None]
        planes = np.concatenate([normals, -(normals * corners[:, 0]).sum(1, keepdims=True)], 1)
        quadrics = np.zeros((len(self._places), 4, 4))
        areas = np.zeros(len(self._places))
        for k in range(3):
            of_face = surface.importance[surface.faces[:, k]] * doubled / 6
            outer = planes[:, :, None] * planes[:, None]
            np.add.at(quadrics, surface.faces[:, k], of_face[:, None, None] * outer)
            np.add.at(areas, surface.faces[:, k], of_face)
        for number, face in enumerate(surface.faces.tolist()):
            for a, b in zip(face, (*face[1:], face[0]), strict=True):
                if len(self._around[a] & self._around[b]) > 1:
                    continue
                along = self._places[b] - self._places[a]
                wall = np.cross(along, normals[number])
                wall /= max(float(np.linalg.norm(wall)), 1e-12)
                plane = np.append(wall, -wall @ self._places[a])
                for vertex in (a, b):
                    weight = _HEM_WEIGHT * surface.importance[vertex] * (along @ along)
                    quadrics[vertex] += weight * np.outer(plane, plane)
        return quadrics, areas

    def _neighbours(self, vertex: int) -> set[int]:
        return {v for f in self._around[vertex] for v in self.faces[f] or ()} - {vertex}

    def _ask(self, vertex: int) -> None:
        """Queue the best collapse of a vertex."""
        best = min(
            ((self._cost(vertex, onto), onto) for onto in self._open_to(vertex)),
            default=(np.inf, -1),
        )
        if np.isfinite(best[0]):
            heapq.heappush(self._queue, (*best[:1], vertex, best[1], self._ages[vertex]))

    def _open_to(self, vertex: int) -> list[int]:
        """Return the neighbours that a vertex may move onto without turning a face over.

        A vertex on a hem stays on the hem, and one on the line between two colours on that line.
        """
        near = self._neighbours(vertex)
        shared = {n: self._around[vertex] & self._around[n] for n in near}
        if any(len(faces) == 1 for faces in shared.values()):
            near = {n for n in near if len(shared[n]) == 1}
        color = self._colors[vertex]
        if any(self._colors[n] != color for n in self._neighbours(vertex)):
            near = {n for n in near if self._is_between_colors(n)}
        near = {n for n in near if self._colors[n] == color}
        return [n for n in near if self._is_safe(vertex, n, shared[n])]

    def _is_between_colors(self, vertex: int) -> bool:
        return any(self._colors[n] != self._colors[vertex] for n in self._neighbours(vertex))

    def _is_safe(self, vertex: int, onto: int, gone: set[int]) -> bool:
        opposite = {v for f in gone for v in self.faces[f] or ()} - {vertex, onto}
        if self._neighbours(vertex) & self._neighbours(onto) != opposite:
            return False  # it would close a tunnel
        for number in self._around[vertex] - gone:
            face = self.faces[number]
            assert face is not None
            before = self._normal([self._places[v] for v in face])
            after = self._normal([self._places[onto if v == vertex else v] for v in face])
            size = (before @ before) * (after @ after)
            if size <= 1e-30 or before @ after < _LEAST_TURN * size**0.5:
                return False
        return True

    @staticmethod
    def _normal(corners: list[Float[np.ndarray, " 3"]]) -> np.ndarray:
        (a, b, c), (d, e, f) = corners[1] - corners[0], corners[2] - corners[0]
        return np.array([b * f - c * e, c * d - a * f, a * e - b * d])

    def _cost(self, vertex: int, onto: int) -> float:
        place = np.append(self._places[onto], 1.0)
        bent = place @ (self._quadrics[vertex] + self._quadrics[onto]) @ place
        other = self._weights[vertex] - self._weights[onto]
        return float(bent + self._areas[vertex] * _SKIN_M**2 * (other @ other))

    def _move(self, vertex: int, onto: int) -> None:
        for number in self._around[vertex]:
            face = self.faces[number]
            assert face is not None
            if onto in face:
                self.faces[number] = None
                self._left -= 1
                for v in face:
                    if v != vertex:
                        self._around[v].discard(number)
                continue
            a, b, c = (onto if v == vertex else v for v in face)
            self.faces[number] = (a, b, c)
            self._around[onto].add(number)
        self._around[vertex] = set()
        self._quadrics[onto] += self._quadrics[vertex]
        self._areas[onto] += self._areas[vertex]
