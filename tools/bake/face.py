"""Head of the open body: painted skin, brows and lips, hair, eyeballs, closing lips, and teeth."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import PchipInterpolator
from scipy.spatial import KDTree

from conventions.joints import JOINT_INDEX, NUM_JOINTS
from renderer.body.look import REGION_INDEX
from tools.bake import geometry
from tools.bake.geometry import Mesh

Points = Float[np.ndarray, "N 3"]

# Base-mesh vertices: an edge of the closed ring where the lips meet, and one deep in the mouth.
LIP_RING_EDGE = (537, 538)
MOUTH_VERTEX = 680
LIP_REACH_M = 0.009
"""Distance (m) from the lip line over which the lips follow when it is closed."""
LIP_RINGS = 6
"""Number of face rings from the lip line to the outer edge of the lips."""

# A dental arch, half a superellipse from above; small enough to stay behind the lips.
ARCH_HALF_WIDTH_M = 0.0195
ARCH_LENGTH_M = 0.013
ARCH_EXPONENT = 2.6
ARCH_BEHIND_LIPS_M = {"upper": 0.009, "lower": 0.0115}
TOOTH_EDGE_M = {"upper": -0.0014, "lower": -0.0020}
"""Height (m) of the edge of each row of teeth above the lip line."""
TOOTH_HEIGHT_M = 0.0085
TOOTH_DEPTH_M = 0.005
ARCH_STEPS = 24


def lip_line(quads: Int[np.ndarray, "Q 4"]) -> list[int]:
    """Return the base-mesh vertices of the closed ring where the lips meet."""
    return _edge_loop(quads, LIP_RING_EDGE)


def mouth_and_lips(
    quads: Int[np.ndarray, "Q 4"],
) -> tuple[Bool[np.ndarray, " Q"], Bool[np.ndarray, " Q"]]:
    """Return masks of the base mesh's faces inside the mouth and on the lips."""
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


def with_closed_lips(positions: Points, ring: list[int], quads: Int[np.ndarray, "Q 4"]) -> Points:
    """Return base-mesh positions with the mouth closed at the lip line."""
    x, y = positions[ring, 0], positions[ring, 1]
    corners = np.argmin(x), np.argmax(x)
    first, second = sorted(corners)
    halves = [np.arange(first, second + 1), np.r_[second : len(ring), : first + 1]]
    halves = [half[np.argsort(x[half], kind="stable")] for half in halves]
    heights = [np.interp(x, x[half], y[half]) for half in halves]
    to_middle = 0.5 * (heights[0] + heights[1]) - y
    body = np.unique(quads)
    distance, nearest = KDTree(positions[ring]).query(positions[body])
    near = np.clip(1 - distance / LIP_REACH_M, 0, 1)
    closed = positions.copy()
    closed[body, 1] += near**2 * (3 - 2 * near) * to_middle[nearest]
    return closed


def make_teeth(row: str, old: Mesh, mouth: Float[np.ndarray, " 3"]) -> Mesh:
    """Make a smooth dental arch that moves like the row of teeth it replaces.

    The row is ``upper`` or ``lower``; the old one is MakeHuman's, which pokes through the lips;
    ``mouth`` is the middle of the lip line.
    """
    sign = 1.0 if row == "upper" else -1.0
    turn = np.linspace(-0.5 * np.pi, 0.5 * np.pi, ARCH_STEPS)
    # Profile of the row, from the gum in front over the edge to the gum behind.
    inset = TOOTH_DEPTH_M * np.array([0.0, 0.1, 0.5, 1.0])
    height = TOOTH_EDGE_M[row] + sign * TOOTH_HEIGHT_M * np.array([1.0, 0.1, 0.0, 1.0])
    across = np.sign(turn) * np.abs(np.sin(turn)) ** (2 / ARCH_EXPONENT)
    forward = np.abs(np.cos(turn)) ** (2 / ARCH_EXPONENT)
    x = (ARCH_HALF_WIDTH_M - inset[:, None]) * across
    z = (ARCH_LENGTH_M - inset[:, None]) * forward - ARCH_LENGTH_M - ARCH_BEHIND_LIPS_M[row]
    y = np.broadcast_to(height[:, None], x.shape)
    positions = mouth + np.stack([x, y, z], axis=-1).reshape(-1, 3)
    grid = np.arange(len(positions)).reshape(x.shape)
    a, b = grid[:-1], grid[1:]
    quads = np.stack([a[:, :-1], b[:, :-1], b[:, 1:], a[:, 1:]], axis=-1).reshape(-1, 4)
    if row == "lower":
        quads = quads[:, ::-1]
    attributes = np.empty((len(positions), old.attributes.shape[1]))
    attributes[:, :3] = positions
    attributes[:, 3 : 3 + NUM_JOINTS] = 0
    attributes[:, 3 + JOINT_INDEX["head" if row == "upper" else "jaw"]] = 1
    # Teeth are rigid: they follow the affine part of the old row's offsets.
    old_affine, affine = (np.c_[p - mouth, np.ones(len(p))] for p in (old.positions, positions))
    offsets = old.attributes[:, 3 + NUM_JOINTS :]
    attributes[:, 3 + NUM_JOINTS :] = affine @ np.linalg.lstsq(old_affine, offsets, rcond=None)[0]
    return Mesh(quads, attributes, np.full(len(positions), REGION_INDEX["teeth"]))


