"""The head: skin, hair, brows and lips painted on it, mouth and teeth, and the eyeballs."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import PchipInterpolator
from scipy.spatial import KDTree

from renderer.bake import geometry
from renderer.bake.geometry import Mesh
from renderer.look import REGION_INDEX
from renderer.smplx_joints import JOINT_INDEX, NUM_JOINTS

Points = Float[np.ndarray, "N 3"]
Heights = Float[np.ndarray, " N"]

# Base-mesh vertices: an edge of the closed ring where the lips meet, and one deep in the mouth.
LIP_RING_EDGE = (537, 538)
MOUTH_VERTEX = 680
LIP_RINGS = 6
"""Rings of faces from the line where the lips meet to their outer edge."""

# Hairline: height above the eyes for each distance behind the eyes, front to nape; metres.
HAIRLINE = (
    (-0.06, 0.068),
    (0.0, 0.061),
    (0.025, 0.048),
    (0.045, 0.030),
    (0.060, 0.018),
    (0.080, 0.014),
    (0.100, 0.008),
    (0.114, -0.012),
    (0.126, -0.040),
    (0.145, -0.060),
    (0.20, -0.068),
)
HAIR_THICKNESS_M = 0.009
HAIR_RAMP_M = 0.03

# Brow: height above the eyes and half thickness for each distance from the middle; metres.
BROW = (
    (0.010, 0.0215, 0.0018),
    (0.022, 0.0245, 0.0028),
    (0.036, 0.0275, 0.0022),
    (0.050, 0.0225, 0.0008),
)

# A dental arch, half a superellipse seen from above; small enough to stay behind the lips.
ARCH_HALF_WIDTH_M = 0.0225
ARCH_LENGTH_M = 0.018
ARCH_EXPONENT = 2.6
ARCH_BEHIND_LIPS_M = 0.0105
TOOTH_HEIGHT_M = 0.0085
TOOTH_DEPTH_M = 0.005
BITE_GAP_M = 0.0006
ARCH_STEPS = 24

# Rings of an eyeball, degrees from the gaze axis, and where its colours end.
EYE_RINGS_DEG = (0, 5, 9, 11, 12, 14, 18, 22, 26, 28, 29.5, 32, 36, 42, 50, 60, 72, 90, 120, 180)
EYE_SECTORS = 24
PUPIL_END_DEG, IRIS_END_DEG, IRIS_RIM_END_DEG = 11.5, 27.0, 29.0
CORNEA_BULGE = 0.035


def lip_line(quads: Int[np.ndarray, "Q 4"]) -> list[int]:
    """Base-mesh vertices of the closed ring where the lips meet."""
    return _edge_loop(quads, LIP_RING_EDGE)


def mouth_and_lips(
    quads: Int[np.ndarray, "Q 4"],
) -> tuple[Bool[np.ndarray, " Q"], Bool[np.ndarray, " Q"]]:
    """Which faces of the base mesh line the mouth, and which are the lips."""
    ring = set(lip_line(quads))
    neighbours: dict[int, set[int]] = defaultdict(set)
    for a, b in geometry.edges(quads).tolist():
        neighbours[a].add(b)
        neighbours[b].add(a)

    def grow(start: set[int], stop: set[int], rounds: int) -> set[int]:
        grown, front = set(start), set(start)
        for _ in range(rounds):
            front = {n for v in front for n in neighbours[v]} - grown - stop
            if not front:
                break
            grown |= front
        return grown

    inside = grow({MOUTH_VERTEX}, ring, len(quads))
    lips = grow(ring, inside, LIP_RINGS)
    is_inside = np.isin(quads, list(inside | ring)).all(axis=1)
    is_lips = np.isin(quads, list(lips)).all(axis=1) & ~is_inside
    return np.asarray(is_inside), np.asarray(is_lips)


def _edge_loop(quads: Int[np.ndarray, "Q 4"], start: tuple[int, int]) -> list[int]:
    """The closed loop of edges that goes straight on at each vertex, from one edge of it."""
    faces_at: dict[int, list[list[int]]] = defaultdict(list)
    for quad in quads.tolist():
        for corner in quad:
            faces_at[corner].append(quad)
    loop = list(start)
    while loop[-1] != loop[0]:
        before, here = loop[-2:]
        beside = {v for quad in faces_at[here] if before in quad for v in quad}
        onward = {v for a, v in _edges_at(faces_at[here], here)} - beside
        loop.append(onward.pop())
    return loop[:-1]


def _edges_at(quads: list[list[int]], vertex: int) -> list[tuple[int, int]]:
    found = []
    for quad in quads:
        k = quad.index(vertex)
        found += [(vertex, quad[k - 1]), (vertex, quad[(k + 1) % 4])]
    return found


class FacePaint:
    """Curves on the head for hair and brows, placed by the eye joints (metres, zero pose)."""

    def __init__(self, joints: Float[np.ndarray, "J 3"]) -> None:
        self.eyes = joints[[JOINT_INDEX["left_eye"], JOINT_INDEX["right_eye"]]].mean(0)
        self._hairline = PchipInterpolator(*np.array(HAIRLINE).T)
        distance, height, half = np.array(BROW).T
        self._brow_height = PchipInterpolator(distance, height)
        self._brow_half = PchipInterpolator(distance, half)

    def above_hairline(self, points: Points) -> Heights:
        behind = np.clip(self.eyes[2] - points[:, 2], HAIRLINE[0][0], HAIRLINE[-1][0])
        return points[:, 1] - self.eyes[1] - self._hairline(behind)

    def in_front(self, points: Points) -> Bool[np.ndarray, " N"]:
        """Around the brows."""
        x, y, z = (points - self.eyes).T
        return (np.abs(x) < 0.06) & (y > 0.005) & (y < 0.045) & (z > -0.02)

    def brow_fields(self) -> tuple[geometry.Field, ...]:
        """Fields that are all positive on the brows only."""
        start, end = BROW[0][0], BROW[-1][0]

        def sideways(points: Points) -> Heights:
            return np.clip(np.abs(points[:, 0]), start, end)

        def height(points: Points) -> Heights:
            return points[:, 1] - self.eyes[1] - self._brow_height(sideways(points))

        return (
            lambda points: self._brow_half(sideways(points)) - height(points),
            lambda points: self._brow_half(sideways(points)) + height(points),
            lambda points: np.abs(points[:, 0]) - start,
            lambda points: end - np.abs(points[:, 0]),
        )


def make_head(skin: Mesh, quads: Int[np.ndarray, "Q 4"], paint: FacePaint) -> Mesh:
    """Mouth, lips, brows and hair on the bare head.

    Args:
        skin: the head in quads.
        quads: the same quads in the vertex numbers of the base mesh.
        paint: where the curves run.
    """
    inside, lips = mouth_and_lips(quads)
    regions = np.full(len(quads), REGION_INDEX["skin"])
    regions[inside], regions[lips] = REGION_INDEX["mouth"], REGION_INDEX["lips"]
    head = geometry.paint(skin.triangles(), np.tile(regions, 2))

    for field in paint.brow_fields():
        head = geometry.cut(head, field, within=paint.in_front)
    head = geometry.cut(head, paint.above_hairline)
    regions = head.regions[head.faces[:, 0]].copy()
    middle = geometry.centres(head)
    brows = np.all([field(middle) > 0 for field in paint.brow_fields()], axis=0)
    is_skin = regions == REGION_INDEX["skin"]
    regions[is_skin & brows & paint.in_front(middle)] = REGION_INDEX["brows"]
    hair = is_skin & (paint.above_hairline(middle) > 0)
    regions[hair] = REGION_INDEX["hair"]
    return _raise_hair(geometry.paint(head, regions))


def _raise_hair(head: Mesh) -> Mesh:
    """Give the hair its thickness, growing from nothing at the hairline."""
    hair = head.regions == REGION_INDEX["hair"]
    faces = head.faces[hair[head.faces].all(1)]
    hairline = head.positions[np.unique(geometry.border_edges(faces))]
    distance, _ = KDTree(hairline).query(head.positions[hair])
    share = np.clip(distance / HAIR_RAMP_M, 0, 1)
    thickness = np.zeros(head.num_vertices)
    thickness[hair] = HAIR_THICKNESS_M * share * (2 - share)
    return head.moved(head.positions + thickness[:, None] * geometry.normals(head))


def eyeball(side: str, old: Points, num_expressions: int) -> Mesh:
    """A round eye in place of the old one, gaze along +z, iris and pupil as rings."""
    back = old[:, 2] < np.percentile(old[:, 2], 75)
    system = np.c_[2 * old[back], np.ones(back.sum())]
    solution = np.linalg.lstsq(system, (old[back] ** 2).sum(1), rcond=None)[0]
    centre, radius = solution[:3], np.sqrt(solution[3] + solution[:3] @ solution[:3])
    polar = np.radians(EYE_RINGS_DEG)
    around = np.arange(EYE_SECTORS) * 2 * np.pi / EYE_SECTORS
    polar, around = (grid.ravel() for grid in np.meshgrid(polar, around, indexing="ij"))
    bulge = radius * (1 + CORNEA_BULGE * np.exp(-((polar / np.radians(24)) ** 4)))
    directions = np.stack(
        [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=1
    )
    carried = np.zeros((len(polar), 3 + NUM_JOINTS + 3 * num_expressions))
    carried[:, :3] = centre + bulge[:, None] * directions
    carried[:, 3 + JOINT_INDEX[f"{side}_eye"]] = 1
    degrees = np.degrees(polar)
    ends = (PUPIL_END_DEG, IRIS_END_DEG, IRIS_RIM_END_DEG)
    names = ("pupil", "iris", "iris_rim", "eye_white")
    regions = np.array([REGION_INDEX[name] for name in names])[np.searchsorted(ends, degrees)]
    grid = np.arange(len(polar)).reshape(len(EYE_RINGS_DEG), EYE_SECTORS)
    a, b = grid[:-1], grid[1:]
    quads = np.stack([a, b, np.roll(b, -1, 1), np.roll(a, -1, 1)], axis=-1).reshape(-1, 4)
    triangles = Mesh(quads, carried, regions).triangles()
    # The poles are rings of equal points: their faces without area go.
    a, b, c = (triangles.positions[triangles.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return triangles.faces_only(area > 1e-12)


def make_teeth(row: str, old: Mesh, mouth: Float[np.ndarray, " 3"]) -> Mesh:
    """A smooth dental arch that moves like the row of teeth it replaces.

    Args:
        row: ``upper`` or ``lower``.
        old: MakeHuman's row of teeth, which pokes through the lips.
        mouth: middle of the line where the lips meet.
    """
    sign = 1.0 if row == "upper" else -1.0
    turn = np.linspace(-0.5 * np.pi, 0.5 * np.pi, ARCH_STEPS)
    # Profile of the row, from the gum in front over the edge to the gum behind.
    inset = TOOTH_DEPTH_M * np.array([0.0, 0.1, 0.5, 1.0])
    height = TOOTH_HEIGHT_M * np.array([1.0, 0.1, 0.0, 1.0]) + BITE_GAP_M
    across = np.sign(turn) * np.abs(np.sin(turn)) ** (2 / ARCH_EXPONENT)
    forward = np.abs(np.cos(turn)) ** (2 / ARCH_EXPONENT)
    x = (ARCH_HALF_WIDTH_M - inset[:, None]) * across
    z = (ARCH_LENGTH_M - inset[:, None]) * forward - ARCH_LENGTH_M - ARCH_BEHIND_LIPS_M
    y = np.broadcast_to(sign * height[:, None], x.shape)
    positions = mouth + np.stack([x, y, z], axis=-1).reshape(-1, 3)
    grid = np.arange(len(positions)).reshape(x.shape)
    a, b = grid[:-1], grid[1:]
    quads = np.stack([a[:, :-1], b[:, :-1], b[:, 1:], a[:, 1:]], axis=-1).reshape(-1, 4)
    if row == "lower":
        quads = quads[:, ::-1]
    distance, nearest = KDTree(old.positions).query(positions, k=4)
    share = 1 / (distance + 1e-4)
    carried = np.einsum("vk,vkc->vc", share / share.sum(1, keepdims=True), old.carried[nearest])
    carried[:, :3] = positions
    return Mesh(quads, carried, np.full(len(positions), REGION_INDEX["teeth"]))
