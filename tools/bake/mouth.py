"""The mouth: where the lips run on MakeHuman's base mesh, lips that close, and teeth."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from jaxtyping import Bool, Float, Int
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
"""How far from the line the lips follow when it is drawn shut."""
LIP_RINGS = 6
"""Rings of faces from the line where the lips meet to their outer edge."""

# A dental arch, half a superellipse seen from above; small enough to stay behind the lips.
ARCH_HALF_WIDTH_M = 0.0195
ARCH_LENGTH_M = 0.013
ARCH_EXPONENT = 2.6
ARCH_BEHIND_LIPS_M = {"upper": 0.009, "lower": 0.0115}
TOOTH_EDGE_M = {"upper": -0.0014, "lower": -0.0020}
"""Height of the edge of a row above the line where the lips meet."""
TOOTH_HEIGHT_M = 0.0085
TOOTH_DEPTH_M = 0.005
ARCH_STEPS = 24


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


def with_closed_lips(positions: Points, ring: list[int], quads: Int[np.ndarray, "Q 4"]) -> Points:
    """Base-mesh positions with the ring where the lips meet drawn shut, and the lips after it.

    Args:
        positions: of the base mesh, metres, zero pose.
        ring: as from ``lip_line``.
        quads: of the body, whose vertices may move.
    """
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
    carried = np.empty((len(positions), old.carried.shape[1]))
    carried[:, :3] = positions
    carried[:, 3 : 3 + NUM_JOINTS] = 0
    carried[:, 3 + JOINT_INDEX["head" if row == "upper" else "jaw"]] = 1
    # Teeth are stiff: the offsets of the old row are followed as far as they are affine.
    old_affine, affine = (np.c_[p - mouth, np.ones(len(p))] for p in (old.positions, positions))
    offsets = old.carried[:, 3 + NUM_JOINTS :]
    carried[:, 3 + NUM_JOINTS :] = affine @ np.linalg.lstsq(old_affine, offsets, rcond=None)[0]
    return Mesh(quads, carried, np.full(len(positions), REGION_INDEX["teeth"]))


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