def _edge_loop(quads: Int[np.ndarray, "Q 4"], start: tuple[int, int]) -> list[int]:
    """Return the closed edge loop through ``start`` that continues straight at each vertex."""
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
    edges = []
    for quad in quads:
        k = quad.index(vertex)
        edges += [(vertex, quad[k - 1]), (vertex, quad[(k + 1) % 4])]
    return edges


Heights = Float[np.ndarray, " N"]

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
HAIR_THICKNESS_M = 0.011
HAIR_EDGE_M = 0.0025
"""Thickness (m) at the hairline, enough to cover the skin, which is the coarser mesh."""
HAIR_RAMP_M = 0.03
HAIR_HEM_M = 0.006
SCALP_MARGIN_M = 0.035
"""Width (m) of the skin below the hairline that is copied with the scalp."""
SKIN_UNDER_HAIR_M = 0.015

# Brow: height above the eyes and half thickness for each distance from the middle; metres.
BROW = (
    (0.010, 0.0215, 0.0018),
    (0.022, 0.0245, 0.0028),
    (0.036, 0.0275, 0.0022),
    (0.050, 0.0225, 0.0008),
)

# Rings of an eyeball, degrees from the gaze axis, and where its colours end.
EYE_RINGS_DEG = (0, 5, 9, 11, 12, 14, 18, 22, 26, 28, 29.5, 32, 36, 42, 50, 60, 72, 90, 120, 180)
EYE_SECTORS = 24
PUPIL_END_DEG, IRIS_END_DEG, IRIS_RIM_END_DEG = 11.5, 27.0, 29.0
CORNEA_BULGE = 0.035


class FacePaint:
    """Hairline and brow curves on the head, placed by the eye joints (metres, zero pose)."""

    def __init__(self, joints: Float[np.ndarray, "J 3"]) -> None:
        self.eyes = joints[[JOINT_INDEX["left_eye"], JOINT_INDEX["right_eye"]]].mean(0)
        self._hairline = PchipInterpolator(*np.array(HAIRLINE).T)
        distance, height, half = np.array(BROW).T
        self._brow_height = PchipInterpolator(distance, height)
        self._brow_half = PchipInterpolator(distance, half)

    def above_hairline(self, points: Points) -> Heights:
        behind = np.clip(self.eyes[2] - points[:, 2], HAIRLINE[0][0], HAIRLINE[-1][0])
        return points[:, 1] - self.eyes[1] - self._hairline(behind)

    def near_brows(self, points: Points) -> Bool[np.ndarray, " N"]:
        """Return a mask of points around the brows."""
        x, y, z = (points - self.eyes).T
        return (np.abs(x) < 0.06) & (y > 0.005) & (y < 0.045) & (z > -0.02)

    def brow_fields(self) -> tuple[geometry.Field, ...]:
        """Return fields that are all positive only on the brows."""
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
    """Add mouth, lips, brows and hair to the bare head; ``paint`` has hairline and brow curves."""
    inside, lips = mouth_and_lips(quads)
    regions = np.full(len(quads), REGION_INDEX["skin"])
    regions[inside], regions[lips] = REGION_INDEX["mouth"], REGION_INDEX["lips"]
    head = geometry.paint(skin.triangles(), np.tile(regions, 2))

    for field in paint.brow_fields():
        head = geometry.cut_along_field(head, field, within=paint.near_brows)
    regions = head.regions[head.faces[:, 0]].copy()
    middle = geometry.centres(head)
    brows = np.all([field(middle) > 0 for field in paint.brow_fields()], axis=0)
    is_skin = regions == REGION_INDEX["skin"]
    regions[is_skin & brows & paint.near_brows(middle)] = REGION_INDEX["brows"]
    bare = paint.above_hairline(middle) < SKIN_UNDER_HAIR_M
    painted = geometry.paint(head.faces_only(bare), regions[bare])
    return geometry.merge_meshes([painted, _hair(skin, paint)])


def _hair(skin: Mesh, paint: FacePaint) -> Mesh:
    """Make hair as a cap on the scalp, finer than the skin so that its outline is round."""
    on_scalp = paint.above_hairline(skin.positions) > -SCALP_MARGIN_M
    scalp = geometry.subdivide_catmull_clark(
        skin.faces_only(np.asarray(on_scalp[skin.faces].all(axis=1)))
    )
    hair = geometry.cut_along_field(scalp, paint.above_hairline)
    hair = hair.faces_only(paint.above_hairline(geometry.centres(hair)) > 0)
    hairline = np.unique(geometry.border_edges(hair.faces))
    distance, _ = KDTree(hair.positions[hairline]).query(hair.positions)
    share = np.clip(distance / HAIR_RAMP_M, 0, 1)
    thickness = HAIR_EDGE_M + (HAIR_THICKNESS_M - HAIR_EDGE_M) * share * (2 - share)
    hair = hair.with_positions(hair.positions + thickness[:, None] * geometry.normals(hair))
    on_border = np.isin(np.arange(hair.num_vertices), hairline)
    hair = geometry.fold_border(hair, on_border, -HAIR_HEM_M * geometry.normals(hair))
    return hair.painted(REGION_INDEX["hair"])


def eyeball(side: str, old: Mesh, num_expressions: int) -> Mesh:
    """Make a round eyeball in place of ``old``, with gaze along +z, iris and pupil as rings."""
    centre, radius = _sphere(old.positions)
    polar = np.radians(EYE_RINGS_DEG)
    around = np.arange(EYE_SECTORS) * 2 * np.pi / EYE_SECTORS
    polar, around = (grid.ravel() for grid in np.meshgrid(polar, around, indexing="ij"))
    bulge = radius * (1 + CORNEA_BULGE * np.exp(-((polar / np.radians(24)) ** 4)))
    directions = np.stack(
        [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=1
    )
    attributes = np.zeros((len(polar), old.attributes.shape[1]))
    attributes[:, :3] = centre + bulge[:, None] * directions
    attributes[:, 3 + JOINT_INDEX[f"{side}_eye"]] = 1
    # No expression moves an eyeball, but its size differs between builds.
    builds = old.offsets[:, num_expressions:].transpose(1, 0, 2)
    offsets = np.zeros((len(polar), old.offsets.shape[1], 3))
    for index, offset in enumerate(builds, start=num_expressions):
        new_centre, new_radius = _sphere(old.positions + offset)
        grown = (new_radius / radius - 1) * bulge[:, None] * directions
        offsets[:, index] = new_centre - centre + grown
    attributes[:, 3 + NUM_JOINTS :] = offsets.reshape(len(polar), -1)
    degrees = np.degrees(polar)
    ends = (PUPIL_END_DEG, IRIS_END_DEG, IRIS_RIM_END_DEG)
    names = ("pupil", "iris", "iris_rim", "eye_white")
    regions = np.array([REGION_INDEX[name] for name in names])[np.searchsorted(ends, degrees)]
    grid = np.arange(len(polar)).reshape(len(EYE_RINGS_DEG), EYE_SECTORS)
    a, b = grid[:-1], grid[1:]
    quads = np.stack([a, b, np.roll(b, -1, 1), np.roll(a, -1, 1)], axis=-1).reshape(-1, 4)
    triangles = Mesh(quads, attributes, regions).triangles()
    # The poles are rings of equal points: their faces have no area and are removed.
    a, b, c = (triangles.positions[triangles.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return triangles.faces_only(area > 1e-12)


def _sphere(points: Points) -> tuple[Float[np.ndarray, " 3"], float]:
    """Return centre and radius of the sphere fitted to the back of an eye."""
    back = points[points[:, 2] < np.percentile(points[:, 2], 75)]
    system = np.c_[2 * back, np.ones(len(back))]
    solution = np.linalg.lstsq(system, (back**2).sum(1), rcond=None)[0]
    centre = solution[:3]
    return centre, float(np.sqrt(solution[3] + centre @ centre))
